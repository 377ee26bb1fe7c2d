"""Images that can be annotated: those of one recording, video or folder, or of a folder of recordings."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import cv2
import numpy as np

from ..errors import FileFormatError, InputError
from ..io import FileSource, RecordingReader, frame_count, images_beforehand, open_source
from ..types import FloatArray, Frame, Image, SessionInfo, Source

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
    """

    def __init__(self, path: Path, view: str = "camera", stated: SessionInfo | None = None) -> None:
        self.path, self.view, self._stated = path, view, stated
        recordings = sorted(path.glob("*.mcap")) if path.is_dir() else []
        self._files = recordings or [path]
        self._names: list[dict[str, int]] = []
        self.session_info: list[SessionInfo] = []
        for file in self._files:
            with self._open(file) as source:
                self.session_info.append(source.session_info)
                self._names.append({name: index for index, name in enumerate(self._frame_names(file, source))})
        self._index = {name: (k, index) for k, names in enumerate(self._names) for name, index in names.items()}
        if not self._index:
            raise FileFormatError(f"{path}: there is no image of the view {view!r} in it")

    def __len__(self) -> int:
        return len(self._index)

    @property
    def examples(self) -> list[str]:
        """Names of the first images."""
        return list(self._index)[:3]

    def session_of(self, name: str) -> int:
        """Returns the index of the session that the image ``name`` belongs to."""
        return self._index[name][0]

    def resolve(self, name: str) -> str | None:
        """Returns the name of the image that another program calls ``name``; None if there is no such image.

        Another program may state the path of a file, the number of a frame, or DeepLabCut's ``img0012.png``.
        """
        if name in self._index:
            return name
        path = PurePosixPath(name.replace("\\", "/"))
        if path.name in self._index:
            return path.name
        if "/".join(path.parts[-2:]) in self._index:
            return "/".join(path.parts[-2:])
        extracted = _EXTRACTED.match(path.stem)
        number = extracted[1] if extracted else name
        if len(self._files) == 1 and number.isdecimal() and int(number) < len(self._index):
            return list(self._index)[int(number)]
        return None

    def beforehand(self, session: int) -> list[Image]:
        """Returns images that are spread over a session, on which its detection is resolved."""
        with self._open(self._files[session]) as source:
            return images_beforehand(source, self.view)

    def candidates(self) -> Iterator[Candidate]:
        """Yields up to `MAX_CANDIDATES` frames, evenly spread over all sessions."""
        step = max(1, -(-len(self) // MAX_CANDIDATES))
        for session, names in enumerate(self._names):
            listed = list(names)[::step]
            for name, image in zip(listed, self._read(session, [names[name] for name in listed]), strict=True):
                yield Candidate(name, session, thumbnail(image))

    def read(self, names: Sequence[str]) -> list[Image]:
        """Returns the images ``names``, in this order: (h, w) grey or (h, w, 3) RGB, uint8."""
        found: dict[str, Image] = {}
        for session, known in enumerate(self._names):
            wanted = sorted({name for name in names if name in known}, key=known.__getitem__)
            found.update(zip(wanted, self._read(session, [known[name] for name in wanted]), strict=True))
        return [found[name] for name in names]

    def _read(self, session: int, indices: Sequence[int]) -> Iterator[Image]:
        """Yields the images at increasing ``indices`` of a session."""
        if not indices:
            return
        with self._open(self._files[session]) as source:
            if isinstance(source, RecordingReader):
                yield from (source.frame_at(index, self.view).image for index in indices)
                return
            wanted, last = set(indices), indices[-1]
            for index, frame in enumerate(_frames(source, self.view)):
                if index in wanted:
                    yield frame.image
                if index == last:
                    return

    def _open(self, file: Path) -> Source:
        return RecordingReader(file) if file.suffix == ".mcap" else open_source(file, stated=self._stated)

    def _frame_names(self, file: Path, source: Source) -> list[str]:
        if isinstance(source, FileSource) and source.file_names:
            return list(source.file_names.values())
        if isinstance(source, RecordingReader) and self.view not in source.views:
            held = ", ".join(source.views) or "no images"
            raise InputError(f"{file}: has no view {self.view!r}, it has {held}; state vision.view")
        count = frame_count(source, self.view) or sum(1 for _ in _frames(source, self.view))
        return [f"{file.name}/{index}" for index in range(count)]


def thumbnail(image: Image) -> FloatArray:
    """Returns the (n,) grey levels, 0 to 1, of a small copy of ``image``."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, THUMBNAIL_PX, interpolation=cv2.INTER_AREA)
    return small.astype(np.float64).ravel() / 255.0


def _frames(source: Source, view: str) -> Iterator[Frame]:
    return (event for event in source if isinstance(event, Frame) and event.view == view)
