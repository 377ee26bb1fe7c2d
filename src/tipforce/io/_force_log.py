"""Force logs and knob logs: which column is what, in which unit."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError, TableError
from ..types import FORCE_RANGE, FloatArray, ForceLogInfo, IntArray
from ..units import FORCE_UNITS
from ._tables import Table, TimeUnit, check_actuation, listed, open_table, rising, time_column, times_ns

__all__ = ["ForceLog", "logs_by_kind", "read_force_log", "read_knob_log"]

_AXIS = re.compile(r"^(?:wrench[._])?f(?:orce)?[ ._]*([xyz])(?:[ _]*[\[(]?(n|mn|g|gf|counts)[\])]?)?$", re.IGNORECASE)
_UNIT_AT_END = re.compile(r"[ _\[(](n|mn|g|gf|counts)[\])]?$", re.IGNORECASE)
_UNITS = {"n": "N", "mn": "mN", "g": "g", "gf": "g", "counts": "counts"}


@dataclass(frozen=True, slots=True, eq=False)
class ForceLog:
    """``stamp_ns`` (n,), as in the log; ``force_n`` (n, 3), NaN for axes it lacks; ``knob`` (n,) or None.

    ``said``: which columns were taken for what.
    """

    stamp_ns: IntArray
    force_n: FloatArray
    knob: FloatArray | None
    said: str


def read_force_log(path: Path, columns: ForceLogInfo | None = None, knob_column: str | None = None) -> ForceLog:
    """Read and check a force log. Raises FileFormatError, TableError (line and column), TimeError (line)."""
    columns = columns or ForceLogInfo()
    table = open_table(path)
    time, unit = time_column(table, columns.time, columns.time_unit)
    axes = _axes(table, columns)
    stamps = times_ns(table, time, unit)
    rising(table, stamps)
    if columns.counts_per_n is not None and not math.isfinite(columns.counts_per_n):
        raise InputError(f"sensor.log.counts_per_n: expected a number, got {columns.counts_per_n}")
    names = [name for _, name, _ in axes] + ([knob_column] if knob_column else [])
    numbers = table.matrix(names)
    force = np.full((len(stamps), 3), math.nan)
    for place, (axis, name, factor) in enumerate(axes):
        force[:, axis] = numbers[:, place] * factor
        _plausible(table, force[:, axis], numbers[:, place], name)
    said = ", ".join(
        f"f{'xyz'[axis]} = {'-' if factor < 0 else ''}{name} ({abs(factor):g} N)" for axis, name, factor in axes
    )
    if knob_column:
        check_actuation(table, knob_column, numbers[:, -1], as_name=knob_column if "_" in knob_column else "knob_deg")
    return ForceLog(stamps, force, numbers[:, -1] if knob_column else None, f"time = {time} ({unit}), {said}")


def _plausible(table: Table, force_n: FloatArray, numbers: FloatArray, name: str) -> None:
    """Raises TableError for a reading that no sensor gives."""
    row = FORCE_RANGE.outside(force_n)
    if row is not None:
        where = f"{table.path}, {table.place(row)}, column {name}"
        raise TableError(
            f"{where}: {numbers[row]:g} is {force_n[row]:.3g} N, which no sensor at a catheter reads; "
            "correct the row or remove it, or check sensor.log.force_unit"
        )


def read_knob_log(path: Path, time_unit: TimeUnit | None = None) -> tuple[IntArray, dict[str, FloatArray]]:
    """A log of drives: a time column and columns NAME_UNIT. Raises as `read_force_log` does."""
    table = open_table(path)
    time, unit = time_column(table, None, time_unit)
    names = [name for name in table.columns if name not in (time, "sec", "nanosec")]
    bad = next((name for name in names if "_" not in name.strip("_")), None)
    if bad is not None or not names:
        raise TableError(
            f"{path}: expected a time and columns that end in their unit, as in time_s,knob_deg; got "
            f"{listed(table.columns)}"
        )
    stamps = times_ns(table, time, unit)
    rising(table, stamps)
    values = table.matrix(names)
    for place, name in enumerate(names):
        check_actuation(table, name, values[:, place])
    return stamps, {name: values[:, place] for place, name in enumerate(names)}


def _axes(table: Table, columns: ForceLogInfo) -> list[tuple[int, str, float]]:
    """(axis, column, newtons in one of its unit) of every axis that the log has."""
    stated = (columns.fx, columns.fy, columns.fz)
    found: list[tuple[int, str, float]] = []
    for axis, name in enumerate(stated):
        if name is not None:
            column = name[1:] if name.startswith("-") and name not in table.columns else name
            table.column(column)
            found.append((axis, column, -1.0 if column != name else 1.0))
    if not found:
        matches = [(column, _AXIS.match(column)) for column in table.columns]
        found = sorted(("xyz".index(match[1].lower()), column, 1.0) for column, match in matches if match)
        if not found or len({axis for axis, _, _ in found}) < len(found):
            raise TableError(
                f"{table.path}: cannot tell which columns are the force ({listed(table.columns)}); state them as "
                "sensor.log.fx, fy and fz in bench.toml"
            )
    units = [_unit(table, column, columns) for _, column, _ in found]
    if columns.counts_per_n is not None and "counts" not in units:
        raise InputError(
            f'{table.path}: no column holds counts; state sensor.log.force_unit = "counts", or leave counts_per_n out'
        )
    return [
        (axis, column, sign * _newtons(table, column, unit, columns))
        for (axis, column, sign), unit in zip(found, units, strict=True)
    ]


def _unit(table: Table, column: str, columns: ForceLogInfo) -> str:
    named = _UNIT_AT_END.search(column)
    unit = columns.force_unit or (_UNITS[named[1].lower()] if named else None)
    if unit is None:
        raise TableError(
            f"{table.path}: the column {column!r} does not name its unit; state sensor.log.force_unit in bench.toml"
        )
    return unit


def _newtons(table: Table, column: str, unit: str, columns: ForceLogInfo) -> float:
    if unit != "counts":
        return FORCE_UNITS[unit]
    if not columns.counts_per_n:
        raise TableError(
            f"{table.path}: the column {column!r} holds counts; state how many are a newton: sensor.log.counts_per_n"
        )
    return 1.0 / columns.counts_per_n


def logs_by_kind(paths: Sequence[Path]) -> dict[str, Path]:
    """Logs by what their columns hold: "force", "stage" (positions, NAME_mm or NAME_m) or "knob" (NAME_deg).

    A single log is always taken for the force's. Raises TableError where two are of one kind, or one is of none.
    """
    if len(paths) == 1:
        return {"force": paths[0]}
    found: dict[str, Path] = {}
    for path in paths:
        header = open_table(path).columns
        if any(_AXIS.match(column) for column in header):
            kind = "force"
        elif any(column.lower().endswith("_deg") for column in header):
            kind = "knob"
        elif any(column.lower().endswith(("_mm", "_m")) for column in header):
            kind = "stage"
        else:
            kind = "force" if "force" not in found else ""
        if not kind or kind in found:
            raise TableError(
                f"{path}: cannot tell what it is a log of ({listed(header)}); a log of the force has columns "
                "like fx_n, one of the stage like forward_mm, one of the knob knob_deg, and there is one of each"
            )
        found[kind] = path
    return found
