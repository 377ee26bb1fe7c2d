"""Facts of a session that a model was told in training: they must be told again, and no others."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from ..errors import InputError
from ..types import BASE_SIDE, BASE_SIDES, CATHETER_FACTS, KNOB_GAIN, Context

__all__ = ["SCALE", "check_metadata", "missing_metadata", "restrict_metadata", "stated_metadata"]

SCALE = "metres_per_px"

_NOTES = (BASE_SIDE, KNOB_GAIN)


def stated_metadata(context: Context) -> tuple[str, ...]:
    """Names of what ``context`` tells of catheter and bench.

    >>> stated_metadata(Context(metres_per_px=2e-4, notes={"base_side": "left"}))
    ('metres_per_px', 'base_side')
    """
    values: dict[str, Any] = {name: getattr(context.catheter, name) for name in CATHETER_FACTS}
    values |= {SCALE: context.metres_per_px} | {name: context.notes.get(name) for name in _NOTES}
    return tuple(name for name, value in values.items() if value is not None)


def restrict_metadata(names: Iterable[str], context: Context) -> Context:
    """``context`` without what it tells of catheter and bench beyond ``names``: what a model was never told.

    >>> restrict_metadata(["base_side"], Context(metres_per_px=2e-4, notes={"base_side": "left"})).metres_per_px
    """
    others = set(stated_metadata(context)) - set(names)
    return replace(
        context,
        catheter=replace(context.catheter, **{name: None for name in CATHETER_FACTS if name in others}),
        metres_per_px=None if SCALE in others else context.metres_per_px,
        notes={name: value for name, value in context.notes.items() if name not in others},
    )


def missing_metadata(needed: Iterable[str], context: Context) -> str:
    """Which of the ``needed`` ones ``context`` does not tell, and how they are stated; empty where it tells all.

    >>> missing_metadata(("metres_per_px",), Context())
    'the sheet does not tell metres_per_px, which the model was told in training; state --metres-per-px VALUE'
    """
    lacking = [name for name in needed if name not in stated_metadata(context)]
    if not lacking:
        return ""
    catheter = ",".join(f"{name}=VALUE" for name in lacking if name in CATHETER_FACTS)
    options = [f"--catheter NAME,{catheter}"] if catheter else []
    options += ["--metres-per-px VALUE"] if SCALE in lacking else []
    options += [f"--note {name}=VALUE" for name in lacking if name in _NOTES]
    return (
        f"the sheet does not tell {', '.join(lacking)}, which the model was told in training; state {' '.join(options)}"
    )


def check_metadata(context: Context) -> None:
    """Raises InputError where a note is not what it has to be."""
    side, gain = context.notes.get(BASE_SIDE), context.notes.get(KNOB_GAIN)
    if side is not None and side not in BASE_SIDES:
        raise InputError(f"{context.session}: {BASE_SIDE} is {side!r}; it must be one of {', '.join(BASE_SIDES)}")
    try:
        known = gain is None or math.isfinite(float(gain))
    except ValueError:
        known = False
    if not known:
        raise InputError(f"{context.session}: {KNOB_GAIN} is {gain!r}; it must be a number")
