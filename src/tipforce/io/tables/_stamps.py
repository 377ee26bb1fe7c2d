"""Finds columns of times and their units, and converts them to stamps in nanoseconds."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ...errors import TableError, TimeError
from ...types import FloatArray, IntArray
from ._dates import FIRST_YEAR, LAST_YEAR, AmbiguousDates, DateOutside, NoDate, is_time_text, parse_times

if TYPE_CHECKING:
    from ._table import Table

TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: dict[str, int] = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
"""Nanoseconds in each unit."""

MAX_STAMP_S = 2**31
"""Limit of stamps: ROS messages hold seconds in 32 bits with a sign."""

STILL_STEP_NS = 1_000_000_000
"""Images without stamps are taken one second apart, in the order of their rows or names."""

_NAMES = "t|time|times|stamp|timestamp|datetime|date[ _/]?time|zeit|zeitstempel|uhrzeit|elapsed|elapsed[ _]time|x_value"
_TIME = re.compile(rf"^(?:{_NAMES})(?:[ _]*[\[(]?(s|sec|seconds|ms|us|µs|ns)[\])]?)?(?: ?[\[(]hh?:mm.*)?$")
_UNIT_AT_END = re.compile(r"[ _\[(](s|sec|seconds|ms|us|µs|ns)[\])]?$")
_MICROSECONDS: dict[str, TimeUnit] = {"us": "us", "µs": "us", "μs": "us"}  # the micro sign and the Greek letter
_UNITS: dict[str, TimeUnit] = {"s": "s", "sec": "s", "seconds": "s", "ms": "ms", "ns": "ns", **_MICROSECONDS}
_YEAR_2001_S, _YEAR_2038_S = 1e9, 2**31
PLAUSIBLE_RATE_HZ = (0.01, 1e5)
"""Plausible rows per second of a log."""


def time_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Returns the columns that may be the time: stamp_ns alone, the pair of ROS tools, else all with such a name."""
    if "stamp_ns" in columns:
        return ("stamp_ns",)
    if {"sec", "nanosec"} <= set(columns):
        return ("sec", "nanosec")
    return tuple(column for column in columns if _TIME.match(column.lower()))


def named_unit(name: str) -> TimeUnit | None:
    """Returns the unit at the end of the name of a column of times, or that the whole name is ("ms"); None without one.

    >>> named_unit("Time [ms]"), named_unit("time_s"), named_unit("time")
    ('ms', 's', None)
    """
    match = _UNIT_AT_END.search(name.lower())
    return _UNITS.get(match[1] if match else name.lower().strip("[]() "))


def unit_since_1970(values: FloatArray) -> TimeUnit | None:
    """Returns the unit of times (n,) since 1970 without a unit; None where they are no such times.

    They must be after 2001, and their steps those of a log: 1.7e12 in steps of 1 are milliseconds; in steps of a
    million they are nanoseconds since the start of a computer.
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    if not len(steps):
        return None
    for unit in get_args(TimeUnit):
        ns = TIME_UNITS[unit]
        seconds, step_s = float(np.median(values)) * ns * 1e-9, float(np.median(steps)) * ns * 1e-9
        if _YEAR_2001_S <= seconds < _YEAR_2038_S and PLAUSIBLE_RATE_HZ[0] <= 1 / step_s <= PLAUSIBLE_RATE_HZ[1]:
            return unit
    return None


def column_ns(table: "Table", names: Sequence[str], unit: TimeUnit | None) -> IntArray:
    """Returns the stamps of a table in which every row has a time.

    Args:
        table: the table with the times.
        names: the column, or the pair sec and nanosec.
        unit: unit of the numbers; None where the name of the column states none.

    Returns:
        (n,) stamps in nanoseconds, as in the table; dates since 1970.

    Raises:
        TimeError: no recording can hold a stamp.
        TableError: a cell is neither number nor date, or the unit is unknown.
    """
    if len(names) > 1:
        seconds, nanoseconds = table.whole_numbers("sec"), table.whole_numbers("nanosec")
        if seconds is not None and nanoseconds is not None:
            return numbers_ns(table.path, seconds, "s") + nanoseconds
        pair = table.matrix(["sec", "nanosec"])
        return numbers_ns(table.path, pair[:, 0] * 1e9 + pair[:, 1], "ns")
    name = names[0]
    if is_time_text(table.first(name)):
        return dates_ns(table, name, table.text(name), None, "correct the row or remove it")
    if unit is None:
        raise TableError(f"{table.path}: the column {name!r} does not name its unit; call it {name}_s, _ms or _ns")
    whole = table.whole_numbers(name)
    return numbers_ns(table.path, table.numbers(name) if whole is None else whole, unit)


def numbers_ns(
    path: Path, values: FloatArray | IntArray, unit: TimeUnit, remedy: str = "check the unit of its times"
) -> IntArray:
    """Converts numbers to nanoseconds; whole numbers exactly.

    Args:
        path: the file, for the message.
        values: (n,) times in ``unit``.
        unit: unit of the times.
        remedy: the advice in the message.

    Returns:
        (n,) times in ns.

    Raises:
        TimeError: no recording can hold them: they are past the year 2038.
    """
    factor = TIME_UNITS[unit]
    if values.dtype != np.int64:  # a fraction of a unit counts: round after the conversion
        values, factor = np.rint(values * factor), 1
    most_s = float(np.abs(values).max()) * factor * 1e-9 if len(values) else 0.0
    if most_s >= MAX_STAMP_S:
        raise TimeError(f"{path}: holds a time of {most_s:.4g} s, past the year 2038; {remedy}")
    return values.astype(np.int64) * factor


def dates_ns(
    table: "Table",
    column: str,
    cells: Sequence[str],
    order: Literal["dmy", "mdy", "ymd"] | None,
    remedy: str,
    *,
    order_remedy: str = "write them as 2026-12-31",
    dates: Sequence[str] | None = None,
    rows: IntArray | None = None,
) -> IntArray:
    """Reads the stamps of times as text.

    Args:
        table: the table with the times, for messages.
        column: name of their column.
        cells: (n,) texts.
        order: order of day, month and year.
        remedy: the advice for a cell that is no time, with {} for its text.
        order_remedy: the advice where the order is unknown.
        dates: (n,) dates, where they are in a column of their own.
        rows: (n,) rows of the table; None: all of them.

    Returns:
        (n,) nanoseconds since 1970, or since midnight for times of day.

    Raises:
        TableError: a cell is no time, or the order of day and month is unknown.
        TimeError: a date is before 1970 or after 2037.
    """
    try:
        return parse_times(cells, order, dates).stamp_ns
    except NoDate as error:
        row = error.row if rows is None else int(rows[error.row])
        remedy = remedy.replace("{}", cells[error.row][:40])
        text = cells[error.row] if dates is None else f"{dates[error.row]} {cells[error.row]}"
        where = f"{table.path}, {table.place(row)}, column {column}"
        if isinstance(error, DateOutside):
            raise TimeError(
                f"{where}: {text[:40]!r} is no date from {FIRST_YEAR} to {LAST_YEAR}; was the clock set? {remedy}"
            ) from None
        if order is not None:
            remedy += f", or check the stated order {order}"
        raise TableError(f"{where}: expected a date as in the rows above, got {text[:40]!r}; {remedy}") from None
    except AmbiguousDates as error:
        fault = f"may be {' or '.join(error.orders)}" if error.orders else "and others are in no one order"
        raise TableError(
            f"{table.path}, column {column}: the date {error.example!r} {fault} (d day, m month, y year); "
            f"{order_remedy}"
        ) from None
