"""The end of a catheter whose length is known: followed just so far, and its tip looked for there."""

import math

import numpy as np

from ._fine_aim import aim_again, end_unlike
from ._fine_end import end_place
from ._fine_fit import fit_spline, spline_at
from ._fine_follow import follow_to
from ._fine_pixels import fast

__all__ = ["base_offset", "end_at_length", "goes_through"]

_UNSEEN = 4.0
"""So many radii before its tip a catheter may be seen for the last time."""
_HIDDEN = 12.0
"""So many radii of it may be hidden, where what comes to light again has the right length."""
_STANDS = 5.0
"""Grey levels by which the tip's front must part what is before and behind it."""
_PAST = 4.0
"""A shaft that shows as clearly as ever so many radii past its length is not this catheter's."""
_CLEAR = 0.5
"""Least weight of a station where the shaft shows clearly."""
_DEVIATION = 0.45
"""Standard deviation of the length in shares of what it may be off."""


@fast
def base_offset(
    coefficients: np.ndarray, intervals: int, length: float, heading: float, entry_u: float, entry_v: float,
    depth: float,
) -> float:  # fmt: skip
    """Arc length at which the curve, straight along its first tangent, meets the base line."""
    u, v, du, dv = spline_at(coefficients, intervals, length, 0.0)
    inward_u, inward_v = math.cos(heading), math.sin(heading)
    rate = du * inward_u + dv * inward_v
    inside = (u - entry_u) * inward_u + (v - entry_v) * inward_v + depth
    first = -inside / rate if rate > 0.3 else 0.0
    return min(max(first, -depth - 3.0), 3.0)


@fast
def goes_through(stations: np.ndarray, n: int, goal: float, give: float, half: float) -> bool:
    """Whether the shaft was traced past the place where it must end, at full contrast and without a break."""
    first, past = goal - give - half, goal + give + _PAST * half
    if n == 0 or stations[n - 1, 2] < past:
        return False
    i = n - 1
    while i > 0 and stations[i, 2] > past:
        i -= 1
    while i > 0 and stations[i, 2] > first:
        if stations[i, 5] != 1.0 or stations[i, 4] < _CLEAR:
            return False
        i -= 1
    return True


@fast
def end_at_length(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, look: np.ndarray, half: float, goal: float,
    give: float, ahead: float, coefficients: np.ndarray, band: np.ndarray, weights: np.ndarray, work: np.ndarray,
    stations: np.ndarray, n: int,
) -> tuple[int, int, float, float, float, float]:  # fmt: skip
    """Follow the shaft from its station ``n`` - 1 to where it must end: arc length ``goal``, within ``give``.

    The spline is left fitted over the last station's arc length + ``ahead`` + 6. Returns stations; their intervals;
    the tip; what it stands out by, 0 where it is not seen; the length of a hidden stretch that is too long, or 0; by
    how many grey levels the end is off from its ``look``.
    """
    while n > 6 and stations[n - 1, 2] > goal - give - half:
        n -= 1
    n, gap = follow_to(pixels, row, channels, box, half, goal, work, stations, n)
    last, length, intervals = _fit(stations, n, half, ahead, coefficients, band, weights)
    if len(look):
        better = aim_again(
            pixels, row, channels, box, look, coefficients, intervals, length, last, goal, half, work, stations, n
        )
        if better > 0:
            n, gap = better, 0.0
            last, length, intervals = _fit(stations, n, half, ahead, coefficients, band, weights)
    if gap > _HIDDEN * half or goal - give - last > _UNSEEN * half:
        return n, intervals, goal, 0.0, max(gap, goal - last), 0.0
    tip, stands = end_place(
        pixels, row, channels, box, coefficients, intervals, length, last, goal, _DEVIATION * give, half, work
    )
    hidden = 0.0
    if stands < _STANDS:
        # a length alone is no proof: what ends before may be another thing, or this one broken off
        stands, hidden = 0.0, max(goal - last, 1.0)
    if n > 6 and last > tip - 0.3 * half:
        # what was measured behind the tip lies on something else
        while n > 6 and stations[n - 1, 2] > tip - 0.3 * half:
            n -= 1
        last, length, intervals = _fit(stations, n, half, ahead, coefficients, band, weights)
    unlike = 0.0
    if len(look):
        unlike = end_unlike(pixels, row, channels, box, look, coefficients, intervals, length, last, tip, half, work)
    return n, intervals, tip, stands, hidden, unlike


@fast
def _fit(
    stations: np.ndarray, n: int, half: float, ahead: float, coefficients: np.ndarray, band: np.ndarray,
    weights: np.ndarray,
) -> tuple[float, float, int]:  # fmt: skip
    """Fit the spline to ``n`` stations; the last one's arc length, the length it is fitted over, its intervals."""
    last = stations[n - 1, 2]
    length = last + ahead + 6.0
    intervals = int(min(max(length / max(2.4 * half, 8.0), 6.0), 80.0))
    for i in range(n):
        weights[i] = stations[i, 4]
    fit_spline(stations, n, length, intervals, 0.05, coefficients, band, weights)
    return last, length, intervals
