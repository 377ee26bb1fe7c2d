"""One door for everything that yields events from files."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

import numpy as np

from ..errors import FileFormatError, InputError
from ..types import STAGE, Actuation, Event, FloatArray, Frame, Image, SessionInfo, Source
from ._dicom import dicom_size, is_dicom, read_dicom
from ._folder import frames_of, read_folder
from ._images import is_image
from ._reader import RecordingReader
from ._video import read_video, video_size

__all__ = [
    "FileSource",
    "can_be_read_again",
    "frame_count",
    "open_source",
    "require_actuation",
    "spread_images",
    "steady_reading",
]


class FileSource:
    """A video, a DICOM file or a folder of images as a `Source`: may be iterated again, and reads as it is asked.

    ``frame_count``: as far as the file says, 0 where it does not.
    """

    def __init__(self, path: Path, actuation: Mapping[str, float], stated: SessionInfo) -> None:
        self.path = path
        self._folder = read_folder(path) if path.is_dir() or is_image(path) else None
        own = self._folder.actuation if self._folder else {}
        constant = {name: value for name, value in stated.actuation.constant.items() if name not in own}
        self._actuation = {**constant, **actuation}
        self._dicom = is_dicom(path)
        if self._folder:
            self.frame_count = len(self._folder.files)
        else:
            self.frame_count = dicom_size(path) if self._dicom else video_size(path)
        self.session_info = SessionInfo(path.stem).updated(stated)
        if self._folder:
            clash = set(self._folder.actuation) & set(actuation)
            if clash:
                raise InputError(f"{path}: has a column {min(clash)!r} already; do not state it a second time")

    @property
    def numbered(self) -> bool:
        """Whether the stamps only count the images, because nobody stated when they were taken."""
        return self._folder is not None and self._folder.numbered

    def lacks(self, names: Iterable[str]) -> list[str]:
        """Those of the actuation's ``names`` that never come."""
        columns = self._folder.actuation if self._folder else {}
        return [name for name in names if name not in self._actuation and name not in columns]

    def readings(self, name: str) -> FloatArray:
        """(n,) all readings of the drive ``name``."""
        columns = self._folder.actuation if self._folder else {}
        values = np.asarray(columns[name] if name in columns else self._actuation.get(name, ()), np.float64).ravel()
        return values[np.isfinite(values)]

    def __iter__(self) -> Iterator[Event]:
        if self._folder:
            frames = frames_of(self._folder, "camera")
        else:
            frames = read_dicom(self.path) if self._dicom else read_video(self.path)
        columns = self._folder.actuation if self._folder else {}
        for place, frame in enumerate(frames):
            if place == 0 and self._actuation:
                yield Actuation(frame.stamp_ns, self._actuation)
            if columns:
                here = {name: float(values[place]) for name, values in columns.items()}
                yield Actuation(frame.stamp_ns, {name: value for name, value in here.items() if value == value})
            yield frame

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing stays open between two iterations."""


def open_source(
    path: Path | str, *, actuation: Mapping[str, float] | None = None, stated: SessionInfo | None = None
) -> Source:
    """A video, DICOM file, image, folder of images or recording as a `Source`; a context manager, to iterate at will.

    ``stated``: metadata in place of those that the file holds; constant readings of drives among them are used where
    the file carries none. ``actuation``: constant readings, too.
    Raises InputError where ``actuation`` has a name that the file carries itself.
    """
    where = Path(path)
    if where.suffix in (".mcap", ".part"):
        reader = RecordingReader(where)
        constant = {} if stated is None else stated.actuation.constant
        wanted = {**constant, **(actuation or {})}
        lacking = set(_never_read(reader, wanted))
        carried = sorted(set(actuation or {}) - lacking)
        if carried:
            reader.close()
            raise InputError(f"{where}: carries {', '.join(carried)} itself; do not state it as well")
        filled = {name: value for name, value in wanted.items() if name in lacking}
        silent = not filled and stated in (None, SessionInfo())
        return reader if silent else _Stated(reader, filled, stated or SessionInfo())
    if not where.exists():
        raise FileFormatError(f"{where}: there is no such file or folder")
    return FileSource(where, actuation or {}, stated or SessionInfo())


def frame_count(source: Source, view: str = "camera") -> int:
    """How many frames of ``view`` will come, as far as the file says; 0 where it does not."""
    if isinstance(source, RecordingReader):
        stream = source.info.streams.get(view)
        return stream.count if stream else 0
    return source.frame_count if isinstance(source, _Counted) else 0


@runtime_checkable
class _Counted(Protocol):
    frame_count: int


@runtime_checkable
class _Lacking(Protocol):
    path: Path

    def lacks(self, names: Iterable[str]) -> list[str]: ...


def can_be_read_again(source: Source) -> bool:
    """Whether ``source`` is a file, which may be iterated more than once, and not a live stream."""
    return isinstance(getattr(source, "path", None), Path)


def spread_images(source: Source, view: str = "camera", count: int = 16) -> list[Image]:
    """Images from all over a file, or from its first seconds where it does not say how many there are.

    What lies beneath the catheter's tip must change between them, or it is taken for a part of it.
    """
    reader = source.reader if isinstance(source, _Stated) else source
    if isinstance(reader, RecordingReader):
        total = frame_count(reader, view)
        rows = np.unique(np.linspace(0, total - 1, min(count, total)).astype(np.int64)) if total else ()
        return [reader.frame_at(int(row), view).image for row in rows]
    total = frame_count(source, view)
    step = max(1, total // count) if total else 5
    frames = (event.image for event in source if isinstance(event, Frame) and event.view == view)
    return list(islice(frames, 0, step * count, step))


_STEADY = 0.1
"""A reading that changes by no more than this share of itself stands still, but for its noise."""


def steady_reading(source: Source, name: str) -> float | None:
    """Mean reading of the drive ``name`` where it stands still all over a file; None where it moves or is not known."""
    values = _read_of(source, name)
    if not len(values) or float(np.ptp(values)) > _STEADY * abs(float(values.mean())):
        return None
    return float(values.mean())


def any_reading(source: Source, name: str) -> bool:
    """Whether the drive ``name`` of a file is ever read to be elsewhere than at 0."""
    return bool(_read_of(source, name).any())


def _read_of(source: Source, name: str) -> FloatArray:
    if isinstance(source, FileSource | _Stated):
        return source.readings(name)
    return _readings(source, name) if isinstance(source, RecordingReader) else np.empty(0)


def require_actuation(source: Source, names: Iterable[str]) -> None:
    """Raises InputError where ``source`` can tell that one of ``names`` never comes: ask before the work.

    A live source cannot tell.
    """
    if isinstance(source, RecordingReader):
        path, lacking = source.path, _never_read(source, names)
    elif isinstance(source, _Lacking):
        path, lacking = source.path, source.lacks(names)
    else:
        return
    if lacking:
        options = (f"actuation.constant.{name}" for name in lacking)
        raise InputError(
            f"{path}: does not carry {', '.join(lacking)}, which the model needs; record it, or where it "
            f"is constant state it in bench.toml: {', '.join(options)}"
        )


def _drive_readings(reader: RecordingReader) -> Iterator[Actuation]:
    """All readings of the catheter's drives in a recording."""
    streams = [name for name, stream in reader.info.streams.items() if stream.kind == "actuation" and name != STAGE]
    return (event for event in (reader.events(*streams) if streams else ()) if isinstance(event, Actuation))


def _never_read(reader: RecordingReader, names: Iterable[str]) -> list[str]:
    """Those of ``names`` without a reading; what is there is mostly there in the first ones, so few are looked at."""
    missing = list(names)
    for event in _drive_readings(reader):
        if not missing:
            break
        missing = [name for name in missing if name not in event.values]
    return missing


def _readings(reader: RecordingReader, name: str) -> FloatArray:
    """(n,) all readings of the drive ``name`` in a recording."""
    return np.array([event.values[name] for event in _drive_readings(reader) if name in event.values])


class _Stated:
    """A recording with values or facts that a person adds."""

    def __init__(self, reader: RecordingReader, actuation: Mapping[str, float], stated: SessionInfo) -> None:
        self.reader, self._actuation = reader, dict(actuation)
        self.path, self.session_info = reader.path, reader.session_info.updated(stated)

    def lacks(self, names: Iterable[str]) -> list[str]:
        """Those of the actuation's ``names`` that never come."""
        return _never_read(self.reader, [name for name in names if name not in self._actuation])

    def readings(self, name: str) -> FloatArray:
        """(n,) all readings of the drive ``name``."""
        stated = self._actuation.get(name)
        return _readings(self.reader, name) if stated is None else np.array([stated])

    def __iter__(self) -> Iterator[Event]:
        for place, event in enumerate(self.reader):
            if place == 0 and self._actuation:
                yield Actuation(event.stamp_ns, self._actuation)
            yield event

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.reader.close()
