"""Images that can be annotated: those of one recording, video or folder, or of a folder of recordings."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Protocol

import cv2
import numpy as np

from ..errors import FileFormatError, InputError
from ..io import (
    FileSource,
    RecordingReader,
    StreamDepth,
    frame_count,
    images_beforehand,
    is_bag,
    is_image,
    open_source,
    read_image,
    spread_rows,
)
from ..types import DEFAULT_VIEW, FloatArray, Frame, Image, SessionInfo, Source, views_of

THUMBNAIL_PX = (32, 24)
"""Width and height of the small grey images by which frames are compared."""
MAX_CANDIDATES = 240
"""Frames of all sessions that are compared when frames are chosen."""
_EXTRACTED = re.compile(r"^img0*(\d+)$")
"""Name that DeepLabCut gives to a frame that it extracts from a video."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A frame that may be chosen.

    Attributes:
        name: its name, see `AnnotationImages`.
        session: index of its session.
        thumbnail: (n,) grey levels of a small copy, 0 to 1.
    """

    name: str
    session: int
    thumbnail: FloatArray


class _Session(Protocol):
    """The images of one session."""

    names: list[str]
    info: SessionInfo

    def read(self, indices: Sequence[int]) -> Iterator[Image]:
        """Yields the images at increasing indices."""
        ...

    def beforehand(self) -> list[Image]:
        """Returns images on which the detection is resolved."""
        ...


class AnnotationImages:
    """Reads single images of a recording, a video, a folder of images, or a folder of recordings.

    An image of a folder has the name of its file. An image of a recording or video has the name of that file and the
    number of the frame, from 0: ``run.mcap/12``.

    Args:
        path: the file or folder.
        view: view of the images.
        stated: metadata in place of the files' own.

    Raises:
        FileFormatError: there is no such file, or no image in it.
        InputError: a recording has no such view.
    """

    def __init__(self, path: Path, view: str = "camera", stated: SessionInfo | None = None) -> None:
        self.path = path
        info = stated or SessionInfo()
        recordings = sorted(path.glob("*.mcap")) if path.is_dir() else []
        self._sessions: list[_Session]
        if path.is_dir() and not recordings:
            self._sessions = [_Folder(path, info)]
        else:
            self._sessions = [_Events(file, view, info) for file in recordings or [path]]
        # name -> number of its session, and its index there
        self._index = {
            name: (number, index)
            for number, session in enumerate(self._sessions)
            for index, name in enumerate(session.names)
        }
        if not self._index:
            raise FileFormatError(f"{path}: holds no images; expected images, recordings (.mcap), or a video file")

    def __len__(self) -> int:
        return len(self._index)

    def __contains__(self, name: object) -> bool:
        return name in self._index

    @property
    def examples(self) -> list[str]:
        """Names of the first images."""
        return list(self._index)[:3]

    @property
    def session_info(self) -> list[SessionInfo]:
        """The metadata of each session."""
        return [each.info for each in self._sessions]

    def session_of(self, name: str) -> int:
        """Returns the index of the session that the image ``name`` belongs to."""
        return self._index[name][0]

    def resolve(self, name: str) -> str | None:
        """Returns the name of the image that another program calls ``name``; None if there is no such image.

        Another program may state the path of a file, its name without the ending, the number of a frame, or
        DeepLabCut's ``img0012.png``. These are tried in this order; a name that fits several images fits none.
        """
        path = PurePosixPath(name.replace("\\", "/"))
        for start in range(len(path.parts)):  # "set/run/12.png", "run/12.png", "12.png"
            if (ending := "/".join(path.parts[start:])) in self._index:
                return ending
        files = [file for file in self._index if is_image(Path(file))]
        same_name = [file for file in files if file.rpartition("/")[2] == path.name]
        same_name = same_name or [file for file in files if Path(file).stem == name]
        if len(same_name) == 1:
            return same_name[0]
        extracted = _EXTRACTED.match(path.stem)
        number = extracted[1] if extracted else name
        if len(self._sessions) == 1 and number.isdecimal() and int(number) < len(self._index):
            return list(self._index)[int(number)]
        return None

    def beforehand(self, session: int) -> list[Image]:
        """Returns images that are spread over a session, on which its detection is resolved."""
        return self._sessions[session].beforehand()

    def candidates(self) -> Iterator[Candidate]:
        """Yields up to `MAX_CANDIDATES` frames, evenly spread over all sessions."""
        step = max(1, -(-len(self) // MAX_CANDIDATES))
        for number, session in enumerate(self._sessions):
            indices = range(0, len(session.names), step)
            for index, image in zip(indices, session.read(indices), strict=True):
                yield Candidate(session.names[index], number, thumbnail(image))

    def each(self, names: Sequence[str]) -> Iterator[tuple[str, Image]]:
        """Yields the images ``names`` with their names, in the order of the files; one at a time is in memory."""
        for number, session in enumerate(self._sessions):
            indices = sorted({self._index[name][1] for name in names if self._index[name][0] == number})
            yield from zip((session.names[k] for k in indices), session.read(indices), strict=True)

    def read(self, names: Sequence[str]) -> list[Image]:
        """Returns the images ``names``, in this order: (h, w) grey or (h, w, 3) RGB, uint8."""
        images = dict(self.each(names))
        return [images[name] for name in names]


def views_at(path: Path, stated: SessionInfo) -> tuple[str, ...]:
    """Returns the views of a recording, or of the first one in a folder of recordings; else the default view.

    Args:
        path: the file or folder.
        stated: metadata in place of the files' own.

    Raises:
        FileFormatError: there is no such file, or it cannot be read.
    """
    recordings = sorted(path.glob("*.mcap")) if path.is_dir() else []
    if path.is_dir() and not recordings:
        return (DEFAULT_VIEW,)
    with open_source(next(iter(recordings), path), stated=stated) as source:
        return views_of(source)


class _Folder:
    """A folder of images, also in its sub-folders where it has none itself."""

    def __init__(self, folder: Path, info: SessionInfo) -> None:
        files = [file for file in folder.iterdir() if is_image(file)] or filter(is_image, folder.rglob("*"))
        self._files = sorted((file for file in files if file.is_file()), key=_by_number)
        self._depth = StreamDepth.of_files(self._files)
        self.names = [file.relative_to(folder).as_posix() for file in self._files]
        self.info = info

    def read(self, indices: Sequence[int]) -> Iterator[Image]:
        return (read_image(self._files[index], self._depth) for index in indices)

    def beforehand(self) -> list[Image]:
        return list(self.read(spread_rows(len(self._files)).tolist()))


class _Events:
    """A recording, a video, a DICOM file or a file of images."""

    def __init__(self, file: Path, view: str, stated: SessionInfo) -> None:
        self._file, self._view, self._stated = file, view, stated
        with self._open() as source:
            self.info = source.session_info.updated(stated)
            if isinstance(source, RecordingReader) and view not in source.views:
                if not source.views:
                    raise InputError(f"{file}: holds no images")
                views = ", ".join(source.views)
                raise InputError(f"{file}: has no view {view!r}, it has {views}: set vision.view={source.views[0]}")
            if isinstance(source, FileSource) and source.file_names:
                self.names = list(source.file_names.values())
            else:
                count = frame_count(source, view) or sum(1 for _ in _frames(source, view))
                self.names = [f"{file.name}/{index}" for index in range(count)]

    def read(self, indices: Sequence[int]) -> Iterator[Image]:
        """Yields the images at increasing indices: a video is read from its beginning, a recording at each index."""
        if not indices:
            return
        with self._open() as source:
            if isinstance(source, RecordingReader):
                yield from (source.frame_at(index, self._view).image for index in indices)
                return
            wanted, last = set(indices), indices[-1]
            for index, frame in enumerate(_frames(source, self._view)):
                if index in wanted:
                    yield frame.image
                if index == last:
                    return

    def beforehand(self) -> list[Image]:
        with self._open() as source:
            return images_beforehand(source, self._view)

    def _open(self) -> Source:
        if self._file.suffix == ".mcap" and not is_bag(self._file):
            return RecordingReader(self._file)
        return open_source(self._file, stated=self._stated)


def thumbnail(image: Image) -> FloatArray:
    """Returns the (n,) grey levels, 0 to 1, of a small copy of ``image``."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, THUMBNAIL_PX, interpolation=cv2.INTER_AREA)
    return small.astype(np.float64).ravel() / 255.0


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Returns a key that sorts image2 before image10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path).lower())]


def _frames(source: Source, view: str) -> Iterator[Frame]:
    return (event for event in source if isinstance(event, Frame) and event.view == view)
