"""One candidate, from its entry to its curve: everything that happens between two looks of the interpreter."""

import math

import numpy as np

from ._fine_beyond import AHEAD_SIZE, NO_ELECTRODE, count_solid, goes_on, look_beyond
from ._fine_end import END_SIZE
from ._fine_fit import TIP_BACK, fit_spline, measure_ends, resample, spline_at, tip_place
from ._fine_follow import FOLLOW_SIZE
from ._fine_length import base_offset, end_at_length, goes_through
from ._fine_pixels import fast
from ._fine_trace import END_BORDER, END_LOST, END_SHORT, END_TIP, trace_shaft

__all__ = ["RESULT_SIZE", "WORK_SIZE", "solve_shaft"]

_STRAIGHT = 0.7
"""Radii before the tip from which on the axis is straight: a compromise of round tips (1) and flat ones (0)."""
_NOTHING = 8.0
"""Less evidence of a shaft behind a gap than this is none."""
_CLEAN_LOW, _CLEAN_HIGH = 0.6, 1.25
"""A tip whose edge has less or more than these shares of the shaft's contrast is looked at a second time."""
_OWN_LOW, _OWN_HIGH = 0.6, 1.6
"""The same against the flanks just before the end: a tip whose edge lies within is believed whatever lies beyond."""
WORK_SIZE = 728 + 1200 + 32 + max(AHEAD_SIZE, END_SIZE, FOLLOW_SIZE)

RESULT_SIZE = 16
"""Stations, diameter, contrast, level, gap, blind length, length, drop at the tip, base u, v, angle, rms, last u, v,
how much goes on beyond the end that was not followed, and by how many grey levels the end is off from its look."""


@fast
def solve_shaft(
    pixels: np.ndarray,
    row: int,
    channels: int,
    box: np.ndarray,
    plan: np.ndarray,
    look: np.ndarray,
    stations: np.ndarray,
    result: np.ndarray,
    points: np.ndarray,
    work: np.ndarray,
) -> tuple[int, int]:
    """Trace, fit, find the tip, resample; returns (number of stations, way it ended) and fills the buffers.

    ``plan``: sign, entry u, v, heading, width, contrast, known diameter, longest gap, how far inside the base line the
    entry was found (the curve is continued back to the line), length of the base's line fit, the catheter's length (0:
    nobody knows), which is right within so much. ``work``: scratch of `WORK_SIZE` + twice the number of points.
    ``look``: of the catheter's end, for `aim_again`; empty where nobody knows it.
    """
    sign, entry_u, entry_v, heading, width = plan[0], plan[1], plan[2], plan[3], plan[4]
    contrast, known, max_gap, depth, base_length = plan[5], plan[6], plan[7], plan[8], plan[9]
    known_length, give = plan[10], plan[11]
    scratch = work[:128]
    coefficients = work[128:328].reshape((100, 2))
    band = work[328:728].reshape((100, 4))
    weights = work[728:1960]
    beyond = work[1960:WORK_SIZE]
    lengths = work[WORK_SIZE:]
    n, end = trace_shaft(
        pixels, row, channels, box, sign, entry_u, entry_v, heading, width, contrast, known, max_gap, scratch,
        stations, result,
    )  # fmt: skip
    diameter, typical, last, level, gap, blind = result[0], result[1], result[2], result[3], result[4], result[5]
    result[0] = n
    result[1] = diameter
    result[2] = typical
    result[3] = level
    result[4] = gap
    result[5] = blind
    result[6] = last
    result[7] = 0.0
    result[14] = result[15] = 0.0
    result[12] = stations[max(n - 1, 0), 0]
    result[13] = stations[max(n - 1, 0), 1]
    if end == END_SHORT:
        return n, end
    half = 0.5 * diameter
    ahead = half + max(0.5 * half, 1.25) + 2.5
    length = last + ahead + 6.0
    intervals = int(min(max(length / max(1.2 * diameter, 8.0), 6.0), 80.0))
    for i in range(n):
        weights[i] = stations[i, 4]
    fit_spline(stations, n, length, intervals, 0.05, coefficients, band, weights)
    tip, drop = tip_place(
        pixels, row, channels, box, sign, coefficients, intervals, length, last, half, TIP_BACK, ahead, typical, scratch
    )
    if end == END_LOST:
        tip = last
    solid = count_solid(stations, n, half)
    unclear = end == END_LOST or solid < n or not _CLEAN_LOW * typical < drop < _CLEAN_HIGH * typical
    straight = goal = math.inf
    if known_length > 0.0:
        goal = known_length + base_offset(coefficients, intervals, length, heading, entry_u, entry_v, depth)
        unclear = unclear or abs(tip - goal) > give
    elif not unclear:
        least = max(6.0, 0.06 * typical)
        unclear = goes_on(pixels, row, channels, box, coefficients, intervals, length, tip, half, least)
    if unclear and known_length > 0.0:
        if (end != END_BORDER or last > goal - give) and not goes_through(stations, n, goal, give, half):
            n, intervals, tip, drop, hidden, result[15] = end_at_length(
                pixels, row, channels, box, look, half, goal, give, ahead, coefficients, band, weights, beyond,
                stations, solid,
            )  # fmt: skip
            last = straight = stations[n - 1, 2]
            length = last + ahead + 6.0
            end = END_LOST if hidden > 0.0 else END_TIP
            result[4] = hidden
            result[5] = blind + max(0.0, tip - last)
            result[0] = n
            result[12] = stations[n - 1, 0]
            result[13] = stations[n - 1, 1]
    elif unclear and (end != END_BORDER or gap > max_gap):
        n, hole, rest, own = look_beyond(
            pixels, row, channels, box, sign, half, typical, max_gap, scratch, coefficients, band, weights, beyond,
            stations, solid, n,
        )  # fmt: skip
        last = stations[n - 1, 2]
        if hole > 0.0:
            end = END_LOST
            result[4] = hole
        elif end == END_LOST and rest < _NOTHING:
            end = END_TIP
        elif hole < 0.0:
            end = END_BORDER
            result[4] = 0.0
        length = last + ahead + 6.0
        intervals = int(min(max(length / max(1.2 * diameter, 8.0), 6.0), 80.0))
        for i in range(n):
            weights[i] = stations[i, 4]
        fit_spline(stations, n, length, intervals, 0.05, coefficients, band, weights)
        tip, drop = tip_place(
            pixels, row, channels, box, sign, coefficients, intervals, length, last, half, TIP_BACK + 1.5 * half,
            ahead, typical, scratch,
        )  # fmt: skip
        if end == END_LOST:
            tip = last
        elif drop != 0.0 and tip < last:
            # what was measured behind the tip lies on something else
            while n > 6 and stations[n - 1, 2] > tip - 0.3 * half:
                n -= 1
            for i in range(n):
                weights[i] = stations[i, 4]
            fit_spline(stations, n, length, intervals, 0.05, coefficients, band, weights)
        result[0] = n
        result[12] = stations[n - 1, 0]
        result[13] = stations[n - 1, 1]
        if end != END_LOST and (rest >= NO_ELECTRODE or not _OWN_LOW * own < drop < _OWN_HIGH * own):
            result[14] = rest
    more = measure_ends(
        pixels, row, channels, box, sign, coefficients, intervals, length, tip if drop > 0.0 else last + 0.5 * half,
        half, heading, max(8.0, 0.25 * typical), scratch, stations, n,
    )  # fmt: skip
    for i in range(n, more):
        weights[i] = stations[i, 4]
    rms = fit_spline(stations, more, length, intervals, 0.05, coefficients, band, weights)
    # back to the base line, straight along the first tangent
    first = base_offset(coefficients, intervals, length, heading, entry_u, entry_v, depth)
    straight = min(straight, tip - _STRAIGHT * half if drop > 0.0 else tip)
    total = resample(coefficients, intervals, length, first, tip, straight, lengths, points)
    # the base tangent: the line through the first part of the shaft, as thesis algorithm 1 has it
    reach = min(base_length, 0.25 * total)
    mean_s = first + 0.5 * reach
    su = sv = 0.0
    for i in range(16):
        s = first + reach * i / 15.0
        u, v, _, _ = spline_at(coefficients, intervals, length, s)
        su += (s - mean_s) * u
        sv += (s - mean_s) * v
    result[6] = total
    result[7] = drop
    result[8] = points[0, 0]
    result[9] = points[0, 1]
    result[10] = math.atan2(sv, su)
    result[11] = rms
    return n, end
