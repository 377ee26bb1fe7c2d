"""Reads force logs and logs of drives: finds their columns and units."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError, TableError
from ..types import FORCE_RANGE, FloatArray, ForceLogInfo, IntArray, LogInfo
from ..units import FORCE_UNITS, force_unit
from .tables import Log, check_actuation, listed, open_log, open_table

_UNIT = r"(?:[ _]*[\[(]?(k?n|[cm]n|k?gf?|lbf?|ozf?|counts)[\])]?)?"
_AXIS = re.compile(rf"^(?:.*wrench[._/])?f(?:orce)?[ ._-]*([xyz]){_UNIT}$", re.IGNORECASE)
_UNIT_AT_END = re.compile(r"[ _\[(](k?n|[cm]n|k?gf?|lbf?|ozf?|counts)[\])]?$", re.IGNORECASE)
_STATUS = re.compile(r"^(?:sensor[ _]?)?status(?:[ _]?(?:code|word))?(?: *\(?hex\)?)?$", re.IGNORECASE)
_FORCE_FACTS = ("force units", "force unit")
_COUNTS_FACT = "counts per unit force"


@dataclass(frozen=True, slots=True, eq=False)
class ForceLog:
    """A force log in newtons.

    Attributes:
        stamp_ns: (n,) strictly rising stamps on the log's own clock.
        force_n: (n, 3) forces, N; NaN for axes that the log lacks and where a cell holds no reading.
        knob: (n,) angle of the knob, or None.
        said: the columns that were taken as time and force.
        status: (n,) status codes of the sensor, 0 for no fault, or None.
        remarks: the assumptions, in sentences.
    """

    stamp_ns: IntArray
    force_n: FloatArray
    knob: FloatArray | None
    said: str
    status: IntArray | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class DriveLog:
    """A log of drives.

    Attributes:
        stamp_ns: (n,) strictly rising stamps.
        values: NAME_UNIT -> (n,) readings; NaN where a cell is empty.
        remarks: the assumptions, in sentences.
    """

    stamp_ns: IntArray
    values: dict[str, FloatArray]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Axis:
    """The force of ``axis`` 0 to 2 is ``column`` times ``newtons``."""

    axis: int
    column: str
    newtons: float


def read_force_log(path: Path, info: ForceLogInfo | None = None, knob_column: str | None = None) -> ForceLog:
    """Reads and checks a force log.

    Args:
        path: a text table, a workbook (.xlsx) or variables of MATLAB (.mat).
        info: description of the log in ``bench.toml``, section ``sensor.log``.
        knob_column: the column with the knob's angle.

    Returns:
        Stamps, forces in newtons on the sensor's axes and, where it is read, the knob's angle; remarks state the
        choices.

    Raises:
        FileFormatError: the file is no table.
        TableError: columns or units are not clear, or a cell holds no reading; the message names line and column.
        TimeError: the times are not those of a log.
        InputError: the description in ``info`` does not fit the file.
    """
    info = info or ForceLogInfo()
    log = open_log(path, info, "sensor.log")
    remarks = list(log.remarks)
    axes = _axes(log, info, remarks)
    if info.counts_per_n is not None and not math.isfinite(info.counts_per_n):
        raise InputError(f"sensor.log.counts_per_n: expected a number, got {info.counts_per_n}")
    numbers = log.readings([axis.column for axis in axes] + ([knob_column] if knob_column else []))
    force = np.full((len(log.stamp_ns), 3), math.nan)
    for axis, readings in zip(axes, numbers.T, strict=False):
        force[:, axis.axis] = readings * axis.newtons
        _plausible(log, force[:, axis.axis], readings, axis.column)
    if knob_column:
        check_actuation(log, knob_column, numbers[:, -1], as_name=knob_column if "_" in knob_column else "knob_deg")
    status = info.status
    if status is None:
        status = next((name for name in log.table.columns if _STATUS.match(name)), "")
    columns = ", ".join(
        f"f{'xyz'[axis.axis]} = {'-' if axis.newtons < 0 else ''}{axis.column} ({abs(axis.newtons):.6g} N)"
        for axis in axes
    )
    return ForceLog(
        log.stamp_ns,
        force,
        numbers[:, -1] if knob_column else None,
        f"{log.time}, {columns}" + (f", status = {status}" if status else ""),
        log.codes(status) if status else None,
        tuple(remarks),
    )


def _plausible(log: Log, force_n: FloatArray, numbers: FloatArray, name: str) -> None:
    """Raises TableError for a reading that no sensor gives: force (n,) in N, ``numbers`` (n,) as in column ``name``."""
    row = FORCE_RANGE.outside(force_n)
    if row is not None:
        raise TableError(
            f"{log.path}, {log.place(row)}, column {name}: {numbers[row]:g} is {force_n[row]:.3g} N, which no sensor "
            f"at a catheter reads; check sensor.log.force_unit; if this number means that there is no reading, state "
            f'sensor.log.missing = ["{numbers[row]:g}"] in bench.toml'
        )


def read_drive_log(path: Path, info: LogInfo | None = None, key: str = "actuation.log") -> DriveLog:
    """Reads a log of drives: times and columns NAME_UNIT.

    Args:
        path: a text table, a workbook (.xlsx) or variables of MATLAB (.mat).
        info: description of the log in ``bench.toml``.
        key: the section of ``info``: "actuation.log", or "stage.log".

    Returns:
        Stamps and the readings of each column by its name.

    Raises:
        FileFormatError, TableError, TimeError: see `read_force_log`.
    """
    log = open_log(path, info or LogInfo(), key)
    date = None if info is None else info.date
    names = [name for name in log.table.columns if name not in (*log.time_names, date) and name.lower() != "date"]
    without_unit = [name for name in names if "_" not in name.strip("_")]
    if without_unit or not names:
        raise TableError(
            f"{path}: expected a time and columns that end in their unit, as in time_s,knob_deg; got "
            f'{listed(log.table.columns)}; name the columns in bench.toml: {key}.columns = ["time_s", "knob_deg"], '
            'with "" for a column that is not read'
        )
    values = log.readings(names)
    readings = {name: values[:, index] for index, name in enumerate(names)}
    for name, column in readings.items():
        check_actuation(log, name, column, remedy=f"if it is no reading, state its text as {key}.missing in bench.toml")
    return DriveLog(log.stamp_ns, readings, log.remarks)


def _axes(log: Log, info: ForceLogInfo, remarks: list[str]) -> list[_Axis]:
    """Returns column and newtons of every axis that the log has.

    The columns are those that ``info`` states ("-fx" is fx with the other sign), else those with names of forces.
    Assumptions on the unit are added to ``remarks``.
    """
    table = log.table
    axes: list[tuple[int, str, float]] = []  # axis 0 to 2, column, sign
    for axis, name in enumerate((info.fx, info.fy, info.fz)):
        if name is not None:
            column = name[1:] if name.startswith("-") and name not in table.columns else name
            table.column(column)
            axes.append((axis, column, -1.0 if column != name else 1.0))
    if not axes:
        matches = [(column, _AXIS.match(column)) for column in table.columns]
        axes = sorted(("xyz".index(match[1].lower()), column, 1.0) for column, match in matches if match)
        if not axes or len({axis for axis, _, _ in axes}) < len(axes):
            raise TableError(
                f"{table.path}: cannot determine which columns are the force ({listed(table.columns)}); state them as "
                "sensor.log.fx, fy and fz in bench.toml"
            )
    units = [_unit(log, column, info) for _, column, _ in axes]
    if info.counts_per_n is not None and "counts" not in units:
        raise InputError(
            f'{table.path}: no column holds counts; state sensor.log.force_unit = "counts", or leave counts_per_n out'
        )
    newtons = _newtons(log, [column for _, column, _ in axes], units, info, remarks)
    return [_Axis(axis, column, sign * factor) for (axis, column, sign), factor in zip(axes, newtons, strict=True)]


def _unit(log: Log, column: str, info: ForceLogInfo) -> str:
    """Returns the unit of a column: stated, in its name, below the header, or above the table."""
    if info.force_unit is not None:
        return info.force_unit
    named = _UNIT_AT_END.search(column)
    facts = [log.table.facts[name] for name in _FORCE_FACTS if name in log.table.facts]
    for text in (named[1] if named else "", log.table.units.get(column, ""), *facts):
        if text.strip(" []()").lower() in ("count", "counts"):
            return "counts"
        if unit := force_unit(text):
            return unit
    raise TableError(
        f"{log.path}: the column {column!r} does not name its unit; state sensor.log.force_unit in bench.toml"
    )


def _newtons(
    log: Log, columns: Sequence[str], units: Sequence[str], info: ForceLogInfo, remarks: list[str]
) -> list[float]:
    """Returns the factor, in newtons, of the numbers of each column.

    A log of the manufacturer ATI states "Counts per Unit Force" and holds counts; a log of later versions of its
    program holds forces under the same header. Whole numbers in all columns are taken as counts.

    Args:
        log: the log; its lines above the table state counts and unit.
        columns: the columns of the forces.
        units: unit of each column, or "counts".
        info: description of the log in ``bench.toml``; it has precedence over the header.
        remarks: gets the assumption.
    """
    stated = log.table.facts.get(_COUNTS_FACT, "")
    per_unit = float(stated) if re.fullmatch(r"\d+(?:\.\d*)?(?:[eE]\d+)?", stated) else 0.0
    if per_unit and info.force_unit in (None, "counts") and info.counts_per_n is None:
        unit = next((unit for unit in units if unit != "counts"), None) or force_unit(
            next((log.table.facts[name] for name in _FORCE_FACTS if name in log.table.facts), "")
        )
        counts = all(log.table.whole_numbers(column) is not None for column in columns)
        if unit is not None and unit != "counts":
            if counts:
                remarks.append(f"its forces are whole numbers: counts, {per_unit:g} per {unit}, as its header states")
                return [FORCE_UNITS[unit] / per_unit] * len(columns)  # type: ignore[index]
            remarks.append(
                f"its header states {per_unit:g} counts per {unit}, but its forces are no whole numbers: they are "
                f"taken as {unit}"
            )
            return [FORCE_UNITS[unit]] * len(columns)  # type: ignore[index]
    factors: list[float] = []
    for column, unit in zip(columns, units, strict=True):
        if unit != "counts":
            factors.append(FORCE_UNITS[unit])  # type: ignore[index]
        elif info.counts_per_n:
            factors.append(1.0 / info.counts_per_n)
        else:
            raise TableError(
                f"{log.path}: the column {column!r} holds counts; state how many are a newton: sensor.log.counts_per_n"
            )
    return factors


def logs_by_kind(paths: Sequence[Path], infos: Mapping[str, LogInfo] | None = None) -> dict[str, Path]:
    """Determines the kind of each log by its columns; a single log is always taken as the force's.

    Args:
        paths: the logs.
        infos: kind -> description of the log of this kind in ``bench.toml``.

    Returns:
        Kind -> log: "force", "stage" (positions, NAME_mm or NAME_m) or "knob" (NAME_deg).

    Raises:
        TableError: two are of one kind, or one is of none.
    """
    if len(paths) == 1:
        return {"force": paths[0]}
    infos, logs = infos or {}, dict[str, Path]()
    for path in paths:
        named = [kind for kind, info in infos.items() if info.columns and kind not in logs]
        try:
            header = open_table(path, log=LogInfo(), key="sensor.log").columns
        except TableError:  # it has no header, so it must be the only log whose columns bench.toml names
            if len(named) != 1:
                raise
            header = infos[named[0]].columns
        kind = _kind_of(header) or ("force" if "force" not in logs else "")
        if not kind or kind in logs:
            raise TableError(
                f"{path}: cannot determine the kind of this log ({listed(header)}); a log of the force has columns "
                "like fx_n, one of the stage like forward_mm, one of the knob knob_deg; there is one log of each kind; "
                "state those of stage and knob: `tipforce import VIDEO FORCE --stage FILE --knob FILE`"
            )
        logs[kind] = path
    return logs


def _kind_of(columns: Sequence[str]) -> str:
    """Returns the kind of a log by the names of its columns; empty where they do not show it."""
    if any(_AXIS.match(column) for column in columns):
        return "force"
    if any(column.lower().endswith("_deg") for column in columns):
        return "knob"
    return "stage" if any(column.lower().endswith(("_mm", "_m")) for column in columns) else ""
