"""One door for everything that yields events from files."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from ..errors import FileFormatError, InputError
from ..types import Actuation, Context, Event, Source
from ._folder import frames_of, read_folder
from ._reader import RecordingReader
from ._video import read_video, video_size

__all__ = ["FileSource", "open_source"]


class FileSource:
    """A video or a folder of images as a `Source`: may be iterated again, and reads as it is asked.

    ``frame_count``: as far as the file says, 0 where it does not.
    """

    def __init__(self, path: Path, actuation: Mapping[str, float], context: Context | None) -> None:
        self._path, self._actuation = path, dict(actuation)
        self._folder = read_folder(path) if path.is_dir() else None
        self.frame_count = len(self._folder.files) if self._folder else video_size(path)
        self.context = context or Context(session=path.stem)
        if self._folder:
            clash = set(self._folder.actuation) & set(self._actuation)
            if clash:
                raise InputError(f"{path}: has a column {min(clash)!r} already; do not state it a second time")

    def __iter__(self) -> Iterator[Event]:
        frames = frames_of(self._folder, "camera") if self._folder else read_video(self._path)
        columns = self._folder.actuation if self._folder else {}
        for place, frame in enumerate(frames):
            if place == 0 and self._actuation:
                yield Actuation(frame.stamp_ns, self._actuation)
            if columns:
                yield Actuation(frame.stamp_ns, {name: float(values[place]) for name, values in columns.items()})
            yield frame

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing stays open between two iterations."""


def open_source(
    path: Path | str, *, actuation: Mapping[str, float] | None = None, context: Context | None = None
) -> Source:
    """A video, a folder of images or a recording as a `Source`; a context manager that can be iterated again.

    ``actuation``: constant values (``knob_deg``) for files that carry none. ``context``: instead of what the file
    knows; recordings carry both themselves and raise InputError where ``actuation`` is stated once more.
    """
    where = Path(path)
    if where.suffix in (".mcap", ".part"):
        reader = RecordingReader(where)
        present = {name for name, stream in reader.info.streams.items() if stream.kind == "actuation" and stream.count}
        if actuation and present:
            reader.close()
            raise InputError(f"{where}: carries its own actuation; do not state {', '.join(actuation)} as well")
        return _Stated(reader, actuation or {}, context) if actuation or context else reader
    if not where.exists():
        raise FileFormatError(f"{where}: there is no such file or folder")
    return FileSource(where, actuation or {}, context)


class _Stated:
    """A recording with values or facts that a person adds."""

    def __init__(self, reader: RecordingReader, actuation: Mapping[str, float], context: Context | None) -> None:
        self._reader, self._actuation = reader, dict(actuation)
        self.context = context or reader.context

    def __iter__(self) -> Iterator[Event]:
        for place, event in enumerate(self._reader):
            if place == 0 and self._actuation:
                yield Actuation(event.stamp_ns, self._actuation)
            yield event

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._reader.close()
