"""Names of columns, and the plausible readings of a drive."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from ...errors import TableError
from ...types import FloatArray, actuation_range

ACTUATION_UNITS = (
    *("deg", "rad", "mm", "um", "m", "px", "kpa", "pa", "bar", "v", "a", "ma", "n", "mn", "nmm"),
    *("count", "steps", "percent"),
)
"""Units at the end of the name of an actuation column: NAME_UNIT."""

_FORCE = re.compile(r"^[ft][xyz]_[a-z]+$", re.IGNORECASE)


def is_force(column: str) -> bool:
    """Returns whether a column is a label by its name: a force or torque such as ``fx_n``, ``tz_nmm``."""
    return bool(_FORCE.match(column))


def is_actuation(column: str) -> bool:
    """Returns whether a column holds readings of a drive by its name: NAME_UNIT, and no label.

    >>> [name for name in ("knob_deg", "fx_n", "note_mm", "speed") if is_actuation(name)]
    ['knob_deg']
    """
    name, _, unit = column.rpartition("_")
    return bool(name) and unit.lower() in ACTUATION_UNITS and not is_force(column) and not column.startswith("note_")


def listed(names: Sequence[str]) -> str:
    """Lists the names of columns for an error; not all of two hundred."""
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")


class _Placed(Protocol):
    @property
    def path(self) -> Path: ...

    def place(self, row: int) -> str: ...


def check_actuation(
    table: _Placed, column: str, values: FloatArray, *, as_name: str = "", remedy: str = "correct the row or remove it"
) -> None:
    """Checks that readings are in the range of their drive; NaN, which marks a missing reading, passes.

    Args:
        table: origin of the readings, for the message.
        column: name of the column, NAME_UNIT.
        values: (n,) readings, in the unit at the end of the name.
        as_name: NAME_UNIT of the drive, if the column has another name.
        remedy: the advice in the message.

    Raises:
        TableError: a reading is outside of the range; the message names its row.
    """
    limits = actuation_range(as_name or column)
    row = limits.outside(values)
    if row is not None:
        raise TableError(
            f"{table.path}, {table.place(row)}, column {column}: {values[row]:g} is outside of {limits}; {remedy}, "
            "or check the column's unit"
        )
