"""Force logs and knob logs: which column is what, in which unit."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InputError, TableError
from ..types import FloatArray, IntArray
from ..units import FORCE_UNITS
from ._columns import TimeUnit, rising, time_column, times_ns
from ._tables import Table, listed, open_table

__all__ = ["ForceColumns", "ForceLog", "read_force_log", "read_knob_log"]

_AXIS = re.compile(r"^(?:wrench[._])?f(?:orce)?[ ._]*([xyz])(?:[ _]*[\[(]?(n|mn|g|gf|counts)[\])]?)?$", re.IGNORECASE)
_UNIT_AT_END = re.compile(r"[ _\[(](n|mn|g|gf|counts)[\])]?$", re.IGNORECASE)
_MOST_N = 1e4
_UNITS = {"n": "N", "mn": "mN", "g": "g", "gf": "g", "counts": "counts"}


@dataclass(frozen=True, slots=True)
class ForceColumns:
    """Which columns of a force log hold what; None: found by its header. A leading "-" turns an axis round.

    ``counts_per_n``: for ``force_unit="counts"``, the sensor's sensitivity.
    """

    time: str | None = None
    fx: str | None = None
    fy: str | None = None
    fz: str | None = None
    time_unit: TimeUnit | None = None
    force_unit: Literal["N", "mN", "g", "counts"] | None = None
    counts_per_n: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ForceLog:
    """``stamp_ns`` (n,), as in the log; ``force_n`` (n, 3), NaN for axes it lacks; ``knob`` (n,) or None.

    ``said``: which columns were taken for what.
    """

    stamp_ns: IntArray
    force_n: FloatArray
    knob: FloatArray | None
    said: str


def read_force_log(path: Path, columns: ForceColumns | None = None, knob_column: str | None = None) -> ForceLog:
    """Read and check a force log. Raises FileFormatError, TableError (line and column), TimeError (line)."""
    columns = columns or ForceColumns()
    table = open_table(path)
    time, unit = time_column(table, columns.time, columns.time_unit)
    axes = _axes(table, columns)
    stamps = times_ns(table, time, unit)
    rising(table, stamps)
    if columns.counts_per_n is not None and not math.isfinite(columns.counts_per_n):
        raise InputError(f"--counts-per-n: expected a number, got {columns.counts_per_n}")
    names = [name for _, name, _ in axes] + ([knob_column] if knob_column else [])
    numbers = table.numbers(names)
    force = np.full((len(stamps), 3), math.nan)
    for place, (axis, name, factor) in enumerate(axes):
        force[:, axis] = numbers[:, place] * factor
        _plausible(table, force[:, axis], numbers[:, place], name)
    said = ", ".join(
        f"f{'xyz'[axis]} = {'-' if factor < 0 else ''}{name} ({abs(factor):g} N)" for axis, name, factor in axes
    )
    return ForceLog(stamps, force, numbers[:, -1] if knob_column else None, f"time = {time} ({unit}), {said}")


def _plausible(table: Table, force_n: FloatArray, numbers: FloatArray, name: str) -> None:
    """Raises TableError for a reading that no sensor gives."""
    wrong = np.flatnonzero(np.abs(force_n) > _MOST_N)
    if len(wrong):
        row = int(wrong[0])
        line = next(number for place, (number, _) in enumerate(table.lines()) if place == row)
        raise TableError(
            f"{table.path}, line {line}, column {name}: {numbers[row]:g} is {force_n[row]:.3g} N, which no sensor at a "
            "catheter reads; correct the row or remove it, or check --force-unit"
        )


def read_knob_log(path: Path, time_unit: TimeUnit | None = None) -> tuple[IntArray, dict[str, FloatArray]]:
    """A log of drives: a time column and columns NAME_UNIT. Raises as `read_force_log` does."""
    table = open_table(path)
    time, unit = time_column(table, None, time_unit)
    names = [name for name in table.header if name not in (time, "sec", "nanosec")]
    bad = next((name for name in names if "_" not in name.strip("_")), None)
    if bad is not None or not names:
        raise TableError(
            f"{path}: expected a time and columns that end in their unit, as in time_s,knob_deg; got "
            f"{listed(table.header)}"
        )
    stamps = times_ns(table, time, unit)
    rising(table, stamps)
    values = table.numbers(names)
    return stamps, {name: values[:, place] for place, name in enumerate(names)}


def _axes(table: Table, columns: ForceColumns) -> list[tuple[int, str, float]]:
    """(axis, column, newtons in one of its unit) of every axis that the log has."""
    stated = (columns.fx, columns.fy, columns.fz)
    found: list[tuple[int, str, float]] = []
    for axis, name in enumerate(stated):
        if name is not None:
            column = name[1:] if name.startswith("-") and name not in table.header else name
            table.column(column)
            found.append((axis, column, -1.0 if column != name else 1.0))
    if not found:
        matches = [(column, _AXIS.match(column)) for column in table.header]
        found = sorted(("xyz".index(match[1].lower()), column, 1.0) for column, match in matches if match)
        if not found or len({axis for axis, _, _ in found}) < len(found):
            raise TableError(
                f"{table.path}: cannot tell which columns are the force ({listed(table.header)}); state them with "
                "--fx, --fy and --fz"
            )
    units = [_unit(table, column, columns) for _, column, _ in found]
    if columns.counts_per_n is not None and "counts" not in units:
        raise InputError(
            f"{table.path}: no column holds counts; state --force-unit counts, or leave --counts-per-n out"
        )
    return [
        (axis, column, sign * _newtons(table, column, unit, columns))
        for (axis, column, sign), unit in zip(found, units, strict=True)
    ]


def _unit(table: Table, column: str, columns: ForceColumns) -> str:
    named = _UNIT_AT_END.search(column)
    unit = columns.force_unit or (_UNITS[named[1].lower()] if named else None)
    if unit is None:
        raise TableError(f"{table.path}: the column {column!r} does not name its unit; state it, as in --force-unit N")
    return unit


def _newtons(table: Table, column: str, unit: str, columns: ForceColumns) -> float:
    if unit != "counts":
        return FORCE_UNITS[unit]
    if not columns.counts_per_n:
        raise TableError(
            f"{table.path}: the column {column!r} holds counts; state how many are a newton: --counts-per-n K"
        )
    return 1.0 / columns.counts_per_n
