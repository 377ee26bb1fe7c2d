"""One candidate, from its entry to its centreline: trace, fit, tip, points; without the interpreter in between."""

import math
from typing import Any, NamedTuple

import numpy as np

from ._continuation import CONTINUATION_SIZE, NO_ELECTRODE, continue_trace, count_solid, may_continue
from ._known_length import KNOWN_LENGTH_SIZE, continues_beyond, find_tip_at_length
from ._pixels import Raster, fast
from ._spline import FitBuffers, fit_axis, fit_spline, resample, spline_at
from ._stations import (
    ARC,
    END_BORDER,
    END_LOST,
    END_SHORT,
    END_TIP,
    WEIGHT,
    U,
    V,
)
from ._tip import TIP_BACK, base_offset, measure_ends, tip_by_contrast
from ._trace import Candidate, trace_shaft

STRAIGHT_TIP_RADII = 0.7
"""The axis is straight over this length before the tip: a compromise of round tips (1) and flat ones (0)."""
MIN_EVIDENCE_FLOORS = 8.0
"""Smallest evidence of a shaft behind a gap."""
MIN_CLEAN_SHARE, MAX_CLEAN_SHARE = 0.6, 1.25
"""A tip is examined further if its edge has a smaller or larger share of the shaft's contrast."""
MIN_OWN_SHARE, MAX_OWN_SHARE = 0.6, 1.6
"""A tip is accepted if its edge has a share of the contrast of the last flanks between these limits."""
STATIONS = 1200
"""Largest number of stations of a shaft."""
_PROFILE = 128
_COEFFICIENTS = _PROFILE + 200
_BAND = _COEFFICIENTS + 400
_WEIGHTS = _BAND + STATIONS + 32
WORK_SIZE = _WEIGHTS + max(CONTINUATION_SIZE, KNOWN_LENGTH_SIZE)
"""Numbers of working memory that `solve_shaft` needs beside twice the number of points."""


class ShaftFit(NamedTuple):
    """Result of `solve_shaft`; lengths and positions in px, angles in radians with v down."""

    n: int
    """Number of stations."""
    end: int
    """One of the ``END_`` constants."""
    diameter: float
    contrast: float
    gap: float
    """See `TracedShaft`; `END_LOST`: the gap or hidden stretch that is too long."""
    blind: float
    """Arc length without flanks."""
    length: float
    """Length from the base line to the tip."""
    drop: float
    """Drop of grey level at the tip; 0 where no clear edge ends the shaft."""
    base_u: float
    base_v: float
    base_angle: float
    rms: float
    """RMS distance of the stations from the curve."""
    last_u: float
    last_v: float
    """The last station."""
    rest: float
    """Evidence of something beyond the end that was not followed, in floors."""
    difference: float
    """Mean difference of the tip from its template in grey levels."""


@fast
def solve_shaft(
    frame: tuple[Any, ...], entry: tuple[float, ...], template: np.ndarray, stations: np.ndarray, points: np.ndarray,
    work: np.ndarray,
) -> ShaftFit:  # fmt: skip
    """Traces a candidate, fits its axis, finds its tip and resamples the centreline.

    Args:
        frame: fields of a `Raster` as a plain tuple; see `find_entries`.
        entry: fields of a `Candidate` as a plain tuple.
        template: grey levels of the tip; empty if unknown.
        stations: (`STATIONS`, 6) array that is filled.
        points: (k, 2) array that receives the centreline, u, v in px.
        work: working memory of `WORK_SIZE` + 2 k numbers.

    Returns:
        The fit; its `END_` constant states why the trace ended.
    """
    image, candidate = Raster(*frame), Candidate(*entry)
    sign, max_gap, known_length, give = candidate.sign, candidate.max_gap, candidate.length, candidate.tolerance
    profile = work[:_PROFILE]
    coefficients = work[_PROFILE:_COEFFICIENTS].reshape((100, 2))
    band = work[_COEFFICIENTS:_BAND].reshape((100, 4))
    weights = work[_BAND:_WEIGHTS]
    buffers = FitBuffers(coefficients, band, weights)
    beyond = work[_WEIGHTS:WORK_SIZE]
    lengths = work[WORK_SIZE:]
    traced = trace_shaft(image, candidate, profile, stations)
    n, end, diameter, typical = traced.n, traced.end, traced.diameter, traced.contrast
    last, gap, blind = traced.last, traced.gap, traced.blind
    if end == END_SHORT:
        last_u, last_v = stations[max(n - 1, 0), U], stations[max(n - 1, 0), V]
        return ShaftFit(n, end, diameter, typical, gap, blind, last, 0.0, 0.0, 0.0, 0.0, 0.0, last_u, last_v, 0.0, 0.0)
    unfollowed = difference = 0.0
    traced_blind = blind
    half = 0.5 * diameter
    ahead = half + max(0.5 * half, 1.25) + 2.5
    spline, _ = fit_axis(stations, n, half, last + ahead + 6.0, buffers)
    tip, drop = tip_by_contrast(image, sign, spline, last, half, TIP_BACK, ahead, typical, profile)
    if end == END_LOST:
        tip = last
    solid = count_solid(stations, n, half)
    unclear = end == END_LOST or solid < n or not MIN_CLEAN_SHARE * typical < drop < MAX_CLEAN_SHARE * typical
    straight = goal = math.inf
    if known_length > 0.0:
        offset = base_offset(spline, candidate.heading, candidate.u, candidate.v, candidate.depth)
        goal = known_length + offset
        unclear = unclear or abs(tip - goal) > give
    elif not unclear:
        unclear = may_continue(image, spline, tip, half, max(6.0, 0.06 * typical))
    if unclear and known_length > 0.0:
        if (end != END_BORDER or last > goal - give) and not continues_beyond(stations, n, goal, give, half):
            found = find_tip_at_length(image, template, half, goal, give, ahead, buffers, beyond, stations, solid)
            n, spline, tip, drop = found.n, found.spline, found.tip, found.contrast
            difference = found.difference
            straight = stations[n - 1, ARC]
            end = END_LOST if found.hidden > 0.0 else END_TIP
            gap = found.hidden
            blind = traced_blind + max(0.0, tip - straight)
            last = straight
    elif unclear and (end != END_BORDER or gap > max_gap):
        more = continue_trace(image, sign, half, typical, max_gap, profile, buffers, beyond, stations, solid, n)
        n = more.n
        last = stations[n - 1, ARC]
        if more.gap > 0.0:
            end = END_LOST
            gap = more.gap
        elif end == END_LOST and more.rest < MIN_EVIDENCE_FLOORS:
            end = END_TIP
        elif more.gap < 0.0:
            end = END_BORDER
            gap = 0.0
        spline, _ = fit_axis(stations, n, half, last + ahead + 6.0, buffers)
        tip, drop = tip_by_contrast(image, sign, spline, last, half, TIP_BACK + 1.5 * half, ahead, typical, profile)
        if end == END_LOST:
            tip = last
        elif drop != 0.0 and tip < last:
            # the stations behind the tip are on another object
            while n > 6 and stations[n - 1, ARC] > tip - 0.3 * half:
                n -= 1
            spline, _ = fit_axis(stations, n, half, spline.length, buffers)
        own = more.contrast
        if end != END_LOST and (more.rest >= NO_ELECTRODE or not MIN_OWN_SHARE * own < drop < MAX_OWN_SHARE * own):
            unfollowed = more.rest
    last_u, last_v = stations[n - 1, U], stations[n - 1, V]
    tip_edge = tip if drop > 0.0 else last + 0.5 * half
    least = max(8.0, 0.25 * typical)
    measured = measure_ends(image, sign, spline, tip_edge, half, candidate.heading, least, profile, stations, n)
    for i in range(n, measured):
        weights[i] = stations[i, WEIGHT]
    # the traced stations keep the weights of the fit before, smaller for outliers
    rms = fit_spline(spline, stations, measured, band, weights)
    # back to the base line, straight along the first tangent
    first = base_offset(spline, candidate.heading, candidate.u, candidate.v, candidate.depth)
    straight = min(straight, tip - STRAIGHT_TIP_RADII * half if drop > 0.0 else tip)
    total = resample(spline, first, tip, straight, lengths, points)
    # the base tangent: the line through the first part of the shaft, as in thesis algorithm 1
    reach = min(candidate.base_length, 0.25 * total)
    mean_s = first + 0.5 * reach
    su = sv = 0.0
    for i in range(16):
        s = first + reach * i / 15.0
        u, v, _, _ = spline_at(spline, s)
        su += (s - mean_s) * u
        sv += (s - mean_s) * v
    angle = math.atan2(sv, su)
    return ShaftFit(
        n, end, diameter, typical, gap, blind, total, drop, points[0, 0], points[0, 1], angle, rms, last_u,
        last_v, unfollowed, difference,
    )  # fmt: skip
