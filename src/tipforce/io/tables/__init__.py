"""Tables: text, workbooks and variables of MATLAB; the times of a log."""

from ._columns import ACTUATION_UNITS, check_actuation, is_actuation, is_force, listed
from ._log import MAX_PAUSE_S, Log, open_log
from ._open import open_table
from ._stamps import MAX_STAMP_S, STILL_STEP_NS, TIME_UNITS
from ._table import Table

__all__ = [
    "ACTUATION_UNITS",
    "MAX_PAUSE_S",
    "MAX_STAMP_S",
    "STILL_STEP_NS",
    "TIME_UNITS",
    "Log",
    "Table",
    "check_actuation",
    "is_actuation",
    "is_force",
    "listed",
    "open_log",
    "open_table",
]
