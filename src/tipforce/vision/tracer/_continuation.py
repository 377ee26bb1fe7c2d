"""Continuation beyond the end of a trace, where the shaft may have another grey level or only one visible flank.

What is followed there adds stations like those of the trace; what cannot be told from the catheter is reported.
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
    best_arc,
    column_of,
    flank_evidence,
    ground_visible,
    refine_arc,
    roughness,
    straighten,
)

CONTINUATION_SIZE = ROWS * COLUMNS + 2 * BLOCKS * COLUMNS + BINS
"""Numbers of working memory that `continue_trace` needs."""
_ENOUGH = 15.0
"""Evidence beyond the end, in floors summed over blocks, from which on something continues there."""
_LONGEST = 11.0
"""What is paler than the shaft, or lighter than the ground, over more radii than this is no electrode."""
NO_ELECTRODE = 1000.0
"""Value of `Continuation.rest` where what was followed is too long for an electrode."""
_TIMES = 64
"""How often the end may be moved forward."""
_SHARPEST = 0.3
"""Radians by which the last steps may turn within a radius of the shaft."""
_CURVED, _BENT = 0.12, 0.03
"""A single edge that turns by more radians, or bends by more per radius, is not a flank."""
_STEP = 0.6
"""Weight of flanks that both grow lighter, or darker, to the same side: a step in the ground has those too."""
_PALE = 0.4
"""Behind a gap the shaft must have this share of its contrast."""


class Continuation(NamedTuple):
    """Result of `continue_trace`."""

    n: int
    """Number of stations."""
    gap: float
    """Length in px of a gap that was too long to go on; -1 where the shaft leaves the image; 0 otherwise."""
    rest: float
    """Evidence that was not followed, in floors."""
    contrast: float
    """Of the shaft before the first end."""


@fast
def may_continue(image: Raster, spline: Spline, tip: float, half: float, least: float) -> bool:
    """Whether either flank, extended beyond ``tip``, separates two levels by ``least`` on average: a quick test."""
    u, v, du, dv = spline_at(spline, tip)
    _, _, au, av = spline_at(spline, tip - 3.0 * half)
    angle = math.atan2(dv, du)
    bend = (du * av - dv * au) / -(math.hypot(du, dv) * math.hypot(au, av) * 3.0 * half) * 0.7
    clear = max(0.2 * half, 1.0)
    for part in range(3):
        left = right = 0.0
        seen = 0
        for k in range(4):
            s = (1.0 + 4.0 * part + k) * half
            turned = angle + bend * s
            middle = angle + 0.5 * bend * s
            pu, pv = u + s * math.cos(middle), v + s * math.sin(middle)
            nu, nv = -math.sin(turned), math.cos(turned)
            far = half + 2.0 * clear
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
    image: Raster, sign: float, u: float, v: float, angle: float, bend: float, half: float, s0: float, first: int,
    last: int, way: float, arc: float, left: np.ndarray, right: np.ndarray, signs: tuple[float, float], floor: float,
    profile: np.ndarray, stations: np.ndarray, n: int,
) -> int:  # fmt: skip
    """Measures the flanks along the arc from block ``first`` to ``last``; where one is lost the other one leads."""
    cell = CELL * half
    reach = max(1.5, 0.28 * half)
    for b in range(first, last + 1):
        if n == stations.shape[0]:
            break
        s = (BLOCK * (b + 0.5)) * cell
        turned = angle + bend * s
        middle = angle + 0.5 * bend * s
        nu, nv = -math.sin(turned), math.cos(turned)
        c = column_of(way, arc, b)
        x = c - MIDDLE
        pu = u + s * math.cos(middle) + x * cell * nu
        pv = v + s * math.sin(middle) + x * cell * nv
        if pu < image.left or pv < image.top or pu > image.right - 1.001 or pv > image.bottom - 1.001:
            break
        l_at, l_drop, r_at, r_drop = measure_pair(image, sign, pu, pv, nu, nv, half, reach, profile)
        least = 1.5 * floor
        l_seen = l_drop * signs[0] > least and left[b, c] * signs[0] > floor
        r_seen = r_drop * signs[1] > least and right[b, c] * signs[1] > floor
        if l_seen and r_seen and abs(l_at + r_at - 2.0 * half) < 0.3 * half:
            off, weight = 0.5 * (r_at - l_at), 0.4
        elif l_seen and (not r_seen or abs(l_at - half) < abs(r_at - half)):
            off, weight = half - l_at, 0.15
        elif r_seen:
            off, weight = r_at - half, 0.15
        else:
            continue
        if abs(off) > reach:
            continue
        n = add_station(stations, n, pu + off * nu, pv + off * nv, s0 + s, half, weight)
    return n


@fast
def _judge_arc(
    left: np.ndarray, right: np.ndarray, last: int, turn: float, bend: float, signs: tuple[float, float],
    floor: float, cap: float,
) -> tuple[float, bool]:  # fmt: skip
    """Returns the mean positive evidence of the flanks up to block ``last``, and whether it is one flank alone."""
    seen = seen_left = seen_right = 0.0
    standing = 0
    for b in range(BEHIND + 1, last + 1):
        c = column_of(turn, bend, b)
        p, q = signs[0] * left[b, c], signs[1] * right[b, c]
        here = 0.5 * (min(max(p, -cap), cap) + min(max(q, -cap), cap))
        if here > 0.0:
            seen += here
            standing += 1
        seen_left += min(max(p, -2.0 * floor), 3.0 * floor)
        seen_right += min(max(q, -2.0 * floor), 3.0 * floor)
    count = last - BEHIND
    return seen / max(standing, 1), min(seen_left, seen_right) < floor * count or signs[0] != signs[1]


@fast
def count_solid(stations: np.ndarray, n: int, half: float) -> int:
    """Counts the stations without the last ones that have other grey levels, or turn more sharply than a shaft can."""
    first = max(n - 4, 6)
    for i in range(first, n):
        before_u, before_v = stations[i - 1, U] - stations[i - 3, U], stations[i - 1, V] - stations[i - 3, V]
        step_u, step_v = stations[i, U] - stations[i - 1, U], stations[i, V] - stations[i - 1, V]
        turn = math.atan2(before_u * step_v - before_v * step_u, before_u * step_u + before_v * step_v)
        if abs(turn) > _SHARPEST * max(1.0, math.hypot(step_u, step_v) / half):
            n = i
            break
    while n > 6 and (stations[n - 1, KIND] == OTHER or stations[n - 1, KIND] == PALE):
        n -= 1
    return n


@fast
def continue_trace(
    image: Raster, sign: float, half: float, typical: float, max_gap: float, profile: np.ndarray, buffers: FitBuffers,
    work: np.ndarray, stations: np.ndarray, n: int, kept: int,
) -> Continuation:  # fmt: skip
    """Follows what continues behind station ``n`` - 1.

    ``stations[n:]`` receives what was found; up to ``kept`` it holds what the trace found there. ``typical``: contrast
    of the shaft. ``profile``, ``work`` (`CONTINUATION_SIZE`): working memory.
    """
    a = ROWS * COLUMNS
    b = a + BLOCKS * COLUMNS
    c = b + BLOCKS * COLUMNS
    strip = work[:a].reshape((ROWS, COLUMNS))
    left = work[a:b].reshape((BLOCKS, COLUMNS))
    right = work[b:c].reshape((BLOCKS, COLUMNS))
    bins = work[c : c + BINS]
    size = half
    cap = max(0.5 * typical, 20.0)
    rest = own = 0.0
    began = n
    shaft_to = stations[n - 1, ARC]
    for _ in range(_TIMES):
        cell = CELL * size
        last = stations[n - 1, ARC]
        spline, _ = fit_axis(stations, n, half, last + 2.0, buffers)
        s0 = last - (BEHIND + 1) * BLOCK * cell
        u, v, du, dv = spline_at(spline, s0)
        _, _, au, av = spline_at(spline, s0 - 3.0 * half)
        angle = math.atan2(dv, du)
        bend = (du * av - dv * au) / -(math.hypot(du, dv) * math.hypot(au, av) * 3.0 * half) * 0.7
        rows = straighten(image, sign, u, v, angle, bend, size, -1, strip)
        blocks = flank_evidence(strip, rows, left, right)
        floor = max(FLOOR, 0.7 * roughness(left, right, blocks, bins))
        if n == began and size == half:
            own = 0.0
            for m in range(BEHIND):
                own += 0.5 * (left[m, MIDDLE] + right[m, MIDDLE]) / BEHIND
        best, at, way, arc, signs, mean, lonely = 0.0, 0, 0.0, 0.0, (1.0, 1.0), 0.0, False
        refused = 0.0
        for k in range(4):
            tried = (1.0 - (k & 1) * 2.0, 1.0 - (k >> 1) * 2.0)
            total, b, turn, curve = best_arc(left, right, blocks, tried[0], tried[1], floor, cap)
            if tried[0] != tried[1]:
                total *= _STEP
            if total < max(best, 0.5 * _ENOUGH * floor):
                continue
            turn, curve = refine_arc(left, right, b, tried, cap, turn, curve)
            stands, alone = _judge_arc(left, right, b, turn, curve, tried, floor, cap)
            if alone and (b >= blocks - 2 or size > half or n > began or abs(turn) > _CURVED or abs(curve) > _BENT):
                # a single edge, long or curved, is the rim of something else
                refused = max(refused, total)
                continue
            best, at, way, arc, signs, mean, lonely = total, b, turn, curve, tried, stands, alone
        if best < _ENOUGH * floor:
            if n == began:
                rest = max(rest, max(best, refused) / floor)
            if refused < _ENOUGH * floor or n > began or size > 1.4 * half:
                break
            # it may be the shaft that grows wider towards the camera
            size *= 1.2
            continue
        # the found shaft has the mean evidence `mean`; it ends where less than half of that is left
        run = top = 0.0
        end = BEHIND
        gap = bare = widest = widest_bare = behind_from = 0
        behind = 0.0
        for m in range(BEHIND + 1, at + 1):
            p = signs[0] * left[m, column_of(way, arc, m)]
            q = signs[1] * right[m, column_of(way, arc, m)]
            here = 0.5 * (min(max(p, -cap), cap) + min(max(q, -cap), cap))
            run += max(min(here, 1.5 * mean), -0.5 * mean) - 0.5 * mean
            if run > top:
                top, end = run, m
        for m in range(BEHIND + 1, end + 1):
            p = signs[0] * left[m, column_of(way, arc, m)]
            q = signs[1] * right[m, column_of(way, arc, m)]
            if max(p, q) < floor:
                gap += 1
                bare += 1 if ground_visible(strip, m, column_of(way, arc, m), 0.35 * typical) else 0
            else:
                gap = bare = 0
            behind += 0.5 * (p + q)
            if gap > widest:
                widest, widest_bare, behind, behind_from = gap, bare, 0.0, m
        if widest * BLOCK * cell > max_gap and (lonely or behind < _PALE * own * (end - behind_from)):
            # what is pale behind a gap is not the shaft
            break
        if widest * BLOCK * cell > max_gap + (4.0 * half if 2 * widest_bare < widest else 0.0) + BLOCK * cell:
            return Continuation(n, widest * BLOCK * cell, best / floor, own)
        before = n
        if n < kept:
            # the stations of the trace are finer, as far as they agree
            agree = n
            while agree < kept and stations[agree, ARC] < s0 + (BLOCK * (end + 1) + 2) * cell:
                s = stations[agree, ARC] - s0
                turned = angle + bend * s
                middle = angle + 0.5 * bend * s
                off = (stations[agree, V] - v - s * math.sin(middle)) * math.cos(turned)
                off -= (stations[agree, U] - u - s * math.cos(middle)) * math.sin(turned)
                at_arc = (column_of(way, arc, int(s / (BLOCK * cell))) - MIDDLE) * cell
                if abs(off - at_arc) > 0.5 * size:
                    break
                agree += 1
            kept = n
            n = agree
            if n > 0 and stations[n - 1, ARC] > s0 + BLOCK * (end + 0.5) * cell:
                rest = 0.0
                continue
        first = max(BEHIND + 1, math.ceil((stations[n - 1, ARC] + 0.25 * half - s0) / (BLOCK * cell) - 0.5))
        more = _add_stations(
            image, sign, u, v, angle, bend, size, s0, first, end, way, arc, left, right, signs,
            floor, profile, stations, n,
        )  # fmt: skip
        rest = 0.0
        if more == before:
            break
        n = more
        if signs[0] > 0.0 and signs[1] > 0.0 and mean > 0.5 * own:
            shaft_to = stations[n - 1, ARC]
        if blocks < BLOCKS and end >= blocks - 2:
            return Continuation(n, -1.0, 0.0, own)
    if stations[n - 1, ARC] - shaft_to > _LONGEST * half:
        rest = max(rest, NO_ELECTRODE)
    return Continuation(n, 0.0, rest, own)
