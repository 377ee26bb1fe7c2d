"""Which column of a table is what, told by its name or by a person; times as whole nanoseconds."""

import re
from typing import Literal

import numpy as np

from ..errors import TableError, TimeError
from ..types import FloatArray, IntArray
from ._tables import Table, listed

__all__ = ["MAX_STAMP_S", "TIME_UNITS", "TimeUnit", "rising", "time_column", "times_ns"]

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: dict[str, int] = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds in one of each unit."""

MAX_STAMP_S = 2**31
"""ROS messages hold seconds in 32 bits with a sign."""

SEC_NANOSEC = "sec+nanosec"
"""Stands for the pair of columns that ROS tools write."""

_TIME = re.compile(r"^(?:t|time|stamp|timestamp|zeit|elapsed)(?:[ _]*[\[(]?(s|sec|seconds|ms|us|µs|ns)[\])]?)?$")
_DATE = re.compile(r"^(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:\.\d{1,9})?)\s*(Z|([+-])(\d\d):?(\d\d))?$")
_UNITS = {"sec": "s", "seconds": "s", "µs": "us"}


def time_column(table: Table, name: str | None, unit: TimeUnit | None) -> tuple[str, TimeUnit]:
    """Name and unit of the time column; `SEC_NANOSEC` for a pair of them. Raises TableError where it cannot be told."""
    if name is None:
        if {"sec", "nanosec"} <= set(table.header):
            return SEC_NANOSEC, "ns"
        fitting = [column for column in table.header if _TIME.match(column.lower())]
        if len(fitting) != 1:
            said = "several columns that may be the time" if fitting else "no column that is called a time"
            raise TableError(
                f"{table.path}: has {said} ({listed(fitting or table.header)}); state it with --time and --time-unit; "
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
            raise TableError(f"{table.path}: the column {name!r} does not name its unit; state it, as in --time-unit s")
        found = _UNITS.get(stated[1], stated[1])
        unit = "s" if found == "s" else "ms" if found == "ms" else "us" if found == "us" else "ns"
    return name, unit


def times_ns(table: Table, column: str, unit: TimeUnit) -> IntArray:
    """(n,) stamps in nanoseconds, as they stand in the table; dates as in 2024-05-03T10:00:00.125 since 1970.

    Raises TimeError for stamps that no recording can hold, TableError for what is neither number nor date.
    """
    if column == SEC_NANOSEC:
        seconds, nanoseconds = table.integers("sec"), table.integers("nanosec")
        if seconds is not None and nanoseconds is not None:
            return _held(table, seconds, 1_000_000_000) + nanoseconds
        pair = table.numbers(["sec", "nanosec"])
        return _held(table, np.rint(pair[:, 0] * 1e9 + pair[:, 1]), 1)
    whole = table.integers(column)
    if whole is not None:
        return _held(table, whole, TIME_UNITS[unit])
    if _DATE.match(_first(table, column)):
        return _dates_ns(table, column)
    return _held(table, np.rint(table.numbers([column])[:, 0] * TIME_UNITS[unit]), 1)


def _held(table: Table, values: IntArray | FloatArray, factor: int) -> IntArray:
    """``values`` times ``factor`` as whole nanoseconds, where a recording can hold them."""
    most_s = float(np.abs(values).max()) * factor * 1e-9 if len(values) else 0.0
    if most_s >= MAX_STAMP_S:
        raise TimeError(f"{table.path}: holds a time of {most_s:.4g} s, beyond the year 2038; check --time-unit")
    return values.astype(np.int64) * factor


def _first(table: Table, column: str) -> str:
    """The first cell of a column, empty without rows."""
    place = table.column(column)
    return next((row[place] for _, row in table.lines() if place < len(row)), "")


def _dates_ns(table: Table, column: str) -> IntArray:
    """Dates of one time zone as nanoseconds since 1970; a Z or an offset from UTC behind them is obeyed."""
    words = table.words(column)
    stamps = np.empty(len(words), np.int64)
    for row, word in enumerate(words):
        found = _DATE.match(word)
        try:
            if found is None:
                raise ValueError(word)
            day = np.datetime64(f"{found[1]}T{found[2]}", "ns").astype(np.int64)
        except ValueError:
            line = next(number for place, (number, _) in enumerate(table.lines()) if place == row)
            raise TableError(
                f"{table.path}, line {line}, column {column}: expected a date as in the rows above, got {word[:40]!r}; "
                "correct the row or remove it"
            ) from None
        ahead = 0 if not found[4] else int(found[4] + "1") * (int(found[5]) * 60 + int(found[6]))
        stamps[row] = day - ahead * 60_000_000_000
    return _held(table, stamps, 1)


def rising(table: Table, stamps_ns: IntArray) -> None:
    """Raises TimeError that names the line where time stands still or runs backwards."""
    steps = np.diff(stamps_ns)
    wrong = np.flatnonzero(steps <= 0)
    if not len(wrong):
        return
    row = int(wrong[0]) + 1
    line = next(number for place, (number, _) in enumerate(table.lines()) if place == row)
    what = "repeats the stamp of the row before" if steps[row - 1] == 0 else "is stamped before the row above it"
    remedy = (
        "write the stamps with more digits or drop the row"
        if steps[row - 1] == 0
        else "sort the rows by time, or split the file where the clock was set back"
    )
    raise TimeError(f"{table.path}, line {line}: {what} ({stamps_ns[row] * 1e-9:.6f} s); {remedy}")
