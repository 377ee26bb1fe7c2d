"""Following a catheter of known length on behind what the trace saw of it, by both flanks in all colours.

There it may be a metal tip before a ground of its own grey, half in a shadow, or hidden for a while. A flank then
stands out with one sign here and with the other there, in one channel more than in another; but it does so over a
stretch as long as the shaft is wide, in its place on either side. The smooth arc whose flanks stand out in most
stretches is followed; a single strong edge counts little.
"""

import math

import numpy as np

from ._fine_pixels import add_station, fast
from ._fine_strip import (
    BEHIND,
    BINS,
    BLOCK,
    BLOCKS,
    CELL,
    COLUMNS,
    FLOOR,
    ROWS,
    column_of,
    flank_evidence,
    roughness,
    straighten,
)  # fmt: skip

__all__ = ["FOLLOW_SIZE", "follow_to", "heading"]

_GROUP = 4
"""Blocks that are averaged: a diameter of the shaft."""
_TURNS, _TURN, _LIKELY_TURN = 6, 0.012, 0.015
_BENDS, _BEND, _LIKELY_BEND = 4, 0.004, 0.006
"""Arcs that are tried to either side, how far apart, and their standard deviation: radians, and 1 / radius."""
_BEFORE = 16.0
"""So many radii of shaft tell where it is heading."""
_STIFF = 7.0
"""So many radii before the tip a catheter is straight: its metal end."""
_SEEN = 1.3
"""A stretch whose flanks give so much counts as seen."""
_ODD = 0.3
"""Stations that lie so many px off count for a quarter."""
_STRAIGHT_ON = 9.5
"""With so many radii left or less nothing is looked for beside the straight line."""
_WEIGHT = 0.2
_TIMES = 12
FOLLOW_SIZE = ROWS * COLUMNS + 6 * BLOCKS * COLUMNS + BINS


@fast
def _group_seen(
    flanks: np.ndarray, channels: int, first: int, last: int, turn: float, bend: float, floor: float
) -> float:
    """How much both flanks of the arc stand out in blocks ``first`` to ``last``: logarithms, so that each counts."""
    total = 0.0
    for side in range(2):
        power = 0.0
        for c in range(channels):
            mean = 0.0
            for b in range(first, last):
                column = column_of(turn, bend, b)
                column = min(max(column, 8), COLUMNS - 9)
                mean += flanks[2 * c + side, b, column]
            mean /= (last - first) * floor
            power += mean * mean
        total += math.log1p(power / channels)
    return total


@fast
def _arc_score(flanks: np.ndarray, channels: int, blocks: int, turn: float, bend: float, floor: float) -> float:
    total = -0.5 * ((turn / _LIKELY_TURN) ** 2 + (bend / _LIKELY_BEND) ** 2)
    first = BEHIND + 1
    while first + 2 <= blocks:
        last = min(first + _GROUP, blocks)
        total += _group_seen(flanks, channels, first, last, turn, bend, floor) * (last - first) / _GROUP
        first = last
    return total


@fast
def heading(stations: np.ndarray, n: int, half: float, back: float) -> tuple[float, float, float, float]:
    """Where the shaft is ``back`` before its last station, its angle there and its bend: a robust parabola."""
    low = n - 1
    while low > 0 and stations[n - 1, 2] - stations[low - 1, 2] < _BEFORE * half:
        low -= 1
    end_u, end_v = stations[n - 1, 0], stations[n - 1, 1]
    run_u, run_v = end_u - stations[low, 0], end_v - stations[low, 1]
    run = max(math.hypot(run_u, run_v), 1e-6)
    run_u /= run
    run_v /= run
    order = min(2, (n - low) // 4) + 1
    sums = np.zeros((3, 4))
    c = np.zeros(3)
    for turn in range(3):
        sums[:] = 0.0
        for i in range(low, n):
            x = ((stations[i, 0] - end_u) * run_u + (stations[i, 1] - end_v) * run_v) / half
            y = ((stations[i, 1] - end_v) * run_u - (stations[i, 0] - end_u) * run_v) / half
            off = (y - c[0] - x * (c[1] + x * c[2])) * half / _ODD
            w = stations[i, 4] + 0.01
            if turn > 0:
                w /= (1.0 + off * off) * (1.0 + off * off)
            p = w
            for k in range(order):
                q = p
                for m in range(order):
                    sums[k, m] += q
                    q *= x
                sums[k, 3] += p * y
                p *= x
        for k in range(order):
            sums[k, k] *= 1.0 + 1e-9
            for m in range(k + 1, order):
                part = sums[m, k] / max(sums[k, k], 1e-12)
                for j in range(4):
                    sums[m, j] -= part * sums[k, j]
        for k in range(order - 1, -1, -1):
            total = sums[k, 3]
            for m in range(k + 1, order):
                total -= sums[k, m] * c[m]
            c[k] = total / max(sums[k, k], 1e-12)
    x = -back / half
    y = (c[0] + x * (c[1] + x * c[2])) * half
    slope = c[1] + 2.0 * x * c[2]
    bend = 2.0 * c[2] / half / (1.0 + slope * slope) ** 1.5
    angle = math.atan2(run_v, run_u) + math.atan(slope)
    return end_u + x * half * run_u - y * run_v, end_v + x * half * run_v + y * run_u, angle, bend


@fast
def _go_straight(
    stations: np.ndarray, n: int, u: float, v: float, angle: float, back: float, goal: float, half: float
) -> int:
    """Stations from the last one straight on to ``goal``, from (u, v), which lies ``back`` before it."""
    last = stations[n - 1, 2]
    count = max(0, int((goal - last) / (0.5 * half)))
    for k in range(1, count + 1):
        if n == stations.shape[0]:
            break
        s = (goal - last) * k / count
        way_u, way_v = (back + s) * math.cos(angle), (back + s) * math.sin(angle)
        n = add_station(stations, n, u + way_u, v + way_v, last + s, half, _WEIGHT)
    return n


@fast
def follow_to(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, half: float, goal: float, work: np.ndarray,
    stations: np.ndarray, n: int,
) -> tuple[int, float]:  # fmt: skip
    """Add stations behind the first ``n`` up to the arc length ``goal``; returns their number, and the longest gap.

    Gap: the longest stretch where no flank was seen, but for the metal end.
    """
    strip = work[: ROWS * COLUMNS].reshape((ROWS, COLUMNS))
    a = ROWS * COLUMNS
    flanks = work[a : a + 6 * BLOCKS * COLUMNS].reshape((6, BLOCKS, COLUMNS))
    bins = work[a + 6 * BLOCKS * COLUMNS :]
    cell = CELL * half
    widest = 0.0
    taken = stations[n - 1, 2]
    for _ in range(_TIMES):
        last = stations[n - 1, 2]
        if last > goal - half:
            break
        back = (BEHIND + 1) * BLOCK * cell
        u, v, angle, bend = heading(stations, n, half, back)
        rest = goal - last
        bend *= max(0.0, 1.0 - (_STIFF * half / rest) ** 2)
        if rest < _STRAIGHT_ON * half:
            # lustre along a metal end leads astray sooner than the shaft's own heading does
            n = _go_straight(stations, n, u, v, angle, back, goal - 0.5 * half, half)
            break
        inside = 0
        for c in range(channels):
            rows = straighten(pixels, row, channels, box, 1.0, u, v, angle, bend, half, c, strip)
            inside = flank_evidence(strip, rows, flanks[2 * c], flanks[2 * c + 1])
        s0 = last - back
        blocks = min(inside, int((goal - _STIFF * half - s0) / (BLOCK * cell)))
        if blocks < BEHIND + 3:
            break
        middle = channels // 2
        floor = max(FLOOR, 0.7 * roughness(flanks[2 * middle], flanks[2 * middle + 1], inside, bins))
        best, way, arc = -1e9, 0.0, 0.0
        for i in range(-_TURNS, _TURNS + 1):
            for j in range(-_BENDS, _BENDS + 1):
                score = _arc_score(flanks, channels, blocks, i * _TURN, j * _BEND, floor)
                if score > best:
                    best, way, arc = score, i * _TURN, j * _BEND
        seen_to = 0
        first = BEHIND + 1
        while first + 2 <= blocks:
            end = min(first + _GROUP, blocks)
            if _group_seen(flanks, channels, first, end, way, arc, floor) > _SEEN:
                seen_to = end
                widest = max(widest, s0 + BLOCK * first * cell - taken)
                taken = s0 + BLOCK * end * cell
            first = end
        if seen_to == 0:
            break
        for b in range(BEHIND + 1, seen_to):
            if n == stations.shape[0]:
                break
            s = BLOCK * (b + 0.5) * cell
            turned = angle + bend * s
            halfway = angle + 0.5 * bend * s
            x = BLOCK * (b - BEHIND - 0.5)
            x = (way * x + 0.5 * arc * CELL * x * x) * cell
            at_u = u + s * math.cos(halfway) - x * math.sin(turned)
            at_v = v + s * math.sin(halfway) + x * math.cos(turned)
            n = add_station(stations, n, at_u, at_v, s0 + s, half, _WEIGHT)
    return n, max(widest, goal - taken - _STRAIGHT_ON * half)
