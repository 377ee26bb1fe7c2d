"""The image beyond the end of a trace, straightened along the extended axis, and the evidence of flanks in it.

The contrast that two flanks of a shaft would have is computed for every cell of the strip; the arcs that a shaft could
take are compared by the sum along them. So an electrode with nearly the grey level of the ground, or with one flank in
shadow, can still be told from the ground by its length.
"""

import math

import numpy as np

from ._pixels import Raster, colour_between, fast, grey_between

ROWS, COLUMNS = 72, 61
CELL = 1.0 / 6.0
"""Size of a cell of the strip in radii of the shaft."""
BLOCK = 3
"""Rows of a block; evidence is summed over blocks."""
BLOCKS = ROWS // BLOCK
MIDDLE = COLUMNS // 2
"""Column of the axis."""
BEHIND = 2
"""Blocks that lie on the known shaft; the next one reaches to its end."""
FLOOR = 4.0
"""Evidence of a block, in grey levels, that is noise even on the smoothest ground."""
BINS = 128
"""Of the histogram that `roughness` needs as a buffer."""
_HALF = 6
"""Cells from the axis to a flank."""
_TURNS, _TURN = 5, 0.036
_BENDS, _BEND = 6, 0.01
"""Arcs to try: how many to either side, and how far apart in radians and in 1 / radius of the shaft."""
_MOST = 3.5
"""Most that one block may add, in floors: a long stretch counts, not one strong edge across."""


@fast
def straighten(
    image: Raster, sign: float, u: float, v: float, angle: float, bend: float, half: float, channel: int,
    strip: np.ndarray,
) -> int:  # fmt: skip
    """Fills ``strip`` (rows, columns) along the arc from (u, v) with ``angle`` and ``bend``; returns the rows inside.

    ``channel`` < 0: grey levels times ``sign``; else the levels of that channel.
    """
    cell = CELL * half
    rows = 0
    for r in range(strip.shape[0]):
        s = (r + 0.5) * cell
        turned = angle + bend * s
        middle = angle + 0.5 * bend * s
        pu, pv = u + s * math.cos(middle), v + s * math.sin(middle)
        if pu < image.left or pv < image.top or pu > image.right - 1.001 or pv > image.bottom - 1.001:
            break
        nu, nv = -math.sin(turned) * cell, math.cos(turned) * cell
        for c in range(strip.shape[1]):
            a = min(max(pu + (c - MIDDLE) * nu, image.left), image.right - 1.001)
            b = min(max(pv + (c - MIDDLE) * nv, image.top), image.bottom - 1.001)
            if channel < 0:
                strip[r, c] = sign * grey_between(image, a, b)
            else:
                strip[r, c] = colour_between(image, channel, a, b)
        rows += 1
    return rows


@fast
def flank_evidence(strip: np.ndarray, rows: int, left: np.ndarray, right: np.ndarray) -> int:
    """Computes inside minus outside of both flanks around each centre, by blocks of rows; returns the blocks."""
    blocks = rows // BLOCK
    for b in range(blocks):
        for c in range(_HALF + 2, strip.shape[1] - _HALF - 2):
            a = z = 0.0
            for k in range(BLOCK):
                line = strip[BLOCK * b + k]
                a += line[c - _HALF + 1] + line[c - _HALF + 2] - line[c - _HALF - 1] - line[c - _HALF - 2]
                z += line[c + _HALF - 1] + line[c + _HALF - 2] - line[c + _HALF + 1] - line[c + _HALF + 2]
            left[b, c] = a / (2.0 * BLOCK)
            right[b, c] = z / (2.0 * BLOCK)
    return blocks


@fast
def roughness(left: np.ndarray, right: np.ndarray, blocks: int, bins: np.ndarray) -> float:
    """Returns the standard deviation of the evidence beside the shaft, from the median of its absolute value."""
    bins[:] = 0.0
    count = 0
    for b in range(blocks):
        for k in range(8):
            for c in (_HALF + 4 + k, COLUMNS - _HALF - 5 - k):
                bins[min(int(2.0 * abs(left[b, c])), bins.shape[0] - 1)] += 1.0
                bins[min(int(2.0 * abs(right[b, c])), bins.shape[0] - 1)] += 1.0
                count += 2
    seen = 0.0
    for m in range(bins.shape[0]):
        seen += bins[m]
        if seen > 0.5 * count:
            return (0.5 * m + 0.25) / 0.6745
    return 0.5 * bins.shape[0] / 0.6745


@fast
def column_of(turn: float, bend: float, b: int) -> int:
    """Returns the column, in block ``b``, of the arc that leaves the axis by ``turn`` and ``bend``."""
    s = (b - BEHIND - 0.5) * BLOCK
    return MIDDLE + math.floor(turn * s + 0.5 * bend * CELL * s * s + 0.5)


@fast
def best_arc(
    left: np.ndarray, right: np.ndarray, blocks: int, sign_left: float, sign_right: float, floor: float, cap: float
) -> tuple[float, int, float, float]:
    """Returns the arc with the largest sum of evidence above ``floor``: sum, last block, turn, bend."""
    best, best_b, best_turn, best_bend = 0.0, 0, 0.0, 0.0
    for i in range(-_TURNS, _TURNS + 1):
        turn = i * _TURN
        for j in range(-_BENDS, _BENDS + 1):
            bend = j * _BEND
            # small turns are likelier
            total = -floor * ((turn / 0.1) ** 2 + (bend / 0.04) ** 2)
            for b in range(BEHIND + 1, blocks):
                c = column_of(turn, bend, b)
                if c < _HALF + 2 or c >= COLUMNS - _HALF - 2:
                    break
                p = sign_left * left[b, c]
                q = sign_right * right[b, c]
                here = 0.5 * (min(max(p, -cap), cap) + min(max(q, -cap), cap)) - floor
                total += min(max(here, -2.0 * floor), _MOST * floor)
                if total > best:
                    best, best_b, best_turn, best_bend = total, b, turn, bend
    return best, best_b, best_turn, best_bend


@fast
def ground_visible(strip: np.ndarray, b: int, c: int, least: float) -> bool:
    """Whether the ground is visible in block ``b``: it has the level of what lies beside the shaft before it."""
    here = left = right = 0.0
    for k in range(BLOCK):
        for m in range(-2, 3):
            here += strip[BLOCK * b + k, c + m]
            left += strip[k, MIDDLE - _HALF - 6 + m]
            right += strip[k, MIDDLE + _HALF + 6 + m]
    count = 5.0 * BLOCK
    return min(left, right) / count - least < here / count < max(left, right) / count + least


@fast
def refine_arc(
    left: np.ndarray, right: np.ndarray, last: int, signs: tuple[float, float], cap: float, turn: float, bend: float
) -> tuple[float, float]:
    """Returns the arc near (turn, bend) with the strongest flanks up to block ``last``."""
    best, best_turn, best_bend = -1e9, turn, bend
    for i in range(-4, 5):
        for j in range(-4, 5):
            a, z = turn + 0.25 * i * _TURN, bend + 0.5 * j * _BEND
            total = 0.0
            for b in range(BEHIND + 1, last + 1):
                c = column_of(a, z, b)
                if c < _HALF + 2 or c >= COLUMNS - _HALF - 2:
                    break
                total += min(max(signs[0] * left[b, c], -cap), 2.0 * cap)
                total += min(max(signs[1] * right[b, c], -cap), 2.0 * cap)
            total -= 0.5 * FLOOR * ((a / 0.1) ** 2 + (z / 0.04) ** 2)
            if total > best:
                best, best_turn, best_bend = total, a, z
    return best_turn, best_bend
