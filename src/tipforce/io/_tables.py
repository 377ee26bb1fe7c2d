"""One reader for tables of numbers as laboratories write them: force logs, drives, stamps, ``metadata.csv``, layouts.

Separator (comma, semicolon, tab, blanks), decimal sign and encoding (UTF-8 with or without a byte order mark, UTF-16,
Windows) are found by looking at the file. Columns without a name, such as the empty ones that spreadsheets leave at the
end, are not read. Lines in errors are counted from 1, as an editor does.
"""

import codecs
import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import IO, Literal, Protocol

import numpy as np

from ..errors import FileFormatError, TableError, TimeError
from ..types import FloatArray, IntArray, actuation_range

__all__ = [
    "ACTUATION_UNITS",
    "MAX_STAMP_S",
    "STILL_STEP_NS",
    "TIME_UNITS",
    "Table",
    "TimeUnit",
    "check_actuation",
    "is_actuation",
    "is_force",
    "listed",
    "open_table",
    "rising",
    "time_column",
    "times_ns",
]

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: dict[str, int] = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds in one of each unit."""

MAX_STAMP_S = 2**31
"""ROS messages hold seconds in 32 bits with a sign."""

STILL_STEP_NS = 1_000_000_000
"""Images without stamps are taken one second apart, in the order of their rows or names."""

ACTUATION_UNITS = (
    *("deg", "rad", "mm", "um", "m", "px", "kpa", "pa", "bar", "v", "a", "ma", "n", "mn", "nmm"),
    *("count", "steps", "percent"),
)
"""What the name of an actuation column may end in: NAME_UNIT."""

SEC_NANOSEC = "sec+nanosec"
"""Stands for the pair of columns that ROS tools write."""

_SEPARATORS = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "blank"}
_SAMPLE = 1 << 20
"""Bytes that tell how a file is written; a line is shorter."""
_GZIP = b"\x1f\x8b"
_MOST_COLUMNS = 10_000
_FIRST_YEAR, _LAST_YEAR = 1970, 2037
_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_FORCE = re.compile(r"^[ft][xyz]_[a-z]+$", re.IGNORECASE)
_TIME = re.compile(r"^(?:t|time|stamp|timestamp|zeit|elapsed)(?:[ _]*[\[(]?(s|sec|seconds|ms|us|µs|ns)[\])]?)?$")
_DATE = re.compile(r"^(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:\.\d{1,9})?)\s*(Z|([+-])(\d\d):?(\d\d))?$")
_UNITS = {"sec": "s", "seconds": "s", "µs": "us"}


def is_force(column: str) -> bool:
    """Whether a column is a label by its name: a force or torque such as ``fx_n``, ``tz_nmm``."""
    return bool(_FORCE.match(column))


def is_actuation(column: str) -> bool:
    """Whether a column holds readings of a drive by its name: NAME_UNIT, and no label.

    >>> [name for name in ("knob_deg", "fx_n", "note_mm", "speed") if is_actuation(name)]
    ['knob_deg']
    """
    name, _, unit = column.rpartition("_")
    return bool(name) and unit.lower() in ACTUATION_UNITS and not is_force(column) and not column.startswith("note_")


class Table:
    """A table with a header row.

    Attributes:
        path: The file.
        header: Names of all columns, empty for those without one.
        columns: The names that there are.
        separator: "," ";" a tab or a blank.
        decimal_comma: Whether numbers are written with a comma.
    """

    def __init__(
        self,
        path: Path,
        header: Sequence[str],
        *,
        separator: str,
        decimal_comma: bool,
        header_line: int,
        encoding: str,
        comments: bool,
    ) -> None:
        self.path, self.header, self.separator, self.decimal_comma = path, tuple(header), separator, decimal_comma
        self.columns = tuple(name for name in header if name)
        self._header_line, self._encoding, self._comments = header_line, encoding, comments

    def __len__(self) -> int:
        return len(self._rows)

    @cached_property
    def _rows(self) -> list[tuple[int, list[str]]]:
        rows = list(self.lines())
        if not rows:
            raise TableError(f"{self.path}: has a header but no rows")
        return rows

    def lines(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of every row of data; blank lines are passed over, and comments (#) where allowed.

        Raises TableError for a row with more cells than the header has columns.
        """
        width = len(self.header)
        with _text(self.path, self._encoding) as stream:
            try:
                for number, row in _parsed(
                    enumerate(stream, start=1), self.separator, self._header_line, self._comments
                ):
                    if len(row) > width and any(row[width:]):
                        raise TableError(
                            f"{self.path}, line {number}: has {len(row)} cells, the header has {width}; a decimal "
                            "comma? export with semicolons or with decimal points"
                        )
                    yield number, row
            except csv.Error as error:
                raise TableError(f"{self.path}: is no table that can be read ({error}); export it as CSV") from None

    def place(self, row: int) -> str:
        """Where a person finds the ``row``-th row of data."""
        return f"line {self._rows[row][0]}"

    def column(self, name: str) -> int:
        """Index of a column. Raises TableError that lists those there are."""
        if name not in self.columns:
            raise TableError(f"{self.path}: has no column {name!r}; it has {listed(self.columns)}")
        return self.header.index(name)

    def text(self, name: str) -> list[str]:
        """A column as text."""
        column = self.column(name)
        return [self._cell(row, line, column) for line, row in self._rows]

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """(n,): a column of finite numbers; NaN for an empty cell where that is allowed.

        Raises TableError that names line and column of what is none.
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
        """(n, len(names)): finite numbers. Raises TableError that names line and column of what is none."""
        columns = [self.column(name) for name in names]
        values = None if "_rows" in vars(self) else self._fast(columns, np.float64)
        if values is None or not np.isfinite(values).all():
            values = np.array([[self._number(row, line, column) for column in columns] for line, row in self._rows])
        if not len(values):
            raise TableError(f"{self.path}: has a header but no rows")
        return values.reshape(-1, len(columns))

    def whole_numbers(self, name: str) -> IntArray | None:
        """(n,): a column of whole numbers, exact beyond 2**53; None where it holds others."""
        values = self._fast([self.column(name)], np.int64)
        return None if values is None else values[:, 0]

    def integers(self, name: str) -> IntArray:
        """(n,): a column of whole numbers, exact beyond 2**53. Raises TableError that names line and column."""
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

    def time_columns(self) -> tuple[str, ...]:
        """The columns that hold the rows' times; none where nothing is called a time. Raises TableError for several."""
        if "stamp_ns" in self.columns:
            return ("stamp_ns",)
        if {"sec", "nanosec"} <= set(self.columns):
            return ("sec", "nanosec")
        fitting = tuple(column for column in self.columns if _TIME.match(column.lower()))
        if len(fitting) > 1:
            raise TableError(
                f"{self.path}: has several columns that may be the time ({listed(fitting)}); call one stamp_ns, and "
                "begin the others' names with note_"
            )
        return fitting

    def stamps_ns(self) -> IntArray | None:
        """(n,) stamps; None where the table has none. Raises TableError for what is no time."""
        names = self.time_columns()
        if not names:
            return None
        if "stamp_ns" in names:
            return self.integers("stamp_ns")
        return times_ns(self, *time_column(self, None if len(names) > 1 else next(iter(names)), None))

    def _fast(self, columns: list[int], kind: type[np.float64] | type[np.int64]) -> "np.ndarray | None":  # type: ignore[type-arg]
        """NumPy's own parser, twenty times faster; None where it stumbles, and the slow way finds out over what."""
        with _text(self.path, self._encoding) as stream:
            for _ in range(self._header_line):
                next(stream)
            lines = (line.replace(",", ".") for line in stream) if self.decimal_comma else stream
            delimiter = None if self.separator == " " else self.separator
            comments = "#" if self._comments else None
            try:
                first = next((line for line in lines if _holds_data(line, self._comments)), None)
                if first is None:
                    return np.empty((0, len(columns)), kind)
                return np.loadtxt(
                    chain([first], lines),
                    dtype=kind,
                    delimiter=delimiter,
                    usecols=columns,
                    ndmin=2,
                    quotechar='"',
                    comments=comments,
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


def listed(names: Sequence[str]) -> str:
    """Names of columns as an error shows them: not all of two hundred."""
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")


def _text(path: Path, encoding: str) -> IO[str]:
    return path.open(encoding=encoding, errors="replace", newline=None)


def _encoding(path: Path) -> str:
    """How the text of ``path`` is written: UTF-8, what Excel calls Unicode (UTF-16), else the Windows code page.

    Raises FileFormatError for what is no text, or has a line that no table has.
    """
    with path.open("rb") as stream:
        sample = stream.read(_SAMPLE)
        wide = sample.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        if sample.startswith(_GZIP):
            raise FileFormatError(f"{path}: is compressed (gzip); unpack it first")
        block, at = sample, 0
        while block:
            if not wide and (place := block.find(b"\0")) >= 0:
                raise FileFormatError(f"{path}: is no text table (byte {at + place} is 0); export it as CSV")
            if len(block) == _SAMPLE and b"\n" not in block and b"\r" not in block:
                raise FileFormatError(
                    f"{path}: has a line of more than {_SAMPLE >> 20} MiB (at byte {at}), which no table has; export "
                    "it as CSV"
                )
            at += len(block)
            block = stream.read(_SAMPLE)
    if wide:
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        if sum(byte > 127 for byte in sample[:4096]) > 0.3 * min(len(sample), 4096):
            raise FileFormatError(f"{path}: is no text table; export it as CSV") from None
        return "cp1252"
    return "utf-8-sig"


def _holds_data(line: str, comments: bool) -> bool:
    return bool(line.strip()) and not (comments and line.lstrip().startswith("#"))


def _parsed(
    lines: Iterable[tuple[int, str]], separator: str, after: int, comments: bool
) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of the rows behind line ``after``."""
    number = 0

    def kept() -> Iterator[str]:
        nonlocal number
        for number, line in lines:
            if number > after and _holds_data(line, comments):
                yield line

    if separator == " ":
        for line in kept():
            yield number, line.split()
    else:
        for cells in csv.reader(kept(), delimiter=separator, skipinitialspace=True):
            yield number, [cell.strip() for cell in cells]


def open_table(path: Path, *, comments: bool = True) -> Table:
    """Finds separator, header and decimal sign by looking at the first rows.

    Args:
        path: The file.
        comments: Whether lines that begin with # are passed over.

    Raises:
        FileFormatError: for what is no text.
        TableError: where the header or the decimal sign cannot be determined.
    """
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    if path.is_dir():
        raise FileFormatError(f"{path}: is a folder; name the table in it")
    encoding = _encoding(path)
    with _text(path, encoding) as stream:
        head = [(number, line) for number, line in zip(range(1, 200), stream, strict=False)]
    first_line, first = next(((number, line) for number, line in head if _holds_data(line, comments)), (0, ""))
    if not first:
        raise FileFormatError(f"{path}: the file is empty, not a table")
    separator = next((sign for sign in _SEPARATORS if sign in first.strip()), ",")
    if first.count(separator) >= _MOST_COLUMNS:
        raise TableError(
            f"{path}, line {first_line}: has {first.count(separator) + 1} columns, at most {_MOST_COLUMNS} are read; "
            "export the columns that are needed"
        )
    try:
        header = next((cells for _, cells in _parsed([(first_line, first)], separator, 0, comments)), [])
    except csv.Error as error:
        raise TableError(f"{path}: is no table that can be read ({error}); export it as CSV") from None
    if any(_NUMBER.match(cell) for cell in header):
        raise TableError(
            f"{path}, line {first_line}: expected the names of the columns, got {first.strip()[:60]!r}; write a "
            "header row, for example time_s,fx_n,fy_n"
        )
    doubled = {name for name, count in Counter(header).items() if name and count > 1}
    if doubled:
        raise TableError(f"{path}, line {first_line}: the column {min(doubled)!r} appears twice; rename one")
    try:
        body = list(_parsed(head, separator, first_line, comments))
    except csv.Error as error:
        raise TableError(f"{path}: is no table that can be read ({error}); export it as CSV") from None
    return Table(
        path,
        header,
        separator=separator,
        decimal_comma=_decimal_comma(path, separator, header, body),
        header_line=first_line,
        encoding=encoding,
        comments=comments,
    )


def _decimal_comma(path: Path, separator: str, header: list[str], body: list[tuple[int, list[str]]]) -> bool:
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


def time_column(table: Table, name: str | None, unit: TimeUnit | None) -> tuple[str, TimeUnit]:
    """Name and unit of the time column; `SEC_NANOSEC` for a pair of them. Raises TableError where it is unclear."""
    if name is None:
        if {"sec", "nanosec"} <= set(table.columns):
            return SEC_NANOSEC, "ns"
        fitting = [column for column in table.columns if _TIME.match(column.lower())]
        if len(fitting) != 1:
            said = "several columns that may be the time" if fitting else "no column that is called a time"
            raise TableError(
                f"{table.path}: has {said} ({listed(fitting or table.columns)}); state sensor.log.time in bench.toml; "
                "the names must stand in the first line that does not begin with #"
            )
        name = fitting[0]
    else:
        table.column(name)
    if unit is None and _DATE.match(_first(table, name)):
        return name, "ns"
    if unit is None:
        stated = re.search(r"[ _\[(](s|sec|seconds|ms|us|µs|ns)[\])]?$", name.lower())
        if stated is None:
            raise TableError(
                f"{table.path}: the column {name!r} does not name its unit; state sensor.log.time_unit in bench.toml"
            )
        found = _UNITS.get(stated[1], stated[1])
        unit = "s" if found == "s" else "ms" if found == "ms" else "us" if found == "us" else "ns"
    return name, unit


def times_ns(table: Table, column: str, unit: TimeUnit) -> IntArray:
    """(n,) stamps in nanoseconds, as they stand in the table; dates as in 2024-05-03T10:00:00.125 since 1970.

    Raises TimeError for stamps that no recording can hold, TableError for what is neither number nor date.
    """
    if column == SEC_NANOSEC:
        seconds, nanoseconds = table.whole_numbers("sec"), table.whole_numbers("nanosec")
        if seconds is not None and nanoseconds is not None:
            return _held(table, seconds, 1_000_000_000) + nanoseconds
        pair = table.matrix(["sec", "nanosec"])
        return _held(table, np.rint(pair[:, 0] * 1e9 + pair[:, 1]), 1)
    whole = table.whole_numbers(column)
    if whole is not None:
        return _held(table, whole, TIME_UNITS[unit])
    if _DATE.match(_first(table, column)):
        return _dates_ns(table, column)
    return _held(table, np.rint(table.numbers(column) * TIME_UNITS[unit]), 1)


def _held(table: Table, values: IntArray | FloatArray, factor: int) -> IntArray:
    """``values`` times ``factor`` as whole nanoseconds, where a recording can hold them."""
    most_s = float(np.abs(values).max()) * factor * 1e-9 if len(values) else 0.0
    if most_s >= MAX_STAMP_S:
        raise TimeError(f"{table.path}: holds a time of {most_s:.4g} s, past the year 2038; check sensor.log.time_unit")
    return values.astype(np.int64) * factor


def _first(table: Table, column: str) -> str:
    """The first cell of a column, empty without rows."""
    index = table.column(column)
    return next((row[index] for _, row in table.lines() if index < len(row)), "")


def _dates_ns(table: Table, column: str) -> IntArray:
    """Dates of one time zone as nanoseconds since 1970; a Z or an offset from UTC behind them is obeyed."""
    words = table.text(column)
    stamps = np.empty(len(words), np.int64)
    for row, word in enumerate(words):
        found = _DATE.match(word)
        try:
            if found is None:
                raise ValueError(word)
            if not _FIRST_YEAR <= int(found[1][:4]) <= _LAST_YEAR:  # later ones wrap round in 64 bits of nanoseconds
                raise TimeError(
                    f"{table.path}, {table.place(row)}, column {column}: {word[:40]!r} is no date from {_FIRST_YEAR} "
                    f"to {_LAST_YEAR}; was the clock set? correct it, or give the rows a time since their start"
                )
            day = np.datetime64(f"{found[1]}T{found[2]}", "ns").astype(np.int64)
        except ValueError:
            where = f"{table.path}, {table.place(row)}, column {column}"
            raise TableError(
                f"{where}: expected a date as in the rows above, got {word[:40]!r}; correct the row or remove it"
            ) from None
        ahead = 0 if not found[4] else int(found[4] + "1") * (int(found[5]) * 60 + int(found[6]))
        stamps[row] = day - ahead * 60_000_000_000
    return _held(table, stamps, 1)


class _Placed(Protocol):
    path: Path

    def place(self, row: int) -> str: ...


def check_actuation(table: _Placed, column: str, values: FloatArray, *, as_name: str = "") -> None:
    """Raises TableError that names the row where a reading (n,) is none that its drive can have; NaN is no reading.

    ``as_name``: NAME_UNIT of the drive, where the column is not called so.
    """
    expected = actuation_range(as_name or column)
    row = expected.outside(values)
    if row is not None:
        raise TableError(
            f"{table.path}, {table.place(row)}, column {column}: {values[row]:g} lies outside of {expected}; correct "
            "the row or remove it, or check the column's unit"
        )


def rising(table: Table, stamps_ns: IntArray) -> None:
    """Raises TimeError that names the line where time stands still or runs backwards."""
    steps = np.diff(stamps_ns)
    wrong = np.flatnonzero(steps <= 0)
    if not len(wrong):
        return
    row = int(wrong[0]) + 1
    what = "repeats the stamp of the row before" if steps[row - 1] == 0 else "is stamped before the row above it"
    remedy = (
        "write the stamps with more digits or drop the row"
        if steps[row - 1] == 0
        else "sort the rows by time, or split the file where the clock was set back"
    )
    raise TimeError(f"{table.path}, {table.place(row)}: {what} ({stamps_ns[row] * 1e-9:.6f} s); {remedy}")
