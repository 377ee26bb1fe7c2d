"""Plausibility of force readings: one check for complete logs and for a live stream."""

from ._check import check_force_log
from ._drift import find_drift
from ._findings import MAX_GAP_S, FindingKind, ForceFinding, ForcePlausibility
from ._monitor import ForceMonitor
from ._zero_steps import ZeroStep, find_zero_steps

__all__ = [
    "MAX_GAP_S",
    "FindingKind",
    "ForceFinding",
    "ForceMonitor",
    "ForcePlausibility",
    "ZeroStep",
    "check_force_log",
    "find_drift",
    "find_zero_steps",
]
