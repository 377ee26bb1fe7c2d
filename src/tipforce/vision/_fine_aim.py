"""Whether the end of a catheter of known look lies where it was followed to, and where else it may lie.

The last stations of a trace may have run along a shadow or another thing's rim, and what is continued from them misses
the end. Where it is known how the catheter looks over its last stretch, rings, metal and lustre, the line is held
against arcs from a place further back, and the one that looks most like it is taken.
"""

import math

import numpy as np

from ._fine_fit import axis_at
from ._fine_follow import heading
from ._fine_pixels import add_station, colour_between, fast

__all__ = ["ACROSS", "ROWS", "WIDTH", "aim_again", "end_unlike"]

ROWS = 13
"""Rows of a look, a radius apart, the first half a radius before the tip."""
ACROSS, WIDTH = 7, 0.85
"""Places across the shaft in a row, and how far the outermost lie from the axis in radii."""
_BACK = 16.0
"""So many radii before the tip the arcs begin."""
_STIFF = 7.0
"""So many radii before the tip a catheter is straight: its metal end."""
_MOST = 40.0
"""Grey levels by which a place is off at most: something may cover it."""
_ALIKE = 6.0
"""A line whose places are off by no more, on average, is the catheter's."""
_BETTER, _BETTER_BY = 0.75, 1.0
"""An arc must be off by this share of what the line is off by, less so many grey levels."""
_TURNS, _TURN, _LIKELY_TURN = 8, 0.012, 0.06
_BENDS, _BEND, _LIKELY_BEND = 5, 0.004, 0.012
"""Arcs that are tried to either side, how far apart, and how likely they are: radians, and 1 / radius."""
_FINER = 3
_TIP_ROWS = 6
"""The metal end's share of the rows: further back rings are where they are to a few px only."""
_WEIGHT = 0.2


@fast
def _off(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, look: np.ndarray, nodes: np.ndarray, half: float,
    every: int,
) -> float:  # fmt: skip
    """By how many grey levels places along ``nodes`` (k, 4: u, v, du, dv) are off from ``look``, every so many."""
    total, count = 0.0, 0
    for i in range(0, nodes.shape[0], every):
        u, v, du, dv = nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3]
        for k in range(0, ACROSS, every):
            x = half * WIDTH * (2.0 * k / (ACROSS - 1) - 1.0)
            a = min(max(u - x * dv, box[0]), box[2] - 1.001)
            b = min(max(v + x * du, box[1]), box[3] - 1.001)
            for c in range(channels):
                total += min(abs(colour_between(pixels, row, channels, c, a, b) - look[i, k * channels + c]), _MOST)
            count += channels
    return total / count


@fast
def _place(u: float, v: float, angle: float, bend: float, curved: float, s: float) -> tuple[float, float, float]:
    """Where an arc that is straight behind ``curved`` is after ``s``, and its direction."""
    arc = min(s, curved)
    middle, end = angle + 0.5 * bend * arc, angle + bend * arc
    over = s - arc
    return (
        u + arc * math.cos(middle) + over * math.cos(end),
        v + arc * math.sin(middle) + over * math.sin(end),
        end,
    )


@fast
def _lay(
    u: float, v: float, angle: float, bend: float, curved: float, back: float, half: float, nodes: np.ndarray
) -> None:
    """``nodes``: the rows of a look along an arc from (u, v) that reaches the tip after ``back``."""
    for k in range(ROWS):
        nodes[k, 0], nodes[k, 1], end = _place(u, v, angle, bend, curved, back - (k + 0.5) * half)
        nodes[k, 2], nodes[k, 3] = math.cos(end), math.sin(end)


@fast
def _rows_of(
    coefficients: np.ndarray, intervals: int, length: float, straight: float, tip: float, half: float, nodes: np.ndarray
) -> None:
    """``nodes``: the rows of a look along a spline with its tip at ``tip``."""
    for i in range(nodes.shape[0]):
        u, v, du, dv = axis_at(coefficients, intervals, length, straight, tip - (i + 0.5) * half)
        norm = math.sqrt(du * du + dv * dv)
        nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3] = u, v, du / norm, dv / norm


@fast
def end_unlike(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, look: np.ndarray, coefficients: np.ndarray,
    intervals: int, length: float, straight: float, tip: float, half: float, work: np.ndarray,
) -> float:  # fmt: skip
    """By how many grey levels the metal end before ``tip`` is off from ``look``, on average."""
    nodes = work[: 4 * _TIP_ROWS].reshape((_TIP_ROWS, 4))
    _rows_of(coefficients, intervals, length, straight, tip, half, nodes)
    return _off(pixels, row, channels, box, look, nodes, half, 1)


@fast
def aim_again(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, look: np.ndarray, coefficients: np.ndarray,
    intervals: int, length: float, straight: float, goal: float, half: float, work: np.ndarray, stations: np.ndarray,
    n: int,
) -> int:  # fmt: skip
    """Stations up to ``goal`` along a line that looks more like the catheter, where there is one; their number, or 0.

    The spline is followed straight on behind ``straight``. ``look``: (`ROWS`, `ACROSS` x channels) grey levels.
    ``work``: scratch of 4 x `ROWS`.
    """
    nodes = work[: 4 * ROWS].reshape((ROWS, 4))
    _rows_of(coefficients, intervals, length, straight, goal, half, nodes)
    kept = _off(pixels, row, channels, box, look, nodes, half, 1)
    cut = n
    while cut > 0 and stations[cut - 1, 2] > goal - _BACK * half:
        cut -= 1
    if kept < _ALIKE or cut < 8:
        return 0
    back = goal - stations[cut - 1, 2]
    curved = back - _STIFF * half
    u, v, angle, bend = heading(stations, cut, half, 0.0)
    best, turn, curve = 1e9, 0.0, 0.0
    from_turn, from_curve = 0.0, 0.0
    for finer in range(2):
        turns, bends = (_FINER, _FINER) if finer else (_TURNS, _BENDS)
        share = 1.0 / (_FINER + 1.0) if finer else 1.0
        from_turn, from_curve = turn, curve
        for i in range(-turns, turns + 1):
            for j in range(-bends, bends + 1):
                way, arc = from_turn + share * i * _TURN, from_curve + share * j * _BEND
                _lay(u, v, angle + way, bend + arc / half, curved, back, half, nodes)
                total = _off(pixels, row, channels, box, look, nodes, half, 2)
                total *= 1.0 + 0.1 * ((way / _LIKELY_TURN) ** 2 + (arc / _LIKELY_BEND) ** 2)
                if total < best:
                    best, turn, curve = total, way, arc
    _lay(u, v, angle + turn, bend + curve / half, curved, back, half, nodes)
    best = _off(pixels, row, channels, box, look, nodes, half, 1)
    if best > _BETTER * kept - _BETTER_BY:
        return 0
    count = max(2, int((back - 0.5 * half) / (0.5 * half)))
    n = cut
    for k in range(1, count + 1):
        if n == stations.shape[0]:
            break
        s = (back - 0.5 * half) * k / count
        at_u, at_v, _ = _place(u, v, angle + turn, bend + curve / half, curved, s)
        n = add_station(stations, n, at_u, at_v, goal - back + s, half, _WEIGHT)
    return n
