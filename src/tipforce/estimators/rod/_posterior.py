"""From fits with and without contact to one force: the force prior of the tissue, and the probability of contact.

The fit of contact is a Gaussian: likelihood times the Gaussian prior that it was fitted with. It is weighed anew, point
by point, with the prior that is meant: forces push at the tip, and their magnitude has a heavy tail (Student), so that
no large force is drawn to the usual ones. No contact is an atom at zero beside it.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...types import FloatArray

_ALONG = 61
_REACH = 4.0
"""The points along the long axis of the fitted Gaussian are within this number of standard deviations."""
_ACROSS = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
_ACROSS_SHARE = np.array([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0])
"""Across it: Gauss-Hermite, exact for the first five moments."""
_NONE_PUSHES = -0.5 * _REACH**2
"""Logarithm of the share of pushing forces where no point pushes: at most."""
_TAIL = 0.05
"""Share outside of the 90 % intervals, on either side."""


class ForcePrior(NamedTuple):
    """Prior of the force in contact. ``fitted_n``: standard deviation of each component in the fit (Gaussian about 0).

    The fit replaces the true prior: a bivariate Student distribution with ``scale_n`` and ``freedom`` degrees of
    freedom, of which only the forces that push at the tip are left.
    """

    fitted_n: float
    scale_n: float
    freedom: float


class Mixed(NamedTuple):
    """``force_n`` (2,), ``covariance_n2`` (2, 2): over both hypotheses; ``contact``: probability of contact.

    ``low_n``, ``high_n`` (3,): 5 and 95 % quantiles of fx, fy and the magnitude.
    """

    force_n: FloatArray
    covariance_n2: FloatArray
    contact: float
    low_n: FloatArray
    high_n: FloatArray


@njit(cache=True, nogil=True)
def _quantiles(values: FloatArray, shares: FloatArray) -> tuple[float, float]:
    """5 and 95 % quantiles of ``values`` with ``shares``, whose sum is 1."""
    order = np.argsort(values)
    below, first, last = 0.0, 0, -1
    for place, k in enumerate(order):
        if below <= _TAIL:
            first = place
        below += shares[k]
        if below >= 1.0 - _TAIL:
            last = place
            break
    return float(values[order[first]]), float(values[order[last]])


@njit(cache=True, nogil=True)
def force_over_contact(
    force: FloatArray, covariance: FloatArray, angle: float, log_odds: float, prior: ForcePrior
) -> Mixed:
    """The force over contact and none.

    Args:
        force: (2,) in contact, as fitted.
        covariance: (2, 2).
        angle: of the tip's axis, rad.
        log_odds: logarithm of the probability of contact over that of none, with the prior of the fit.
        prior: of the force.
    """
    xx, xy, yy = covariance[0, 0], 0.5 * (covariance[0, 1] + covariance[1, 0]), covariance[1, 1]
    middle, apart = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    turn = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(turn), math.sin(turn)
    along, across = math.sqrt(middle + apart), math.sqrt(max(middle - apart, 0.0))
    axis_x, axis_y = math.cos(angle), math.sin(angle)
    count = _ALONG * _ACROSS.size
    points, shares = np.zeros((3, count + 1)), np.zeros(count + 1)
    # density of the prior that is meant over that of the fit, where the force is zero
    ratio = 2.0 * (prior.fitted_n / prior.scale_n) ** 2
    power = -0.5 * (prior.freedom + 2.0)
    total = gauss = 0.0
    for i in range(_ALONG):
        z = _REACH * (2.0 * i / (_ALONG - 1) - 1.0)
        density = math.exp(-0.5 * z * z)
        gauss += density
        for j in range(_ACROSS.size):
            p, q = z * along, _ACROSS[j] * across
            x, y = force[0] + c * p - s * q, force[1] + s * p + c * q
            k = i * _ACROSS.size + j
            square = x * x + y * y
            points[0, k], points[1, k], points[2, k] = x, y, math.sqrt(square)
            if x * axis_x + y * axis_y < 0.0:
                tail = (1.0 + square / (prior.freedom * prior.scale_n**2)) ** power
                share = density * _ACROSS_SHARE[j] * tail * math.exp(0.5 * square / prior.fitted_n**2)
                shares[k] = share
                total += share
    pushes = math.log(ratio * total / gauss) if total > 0.0 else _NONE_PUSHES
    odds = max(-700.0, min(700.0, log_odds + pushes))
    contact = 1.0 / (1.0 + math.exp(-odds)) if total > 0.0 else 0.0
    for k in range(count):
        shares[k] *= contact / total if total > 0.0 else 0.0
    shares[count] = 1.0 - contact
    mean, spread = np.zeros(2), np.zeros((2, 2))
    for k in range(count):
        for a in range(2):
            mean[a] += shares[k] * points[a, k]
    for k in range(count + 1):
        for a in range(2):
            for b in range(2):
                spread[a, b] += shares[k] * (points[a, k] - mean[a]) * (points[b, k] - mean[b])
    low, high = np.zeros(3), np.zeros(3)
    for a in range(3):
        low[a], high[a] = _quantiles(points[a], shares)
    return Mixed(mean, spread, contact, low, high)
