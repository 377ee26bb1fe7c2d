"""Tables of numbers as laboratories write them: comma, semicolon, tab or blanks; decimal point or comma."""

import codecs
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from ..errors import FileFormatError, TableError
from ..types import FloatArray, IntArray

__all__ = ["Table", "listed", "open_table"]

_SEPARATORS = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "blank"}
_SAMPLE = 1 << 20
"""Bytes that tell how a file is written."""
_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")


@dataclass(frozen=True, slots=True)
class Table:
    """A table with a header row. ``header_line``: its number, counted from 1; ``encoding``: of the file's text."""

    path: Path
    header: tuple[str, ...]
    separator: str
    decimal_comma: bool
    header_line: int
    encoding: str

    def lines(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of every row of data; blank lines and comments (#) are passed over."""
        with _text(self.path, self.encoding) as stream:
            for number, line in enumerate(stream, start=1):
                if number > self.header_line and line.strip() and not line.lstrip().startswith("#"):
                    yield number, _cells(line, self.separator)

    def column(self, name: str) -> int:
        """Place of a column. Raises TableError that lists those there are."""
        if name not in self.header:
            raise TableError(f"{self.path}: has no column {name!r}; it has {listed(self.header)}")
        return self.header.index(name)

    def numbers(self, names: Sequence[str]) -> FloatArray:
        """(n, len(names)): finite numbers. Raises TableError naming line and column of one that is not."""
        columns = [self.column(name) for name in names]
        values = self._fast(columns, np.float64)
        if values is None or not np.isfinite(values).all():
            values = np.array([[self._number(row, line, column) for column in columns] for line, row in self.lines()])
        if not len(values):
            raise TableError(f"{self.path}: has a header but no rows")
        return values.reshape(-1, len(columns))

    def integers(self, name: str) -> IntArray | None:
        """(n,): a column of whole numbers, exact beyond 2**53; None where it holds others."""
        values = self._fast([self.column(name)], np.int64)
        return None if values is None else values[:, 0]

    def words(self, name: str) -> list[str]:
        """A column as text."""
        column = self.column(name)
        return [self._cell(row, line, column) for line, row in self.lines()]

    def _fast(self, columns: list[int], kind: type[np.float64] | type[np.int64]) -> "np.ndarray | None":  # type: ignore[type-arg]
        """NumPy's own parser, twenty times faster; None where it stumbles, and the slow way finds out over what."""
        with _text(self.path, self.encoding) as stream:
            for _ in range(self.header_line):
                next(stream)
            lines = (line.replace(",", ".") for line in stream) if self.decimal_comma else stream
            delimiter = None if self.separator == " " else self.separator
            try:
                first = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), None)
                if first is None:
                    return np.empty((0, len(columns)), kind)
                return np.loadtxt(
                    _after(first, lines), dtype=kind, delimiter=delimiter, usecols=columns, ndmin=2, quotechar='"'
                )
            except (ValueError, OverflowError):
                return None

    def _cell(self, row: list[str], line: int, column: int) -> str:
        if column >= len(row):
            raise TableError(
                f"{self.path}, line {line}: has {len(row)} cells, the header has {len(self.header)} "
                f"({self.header[column]} is missing); complete the row or remove it"
            )
        return row[column]

    def _number(self, row: list[str], line: int, column: int) -> float:
        text = self._cell(row, line, column)
        place = f"{self.path}, line {line}, column {self.header[column]}"
        try:
            value = float(text.replace(",", ".") if self.decimal_comma else text)
        except ValueError:
            if "," in text and _NUMBER.match(text):
                raise TableError(
                    f"{place}: {text!r} has a decimal comma where the rows above have a point; write one of the two"
                ) from None
            said = f"expected a number, got {text[:40]!r}" if text else "is empty"
            raise TableError(f"{place}: {said}; correct the row or remove it") from None
        if not math.isfinite(value):
            raise TableError(f"{place}: expected a number, got {text[:40]!r}; correct the row or remove it")
        return value


def _after(first: str, lines: Iterator[str] | IO[str]) -> Iterator[str]:
    yield first
    yield from lines


def listed(names: Sequence[str]) -> str:
    """Names of columns as an error shows them: not all of two hundred."""
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")


def _text(path: Path, encoding: str) -> IO[str]:
    return path.open(encoding=encoding, errors="replace", newline=None)


def _encoding(path: Path) -> str:
    """How the text of ``path`` is written: UTF-8, what Excel calls Unicode (UTF-16), else the Windows code page.

    Raises FileFormatError for what is no text.
    """
    with path.open("rb") as stream:
        sample = stream.read(_SAMPLE)
    if sample.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if b"\0" in sample:
        raise FileFormatError(f"{path}: is no text table; export it as CSV")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        if sum(byte > 127 for byte in sample[:4096]) > 0.3 * min(len(sample), 4096):
            raise FileFormatError(f"{path}: is no text table; export it as CSV") from None
        return "cp1252"
    return "utf-8-sig"


def _cells(line: str, separator: str) -> list[str]:
    parts = line.split() if separator == " " else line.rstrip("\n").split(separator)
    return [part.strip().strip('"').strip() for part in parts]


def open_table(path: Path) -> Table:
    """Find separator, header and decimal sign by looking at the first rows.

    Raises FileFormatError for what is no text, TableError where the header or the decimal sign cannot be told.
    """
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    if path.is_dir():
        raise FileFormatError(f"{path}: is a folder; name the table in it")
    encoding = _encoding(path)
    with _text(path, encoding) as stream:
        head = [(number, line) for number, line in zip(range(1, 200), stream, strict=False) if line.strip()]
    rows = [(number, line) for number, line in head if not line.lstrip().startswith("#")]
    if not rows:
        raise FileFormatError(f"{path}: the file is empty, not a table")
    header_line, first = rows[0]
    separator = next((sign for sign in _SEPARATORS if sign in first.strip()), ",")
    header = _cells(first, separator)
    if any(_NUMBER.match(cell) for cell in header):
        raise TableError(
            f"{path}, line {header_line}: expected the names of the columns, got {first.strip()[:60]!r}; write a "
            "header row, for example time_s,fx_n,fy_n"
        )
    doubled = {name for name in header if name and header.count(name) > 1}
    if doubled:
        raise TableError(f"{path}, line {header_line}: the column {min(doubled)!r} appears twice; rename one")
    comma = _decimal_comma(path, separator, header, rows[1:])
    return Table(path, tuple(header), separator, comma, header_line, encoding)


def _decimal_comma(path: Path, separator: str, header: list[str], rows: list[tuple[int, str]]) -> bool:
    body = [(number, _cells(line, separator)) for number, line in rows]
    if separator == ",":
        for number, cells in body[:1]:
            if len(cells) == 2 * len(header) or (len(cells) > len(header) and any(cells[len(header) :])):
                raise TableError(
                    f"{path}, line {number}: has {len(cells)} cells for {len(header)} columns: commas seem to be both "
                    "decimal sign and separator; export with semicolons or with decimal points"
                )
        return False
    numbers = [cell for _, cells in body for cell in cells if _NUMBER.match(cell)]
    comma = sum("," in cell for cell in numbers)
    return comma > 0 and not any("." in cell for cell in numbers)
