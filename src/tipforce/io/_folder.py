"""A folder of images with stamps in a table or in the files' names."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import FileFormatError, InputError, TimeError
from ..types import FloatArray, Frame, Image, IntArray
from ._columns import TIME_UNITS, time_column, times_ns
from ._tables import Table, listed, open_table

__all__ = ["ImageFolder", "read_folder", "read_image"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
_TABLES = ("stamps.csv", "metadata.csv")
_SEC_NANOSEC = re.compile(r"(?<!\d)(\d{9,10})[-_.](\d{9})(?!\d)")
_WITH_UNIT = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?)_?(ns|us|ms|s)(?![A-Za-z0-9])")
_DIGITS = re.compile(r"\d+")
_FORCES = re.compile(r"^[ft][xyz]_[a-z]+$")
_UNIT_NAME = re.compile(r"^[A-Za-z]\w*_(deg|rad|mm|m|kpa|pa|bar|v|a|n|steps|percent)$", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class ImageFolder:
    """``files``: n paths in the order of ``stamp_ns`` (n,); ``actuation``: name -> (n,)."""

    files: tuple[Path, ...]
    stamp_ns: IntArray
    actuation: dict[str, FloatArray]


def read_image(path: Path) -> Image:
    """One picture, 8 bit: (h, w) grey or (h, w, 3) RGB, turned as its EXIF data say, without its alpha channel.

    Of 16-bit pictures the upper eight bits are kept, of 12-bit numbers in them the upper eight of twelve. Raises
    FileFormatError.
    """
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    kind = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH
    image = cv2.imdecode(np.fromfile(path, np.uint8), kind) if path.stat().st_size else None
    if image is None:
        raise FileFormatError(f"{path}: is no picture that can be read; write it as PNG, JPEG or TIFF")
    image = _eight_bit(path, image)
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)  # type: ignore[return-value]


def _eight_bit(path: Path, image: npt.NDArray[Any]) -> Image:
    """(h, w) or (h, w, 3) uint8 of an image of 8 or 16 bit. Raises FileFormatError for other types."""
    if image.dtype == np.uint8:
        return image
    if image.dtype != np.uint16:
        raise FileFormatError(f"{path}: holds {image.dtype} pixels; write it with 8 or 16 bit")
    # cameras of 12 bit write their numbers as they are, and a 256th of them would be nearly black; more widths than
    # these two would make the brightness jump from picture to picture with the brightest pixel
    return (image >> (4 if int(image.max()) < 4096 else 8)).astype(np.uint8)


def read_folder(folder: Path) -> ImageFolder:
    """The images of ``folder`` in the order of their stamps.

    Stamps come from ``stamps.csv`` or ``metadata.csv`` (``file_name`` and a time column such as ``stamp_ns`` or
    ``time_s``; further columns NAME_UNIT are actuation), else from the names: ``SECONDS-NANOSECONDS``, a number with
    its unit (``123_ns``, ``0.25s``), or a count of nanoseconds, microseconds or milliseconds since 1970.
    Raises FileFormatError without images or stamps, TimeError where stamps repeat.
    """
    for name in _TABLES:
        if (folder / name).exists():
            found = _from_table(folder, open_table(folder / name))
            break
    else:
        found = _from_names(folder)
    order = np.argsort(found.stamp_ns, kind="stable")
    stamps = found.stamp_ns[order]
    files = tuple(found.files[place] for place in order.tolist())
    repeated = np.flatnonzero(np.diff(stamps) == 0)
    if len(repeated):
        first, second = files[int(repeated[0])], files[int(repeated[0]) + 1]
        raise TimeError(f"{folder}: {first.name} and {second.name} carry the same stamp, {stamps[repeated[0]]} ns")
    return ImageFolder(files, stamps, {name: values[order] for name, values in found.actuation.items()})


def frames_of(folder: ImageFolder, view: str) -> Iterator[Frame]:
    """The pictures, one after the other."""
    for path, stamp in zip(folder.files, folder.stamp_ns.tolist(), strict=True):
        yield Frame(stamp, read_image(path), view)


def _from_table(folder: Path, table: Table) -> ImageFolder:
    if "file_name" not in table.header:
        raise FileFormatError(f"{table.path}: has no column file_name; it has {listed(table.header)}")
    files = tuple(folder / name for name in table.words("file_name"))
    missing = next((path for path in files if not path.is_file()), None)
    if missing is not None:
        raise FileFormatError(f"{table.path}: names {missing.name}, which is not in {missing.parent}")
    if "session" in table.header and len(set(table.words("session"))) > 1:
        raise InputError(f"{table.path}: holds several sessions; a source of events is one; use it as a dataset folder")
    column, unit = time_column(table, None, None)
    stamps = times_ns(table, column, unit)
    names = [name for name in table.header if _UNIT_NAME.match(name) and not _FORCES.match(name) and name != column]
    values = table.numbers(names) if names else np.empty((len(files), 0))
    return ImageFolder(files, stamps, {name: values[:, place] for place, name in enumerate(names)})


def _from_names(folder: Path) -> ImageFolder:
    files = tuple(sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES and path.is_file()))
    if not files:
        raise FileFormatError(f"{folder}: holds no images ({', '.join(sorted(_SUFFIXES))})")
    return ImageFolder(files, np.array([_stamp_of(path) for path in files], dtype=np.int64), {})


def _stamp_of(path: Path) -> int:
    name = path.stem
    if both := _SEC_NANOSEC.search(name):
        return int(both[1]) * 1_000_000_000 + int(both[2])
    if stamped := _WITH_UNIT.search(name):
        factor = TIME_UNITS[stamped[2]]
        return int(stamped[1]) * factor if stamped[1].isdigit() else round(float(stamped[1]) * factor)
    longest = max(_DIGITS.findall(name), key=len, default="")
    if len(longest) >= 12:  # since 1970: milliseconds have 12 or 13 digits, micro 15 or 16, nano 18 or 19
        return int(longest) * (1 if len(longest) >= 18 else 1_000 if len(longest) >= 15 else 1_000_000)
    raise FileFormatError(
        f"{path}: its name holds no time stamp (seconds-nanoseconds, or a number with its unit: 41666667_ns); "
        f"write the stamps into {path.parent / 'stamps.csv'} with the columns file_name,stamp_ns"
    )
