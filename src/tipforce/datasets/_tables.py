"""Reading numbers out of CSV files, with errors that name row and column."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import FileFormatError, TableError, TimeError
from ..types import FloatArray, IntArray

__all__ = ["CsvTable", "check_stamps"]


class CsvTable:
    """A CSV file with a header; row numbers in errors count the header as row 1, as a spreadsheet does."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise FileFormatError(f"{path}: there is no such file")
        try:
            with path.open(newline="", encoding="utf-8-sig") as stream:
                rows = [row for row in csv.reader(stream) if row]
        except (UnicodeDecodeError, csv.Error) as error:
            raise FileFormatError(f"{path}: is no CSV text file in UTF-8 ({error}); save it as one") from None
        if not rows:
            raise FileFormatError(f"{path}: is empty; expected a header and rows")
        self.columns = [name.strip() for name in rows[0]]
        if len(self.columns) == 1 and (";" in rows[0][0] or "\t" in rows[0][0]):
            raise TableError(f"{path}: columns must be parted by commas; the header reads {rows[0][0]!r}")
        twice = sorted({name for name in self.columns if self.columns.count(name) > 1})
        if twice:
            raise TableError(f"{path}: the column {twice[0]!r} is there twice")
        self._rows = rows[1:]
        if not self._rows:
            raise TableError(f"{path}: has a header but no rows")
        for number, row in enumerate(self._rows, 2):
            if len(row) != len(self.columns):
                hint = "; a decimal comma?" if len(row) > len(self.columns) else ""
                raise TableError(f"{path}, row {number}: has {len(row)} cells, expected {len(self.columns)}{hint}")

    def __len__(self) -> int:
        return len(self._rows)

    def place(self, row: int) -> str:
        """What a spreadsheet calls the ``row``-th row."""
        return f"row {row + 2}"

    def require(self, names: Sequence[str]) -> None:
        """Raises TableError that names the first missing column and those there are."""
        for name in names:
            if name not in self.columns:
                raise TableError(f"{self.path}: has no column {name!r}; its columns are {', '.join(self.columns)}")

    def text(self, name: str) -> list[str]:
        """The cells of one column."""
        self.require([name])
        place = self.columns.index(name)
        return [row[place].strip() for row in self._rows]

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """(n,) of one column, NaN for an empty cell where that is allowed.

        Raises TableError for a cell that is empty, no number, or not finite.
        """
        cells = self.text(name)
        values = np.empty(len(cells))
        for index, cell in enumerate(cells):
            if may_be_empty and not cell:
                values[index] = math.nan
                continue
            try:
                value = float(cell)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                hint = "write a decimal point, not a comma" if "," in cell else "correct the row or remove it"
                raise TableError(
                    f"{self.path}, row {index + 2}, column {name}: expected a finite number, got {cell[:40]!r}; {hint}"
                )
            values[index] = value
        return values

    def integers(self, name: str) -> IntArray:
        """(n,) of one column of whole numbers, exact to the last nanosecond. Raises TableError."""
        cells = self.text(name)
        values = np.empty(len(cells), np.int64)
        for index, cell in enumerate(cells):
            try:
                values[index] = int(cell)
            except (ValueError, OverflowError):
                raise TableError(
                    f"{self.path}, row {index + 2}, column {name}: expected a whole number, got {cell!r}"
                ) from None
        return values


def check_stamps(where: str, session: str, stamps: IntArray) -> None:
    """Raises TimeError where two samples of one session have the same stamp; ``stamps`` sorted."""
    same = np.flatnonzero(np.diff(stamps) == 0)
    if len(same):
        raise TimeError(
            f"{where}: session {session} has two samples with the stamp {int(stamps[same[0]])} ns; give each its own"
        )
