"""Continues a shaft beyond the end of its trace, where it has another grey level or only one visible flank.

The trace ends where a pair of flanks is lost. Here the image beyond that end is straightened along the extended axis
(`_strip`), the smooth arc with the strongest flanks is searched in it, and stations are added along that arc as far as
the flanks are visible. The search is repeated from the new end. An object that
cannot be separated from the catheter is reported as evidence that was not followed; the tracer then rejects the end.
"""

import math
from typing import NamedTuple

import numpy as np

from ._pixels import Raster, fast, grey_between, measure_pair
from ._spline import FitBuffers, Spline, fit_axis, spline_at
from ._stations import ARC, KIND, OTHER, PALE, U, V, add_station
from ._strip import (
    BEHIND,
    BINS,
    BLOCK,
    BLOCKS,
    CELL,
    COLUMNS,
    FLOOR,
    MIDDLE,
    ROWS,
    Arc,
    Deviation,
    Flanks,
    arc_at,
    best_deviation,
    column_of,
    flank_evidence,
    ground_visible,
    mean_evidence,
    refine_deviation,
    roughness,
    straighten,
)

CONTINUATION_SIZE = ROWS * COLUMNS + 2 * BLOCKS * COLUMNS + BINS
"""Numbers of working memory that `continue_trace` needs."""
MIN_EVIDENCE_FLOORS = 15.0
"""Evidence beyond the end, in floors summed over blocks, from which on something continues there."""
MAX_ELECTRODE_RADII = 11.0
"""A piece that is paler than the shaft, or lighter than the ground, over a greater length is no electrode."""
NO_ELECTRODE = 1000.0
"""Value of `Continuation.rest` where the followed piece is too long for an electrode."""
MAX_ROUNDS = 64
"""The end is moved forward at most this many times."""
MAX_TURN_RAD = 0.3
"""The last steps of a trace turn by at most this angle within a radius of the shaft."""
MAX_LONE_TURN_RAD, MAX_LONE_BEND = 0.12, 0.03
"""A single edge that turns by more (radians), or bends by more (1/radius), is not a flank."""
STEP_SHARE = 0.6
"""Weight of flanks that both rise, or both fall, to the same side: a step in the ground has such flanks, too."""
MIN_CONTRAST_SHARE_BEHIND_GAP = 0.4
"""Behind a gap the shaft must have this share of its contrast."""
WIDENING = 1.2
"""Factor by which the half width is enlarged when nothing is found: the shaft may bend toward the camera."""
MAX_WIDENING = 1.4
"""The half width is enlarged only while it is below this multiple of the first one."""


class Continuation(NamedTuple):
    """Result of `continue_trace`."""

    n: int
    """Number of stations."""
    gap: float
    """Length in px of a gap that was too long to go on; -1 where the shaft leaves the image; 0 otherwise."""
    rest: float
    """Evidence that was not followed, in floors."""
    contrast: float
    """Contrast of the shaft before the first end, in grey levels."""


class _Found(NamedTuple):
    """The strongest arc beyond an end; ``total`` is 0 where there is none."""

    total: float
    """Sum of its evidence above the floor, in grey levels."""
    last: int
    """Its last block."""
    deviation: Deviation
    left_sign: float
    right_sign: float
    """+1 where the flank has the shaft's polarity, -1 where it is inverted."""
    mean: float
    """Mean evidence of its visible blocks."""
    lone: bool
    """Whether only one of its flanks is visible."""
    rejected: float
    """Largest sum of an arc that was rejected because it is the rim of another object."""


class _WidestGap(NamedTuple):
    """The widest gap on the followed arc, in blocks."""

    blocks: int
    bare_blocks: int
    """Blocks of it where the ground is visible."""
    end: int
    """Block at which it ends."""
    evidence_behind: float
    """Sum of the evidence of the blocks behind it."""


@fast
def _arc_beyond(spline: Spline, s: float, half: float) -> Arc:
    """Extends the axis at arc length ``s`` by a circle; 0.7 of the curvature over the last three radii."""
    u, v, du, dv = spline_at(spline, s)
    _, _, au, av = spline_at(spline, s - 3.0 * half)
    curvature = (du * av - dv * au) / -(math.hypot(du, dv) * math.hypot(au, av) * 3.0 * half) * 0.7
    return Arc(u, v, math.atan2(dv, du), curvature, s)


@fast
def may_continue(image: Raster, spline: Spline, tip: float, half: float, least: float) -> bool:
    """Tests quickly whether either flank, extended beyond the tip, separates two grey levels.

    Args:
        image: the frame.
        spline: the axis.
        tip: arc length of the tip in px.
        half: half of the shaft's width in px.
        least: smallest mean difference across a flank, in grey levels.

    Returns:
        True where a flank separates two grey levels, so that the shaft may continue.
    """
    arc = _arc_beyond(spline, tip, half)
    clear = max(0.2 * half, 1.0)
    far = half + 2.0 * clear
    for part in range(3):
        left = right = 0.0
        seen = 0
        for k in range(4):
            pu, pv, angle = arc_at(arc, (1.0 + 4.0 * part + k) * half)
            nu, nv = -math.sin(angle), math.cos(angle)
            if pu - far < image.left or pu + far > image.right - 1.001:
                continue
            if pv - far < image.top or pv + far > image.bottom - 1.001:
                continue
            seen += 1
            for m in range(1, 3):
                inner, outer = half - m * clear, half + m * clear
                left += grey_between(image, pu - inner * nu, pv - inner * nv)
                left -= grey_between(image, pu - outer * nu, pv - outer * nv)
                right += grey_between(image, pu + inner * nu, pv + inner * nv)
                right -= grey_between(image, pu + outer * nu, pv + outer * nv)
        if seen > 1 and max(abs(left), abs(right)) > 2.0 * seen * least:
            return True
    return False


@fast
def _add_stations(
    image: Raster, sign: float, arc: Arc, half: float, found: _Found, first: int, last: int, flanks: Flanks,
    profile: np.ndarray, stations: np.ndarray, n: int,
) -> int:  # fmt: skip
    """Measures the flanks along the found arc from block ``first`` to ``last``; returns the number of stations.

    Where only one flank is visible, the centre is half a width beside it.
    """
    cell = CELL * half
    reach = max(1.5, 0.28 * half)
    least = 1.5 * flanks.floor
    for b in range(first, last + 1):
        if n == stations.shape[0]:
            break
        s = (BLOCK * (b + 0.5)) * cell
        axis_u, axis_v, angle = arc_at(arc, s)
        nu, nv = -math.sin(angle), math.cos(angle)
        column = column_of(found.deviation, b)
        x = column - MIDDLE
        u, v = axis_u + x * cell * nu, axis_v + x * cell * nv
        if u < image.left or v < image.top or u > image.right - 1.001 or v > image.bottom - 1.001:
            break
        left, left_drop, right, right_drop = measure_pair(image, sign, u, v, nu, nv, half, reach, profile)
        left_seen = left_drop * found.left_sign > least
        left_seen = left_seen and flanks.left[b, column] * found.left_sign > flanks.floor
        right_seen = right_drop * found.right_sign > least
        right_seen = right_seen and flanks.right[b, column] * found.right_sign > flanks.floor
        if left_seen and right_seen and abs(left + right - 2.0 * half) < 0.3 * half:
            offset, weight = 0.5 * (right - left), 0.4
        elif left_seen and (not right_seen or abs(left - half) < abs(right - half)):
            offset, weight = half - left, 0.15
        elif right_seen:
            offset, weight = right - half, 0.15
        else:
            continue
        if abs(offset) > reach:
            continue
        n = add_station(stations, n, u + offset * nu, v + offset * nv, arc.start_arc + s, half, weight)
    return n


@fast
def _judge_arc(
    flanks: Flanks, last: int, deviation: Deviation, left_sign: float, right_sign: float
) -> tuple[float, bool]:
    """Returns the mean positive evidence of the flanks up to block ``last``, and whether only one is visible."""
    floor = flanks.floor
    seen = seen_left = seen_right = 0.0
    positive = 0
    for b in range(BEHIND + 1, last + 1):
        column = column_of(deviation, b)
        p, q = left_sign * flanks.left[b, column], right_sign * flanks.right[b, column]
        here = mean_evidence(p, q, flanks.cap)
        if here > 0.0:
            seen += here
            positive += 1
        seen_left += min(max(p, -2.0 * floor), 3.0 * floor)
        seen_right += min(max(q, -2.0 * floor), 3.0 * floor)
    count = last - BEHIND
    return seen / max(positive, 1), min(seen_left, seen_right) < floor * count or left_sign != right_sign


@fast
def count_solid(stations: np.ndarray, n: int, half: float) -> int:
    """Counts the stations before the last ones that have other grey levels, or that turn too sharply for a shaft.

    Args:
        stations: (k, 6) array of stations.
        n: number of stations.
        half: half of the shaft's width in px.

    Returns:
        Number of the stations that stay.
    """
    first = max(n - 4, 6)
    for i in range(first, n):
        before_u, before_v = stations[i - 1, U] - stations[i - 3, U], stations[i - 1, V] - stations[i - 3, V]
        step_u, step_v = stations[i, U] - stations[i - 1, U], stations[i, V] - stations[i - 1, V]
        turn = math.atan2(before_u * step_v - before_v * step_u, before_u * step_u + before_v * step_v)
        if abs(turn) > MAX_TURN_RAD * max(1.0, math.hypot(step_u, step_v) / half):
            n = i
            break
    while n > 6 and (stations[n - 1, KIND] == OTHER or stations[n - 1, KIND] == PALE):
        n -= 1
    return n


@fast
def _find_arc(flanks: Flanks, widened: bool, moved: bool) -> _Found:
    """Searches the strongest arc over the four combinations of the flanks' signs.

    A single edge that is long or curved, or that is found only after the width was enlarged or the end was moved
    forward, is the rim of another object.
    """
    found = _Found(0.0, 0, Deviation(0.0, 0.0), 1.0, 1.0, 0.0, False, 0.0)
    rejected = 0.0
    for k in range(4):
        left_sign, right_sign = 1.0 - (k & 1) * 2.0, 1.0 - (k >> 1) * 2.0
        total, last, deviation = best_deviation(flanks, left_sign, right_sign)
        if left_sign != right_sign:
            total *= STEP_SHARE
        if total < max(found.total, 0.5 * MIN_EVIDENCE_FLOORS * flanks.floor):
            continue
        deviation = refine_deviation(flanks, last, left_sign, right_sign, deviation)
        mean, lone = _judge_arc(flanks, last, deviation, left_sign, right_sign)
        curved = abs(deviation.turn) > MAX_LONE_TURN_RAD or abs(deviation.bend) > MAX_LONE_BEND
        if lone and (last >= flanks.blocks - 2 or widened or moved or curved):
            rejected = max(rejected, total)
            continue
        found = _Found(total, last, deviation, left_sign, right_sign, mean, lone, 0.0)
    return _Found(
        found.total, found.last, found.deviation, found.left_sign, found.right_sign, found.mean, found.lone, rejected
    )


@fast
def _visible_end(flanks: Flanks, found: _Found) -> int:
    """Returns the last block of the found arc before which at least half of its mean evidence remains."""
    run = top = 0.0
    end = BEHIND
    for b in range(BEHIND + 1, found.last + 1):
        column = column_of(found.deviation, b)
        p, q = found.left_sign * flanks.left[b, column], found.right_sign * flanks.right[b, column]
        here = mean_evidence(p, q, flanks.cap)
        run += max(min(here, 1.5 * found.mean), -0.5 * found.mean) - 0.5 * found.mean
        if run > top:
            top, end = run, b
    return end


@fast
def _widest_gap(strip: np.ndarray, flanks: Flanks, found: _Found, end: int, ground_tolerance: float) -> _WidestGap:
    """Finds the widest gap on the found arc up to block ``end``; ``ground_tolerance`` in grey levels."""
    gap = bare = widest = widest_bare = behind_from = 0
    behind = 0.0
    for b in range(BEHIND + 1, end + 1):
        column = column_of(found.deviation, b)
        p, q = found.left_sign * flanks.left[b, column], found.right_sign * flanks.right[b, column]
        if max(p, q) < flanks.floor:
            gap += 1
            bare += 1 if ground_visible(strip, b, column, ground_tolerance) else 0
        else:
            gap = bare = 0
        behind += 0.5 * (p + q)
        if gap > widest:
            widest, widest_bare, behind, behind_from = gap, bare, 0.0, b
    return _WidestGap(widest, widest_bare, behind_from, behind)


@fast
def _count_agreeing(
    stations: np.ndarray, n: int, kept: int, arc: Arc, half: float, deviation: Deviation, end_arc: float, cell: float
) -> int:
    """Counts the stations of the trace, from ``n`` to ``kept``, that are on the found arc before ``end_arc``."""
    while n < kept and stations[n, ARC] < end_arc:
        s = stations[n, ARC] - arc.start_arc
        u, v, angle = arc_at(arc, s)
        offset = (stations[n, V] - v) * math.cos(angle) - (stations[n, U] - u) * math.sin(angle)
        expected = (column_of(deviation, int(s / (BLOCK * cell))) - MIDDLE) * cell
        if abs(offset - expected) > 0.5 * half:
            break
        n += 1
    return n


@fast
def _flank_blocks(work: np.ndarray, rows: int, strip: np.ndarray, contrast: float) -> Flanks:
    """Computes the evidence of the flanks in the first ``rows`` of ``strip``."""
    size = BLOCKS * COLUMNS
    left = work[:size].reshape((BLOCKS, COLUMNS))
    right = work[size : 2 * size].reshape((BLOCKS, COLUMNS))
    blocks = flank_evidence(strip, rows, left, right)
    floor = max(FLOOR, 0.7 * roughness(left, right, blocks, work[2 * size : 2 * size + BINS]))
    return Flanks(left, right, blocks, floor, max(0.5 * contrast, 20.0))


@fast
def _own_evidence(flanks: Flanks) -> float:
    """Returns the mean evidence of the flanks of the known shaft, before its end."""
    own = 0.0
    for b in range(BEHIND):
        own += 0.5 * (flanks.left[b, MIDDLE] + flanks.right[b, MIDDLE]) / BEHIND
    return own


@fast
def continue_trace(
    image: Raster, sign: float, half: float, contrast: float, max_gap: float, profile: np.ndarray, buffers: FitBuffers,
    work: np.ndarray, stations: np.ndarray, n: int, kept: int,
) -> Continuation:  # fmt: skip
    """Follows the shaft behind station ``n`` - 1.

    Args:
        image: the frame.
        sign: +1 for a light shaft, -1 for a dark one.
        half: half of the shaft's width in px.
        contrast: contrast of the shaft in grey levels.
        max_gap: longest gap in px.
        profile: buffer for one profile.
        buffers: working memory of the fit.
        work: working memory of `CONTINUATION_SIZE` numbers.
        stations: (k, 6) array; rows from ``n`` on receive the stations that are found.
        n: number of stations that certainly belong to the shaft.
        kept: number of stations that the trace found in all.

    Returns:
        Number of stations, and the gap or the evidence that was not followed.
    """
    strip = work[: ROWS * COLUMNS].reshape((ROWS, COLUMNS))
    size = half
    rest = own = 0.0
    first_n = n
    shaft_to = stations[n - 1, ARC]
    for _ in range(MAX_ROUNDS):
        cell = CELL * size
        block = BLOCK * cell
        last = stations[n - 1, ARC]
        spline, _ = fit_axis(stations, n, half, last + 2.0, buffers)
        arc = _arc_beyond(spline, last - (BEHIND + 1) * BLOCK * cell, half)
        rows = straighten(image, sign, arc, size, -1, strip)
        flanks = _flank_blocks(work[ROWS * COLUMNS :], rows, strip, contrast)
        if n == first_n and size == half:
            own = _own_evidence(flanks)
        found = _find_arc(flanks, size > half, n > first_n)
        if found.total < MIN_EVIDENCE_FLOORS * flanks.floor:
            if n == first_n:
                rest = max(rest, max(found.total, found.rejected) / flanks.floor)
            nothing = found.rejected < MIN_EVIDENCE_FLOORS * flanks.floor
            if nothing or n > first_n or size > MAX_WIDENING * half:
                break
            size *= WIDENING
            continue
        end = _visible_end(flanks, found)
        gap = _widest_gap(strip, flanks, found, end, 0.35 * contrast)
        pale = gap.evidence_behind < MIN_CONTRAST_SHARE_BEHIND_GAP * own * (end - gap.end)
        if gap.blocks * BLOCK * cell > max_gap and (found.lone or pale):
            break
        allowed = max_gap + (4.0 * half if 2 * gap.bare_blocks < gap.blocks else 0.0)
        if gap.blocks * BLOCK * cell > allowed + BLOCK * cell:
            return Continuation(n, gap.blocks * BLOCK * cell, found.total / flanks.floor, own)
        before = n
        if n < kept:
            # the stations of the trace are finer, as far as they agree
            end_arc = arc.start_arc + (BLOCK * (end + 1) + 2) * cell
            agreeing = _count_agreeing(stations, n, kept, arc, size, found.deviation, end_arc, cell)
            kept, n = n, agreeing
            if n > 0 and stations[n - 1, ARC] > arc.start_arc + BLOCK * (end + 0.5) * cell:
                rest = 0.0
                continue
        next_block = math.ceil((stations[n - 1, ARC] + 0.25 * half - arc.start_arc) / block - 0.5)
        first = max(BEHIND + 1, next_block)
        more = _add_stations(image, sign, arc, size, found, first, end, flanks, profile, stations, n)
        rest = 0.0
        if more == before:
            break
        n = more
        if found.left_sign > 0.0 and found.right_sign > 0.0 and found.mean > 0.5 * own:
            shaft_to = stations[n - 1, ARC]
        if flanks.blocks < BLOCKS and end >= flanks.blocks - 2:
            return Continuation(n, -1.0, 0.0, own)
    if stations[n - 1, ARC] - shaft_to > MAX_ELECTRODE_RADII * half:
        rest = max(rest, NO_ELECTRODE)
    return Continuation(n, 0.0, rest, own)
