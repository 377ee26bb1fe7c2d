"""How the wall beats: waveforms over a cycle, from -1 to 1."""

from collections.abc import Callable
from functools import cache

import numpy as np

from ...types import FloatArray

__all__ = ["WAVES", "half_wave", "sine"]

Wave = Callable[[FloatArray], FloatArray]

# Centre and width in degrees of the cycle, and height: what is left of P, R and T when only the half-waves above the
# base line are moved, widened to what a stage on a spindle can follow.
_BUMPS = ((-110.0, 34.0, 0.20), (0.0, 40.0, 1.0), (125.0, 42.0, 0.35))


def sine(cycles: FloatArray) -> FloatArray:
    """(n,) time in cycles -> (n,)."""
    return np.sin(2 * np.pi * cycles)


def _bumps(cycles: FloatArray) -> FloatArray:
    total = np.zeros(np.shape(cycles))
    for centre, width, height in _BUMPS:
        away = np.remainder(360.0 * cycles - centre + 180.0, 360.0) - 180.0
        total += height * np.exp(-0.5 * (away / width) ** 2)
    return total


@cache
def _span() -> tuple[float, float]:
    values = _bumps(np.linspace(0.0, 1.0, 4001))
    return float(values.min()), float(values.max())


def half_wave(cycles: FloatArray) -> FloatArray:
    """(n,) time in cycles -> (n,): the half-waves of a PQRST course that lie above its base line (thesis fig. 20b).

    >>> bool(half_wave(np.zeros(1))[0] > 0.999)
    True
    """
    low, high = _span()
    return 2.0 * (_bumps(cycles) - low) / (high - low) - 1.0


WAVES: dict[str, Wave] = {"sine": sine, "half-wave PQRST": half_wave}
