"""From fits with and without contact to one force: what the tissue can do, and how likely it touches at all."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...types import FloatArray

__all__ = ["Mixed", "force_over_contact"]

_HALF = math.log(0.5)
"""Of the prior's forces push at the tip."""


class Mixed(NamedTuple):
    """``force_n`` (2,), ``covariance_n2`` (2, 2): over both hypotheses; ``contact``: probability of contact."""

    force_n: FloatArray
    covariance_n2: FloatArray
    contact: float


@njit(cache=True, nogil=True)
def _log_normal_share(value: float) -> float:
    """Logarithm of the share of a standard Gaussian below ``value``."""
    if value > -5.0:
        return math.log(0.5 * math.erfc(-value / math.sqrt(2.0)))
    square = value * value
    return -0.5 * square - math.log(-value * math.sqrt(2.0 * math.pi)) + math.log1p(-1.0 / square + 3.0 / square**2)


@njit(cache=True, nogil=True)
def _truncated(mean: FloatArray, covariance: FloatArray, angle: float) -> tuple[FloatArray, FloatArray, float]:
    """Mean and covariance of a Gaussian (2,), (2, 2) of which only forces that push at the tip are left.

    ``angle``: of the tip's axis. Returns also the logarithm of the share that is left.
    """
    a = np.array([-math.cos(angle), -math.sin(angle)])
    along = covariance @ a
    std = math.sqrt(max(float(a @ along), 1e-30))
    at = float(a @ mean) / std
    left = _log_normal_share(at)
    ratio = math.exp(-0.5 * at * at - 0.5 * math.log(2.0 * math.pi) - left)
    shift = along / std
    return mean + ratio * shift, covariance - ratio * (ratio + at) * np.outer(shift, shift), left


@njit(cache=True, nogil=True)
def _mixed(force: FloatArray, covariance: FloatArray, log_odds: float) -> Mixed:
    """The force over both hypotheses: ``force`` (2,), ``covariance`` (2, 2) in contact, none without.

    ``log_odds``: logarithm of the probability of contact over that of none.
    """
    share = 1.0 / (1.0 + math.exp(-max(-700.0, min(700.0, log_odds))))
    mean = share * force
    spread = share * covariance + share * (1.0 - share) * np.outer(force, force)
    return Mixed(mean, spread, share)


@njit(cache=True, nogil=True)
def force_over_contact(force: FloatArray, covariance: FloatArray, angle: float, log_odds: float) -> Mixed:
    """The force over contact and none.

    Args:
        force: (2,) in contact, as fitted; forces that pull at the tip are then excluded.
        covariance: (2, 2).
        angle: of the tip's axis, rad.
        log_odds: logarithm of the probability of contact over that of none, before pulling forces are excluded.
    """
    pushing, spread, left = _truncated(force, covariance, angle)
    return _mixed(pushing, spread, log_odds + left - _HALF)
