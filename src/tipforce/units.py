"""Grams and newtons: the clinic reads grams, the code computes in newtons.

>>> round(newtons_to_grams(0.2), 2)
20.39
>>> round(newtons_from(20, "g"), 4)
0.1961
"""

from typing import Literal

__all__ = ["FORCE_UNITS", "GRAM_N", "ForceUnit", "grams_to_newtons", "newtons_from", "newtons_to_grams"]

GRAM_N = 9.80665e-3
"""One gram-force in newtons."""

ForceUnit = Literal["N", "mN", "g"]

FORCE_UNITS: dict[str, float] = {"N": 1.0, "mN": 1e-3, "g": GRAM_N}
"""Newtons in one of each unit a force log may be written in."""


def grams_to_newtons(grams: float) -> float:
    """Newtons of a force in gram-force."""
    return grams * GRAM_N


def newtons_to_grams(newtons: float) -> float:
    """Gram-force of a force in newtons."""
    return newtons / GRAM_N


def newtons_from(value: float, unit: str) -> float:
    """Newtons of ``value`` in ``unit``, one of `FORCE_UNITS`."""
    return value * FORCE_UNITS[unit]
