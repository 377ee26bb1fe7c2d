"""Grams and newtons: the clinic reads grams, the code computes in newtons.

>>> round(newtons_to_grams(0.2), 2)
20.39
>>> round(grams_to_newtons(20), 4)
0.1961
"""

from typing import Literal

__all__ = [
    "FORCE_UNITS",
    "GRAM_N",
    "POUND_N",
    "ForceUnit",
    "force_unit",
    "grams_to_newtons",
    "newtons_to_grams",
]

GRAM_N = 9.80665e-3
"""One gram-force in newtons."""

POUND_N = 4.4482216152605
"""One pound-force in newtons: 0.45359237 kg times 9.80665 m/s^2."""

ForceUnit = Literal["N", "kN", "cN", "mN", "kgf", "gf", "g", "lbf", "ozf"]

FORCE_UNITS: dict[ForceUnit, float] = {
    "N": 1.0,
    "kN": 1e3,
    "cN": 1e-2,
    "mN": 1e-3,
    "kgf": 1e3 * GRAM_N,
    "gf": GRAM_N,
    "g": GRAM_N,
    "lbf": POUND_N,
    "ozf": POUND_N / 16,
}
"""Newtons in one of each unit that a force log may use."""

_SPELLINGS: dict[str, ForceUnit] = {
    **{name.lower(): name for name in FORCE_UNITS},
    "newton": "N",
    "newtons": "N",
    "kg": "kgf",
    "kp": "kgf",
    "p": "gf",
    "lb": "lbf",
    "lbs": "lbf",
    "oz": "ozf",
    "gram": "gf",
    "grams": "gf",
}


def force_unit(text: str) -> ForceUnit | None:
    """Returns the unit that a header or a sensor calls ``text``; None for another text.

    >>> force_unit("lb"), force_unit("[mN]"), force_unit("mm")
    ('lbf', 'mN', None)
    """
    return _SPELLINGS.get(text.strip(" []()").lower())


def grams_to_newtons(grams: float) -> float:
    """Converts a force from gram-force to newtons."""
    return grams * GRAM_N


def newtons_to_grams(newtons: float) -> float:
    """Converts a force from newtons to gram-force."""
    return newtons / GRAM_N
