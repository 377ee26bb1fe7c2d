"""The tip of a catheter of known length: the shaft is followed to that length, and its tip is searched there.

Beyond the end of the trace there may be a metal tip on a ground of the same grey level, half in shadow, or a hidden
piece. The sign of a flank then changes along the shaft, and its contrast differs between the channels; but both flanks
are visible in most pieces that are as long as the shaft is wide. The smooth arc with the most visible pieces is
followed; a single strong edge counts little.
"""

import math
from typing import NamedTuple

import numpy as np

from ._pixels import Raster, fast
from ._spline import FitBuffers, Spline, fit_axis, heading
from ._stations import ARC, KIND, SHAFT, WEIGHT, add_station
from ._strip import (
    BEHIND,
    BINS,
    BLOCK,
    BLOCKS,
    CELL,
    COLUMNS,
    FLOOR,
    ROWS,
    Arc,
    Deviation,
    arc_at,
    column_of,
    flank_evidence,
    roughness,
    straighten,
)
from ._tip import TIP_SIZE, tip_by_colour
from ._tip_template import match_template, template_difference

MAX_UNDETECTED_RADII = 4.0
"""The last detected piece may be this far before the tip."""
MAX_HIDDEN_RADII = 12.0
"""A hidden piece may be this long, if the catheter ends at its known length."""
MIN_TIP_CONTRAST_GREY = 5.0
"""Smallest difference of grey level between the two sides of the front of the tip."""
MAX_EXCESS_RADII = 4.0
"""A shaft that remains clear this far beyond its length is not this catheter."""
MIN_CLEAR_WEIGHT = 0.5
"""Least weight of a station where the shaft is clear."""
LENGTH_DEVIATION_SHARE = 0.45
"""Standard deviation of the length in shares of its tolerance."""
GROUP_BLOCKS = 4
"""Blocks that are averaged: a diameter of the shaft."""
MAX_TURN_STEPS, TURN_STEP_RAD, LIKELY_TURN_RAD = 6, 0.012, 0.015
MAX_BEND_STEPS, BEND_STEP, LIKELY_BEND = 4, 0.004, 0.006
"""Arcs to try on either side, how far apart, and their standard deviation: radians, and 1 / radius."""
STIFF_TIP_RADII = 7.0
"""Length of the straight metal tip."""
MIN_GROUP_EVIDENCE = 1.3
"""Evidence from which on a stretch counts as detected."""
STRAIGHT_RADII = 9.5
"""The shaft is extended straight when at most this length remains."""
ADDED_WEIGHT = 0.2
"""Weight of the stations that are added."""
MAX_ROUNDS = 12
_FOLLOW_SIZE = ROWS * COLUMNS + 6 * BLOCKS * COLUMNS + BINS
KNOWN_LENGTH_SIZE = max(_FOLLOW_SIZE, TIP_SIZE)
"""Numbers of working memory that `find_tip_at_length` needs."""


class TipAtLength(NamedTuple):
    """Result of `find_tip_at_length`; lengths in px."""

    n: int
    """Number of stations."""
    spline: Spline
    """Fitted to them, over the last arc length + ``ahead`` + 6 px."""
    tip: float
    """Arc length."""
    contrast: float
    """Contrast of the tip in grey levels; 0 where it is not visible."""
    hidden: float
    """Length of a hidden stretch that is too long, or 0."""
    difference: float
    """Mean difference of the tip from the template in grey levels."""


@fast
def _group_evidence(
    flanks: np.ndarray, channels: int, first: int, last: int, turn: float, bend: float, floor: float
) -> float:
    """Returns the evidence of both flanks of the arc in blocks ``first`` to ``last``, as logarithms."""
    total = 0.0
    for side in range(2):
        power = 0.0
        for c in range(channels):
            mean = 0.0
            for b in range(first, last):
                column = column_of(Deviation(turn, bend), b)
                column = min(max(column, 8), COLUMNS - 9)
                mean += flanks[2 * c + side, b, column]
            mean /= (last - first) * floor
            power += mean * mean
        total += math.log1p(power / channels)
    return total


@fast
def _arc_score(flanks: np.ndarray, channels: int, blocks: int, turn: float, bend: float, floor: float) -> float:
    """Returns the log-probability, up to a constant, that the shaft goes on along one arc.

    It is the evidence of both flanks in groups of blocks, and a Gaussian prior about the extended axis.

    Args:
        flanks: (6, `BLOCKS`, `COLUMNS`) contrast in grey levels of left and right flank, channel after channel.
        channels: number of colour channels.
        blocks: number of blocks along the shaft in which flanks are searched.
        turn: angle between arc and extended axis in radians.
        bend: difference of their curvatures in 1 / radius of the shaft.
        floor: contrast of the noise in grey levels.
    """
    total = -0.5 * ((turn / LIKELY_TURN_RAD) ** 2 + (bend / LIKELY_BEND) ** 2)
    first = BEHIND + 1
    while first + 2 <= blocks:
        last = min(first + GROUP_BLOCKS, blocks)
        total += _group_evidence(flanks, channels, first, last, turn, bend, floor) * (last - first) / GROUP_BLOCKS
        first = last
    return total


@fast
def _go_straight(
    stations: np.ndarray, n: int, u: float, v: float, angle: float, back: float, goal: float, half: float
) -> int:
    """Adds stations from the last one straight to ``goal``, from (u, v), ``back`` px before it."""
    last = stations[n - 1, ARC]
    count = max(0, int((goal - last) / (0.5 * half)))
    for k in range(1, count + 1):
        if n == stations.shape[0]:
            break
        s = (goal - last) * k / count
        way_u, way_v = (back + s) * math.cos(angle), (back + s) * math.sin(angle)
        n = add_station(stations, n, u + way_u, v + way_v, last + s, half, ADDED_WEIGHT)
    return n


@fast
def _follow_to(
    image: Raster, half: float, goal: float, work: np.ndarray,
    stations: np.ndarray, n: int,
) -> tuple[int, float]:  # fmt: skip
    """Adds stations behind the first ``n`` up to the arc length ``goal``; returns their number, and the longest gap.

    Gap: the longest stretch where no flank was detected, except the metal tip.
    """
    channels = image.channels
    strip = work[: ROWS * COLUMNS].reshape((ROWS, COLUMNS))
    a = ROWS * COLUMNS
    flanks = work[a : a + 6 * BLOCKS * COLUMNS].reshape((6, BLOCKS, COLUMNS))
    bins = work[a + 6 * BLOCKS * COLUMNS :]
    cell = CELL * half
    widest = 0.0
    taken = stations[n - 1, ARC]
    for _ in range(MAX_ROUNDS):
        last = stations[n - 1, ARC]
        if last > goal - half:
            break
        back = (BEHIND + 1) * BLOCK * cell
        u, v, angle, bend = heading(stations, n, half, back)
        rest = goal - last
        bend *= max(0.0, 1.0 - (STIFF_TIP_RADII * half / rest) ** 2)
        if rest < STRAIGHT_RADII * half:
            # lustre along a metal tip misleads more than the direction of the shaft does
            n = _go_straight(stations, n, u, v, angle, back, goal - 0.5 * half, half)
            break
        arc_ahead = Arc(u, v, angle, bend, last - back)
        inside = 0
        for c in range(channels):
            rows = straighten(image, 1.0, arc_ahead, half, c, strip)
            inside = flank_evidence(strip, rows, flanks[2 * c], flanks[2 * c + 1])
        s0 = last - back
        blocks = min(inside, int((goal - STIFF_TIP_RADII * half - s0) / (BLOCK * cell)))
        if blocks < BEHIND + 3:
            break
        middle = channels // 2
        floor = max(FLOOR, 0.7 * roughness(flanks[2 * middle], flanks[2 * middle + 1], inside, bins))
        best, way, arc = -1e9, 0.0, 0.0
        for i in range(-MAX_TURN_STEPS, MAX_TURN_STEPS + 1):
            for j in range(-MAX_BEND_STEPS, MAX_BEND_STEPS + 1):
                score = _arc_score(flanks, channels, blocks, i * TURN_STEP_RAD, j * BEND_STEP, floor)
                if score > best:
                    best, way, arc = score, i * TURN_STEP_RAD, j * BEND_STEP
        found_to = 0
        first = BEHIND + 1
        while first + 2 <= blocks:
            end = min(first + GROUP_BLOCKS, blocks)
            if _group_evidence(flanks, channels, first, end, way, arc, floor) > MIN_GROUP_EVIDENCE:
                found_to = end
                widest = max(widest, s0 + BLOCK * first * cell - taken)
                taken = s0 + BLOCK * end * cell
            first = end
        if found_to == 0:
            break
        for b in range(BEHIND + 1, found_to):
            if n == stations.shape[0]:
                break
            s = BLOCK * (b + 0.5) * cell
            axis_u, axis_v, turned = arc_at(arc_ahead, s)
            x = BLOCK * (b - BEHIND - 0.5)
            x = (way * x + 0.5 * arc * CELL * x * x) * cell
            at_u = axis_u - x * math.sin(turned)
            at_v = axis_v + x * math.cos(turned)
            n = add_station(stations, n, at_u, at_v, s0 + s, half, ADDED_WEIGHT)
    return n, max(widest, goal - taken - STRAIGHT_RADII * half)


@fast
def continues_beyond(stations: np.ndarray, n: int, goal: float, give: float, half: float) -> bool:
    """Tests whether the shaft was traced beyond the arc length where it must end, at full contrast and without a break.

    Args:
        stations: (k, 6) array of stations.
        n: number of stations.
        goal: arc length of the tip in px, by the known length.
        give: tolerance of ``goal`` in px.
        half: half of the shaft's width in px.

    Returns:
        True where it continues, so that the known length does not fit.
    """
    first, past = goal - give - half, goal + give + MAX_EXCESS_RADII * half
    if n == 0 or stations[n - 1, ARC] < past:
        return False
    i = n - 1
    while i > 0 and stations[i, ARC] > past:
        i -= 1
    while i > 0 and stations[i, ARC] > first:
        if stations[i, KIND] != SHAFT or stations[i, WEIGHT] < MIN_CLEAR_WEIGHT:
            return False
        i -= 1
    return True


@fast
def find_tip_at_length(
    image: Raster, template: np.ndarray, half: float, goal: float, give: float, ahead: float, buffers: FitBuffers,
    work: np.ndarray, stations: np.ndarray, n: int,
) -> TipAtLength:  # fmt: skip
    """Follows the shaft from its last station to where it must end.

    Args:
        image: the frame.
        template: (`TEMPLATE_ROWS`, `TEMPLATE_COLUMNS` x channels) grey levels of the tip; empty if unknown.
        half: half of the shaft's width in px.
        goal: arc length of the tip in px, by the known length.
        give: tolerance of ``goal`` in px.
        ahead: length in px that the spline extends beyond the last station, less 6.
        buffers: working memory of the fit.
        work: working memory of `KNOWN_LENGTH_SIZE` numbers.
        stations: (k, 6) array of stations; new ones are added.
        n: number of stations.

    Returns:
        The tip, and the spline of the stations up to it.
    """
    while n > 6 and stations[n - 1, ARC] > goal - give - half:
        n -= 1
    n, gap = _follow_to(image, half, goal, work, stations, n)
    last = stations[n - 1, ARC]
    spline, _ = fit_axis(stations, n, half, last + ahead + 6.0, buffers)
    if len(template):
        better = match_template(image, template, spline, last, goal, half, work, stations, n)
        if better > 0:
            n, gap = better, 0.0
            last = stations[n - 1, ARC]
            spline, _ = fit_axis(stations, n, half, last + ahead + 6.0, buffers)
    if gap > MAX_HIDDEN_RADII * half or goal - give - last > MAX_UNDETECTED_RADII * half:
        return TipAtLength(n, spline, goal, 0.0, max(gap, goal - last), 0.0)
    tip, contrast = tip_by_colour(image, spline, last, goal, LENGTH_DEVIATION_SHARE * give, half, work)
    hidden = 0.0
    if contrast < MIN_TIP_CONTRAST_GREY:
        # a length alone is no proof: a shaft that ends before may be another object, or this catheter broken off
        contrast, hidden = 0.0, max(goal - last, 1.0)
    if n > 6 and last > tip - 0.3 * half:
        # the stations behind the tip are on another object
        while n > 6 and stations[n - 1, ARC] > tip - 0.3 * half:
            n -= 1
        last = stations[n - 1, ARC]
        spline, _ = fit_axis(stations, n, half, last + ahead + 6.0, buffers)
    difference = 0.0
    if len(template):
        difference = template_difference(image, template, spline, last, tip, half, work)
    return TipAtLength(n, spline, tip, contrast, hidden, difference)
