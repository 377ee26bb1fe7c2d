"""Which column of a table is what, told by its name or by a person; times as whole nanoseconds."""

import re
from typing import Literal

import numpy as np

from ..errors import TableError, TimeError
from ..types import IntArray
from ._table import Table

__all__ = ["TIME_UNITS", "TimeUnit", "rising", "time_column", "times_ns"]

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: dict[str, int] = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds in one of each unit."""

SEC_NANOSEC = "sec+nanosec"
"""Stands for the pair of columns that ROS tools write."""

_TIME = re.compile(r"^(?:t|time|stamp|timestamp|zeit|elapsed)(?:[ _]*[\[(]?(s|sec|seconds|ms|us|µs|ns)[\])]?)?$")
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
                f"{table.path}: has {said} ({', '.join(fitting or table.header)}); state it with --time and --time-unit"
            )
        name = fitting[0]
    else:
        table.column(name)
    if unit is None:
        stated = re.search(r"[ _\[(](s|sec|seconds|ms|us|µs|ns)[\])]?$", name.lower())
        if stated is None:
            raise TableError(f"{table.path}: the column {name!r} does not name its unit; state it, as in --time-unit s")
        found = _UNITS.get(stated[1], stated[1])
        unit = "s" if found == "s" else "ms" if found == "ms" else "us" if found == "us" else "ns"
    return name, unit


def times_ns(table: Table, column: str, unit: TimeUnit) -> IntArray:
    """(n,) stamps in nanoseconds, as they stand in the table."""
    if column == SEC_NANOSEC:
        seconds, nanoseconds = table.integers("sec"), table.integers("nanosec")
        if seconds is not None and nanoseconds is not None:
            return seconds * 1_000_000_000 + nanoseconds
        pair = table.numbers(["sec", "nanosec"])
        return np.rint(pair[:, 0] * 1e9 + pair[:, 1]).astype(np.int64)
    whole = table.integers(column)
    if whole is not None:
        return whole * TIME_UNITS[unit]
    return np.rint(table.numbers([column])[:, 0] * TIME_UNITS[unit]).astype(np.int64)


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
