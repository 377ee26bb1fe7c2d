"""Reads tables of numbers from laboratories: force logs, drives, stamps, ``metadata.csv``, published datasets.

Separator (comma, semicolon, tab, blanks), decimal sign and encoding (UTF-8 with or without a byte order mark, UTF-16,
Windows) are found from the file. Columns without a name, such as the empty ones that spreadsheets leave at the end, are
not read. Errors count lines from 1, as an editor does.
"""

import csv
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain, islice
from pathlib import Path

import numpy as np

from ...errors import TableError
from ...types import FloatArray, IntArray, LogInfo
from ._columns import listed
from ._layout import MISSING, Layout, holds_data, open_text, parsed
from ._stamps import column_ns, named_unit, time_columns

_WHOLE = re.compile(r"^[+-]?\d+$")


class Table:
    """A table with a header row.

    Attributes:
        path: The file.
        header: Names of all columns, empty for those without one.
        columns: Names of the columns that have one.
        units: Column -> unit, where a row below the header states units.
        facts: Name, in small letters, -> value, from lines above the header.
    """

    unit_of_place = "line"

    def __init__(self, path: Path, layout: Layout, log: LogInfo | None = None, key: str = "") -> None:
        self.path, self._layout, self._key = path, layout, key
        self.header = layout.header
        self.columns = tuple(name for name in layout.header if name)
        self.units: Mapping[str, str] = layout.units
        self.facts: Mapping[str, str] = layout.facts
        missing = log.missing if log else ()
        self._narrow = False  # whether no row was found to have more cells than the header
        self._missing = MISSING | {text.lower() for text in missing}
        self._missing_values = [value for text in missing if (value := self._value(text)) is not None]
        self._lines = (1, math.inf) if log is None or log.lines is None else log.lines

    def __len__(self) -> int:
        return len(self._rows)

    @cached_property
    def _rows(self) -> list[tuple[int, list[str]]]:
        rows = list(self.lines())
        if not rows:
            raise self.no_rows()
        return rows

    def no_rows(self) -> TableError:
        """Returns the error for a table without rows."""
        if self._lines != (1, math.inf):
            return TableError(
                f"{self.path}: has no rows in the lines {self._lines[0]} to {self._lines[1]:g}; see {self._key}.lines "
                "in bench.toml"
            )
        return TableError(f"{self.path}: has a header but no rows")

    def lines(self) -> Iterator[tuple[int, list[str]]]:
        """Yields line number and cells of every row of data; skips blank lines, and comments (#) where allowed.

        Raises TableError for a row with more cells than the header has columns; in a log these may be words.
        """
        width, layout = len(self.header), self._layout
        with open_text(self.path, layout.encoding) as stream:
            try:
                for number, row in parsed(enumerate(stream, start=1), layout.separator, layout.above, layout.comments):
                    if number < self._lines[0]:
                        continue
                    if number > self._lines[1]:
                        break
                    if layout.pairs and len(row) == 2 * width:
                        row = [f"{whole},{part}" for whole, part in zip(row[::2], row[1::2], strict=True)]
                    if len(row) > width and any(map(self._may_be_number, row[width:])):
                        raise TableError(f"{self.path}, line {number}: {self._too_wide(number, row)}")
                    yield number, row
            except csv.Error as error:
                raise TableError(f"{self.path}: is no table that can be read ({error}); export it as CSV") from None

    def _may_be_number(self, cell: str) -> bool:
        """Returns whether a cell beyond the header may be part of a number; a remark in a log is none."""
        return bool(cell) and (not self._key or cell[0].isdigit())

    def _too_wide(self, number: int, row: Sequence[str]) -> str:
        remedy = "a decimal comma? export with semicolons or with decimal points"
        if self._key:
            remedy += f", or import the rows above: {self._key}.lines = [1, {number - 1}] in bench.toml"
        return f"has {len(row)} cells, the header has {len(self.header)}; {remedy}"

    def place(self, row: int) -> str:
        """Returns the position of row ``row`` of the data in the file, for messages."""
        return f"{self.unit_of_place} {self._rows[row][0]}"

    def column(self, name: str) -> int:
        """Returns the index of a column. Raises TableError with a list of the columns if it is missing."""
        if name not in self.columns:
            raise TableError(f"{self.path}: has no column {name!r}; it has {listed(self.columns)}")
        return self.header.index(name)

    def text(self, name: str) -> list[str]:
        """Returns a column as text."""
        column = self.column(name)
        return [self._cell(row, line, column) for line, row in self._rows]

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """Returns a column (n,) of finite numbers.

        Args:
            name: the column's name.
            may_be_empty: whether an empty cell is allowed; it is NaN then.

        Raises:
            TableError: a cell holds no number; the message names line and column.
        """
        if not may_be_empty:
            return self.matrix([name])[:, 0]
        column = self.column(name)
        return np.array(
            [
                self._number(row, line, column) if column < len(row) and row[column] else math.nan
                for line, row in self._rows
            ]
        )

    def matrix(self, names: Sequence[str]) -> FloatArray:
        """Returns (n, len(names)) finite numbers. Raises TableError with line and column of a cell that holds none."""
        columns = [self.column(name) for name in names]
        # the rows are cached where they were read before
        values = None if "_rows" in vars(self) else self._fast(columns, np.float64)
        if values is None or not np.isfinite(values).all():
            values = np.array([[self._number(row, line, column) for column in columns] for line, row in self._rows])
        if not len(values):
            raise self.no_rows()
        return values.reshape(-1, len(columns))

    def readings(self, names: Sequence[str]) -> FloatArray:
        """Returns (n, len(names)) numbers; NaN where a cell is empty, missing or states that there is no reading.

        Raises TableError with line and column of a cell that holds another text.
        """
        columns = [self.column(name) for name in names]
        values = self._fast(columns, np.float64)
        if values is None or np.isinf(values).any():
            values = np.stack([self._readings_of(name) for name in names], axis=1)
        if not len(values):
            raise self.no_rows()
        values = values.reshape(-1, len(columns))
        values[np.isin(values, self._missing_values)] = math.nan
        return values

    def cells(self, name: str) -> list[str]:
        """Returns the (n,) cells of a column; empty where a row is too short."""
        column = self.column(name)
        return [row[column] if column < len(row) else "" for _, row in self._rows]

    def _readings_of(self, name: str) -> FloatArray:
        """Returns the (n,) `readings` of one column, cell by cell."""
        cells = self.cells(name)
        if not (self._layout.decimal_comma or self._layout.thousands):
            try:
                values = np.array(list(map(float, cells)))
                if np.isfinite(values).all():
                    return values
            except ValueError:
                pass
        readings = np.empty(len(cells))
        for row, cell in enumerate(cells):
            value = self._value(cell)
            if value is None and cell.lower() not in self._missing:
                raise TableError(f"{self.path}, {self.place(row)}, column {name}: {self._no_number(cell)}")
            readings[row] = math.nan if value is None or cell.lower() in self._missing else value
        return readings

    def _no_number(self, cell: str) -> str:
        """Returns the message for the text of a cell that is no number: fault and remedy."""
        if "," in cell and re.match(r"^[+-]?\d*,\d+$", cell):
            fault = f"{cell!r} has a decimal comma where the rows above have a point"
        else:
            fault = f"expected a number, got {cell[:40]!r}"
        return (
            f'{fault}; if it means that there is no reading, state {self._key}.missing = ["{cell[:40]}"] in bench.toml'
        )

    def _value(self, text: str) -> float | None:
        """Returns the finite number in a cell; None for another text."""
        layout = self._layout
        if layout.thousands and layout.thousands in text:
            sign = re.escape(layout.thousands)
            if not re.match(rf"^[+-]?\d{{1,3}}(?:{sign}\d{{3}})+(?:[.,]\d*)?$", text):
                return None
            text = text.replace(layout.thousands, "")
        try:
            value = float(text.replace(",", ".") if layout.decimal_comma else text)
        except ValueError:
            return None
        return value if math.isfinite(value) else None

    def whole_numbers(self, name: str) -> IntArray | None:
        """Returns a column (n,) of whole numbers, exact beyond 2**53; None where it holds others."""
        if not _WHOLE.match(self.first(name)):
            return None
        values = self._fast([self.column(name)], np.int64)
        if values is not None:
            return values[:, 0]
        try:
            return np.array([int(cell) for cell in self.cells(name)], np.int64)
        except (ValueError, OverflowError):
            return None

    def integers(self, name: str) -> IntArray:
        """Returns a column (n,) of whole numbers, exact beyond 2**53. Raises TableError with line and column."""
        values = self.whole_numbers(name)
        if values is not None:
            return values
        for row, cell in enumerate(self.text(name)):
            try:
                int(cell)
            except ValueError:
                raise TableError(
                    f"{self.path}, {self.place(row)}, column {name}: expected a whole number, got {cell[:40]!r}"
                ) from None
        raise TableError(f"{self.path}, column {name}: expected whole numbers of at most 64 bits")

    def codes(self, name: str) -> IntArray:
        """Returns a column (n,) of status codes, decimal or hexadecimal (0x8000); 0 for an empty cell.

        Raises TableError with line and column of a cell that holds none.
        """
        hexadecimal = "hex" in name.lower()
        codes: dict[str, int] = {"": 0}
        cells = self.cells(name)
        for row, cell in enumerate(cells):
            if cell not in codes:
                code = _code(cell, hexadecimal=hexadecimal)
                if code is None:
                    without_codes = ", ".join('""' if column == name else f'"{column}"' for column in self.header)
                    raise TableError(
                        f"{self.path}, {self.place(row)}, column {name}: expected a status code, got {cell[:40]!r}; "
                        f"state the column of the codes in bench.toml: {self._key}.status; or read none: "
                        f"{self._key}.columns = [{without_codes}]"
                    )
                codes[cell] = code
        return np.array([codes[cell] for cell in cells], np.int64)

    def time_columns(self) -> tuple[str, ...]:
        """Returns the columns of the times; none if no column has the name of a time. Raises TableError for several."""
        names = time_columns(self.columns)
        if len(names) > 1 and names != ("sec", "nanosec"):
            raise TableError(
                f"{self.path}: has several columns that may be the time ({listed(names)}); call one stamp_ns, and "
                "begin the others' names with note_"
            )
        return names

    def stamps_ns(self) -> IntArray | None:
        """Returns the (n,) stamps; None if the table has none. Raises TableError for a cell that is no time."""
        names = self.time_columns()
        if not names:
            return None
        if "stamp_ns" in names:
            return self.integers("stamp_ns")
        name = names[0]
        unit = "ns" if len(names) > 1 else named_unit(name)
        return column_ns(self, names, unit)

    def first(self, name: str) -> str:
        """Returns the first cell of a column that is not empty; empty if all are."""
        index = self.column(name)
        return next((row[index] for _, row in self.lines() if index < len(row) and row[index]), "")

    def _fast(self, columns: list[int], kind: type[np.float64] | type[np.int64]) -> "np.ndarray | None":  # type: ignore[type-arg]
        """Returns the numbers (n, len(columns)) of columns, read by NumPy, twenty times faster than cell by cell.

        None where NumPy fails: reading cell by cell then finds the cell at fault.
        """
        layout = self._layout
        if layout.thousands or layout.pairs or (layout.decimal_comma and layout.separator == ","):
            return None
        first_line, last_line = max(layout.above, self._lines[0] - 1), self._lines[1]
        with open_text(self.path, layout.encoding) as stream:
            stated_lines = islice(stream, first_line, None if last_line == math.inf else int(last_line))
            lines = (line.replace(",", ".") for line in stated_lines) if layout.decimal_comma else stated_lines
            if self._key and layout.separator != " " and not self._narrow:  # a log; NumPy ignores further cells
                lines = _no_wider(lines, layout.separator, len(self.header))
            delimiter = None if layout.separator == " " else layout.separator
            comments = "#" if layout.comments else None
            try:
                first = next((line for line in lines if holds_data(line, layout.comments)), None)
                if first is None:  # NumPy warns of an empty file
                    return np.empty((0, len(columns)), kind)
                values = np.loadtxt(
                    chain([first], lines),
                    dtype=kind,
                    delimiter=delimiter,
                    usecols=columns,
                    ndmin=2,
                    quotechar='"',
                    comments=comments,
                )
                self._narrow = True
                return values
            except (ValueError, OverflowError):
                return None

    def _cell(self, row: list[str], line: int, column: int) -> str:
        if column >= len(row):
            raise TableError(
                f"{self.path}, {self.unit_of_place} {line}: has {len(row)} cells, the header has {len(self.header)} "
                f"({self.header[column]} is missing); complete the row or remove it"
            )
        return row[column]

    def _number(self, row: list[str], line: int, column: int) -> float:
        """Returns the number in cell ``column`` of a row. Raises TableError; ``line`` is its position in the file."""
        text = self._cell(row, line, column)
        value = self._value(text)
        if value is None:
            if "," in text and re.match(r"^[+-]?\d*,\d+$", text):
                fault = f"{text!r} has a decimal comma where the rows above have a point; write one of the two"
            elif text:
                fault = f"expected a number, got {text[:40]!r}; correct the row or remove it"
            else:
                fault = "is empty; correct the row or remove it"
            raise TableError(f"{self.path}, {self.unit_of_place} {line}, column {self.header[column]}: {fault}")
        return value


def _no_wider(lines: Iterable[str], separator: str, width: int) -> Iterator[str]:
    """Yields the lines. Raises ValueError at one that seems to have more than ``width`` cells.

    Counting separators is fast. Only a line with quotes, in which a separator may be text, is split in full. One
    separator at the end of a line is allowed.
    """
    for line in lines:
        count = line.count(separator)
        if count >= width and '"' in line:
            count = len(next(csv.reader([line], delimiter=separator, skipinitialspace=True))) - 1
        if count > width or (count == width and not line.rstrip("\r\n").endswith(separator)):
            raise ValueError(line)
        yield line


def _code(text: str, *, hexadecimal: bool) -> int | None:
    """Returns the status code in a cell, as "0x8000", "128" or "128.0"; None for another text.

    ``hexadecimal``: whether digits without 0x are hexadecimal.
    """
    try:
        if text[:2].lower() == "0x" or (hexadecimal and "." not in text):
            code = int(text, 16)
        else:
            number = int(text) if text.lstrip("+-").isdigit() else float(text)
            code = int(number) if float(number).is_integer() else -1
    except (ValueError, OverflowError):
        return None
    return code if 0 <= code < 1 << 63 else None
