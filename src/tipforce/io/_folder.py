"""A folder of images with stamps in a table or in the files' names."""

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FileFormatError, InputError, TimeError
from ..types import FloatArray, Frame, IntArray
from ._images import IMAGE_SUFFIXES, StreamDepth, read_image
from .tables import STILL_STEP_NS, TIME_UNITS, Table, check_actuation, is_actuation, open_table

_TABLES = ("stamps.csv", "metadata.csv")
_SEC_NANOSEC = re.compile(r"(?<!\d)(\d{9,10})[-_.](\d{9})(?!\d)")
_WITH_UNIT = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?)_?(ns|us|ms|s)(?![A-Za-z0-9])")
_DIGITS = re.compile(r"\d+")


@dataclass(frozen=True, slots=True, eq=False)
class ImageFolder:
    """Images of a folder in the order of their stamps.

    Attributes:
        files: n paths.
        stamp_ns: (n,) stamps.
        actuation: name -> (n,) readings; NaN without a reading.
        numbered: whether the stamps only count the images, because no file states them.
    """

    files: tuple[Path, ...]
    stamp_ns: IntArray
    actuation: dict[str, FloatArray]
    numbered: bool = False

    @property
    def frame_count(self) -> int:
        """Number of images."""
        return len(self.files)

    @property
    def file_names(self) -> tuple[str, ...]:
        """Name of each image without its folder."""
        return tuple(path.name for path in self.files)

    def frames(self, view: str = "camera") -> Iterator[Frame]:
        """Yields the images in the order of their stamps."""
        depth = StreamDepth.of_files(self.files)
        for path, stamp in zip(self.files, self.stamp_ns.tolist(), strict=True):
            yield Frame(stamp, read_image(path, depth), view)


class InFolder:
    """Finds the files that a table names in its folder; files elsewhere on the machine are refused."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._root = os.path.realpath(folder)
        self._places: dict[Path, bool] = {}

    def file(self, table: Table, row: int, name: str) -> Path:
        """Returns the path of the file that a table names.

        Args:
            table: the table.
            row: the row that names the file.
            name: name of the file, relative to the folder.

        Raises:
            FileFormatError: there is no such file, or it is outside of the folder, also by a link.
        """
        path = self._folder / name
        try:
            exists, is_link = path.is_file(), path.is_symlink()
        except (OSError, ValueError):  # no file can have this name
            exists, is_link = False, False
        if path.parent not in self._places:  # thousands of images are in few folders
            self._places[path.parent] = self._within(path.parent)
        if not self._places[path.parent] or (is_link and not self._within(path)):
            raise FileFormatError(
                f"{table.path}, {table.place(row)}: {name[:200]!r} is outside of {self._folder}; copy it there and "
                "name it from there"
            )
        if not exists:
            raise FileFormatError(f"{table.path}, {table.place(row)}: there is no image {str(path)[:300]}")
        return path

    def _within(self, path: Path) -> bool:
        """Returns whether ``path``, with its links resolved, is in the folder."""
        try:
            return os.path.commonpath([self._root, os.path.realpath(path)]) == self._root
        except (OSError, ValueError):
            return True  # no file can have this name


def read_folder(folder: Path) -> ImageFolder:
    """Reads the images of a folder in the order of their stamps, or one image file.

    Stamps come from ``stamps.csv`` or ``metadata.csv`` (``file_name`` and a time column such as ``stamp_ns`` or
    ``time_s``; further columns NAME_UNIT are actuation), else from the names: ``SECONDS-NANOSECONDS``, a number with
    its unit (``123_ns``, ``0.25s``), or a count of nanoseconds, microseconds or milliseconds since 1970. Where no name
    holds a stamp, the images are in the order of the numbers in their names and one second apart.

    Raises:
        FileFormatError: there are no images, or only some names hold stamps.
        TimeError: stamps repeat.
    """
    if folder.is_file():
        return ImageFolder((folder,), _numbered(1), {}, numbered=True)
    for name in _TABLES:
        if (folder / name).exists():
            unsorted = _from_table(folder, open_table(folder / name))
            break
    else:
        unsorted = _from_names(folder)
    order = np.argsort(unsorted.stamp_ns, kind="stable")
    stamps = unsorted.stamp_ns[order]
    files = tuple(unsorted.files[row] for row in order.tolist())
    repeated = np.flatnonzero(np.diff(stamps) == 0)
    if len(repeated):
        first, second = files[int(repeated[0])], files[int(repeated[0]) + 1]
        raise TimeError(f"{folder}: {first.name} and {second.name} carry the same stamp, {stamps[repeated[0]]} ns")
    actuation = {name: values[order] for name, values in unsorted.actuation.items()}
    return ImageFolder(files, stamps, actuation, unsorted.numbered)


def _from_table(folder: Path, table: Table) -> ImageFolder:
    """Returns the images that a table names, in its order; see `read_folder`."""
    in_folder = InFolder(folder)
    files = tuple(in_folder.file(table, row, name) for row, name in enumerate(table.text("file_name")))
    if "session" in table.columns and len(set(table.text("session"))) > 1:
        raise InputError(f"{table.path}: holds several sessions; a source of events is one; use it as a dataset folder")
    stamps = table.stamps_ns()
    times = table.time_columns()
    names = [name for name in table.columns if is_actuation(name) and name not in times]
    actuation = {name: table.numbers(name, may_be_empty=True) for name in names}
    for name, values in actuation.items():
        check_actuation(table, name, values)
    if stamps is None:
        return ImageFolder(files, _numbered(len(files)), actuation, numbered=True)
    return ImageFolder(files, stamps, actuation)


def _numbered(count: int) -> IntArray:
    return np.arange(count, dtype=np.int64) * STILL_STEP_NS


def _from_names(folder: Path) -> ImageFolder:
    """Returns the images of a folder with the stamps in their names, else in the order of the numbers in them."""
    images = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES and path.is_file()]
    files = tuple(sorted(images, key=_by_number))
    if not files:
        raise FileFormatError(f"{folder}: holds no images ({', '.join(sorted(IMAGE_SUFFIXES))})")
    stamps = [_stamp_of(path) for path in files]
    stated = [stamp for stamp in stamps if stamp is not None]
    if not stated:
        _warn_of_order(folder, files)
        return ImageFolder(files, _numbered(len(files)), {}, numbered=True)
    if len(stated) < len(files):
        path = files[stamps.index(None)]
        raise FileFormatError(
            f"{path}: its name holds no time stamp (seconds-nanoseconds, or a number with its unit: 41666667_ns), as "
            f"others in {path.parent} do; write the stamps into {path.parent / 'stamps.csv'} with the columns "
            "file_name,stamp_ns"
        )
    return ImageFolder(files, np.array(stated, dtype=np.int64), {})


def _by_number(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Returns a key that sorts image2 before image10."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name


def _warn_of_order(folder: Path, files: Sequence[Path]) -> None:
    """Warns about the order of the images where their names in alphabetical order have another one."""
    for number, (image, by_letters) in enumerate(zip(files, sorted(files), strict=True), start=1):
        if image != by_letters:
            warnings.warn(
                f"{folder}: its {len(files)} images are taken in the order of the numbers in their names, "
                f"{files[0].name} to {files[-1].name}: image {number} is {image.name}, not {by_letters.name}; for "
                f"another order write a {_TABLES[0]} with the columns file_name,stamp_ns",
                stacklevel=1,
            )
            return


def _stamp_of(path: Path) -> int | None:
    """Returns the stamp in the name of a file, ns; None where it has none. See `read_folder` for the forms."""
    name = path.stem
    if pair := _SEC_NANOSEC.search(name):
        return int(pair[1]) * 1_000_000_000 + int(pair[2])
    if with_unit := _WITH_UNIT.search(name):
        factor = TIME_UNITS[with_unit[2]]
        return int(with_unit[1]) * factor if with_unit[1].isdigit() else round(float(with_unit[1]) * factor)
    longest = max(_DIGITS.findall(name), key=len, default="")
    if len(longest) >= 12:  # since 1970: milliseconds have 12 or 13 digits, micro 15 or 16, nano 18 or 19
        return int(longest) * (1 if len(longest) >= 18 else 1_000 if len(longest) >= 15 else 1_000_000)
    return None
