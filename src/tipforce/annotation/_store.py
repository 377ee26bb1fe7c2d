"""Keeps annotations in one JSON file beside the recording or folder; the file is replaced after every change."""

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .._system.json_files import read_json
from ..errors import FileFormatError, InputError
from ..io import write_atomic
from ..types import FloatArray, Image
from ..vision import Annotation
from ._images import THUMBNAIL_PX, thumbnail
from ._spline import curve_through

FORMAT: Literal["tipforce-annotations"] = "tipforce-annotations"
VERSION = 1
SUFFIX = ".annotations.json"
MAX_POINTS = 200
"""Largest number of points of one line."""
MAX_PIXEL = 100_000.0
"""Largest coordinate of a point, px."""
MAX_LEVEL_DIFFERENCE = 3
"""An image is the one that was marked if no grey level of its thumbnail, 0 to 255, differs by more. Measured in two
sessions of ``varied``: JPEG of quality 60 to 90 changes a level by at most 1; the frame ten later differs by 6 or more
in 90 % of the frames, by 14 and 30 in the median."""


_Pixel = Annotated[float, Field(ge=-MAX_PIXEL, le=MAX_PIXEL)]


class _StoredFrame(BaseModel):
    model_config = ConfigDict(extra="forbid")

    image: str = Field(min_length=1, max_length=500)
    points_px: list[tuple[_Pixel, _Pixel]] = Field(default=[], max_length=MAX_POINTS)
    tip_hidden: bool = False
    present: bool = True
    done: bool = False
    thumbnail: str = Field(default="", max_length=4 * THUMBNAIL_PX[0] * THUMBNAIL_PX[1])


class _StoredFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    format: Literal["tipforce-annotations"] = FORMAT
    version: Annotated[int, Field(ge=VERSION, le=VERSION)] = VERSION
    source: str
    frames: list[_StoredFrame]


@dataclass(frozen=True, slots=True, eq=False)
class MarkedFrame:
    """The marks of a person in one frame.

    Attributes:
        image: name of the image.
        points_px: (k, 2) points u, v in px that the line passes through, base to tip; (0, 2): not marked yet.
        tip_hidden: whether the tip is behind something.
        present: whether a catheter is in the image.
        done: whether the person has finished the frame.
        thumbnail: grey levels of a small copy of the image (base64), by which another image of the same name is
            recognised; "": not known yet.
    """

    image: str
    points_px: FloatArray
    tip_hidden: bool = False
    present: bool = True
    done: bool = False
    thumbnail: str = ""

    @classmethod
    def empty(cls, image: str) -> "MarkedFrame":
        """Returns a frame without marks."""
        return cls(image, np.empty((0, 2)))

    @classmethod
    def from_values(cls, image: str, values: Mapping[str, Any]) -> "MarkedFrame":
        """Returns a frame from JSON values.

        Raises:
            InputError: a value is missing, of another type or outside of its range; a finished frame has less than two
                points; two points in a row are the same.
        """
        try:
            stored = _StoredFrame.model_validate({**values, "image": image})
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise InputError(f"{image[:200]}: {place}: {first['msg']}") from None
        points = np.asarray(stored.points_px, np.float64).reshape(-1, 2)
        if not stored.present:
            points = np.empty((0, 2))
        frame = cls(image, points, stored.tip_hidden and stored.present, stored.present, stored.done, stored.thumbnail)
        if frame.done:
            frame.annotation()  # checks the points
        return frame

    def values(self) -> dict[str, Any]:
        """Returns the frame as JSON values."""
        return {
            "image": self.image,
            "points_px": np.round(self.points_px, 3).tolist(),
            "tip_hidden": self.tip_hidden,
            "present": self.present,
            "done": self.done,
            "thumbnail": self.thumbnail,
        }

    def seen_in(self, image: Image) -> "MarkedFrame":
        """Returns the frame with the thumbnail of its image."""
        return replace(self, thumbnail=base64.b64encode(_levels(image).tobytes()).decode())

    def is_of(self, image: Image) -> bool:
        """Whether ``image`` is the image that was marked, as far as that is known."""
        if not self.thumbnail:
            return True
        try:
            marked = np.frombuffer(base64.b64decode(self.thumbnail, validate=True), np.uint8)
        except ValueError:
            return False
        levels = _levels(image).astype(np.int64)
        return len(marked) == len(levels) and int(np.abs(levels - marked).max()) <= MAX_LEVEL_DIFFERENCE

    def annotation(self) -> Annotation:
        """Returns the frame for the training: the curve through the points.

        Raises:
            InputError: there is a catheter, but not two points that differ.
        """
        marked = Annotation(self.image, self.points_px, self.tip_hidden, self.present)
        return replace(marked, points_px=curve_through(self.points_px)) if self.present else marked


class AnnotationStore:
    """The frames of one recording or folder that a person marks.

    Args:
        path: the recording or folder; the file is `store_path` of it.
        view: the view of the images.

    Raises:
        FileFormatError: the file exists and is not one of this program.
    """

    def __init__(self, path: Path, view: str = "camera") -> None:
        self.file, self._source = store_path(path, view), path.resolve().name
        self.frames: dict[str, MarkedFrame] = {}
        if self.file.exists():
            self.frames = {frame.image: frame for frame in _read(self.file)}

    def add(self, frames: Iterable[MarkedFrame]) -> None:
        """Adds frames, or replaces those with the same names, and saves all."""
        self.frames |= {frame.image: frame for frame in frames}
        self.save()

    def check_image(self, name: str, image: Image) -> None:
        """Checks that ``image`` is the one that was marked as ``name``, and remembers it where none was known.

        Raises:
            InputError: it is another image.
        """
        frame = self.frames[name]
        if not frame.is_of(image):
            raise InputError(
                f"{self.file}: {name} is another image than the one that was marked; the recording or folder has "
                "changed: move the annotations away to start again"
            )
        if not frame.thumbnail:
            self.frames[name] = frame.seen_in(image)

    def save(self) -> None:
        """Writes the file. Raises OutputError where this is not possible."""
        frames = [_StoredFrame.model_validate(frame.values()) for frame in self.frames.values()]
        stored = _StoredFile(source=self._source, frames=frames)
        write_atomic(self.file, stored.model_dump_json(indent=1) + "\n")

    @property
    def finished(self) -> list[MarkedFrame]:
        """The frames that the person has finished."""
        return [frame for frame in self.frames.values() if frame.done]


def store_path(path: Path, view: str = "camera") -> Path:
    """Returns the file with the annotations of a recording or folder.

    Args:
        path: the recording or folder.
        view: the view of the images; each view but "camera" has a file of its own.

    Returns:
        The path of the file.

    >>> store_path(Path("runs/monday.mcap")).name, store_path(Path("runs/monday.mcap"), "a").name
    ('monday.annotations.json', 'monday.a.annotations.json')
    """
    path = path.resolve()
    stem = path.name if path.is_dir() else path.stem
    of_view = "" if view == "camera" else f".{view.replace('/', '-')}"
    return path.with_name(f"{stem}{of_view}{SUFFIX}")


def _levels(image: Image) -> npt.NDArray[np.uint8]:
    return np.rint(255.0 * thumbnail(image)).astype(np.uint8)


def _read(file: Path) -> list[MarkedFrame]:
    """Returns the frames of a file. Raises FileFormatError if it is no file of annotations, or of another version."""
    remedy = "move it away to start again"
    values = read_json(file, remedy=remedy)
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise FileFormatError(f"{file}: is no file of annotations (format {FORMAT!r}); {remedy}")
    if values.get("version") != VERSION:
        raise FileFormatError(
            f"{file}: has version {values.get('version')}, expected {VERSION}; use the tipforce that wrote it"
        )
    try:
        stored = _StoredFile.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise FileFormatError(f"{file}: {place}: {first['msg']}; {remedy}") from None
    try:
        return [MarkedFrame.from_values(frame.image, frame.model_dump()) for frame in stored.frames]
    except InputError as error:
        raise FileFormatError(f"{file}: {error}; {remedy}") from None
