"""The image beyond the end of a trace, straightened along the extended axis, and the evidence of flanks in it.

The strip has square cells of a sixth of the shaft's radius. For every cell the contrast is computed that two flanks
around it would have; three rows are averaged to a block. An arc deviates from the extended axis by a turn and a bend.
The evidence of an arc is the sum over its blocks, so an electrode with nearly the grey level of the ground, or with one
flank in shadow, is separated from the ground by its length.
"""

import math
from typing import NamedTuple

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
"""Blocks that are on the known shaft; the next one reaches to its end."""
FLOOR = 4.0
"""Evidence of a block, in grey levels, that is noise even on the smoothest ground."""
BINS = 128
"""Number of bins of the histogram that `roughness` needs as a buffer."""
FLANK_CELLS = 6
"""Cells from the axis to a flank."""
MAX_TURN_STEPS, TURN_STEP_RAD = 5, 0.036
MAX_BEND_STEPS, BEND_STEP = 6, 0.01
"""Arcs that are tried: number of steps to either side, and their size in radians and in 1/radius of the shaft."""
LIKELY_TURN_RAD, LIKELY_BEND = 0.1, 0.04
"""Standard deviations of the turn in radians and of the bend in 1/radius, before the image is seen."""
MAX_BLOCK_FLOORS = 3.5
"""Largest evidence of one block, in floors: a long piece counts, not one strong edge across."""


class Arc(NamedTuple):
    """A circle that extends the axis, from (u, v) on; ``start_arc`` is the arc length there in px."""

    u: float
    v: float
    angle: float
    """Direction in radians, v down."""
    curvature: float
    """In 1/px."""
    start_arc: float


class Deviation(NamedTuple):
    """How an arc leaves the extended axis at the end of the known shaft."""

    turn: float
    """In radians."""
    bend: float
    """In 1/radius of the shaft."""


class Flanks(NamedTuple):
    """Evidence of the two flanks around each cell, by blocks of rows."""

    left: np.ndarray
    right: np.ndarray
    """(`BLOCKS`, `COLUMNS`): contrast across the flank in grey levels."""
    blocks: int
    """Blocks inside the image."""
    floor: float
    """Evidence in grey levels that is noise."""
    cap: float
    """Largest evidence in grey levels that counts."""


@fast
def arc_at(arc: Arc, s: float) -> tuple[float, float, float]:
    """Evaluates an arc.

    Args:
        arc: the arc.
        s: distance along it in px.

    Returns:
        u, v in px and the direction in radians.
    """
    middle = arc.angle + 0.5 * arc.curvature * s
    return arc.u + s * math.cos(middle), arc.v + s * math.sin(middle), arc.angle + arc.curvature * s


@fast
def straighten(image: Raster, sign: float, arc: Arc, half: float, channel: int, strip: np.ndarray) -> int:
    """Fills the strip with the image along an arc.

    Args:
        image: the frame.
        sign: factor of the grey levels, +1 for a light shaft, -1 for a dark one.
        arc: the extended axis.
        half: half of the shaft's width in px.
        channel: the channel that is read; negative for grey levels times ``sign``.
        strip: (`ROWS`, `COLUMNS`) array that is filled.

    Returns:
        The number of rows inside the image.
    """
    cell = CELL * half
    rows = 0
    for r in range(strip.shape[0]):
        u, v, angle = arc_at(arc, (r + 0.5) * cell)
        if u < image.left or v < image.top or u > image.right - 1.001 or v > image.bottom - 1.001:
            break
        nu, nv = -math.sin(angle) * cell, math.cos(angle) * cell
        for c in range(strip.shape[1]):
            a = min(max(u + (c - MIDDLE) * nu, image.left), image.right - 1.001)
            b = min(max(v + (c - MIDDLE) * nv, image.top), image.bottom - 1.001)
            if channel < 0:
                strip[r, c] = sign * grey_between(image, a, b)
            else:
                strip[r, c] = colour_between(image, channel, a, b)
        rows += 1
    return rows


@fast
def flank_evidence(strip: np.ndarray, rows: int, left: np.ndarray, right: np.ndarray) -> int:
    """Computes the contrast of both flanks around each cell, inside minus outside, by blocks of rows.

    Args:
        strip: (`ROWS`, `COLUMNS`) straightened image.
        rows: number of rows inside the image.
        left: (`BLOCKS`, `COLUMNS`) array that receives the contrast of the left flank.
        right: the same for the right flank.

    Returns:
        The number of blocks.
    """
    blocks = rows // BLOCK
    for b in range(blocks):
        for c in range(FLANK_CELLS + 2, strip.shape[1] - FLANK_CELLS - 2):
            a = z = 0.0
            for k in range(BLOCK):
                row = strip[BLOCK * b + k]
                near, far = c - FLANK_CELLS, c + FLANK_CELLS
                a += row[near + 1] + row[near + 2] - row[near - 1] - row[near - 2]
                z += row[far - 1] + row[far - 2] - row[far + 1] - row[far + 2]
            left[b, c] = a / (2.0 * BLOCK)
            right[b, c] = z / (2.0 * BLOCK)
    return blocks


@fast
def roughness(left: np.ndarray, right: np.ndarray, blocks: int, bins: np.ndarray) -> float:
    """Returns the standard deviation of the evidence beside the shaft, from the median of its absolute value.

    Args:
        left: (`BLOCKS`, `COLUMNS`) contrast of the left flank in grey levels.
        right: the same for the right flank.
        blocks: number of blocks inside the image.
        bins: buffer of `BINS` numbers.
    """
    bins[:] = 0.0
    count = 0
    for b in range(blocks):
        for k in range(8):
            for c in (FLANK_CELLS + 4 + k, COLUMNS - FLANK_CELLS - 5 - k):
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
def column_of(deviation: Deviation, b: int) -> int:
    """Returns the column of the strip that an arc crosses in a block.

    Args:
        deviation: the arc.
        b: number of the block.
    """
    s = (b - BEHIND - 0.5) * BLOCK
    return MIDDLE + math.floor(deviation.turn * s + 0.5 * deviation.bend * CELL * s * s + 0.5)


@fast
def _in_strip(column: int) -> bool:
    return FLANK_CELLS + 2 <= column < COLUMNS - FLANK_CELLS - 2


@fast
def mean_evidence(left: float, right: float, cap: float) -> float:
    """Returns the mean of two flanks' evidence, each limited.

    Args:
        left: evidence of the left flank in grey levels.
        right: evidence of the right flank in grey levels.
        cap: limit of either sign in grey levels.
    """
    return 0.5 * (min(max(left, -cap), cap) + min(max(right, -cap), cap))


@fast
def _penalty(deviation: Deviation) -> float:
    """Returns the penalty of a turn and a bend, in floors: small ones are more likely."""
    return (deviation.turn / LIKELY_TURN_RAD) ** 2 + (deviation.bend / LIKELY_BEND) ** 2


@fast
def best_deviation(flanks: Flanks, left_sign: float, right_sign: float) -> tuple[float, int, Deviation]:
    """Searches the arc with the largest sum of evidence above the floor.

    Args:
        flanks: evidence of the flanks.
        left_sign: +1 where the left flank has the shaft's polarity, -1 where it is inverted.
        right_sign: the same for the right flank.

    Returns:
        The sum in grey levels, the last block of the arc, and its deviation from the extended axis.
    """
    floor = flanks.floor
    best, best_b, best_deviation = 0.0, 0, Deviation(0.0, 0.0)
    for i in range(-MAX_TURN_STEPS, MAX_TURN_STEPS + 1):
        for j in range(-MAX_BEND_STEPS, MAX_BEND_STEPS + 1):
            deviation = Deviation(i * TURN_STEP_RAD, j * BEND_STEP)
            total = -floor * _penalty(deviation)
            for b in range(BEHIND + 1, flanks.blocks):
                c = column_of(deviation, b)
                if not _in_strip(c):
                    break
                p, q = left_sign * flanks.left[b, c], right_sign * flanks.right[b, c]
                here = mean_evidence(p, q, flanks.cap) - floor
                total += min(max(here, -2.0 * floor), MAX_BLOCK_FLOORS * floor)
                if total > best:
                    best, best_b, best_deviation = total, b, deviation
    return best, best_b, best_deviation


@fast
def ground_visible(strip: np.ndarray, b: int, c: int, tolerance: float) -> bool:
    """Tests whether the ground is visible at a cell: it has the level of the ground beside the known shaft.

    Args:
        strip: (`ROWS`, `COLUMNS`) straightened image.
        b: block.
        c: column.
        tolerance: difference in grey levels that is allowed.

    Returns:
        True where the cell has that level.
    """
    here = left = right = 0.0
    for k in range(BLOCK):
        for m in range(-2, 3):
            here += strip[BLOCK * b + k, c + m]
            left += strip[k, MIDDLE - FLANK_CELLS - 6 + m]
            right += strip[k, MIDDLE + FLANK_CELLS + 6 + m]
    count = 5.0 * BLOCK
    return min(left, right) / count - tolerance < here / count < max(left, right) / count + tolerance


@fast
def refine_deviation(flanks: Flanks, last: int, left_sign: float, right_sign: float, coarse: Deviation) -> Deviation:
    """Searches the arc near ``coarse`` with the strongest flanks up to block ``last``.

    Args:
        flanks: evidence of the flanks.
        last: last block that counts.
        left_sign: +1 where the left flank has the shaft's polarity, -1 where it is inverted.
        right_sign: the same for the right flank.
        coarse: result of `best_deviation`.

    Returns:
        The refined arc.
    """
    cap = flanks.cap
    best, refined = -1e9, coarse
    for i in range(-4, 5):
        for j in range(-4, 5):
            deviation = Deviation(coarse.turn + 0.25 * i * TURN_STEP_RAD, coarse.bend + 0.5 * j * BEND_STEP)
            total = 0.0
            for b in range(BEHIND + 1, last + 1):
                c = column_of(deviation, b)
                if not _in_strip(c):
                    break
                total += min(max(left_sign * flanks.left[b, c], -cap), 2.0 * cap)
                total += min(max(right_sign * flanks.right[b, c], -cap), 2.0 * cap)
            total -= 0.5 * FLOOR * _penalty(deviation)
            if total > best:
                best, refined = total, deviation
    return refined
