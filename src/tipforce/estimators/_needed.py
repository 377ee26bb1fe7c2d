"""Facts of a session that a model was told in training, and must be told again."""

from collections.abc import Iterable
from typing import Any

from ..types import Context

__all__ = ["BASE_SIDE", "GAIN", "SCALE", "missing_facts", "stated_facts"]

SCALE, BASE_SIDE, GAIN = "metres_per_px", "base_side", "knob_gain_per_m_deg"
"""Scale of the picture; border of the picture that the base lies at; curvature that a degree of the knob asks for."""

_CATHETER = ("diameter_m", "flexible_length_m", "rigid_length_m", "bending_stiffness_nm2")
_NOTES = (BASE_SIDE, GAIN)


def stated_facts(context: Context) -> tuple[str, ...]:
    """Names of what ``context`` tells of catheter and bench.

    >>> stated_facts(Context(metres_per_px=2e-4, notes={"base_side": "left"}))
    ('metres_per_px', 'base_side')
    """
    values: dict[str, Any] = {name: getattr(context.catheter, name) for name in _CATHETER}
    values |= {SCALE: context.metres_per_px} | {name: context.notes.get(name) for name in _NOTES}
    return tuple(name for name, value in values.items() if value is not None)


def missing_facts(needed: Iterable[str], context: Context) -> str:
    """Which of the ``needed`` ones ``context`` does not tell, and how they are stated; empty where it tells all.

    >>> missing_facts(("metres_per_px",), Context())
    'the sheet does not tell metres_per_px, which the model was told in training; state --metres-per-px VALUE'
    """
    lacking = [name for name in needed if name not in stated_facts(context)]
    if not lacking:
        return ""
    catheter = ",".join(f"{name}=VALUE" for name in lacking if name in _CATHETER)
    options = [f"--catheter NAME,{catheter}"] if catheter else []
    options += ["--metres-per-px VALUE"] if SCALE in lacking else []
    options += [f"--note {name}=VALUE" for name in lacking if name in _NOTES]
    return (
        f"the sheet does not tell {', '.join(lacking)}, which the model was told in training; state {' '.join(options)}"
    )
