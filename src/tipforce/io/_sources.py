"""Opens every kind of file that holds events: video, DICOM, images, ROS bag, recording."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from heapq import merge
from itertools import islice
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from .._system.contexts import ClosedAtExit
from .._system.rows import evenly_spread
from ..errors import FileFormatError, InputError, TimeError
from ..types import (
    ADVANCE,
    DEFAULT_VIEW,
    STAGE,
    Actuation,
    ActuationInfo,
    Event,
    FloatArray,
    Frame,
    Image,
    IntArray,
    SessionInfo,
    Source,
    ViewInfo,
)
from ._dicom import DicomFile, is_dicom
from ._folder import ImageFolder, read_folder
from ._image_size import image_count
from ._images import file_bytes, is_image
from ._reader import RecordingReader
from ._stack import ImageStack
from .bags import is_bag, open_bag
from .video import VideoFile

MAX_SCALE_RATIO_STDS = 3.0
"""A stated scale that differs by more standard uncertainties from that of a DICOM header is remarked."""


class FileSource(ClosedAtExit):
    """A video, a DICOM file, images or a folder of them as a `Source` of one view.

    It may be iterated any number of times, and is read while it is iterated.

    Args:
        path: the file or folder.
        actuation: constant readings of drives that the file does not have.
        stated: metadata that replace those of the file.
        view: name of its view; None: see `view_of_file`.

    Raises:
        InputError: ``actuation`` has a drive that the file has, too.
    """

    def __init__(
        self, path: Path, actuation: Mapping[str, float], stated: SessionInfo, view: str | None = None
    ) -> None:
        """Opens the file, and joins its metadata and drives with the stated ones; see the class."""
        self.path, self.views = path, (view or view_of_file(path, stated.views),)
        self._file = _opened(path)
        self.remarks: tuple[str, ...] = ()
        self._columns = self._file.actuation if isinstance(self._file, ImageFolder) else {}
        constant = {name: value for name, value in stated.actuation.constant.items() if name not in self._columns}
        self._actuation = {**constant, **actuation}
        self.session_info = SessionInfo(path.stem).updated(stated)
        if isinstance(self._file, DicomFile):
            self.session_info, self.remarks = _with_geometry(self.session_info, self.views[0], self._file)
        if clash := set(self._columns) & set(actuation):
            raise InputError(f"{path}: has a column {min(clash)!r} already; do not state it a second time")

    @property
    def frame_count(self) -> int:
        """Number of images that the file states; 0 where it states none."""
        return self._file.frame_count

    @property
    def file_names(self) -> Mapping[int, str]:
        """Stamp in ns -> name of the image file, or of the page in it; empty for a video or DICOM file."""
        if isinstance(self._file, ImageFolder):
            return dict(zip(self._file.stamp_ns.tolist(), self._file.file_names, strict=True))
        if isinstance(self._file, ImageStack):
            return dict(zip(self._file.stamp_ns, self._file.file_names, strict=True))
        return {}

    @property
    def numbered(self) -> bool:
        """Whether the stamps only count the images, because no file states their times."""
        return isinstance(self._file, ImageStack) or (isinstance(self._file, ImageFolder) and self._file.numbered)

    def lacks(self, names: Iterable[str]) -> list[str]:
        """Returns those of the actuation's ``names`` that have no reading."""
        return [name for name in names if name not in self._actuation and name not in self._columns]

    def readings(self, name: str) -> FloatArray:
        """Returns the (n,) readings of the drive ``name``."""
        stated = self._columns[name] if name in self._columns else self._actuation.get(name, ())
        values = np.asarray(stated, np.float64).ravel()
        return values[np.isfinite(values)]

    def __iter__(self) -> Iterator[Event]:
        """Yields the constant readings before the first image, and before each image the readings of its row."""
        for row, frame in enumerate(self._file.frames(self.views[0])):
            if row == 0 and self._actuation:
                yield Actuation(frame.stamp_ns, self._actuation)
            if self._columns:
                readings = {name: float(values[row]) for name, values in self._columns.items()}
                yield Actuation(frame.stamp_ns, {n: value for n, value in readings.items() if not math.isnan(value)})
            yield frame


def view_of_file(path: Path, stated: Iterable[str]) -> str:
    """Returns the name of the view that a file or folder of images shows.

    Args:
        path: the file or folder.
        stated: views of the metadata.

    Returns:
        The only view of the metadata, or the one that ends the name of the file; else the default view.

    >>> view_of_file(Path("video_a.mp4"), ["a", "b"]), view_of_file(Path("video.mp4"), ["a", "b"])
    ('a', 'camera')
    """
    names = tuple(stated)
    if len(names) == 1:
        return names[0]
    matching = [name for name in names if path.stem == name or path.stem.endswith((f"_{name}", f"-{name}"))]
    return max(matching, key=len, default=DEFAULT_VIEW)


def _with_geometry(info: SessionInfo, view: str, file: DicomFile) -> tuple[SessionInfo, tuple[str, ...]]:
    """Returns metadata with the geometry of a DICOM file where they state none, and sentences on it.

    Args:
        info: metadata of the session; they have precedence.
        view: name of the view that the file shows.
        file: the file.
    """
    stated, header, name = info.view(view), file.view.info, file.path.name
    if header == ViewInfo():
        return info, ()
    remarks = [f"{name}, view {view}: {file.view.found}"] if file.view.found else []
    remarks += [
        f"{name}, view {view}: {text.format(view=view)}"
        for text in file.view.missing
        if not ("projection" in text and stated.projection) and not ("metres_per_px" in text and stated.metres_per_px)
    ]
    filled = replace(stated, modality=stated.modality or header.modality)
    if stated.metres_per_px is None:
        filled = replace(
            filled,
            metres_per_px=header.metres_per_px,
            metres_per_px_uncertainty=header.metres_per_px_uncertainty,
        )
    elif header.metres_per_px is not None and header.metres_per_px_uncertainty is not None:
        ratio = stated.metres_per_px / header.metres_per_px
        if abs(ratio - 1.0) > MAX_SCALE_RATIO_STDS * header.metres_per_px_uncertainty:
            remarks.append(
                f"{name}, view {view}: views.{view}.metres_per_px of bench.toml is {ratio:.2f} times the scale of the "
                "header, and is used; check it"
            )
    if stated.projection is None and header.projection is not None:
        filled = replace(
            filled,
            projection=header.projection,
            projection_frame=header.projection_frame,
            pose_uncertainty_deg=stated.pose_uncertainty_deg or header.pose_uncertainty_deg,
            pose_uncertainty_m=stated.pose_uncertainty_m or header.pose_uncertainty_m,
        )
    return replace(info, views={**info.views, view: filled}), tuple(remarks)


class FilesOfViews(ClosedAtExit):
    """Files of images, one for each view, as one `Source`; their stamps are on one clock.

    A view has the name of the metadata's view that ends the name of its file, as in ``video_a.mp4``. Planes A and B of
    a biplane system are the views a and b, as their DICOM files state. Where the metadata describe no view, it has the
    last word of this name. Stamps of DICOM files count from the ContentTime of the earliest one.

    Args:
        paths: at least two files or folders.
        stated: metadata of the session.

    Raises:
        FileFormatError: a file cannot be read.
        InputError: two files have the same view, or the metadata do not describe the view of a file.
        TimeError: DICOM files were not taken at the same time.
    """

    def __init__(self, paths: Sequence[Path], stated: SessionInfo) -> None:
        """Determines the view of each file and opens it; see the class for the rules."""
        dicom = {path: DicomFile(path) for path in paths if is_dicom(path)}
        planes = {path: file.view.plane for path, file in dicom.items() if file.view.plane}
        names = {path: view_of_file(path, stated.views) for path in paths}
        known = {*stated.views}
        names_differ = len(set(names.values())) == len(paths) and known.issuperset(names.values())
        planes_fit = not known or not known.isdisjoint(planes.values())
        if planes_fit and not names_differ and len(set(planes.values())) == len(paths):
            names, known = planes, set[str]()  # the planes need no description in the metadata
        elif not known:
            names = {path: re.split(r"\W|_", path.stem)[-1] or path.stem for path in paths}
        for path, view in names.items():
            if list(names.values()).count(view) > 1 or (known and view not in known):
                described = ", ".join(stated.views) or "no view"
                raise InputError(
                    f"{path}: its view is not known; expected a name that ends in a view of bench.toml, as in "
                    f"{path.stem}_{next(iter(stated.views), 'a')}{path.suffix}; the metadata describe {described}"
                )
        self._files = [FileSource(path, {}, stated, view) for path, view in names.items()]
        views = {view: file.session_info.view(view) for view, file in zip(names.values(), self._files, strict=True)}
        self.views, self.session_info = tuple(names.values()), self._files[0].session_info
        if any(file.remarks for file in self._files):
            self.session_info = replace(self.session_info, views={**self.session_info.views, **views})
        self._later_ns = _later_ns(dicom) if len(dicom) == len(paths) else [0] * len(paths)
        shift_remarks = [
            f"{path.name}: its stamps are {later * 1e-9:.6f} s later, because its ContentTime is"
            for path, later in zip(names, self._later_ns, strict=True)
            if later
        ]
        self.remarks = (*(remark for file in self._files for remark in file.remarks), *shift_remarks)

    @property
    def frame_count(self) -> int:
        """Number of images that all files state; 0 where one states none."""
        counts = [file.frame_count for file in self._files]
        return sum(counts) if all(counts) else 0

    @property
    def numbered(self) -> bool:
        """Whether the stamps of a file only count its images."""
        return any(file.numbered for file in self._files)

    def __iter__(self) -> Iterator[Event]:
        first, *others = (_moved(file, later) for file, later in zip(self._files, self._later_ns, strict=True))
        images = ((event for event in file if isinstance(event, Frame)) for file in others)
        # readings of drives come with the first view
        yield from merge(first, *images, key=lambda event: event.stamp_ns)


def _moved(events: Iterable[Event], later_ns: int) -> Iterator[Event]:
    for event in events:
        yield replace(event, stamp_ns=event.stamp_ns + later_ns) if later_ns else event


def _later_ns(files: Mapping[Path, DicomFile]) -> list[int]:
    """Returns the time of each file's zero after that of the earliest one, ns; all 0 where one states no time.

    Raises TimeError where two files do not overlap.
    """
    stated = [file.start_ns for file in files.values()]
    starts = [start for start in stated if start is not None]
    if len(starts) < len(stated):
        return [0] * len(stated)
    later = [start - min(starts) for start in starts]
    spans = [[shift + stamp for stamp in file.span_ns()] for file, shift in zip(files.values(), later, strict=True)]
    starts_last = max(range(len(spans)), key=lambda k: spans[k][0])
    ends_first = min(range(len(spans)), key=lambda k: spans[k][1])
    if spans[starts_last][0] > spans[ends_first][1]:
        names = [path.name for path in files]
        raise TimeError(
            f"{names[starts_last]}: begins {1e-9 * (spans[starts_last][0] - spans[ends_first][1]):.1f} s after the end "
            f"of {names[ends_first]}, by their ContentTime; two views are the planes of one run: import the files one "
            "by one"
        )
    return later


def _opened(path: Path) -> ImageFolder | ImageStack | DicomFile | VideoFile:
    """Opens a folder or file of images, a DICOM file, or else a video."""
    if path.is_dir():
        return read_folder(path)
    if is_image(path) and path.is_file():
        several = image_count(file_bytes(path)) > 1
        if not several:
            return read_folder(path)
        if path.suffix.lower() in (".tif", ".tiff"):
            return ImageStack(path)
        if path.suffix.lower() == ".webp":
            raise FileFormatError(
                f"{path}: is an animation, which is not read; write its images to a folder: magick {path.name} "
                "FOLDER/frame-%03d.png"
            )
    return DicomFile(path) if is_dicom(path) else VideoFile(path)


def open_source(
    path: Path | str, *, actuation: Mapping[str, float] | None = None, stated: SessionInfo | None = None
) -> Source:
    """Opens a video, DICOM file, image, folder of images, ROS bag or recording.

    Args:
        path: the file or folder.
        actuation: constant readings of drives.
        stated: metadata that replace those of the file; its constant readings of drives are used where the file has
            none.

    Returns:
        A `Source` and context manager.

    Raises:
        FileFormatError: there is no such file or folder, or it cannot be read.
        InputError: ``actuation`` has a name that the file has itself.
    """
    where = Path(path)
    if where.suffix in (".mcap", ".part") and not is_bag(where):
        reader = RecordingReader(where)
        constant = {} if stated is None else stated.actuation.constant
        constant_readings = {**constant, **(actuation or {})}
        lacking = set(_never_read(reader, constant_readings))
        stated_twice = sorted(set(actuation or {}) - lacking)
        if stated_twice:
            reader.close()
            raise InputError(f"{where}: carries {', '.join(stated_twice)} itself; do not state it as well")
        filled = {name: value for name, value in constant_readings.items() if name in lacking}
        nothing_added = not filled and stated in (None, SessionInfo())
        return reader if nothing_added else _Stated(reader, filled, stated or SessionInfo())
    if not where.exists():
        raise FileFormatError(f"{where}: there is no such file or folder")
    if is_bag(where):
        info = SessionInfo(actuation=ActuationInfo(constant=dict(actuation or {})))
        return open_bag(where, (stated or SessionInfo()).updated(info))
    return FileSource(where, actuation or {}, stated or SessionInfo())


def frame_count(source: Source, view: str = "camera") -> int:
    """Returns the number of frames that the file states; 0 where it states none.

    Args:
        source: the open source.
        view: name of the view.
    """
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


@runtime_checkable
class _Readable(Protocol):
    def readings(self, name: str) -> FloatArray: ...


def can_be_read_again(source: Source) -> bool:
    """Returns whether ``source`` is a file, which may be iterated more than once, and not a live stream."""
    return isinstance(getattr(source, "path", None), Path)


UNKNOWN_LENGTH_STEP = 5
"""Step between the images that are taken of a file that does not state its length."""
MAX_CALIBRATION_IMAGES = 16
"""Number of images of a session, or fewer, that resolve its detection."""


def spread_rows(count: int) -> IntArray:
    """Returns the indices of the images of a session that resolve its detection, spread over all ``count``.

    The ground beneath the tip must change between them, or it is taken for a part of the catheter.
    """
    return evenly_spread(count, MAX_CALIBRATION_IMAGES)


def spread_images(source: Source, view: str = "camera") -> list[Image]:
    """Returns the images of a file at `spread_rows`, or of its first seconds where it does not state its length.

    Args:
        source: the open file.
        view: name of the view.
    """
    reader = source.reader if isinstance(source, _Stated) else source
    if isinstance(reader, RecordingReader):
        rows = spread_rows(frame_count(reader, view)).tolist()
        return [reader.frame_at(row, view).image for row in rows]
    total = frame_count(source, view)
    rows = set(
        spread_rows(total).tolist()
        if total
        else range(0, UNKNOWN_LENGTH_STEP * MAX_CALIBRATION_IMAGES, UNKNOWN_LENGTH_STEP)
    )
    frames = (event.image for event in source if isinstance(event, Frame) and event.view == view)
    return [image for row, image in enumerate(islice(frames, max(rows) + 1)) if row in rows]


def images_beforehand(source: Source, view: str = "camera") -> list[Image]:
    """Returns the images of a file that resolve its detection: those of `spread_images`.

    There are none where the clamp is advanced, because the images then show the catheter at different positions.

    Args:
        source: the open file.
        view: name of the view.
    """
    return [] if any_reading(source, ADVANCE) else spread_images(source, view)


MAX_STEADY_VARIATION = 0.1
"""A reading that varies by at most this share of its mean is constant but for noise."""


def steady_reading(source: Source, name: str) -> float | None:
    """Returns the mean reading of a drive that is constant in a file; None if it moves or is unknown.

    Args:
        source: the open source.
        name: name of the drive with its unit, such as "knob_deg"; the result has this unit.
    """
    values = _read_of(source, name)
    if not len(values) or float(np.ptp(values)) > MAX_STEADY_VARIATION * abs(float(values.mean())):
        return None
    return float(values.mean())


def any_reading(source: Source, name: str) -> bool:
    """Returns whether a drive of a file has a reading other than 0.

    Args:
        source: the open source.
        name: name of the drive with its unit.
    """
    return bool(_read_of(source, name).any())


def _read_of(source: Source, name: str) -> FloatArray:
    if isinstance(source, RecordingReader):
        return _readings(source, name)
    return source.readings(name) if isinstance(source, _Readable) else np.empty(0)


def require_actuation(source: Source, names: Iterable[str]) -> None:
    """Checks, before the work, that a file has readings of the drives that a model needs. A live source is not checked.

    Args:
        source: the open source.
        names: names of the drives with their units.

    Raises:
        InputError: there is no reading of a drive; the message has the lines of ``bench.toml`` that state a constant.
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
    """Returns all readings of the catheter's drives in a recording."""
    streams = [name for name, stream in reader.info.streams.items() if stream.kind == "actuation" and name != STAGE]
    return (event for event in (reader.events(*streams) if streams else ()) if isinstance(event, Actuation))


def _never_read(reader: RecordingReader, names: Iterable[str]) -> list[str]:
    """Returns those of ``names`` without a reading; it stops at the first reading of the last one."""
    missing = list(names)
    for event in _drive_readings(reader):
        if not missing:
            break
        missing = [name for name in missing if name not in event.values]
    return missing


def _readings(reader: RecordingReader, name: str) -> FloatArray:
    """Returns the (n,) readings of the drive ``name`` in a recording."""
    return np.array([event.values[name] for event in _drive_readings(reader) if name in event.values])


class _Stated(ClosedAtExit):
    """A recording with values or facts that a person adds."""

    def __init__(self, reader: RecordingReader, actuation: Mapping[str, float], stated: SessionInfo) -> None:
        self.reader, self._actuation = reader, dict(actuation)
        self.path, self.session_info = reader.path, reader.session_info.updated(stated)
        self.views = reader.views

    def lacks(self, names: Iterable[str]) -> list[str]:
        """Returns those of the actuation's ``names`` that have no reading."""
        return _never_read(self.reader, [name for name in names if name not in self._actuation])

    def readings(self, name: str) -> FloatArray:
        """Returns the (n,) readings of the drive ``name``."""
        stated = self._actuation.get(name)
        return _readings(self.reader, name) if stated is None else np.array([stated])

    def __iter__(self) -> Iterator[Event]:
        for place, event in enumerate(self.reader):
            if place == 0 and self._actuation:
                yield Actuation(event.stamp_ns, self._actuation)
            yield event

    def close(self) -> None:
        """Closes the recording."""
        self.reader.close()
