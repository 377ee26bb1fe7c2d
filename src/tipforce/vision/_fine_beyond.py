"""A second look past the end of a trace, where the shaft may go on with another grey level or with one flank only.

What is followed beyond the end adds stations like the trace's own; what cannot be told from the catheter is reported.
"""

import math

import numpy as np

from ._fine_fit import fit_spline, spline_at
from ._fine_pixels import add_station, fast, grey_between, measure_pair
from ._fine_strip import (
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
    ground_shows,
    roughness,
    settle_arc,
    straighten,
)  # fmt: skip

__all__ = ["AHEAD_SIZE", "NO_ELECTRODE", "count_solid", "goes_on", "look_beyond"]

AHEAD_SIZE = ROWS * COLUMNS + 2 * BLOCKS * COLUMNS + BINS
_ENOUGH = 15.0
"""Evidence beyond the end, in floors summed over blocks, from which on something goes on there."""
_LONGEST = 11.0
"""What is paler than the shaft, or lighter than the ground, for more radii at the end is no electrode."""
NO_ELECTRODE = 1000.0
"""Stands for the evidence that was not followed where what was followed is too long."""
_TIMES = 64
"""How often the end may be moved on."""
_SHARPEST = 0.3
"""Radians by which the last steps may turn within a radius of the shaft."""
_CURVED, _BENT = 0.12, 0.03
"""A lone edge that turns by more radians, or bends by more per radius, is not taken for a flank."""
_STEP = 0.6
"""What counts of flanks that both grow lighter, or darker, to the same side: a step in the ground has those too."""
_PALE = 0.4
"""What lies behind a gap must have this share of the shaft's contrast to be the shaft."""


@fast
def goes_on(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, coefficients: np.ndarray, intervals: int,
    length: float, tip: float, half: float, least: float,
) -> bool:  # fmt: skip
    """Whether either flank, extended beyond ``tip``, parts two grey levels by ``least`` on average: a quick test."""
    u, v, du, dv = spline_at(coefficients, intervals, length, tip)
    _, _, au, av = spline_at(coefficients, intervals, length, tip - 3.0 * half)
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
            if pu - far < box[0] or pv - far < box[1] or pu + far > box[2] - 1.001 or pv + far > box[3] - 1.001:
                continue
            seen += 1
            for m in range(1, 3):
                inner, outer = half - m * clear, half + m * clear
                left += grey_between(pixels, row, channels, pu - inner * nu, pv - inner * nv)
                left -= grey_between(pixels, row, channels, pu - outer * nu, pv - outer * nv)
                right += grey_between(pixels, row, channels, pu + inner * nu, pv + inner * nv)
                right -= grey_between(pixels, row, channels, pu + outer * nu, pv + outer * nv)
        if seen > 1 and max(abs(left), abs(right)) > 2.0 * seen * least:
            return True
    return False


@fast
def _add_stations(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, sign: float, u: float, v: float, angle: float,
    bend: float, half: float, s0: float, first: int, last: int, way: float, arc: float, left: np.ndarray,
    right: np.ndarray, signs: tuple[float, float], floor: float, scratch: np.ndarray, stations: np.ndarray, n: int,
) -> int:  # fmt: skip
    """Measure the flanks along the arc from block ``first`` to ``last``; where one is lost the other one leads."""
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
        if pu < box[0] or pv < box[1] or pu > box[2] - 1.001 or pv > box[3] - 1.001:
            break
        l_at, l_drop, r_at, r_drop = measure_pair(
            pixels, row, channels, box, sign, pu, pv, nu, nv, half, reach, scratch
        )
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
    """How much the flanks stand out, where they do, up to block ``last``, and whether one of them does so alone."""
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
    """Stations without those at the end that are of other grey levels, or turn aside more sharply than a shaft can."""
    first = max(n - 4, 6)
    for i in range(first, n):
        before_u, before_v = stations[i - 1, 0] - stations[i - 3, 0], stations[i - 1, 1] - stations[i - 3, 1]
        step_u, step_v = stations[i, 0] - stations[i - 1, 0], stations[i, 1] - stations[i - 1, 1]
        turn = math.atan2(before_u * step_v - before_v * step_u, before_u * step_u + before_v * step_v)
        if abs(turn) > _SHARPEST * max(1.0, math.hypot(step_u, step_v) / half):
            n = i
            break
    while n > 6 and (stations[n - 1, 5] == 2.0 or stations[n - 1, 5] == 4.0):
        n -= 1
    return n


@fast
def look_beyond(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, sign: float, half: float, typical: float,
    max_gap: float, scratch: np.ndarray, coefficients: np.ndarray, band: np.ndarray, weights: np.ndarray,
    work: np.ndarray, stations: np.ndarray, n: int, kept: int,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Follow what goes on behind station ``n`` - 1.

    ``stations[n:]`` receives what was found; up to ``kept`` it holds what the trace saw there. ``work``: scratch of
    `AHEAD_SIZE`. Returns the number of stations; the length of a gap that was too long to go on in px, or -1 where
    the shaft leaves the picture, or 0; evidence that was not followed; the shaft's contrast before the first end.
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
    shaft_to = stations[n - 1, 2]
    for _ in range(_TIMES):
        cell = CELL * size
        last = stations[n - 1, 2]
        length = last + 2.0
        intervals = int(min(max(length / max(2.4 * half, 8.0), 6.0), 80.0))
        for i in range(n):
            weights[i] = stations[i, 4]
        fit_spline(stations, n, length, intervals, 0.05, coefficients, band, weights)
        s0 = last - (BEHIND + 1) * BLOCK * cell
        u, v, du, dv = spline_at(coefficients, intervals, length, s0)
        _, _, au, av = spline_at(coefficients, intervals, length, s0 - 3.0 * half)
        angle = math.atan2(dv, du)
        bend = (du * av - dv * au) / -(math.hypot(du, dv) * math.hypot(au, av) * 3.0 * half) * 0.7
        rows = straighten(pixels, row, channels, box, sign, u, v, angle, bend, size, -1, strip)
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
            turn, curve = settle_arc(left, right, b, tried, cap, turn, curve)
            stands, alone = _judge_arc(left, right, b, turn, curve, tried, floor, cap)
            if alone and (b >= blocks - 2 or size > half or n > began or abs(turn) > _CURVED or abs(curve) > _BENT):
                # one edge, long or curved, is the rim of something else
                refused = max(refused, total)
                continue
            best, at, way, arc, signs, mean, lonely = total, b, turn, curve, tried, stands, alone
        if best < _ENOUGH * floor:
            if n == began:
                rest = max(rest, max(best, refused) / floor)
            if refused < _ENOUGH * floor or n > began or size > 1.4 * half:
                break
            # unless it is the shaft, grown wider towards the camera
            size *= 1.2
            continue
        # what was found stands out by so much; where less than half of it is left, it has ended
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
                bare += 1 if ground_shows(strip, m, column_of(way, arc, m), 0.35 * typical) else 0
            else:
                gap = bare = 0
            behind += 0.5 * (p + q)
            if gap > widest:
                widest, widest_bare, behind, behind_from = gap, bare, 0.0, m
        if widest * BLOCK * cell > max_gap and (lonely or behind < _PALE * own * (end - behind_from)):
            # what is pale behind a gap is not the shaft
            break
        if widest * BLOCK * cell > max_gap + (4.0 * half if 2 * widest_bare < widest else 0.0) + BLOCK * cell:
            return n, widest * BLOCK * cell, best / floor, own
        before = n
        if n < kept:
            # the trace's own stations there are the finer ones, as far as they agree
            agree = n
            while agree < kept and stations[agree, 2] < s0 + (BLOCK * (end + 1) + 2) * cell:
                s = stations[agree, 2] - s0
                turned = angle + bend * s
                middle = angle + 0.5 * bend * s
                off = (stations[agree, 1] - v - s * math.sin(middle)) * math.cos(turned)
                off -= (stations[agree, 0] - u - s * math.cos(middle)) * math.sin(turned)
                at_arc = (column_of(way, arc, int(s / (BLOCK * cell))) - MIDDLE) * cell
                if abs(off - at_arc) > 0.5 * size:
                    break
                agree += 1
            kept = n
            n = agree
            if n > 0 and stations[n - 1, 2] > s0 + BLOCK * (end + 0.5) * cell:
                rest = 0.0
                continue
        first = max(BEHIND + 1, math.ceil((stations[n - 1, 2] + 0.25 * half - s0) / (BLOCK * cell) - 0.5))
        more = _add_stations(
            pixels, row, channels, box, sign, u, v, angle, bend, size, s0, first, end, way, arc, left, right, signs,
            floor, scratch, stations, n,
        )  # fmt: skip
        rest = 0.0
        if more == before:
            break
        n = more
        if signs[0] > 0.0 and signs[1] > 0.0 and mean > 0.5 * own:
            shaft_to = stations[n - 1, 2]
        if blocks < BLOCKS and end >= blocks - 2:
            return n, -1.0, 0.0, own
    if stations[n - 1, 2] - shaft_to > _LONGEST * half:
        rest = max(rest, NO_ELECTRODE)
    return n, 0.0, rest, own
