"""Laying one thing over another: the moving tissue with its shadow, the tubes, what stands in front.

A layer holds, for each pixel, its own light times cover, and in its last plane the share of what lies behind it that
is still seen (so a shadow is a layer without light of its own). ``clean`` (c, h, w) is changed in place.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._compile import STEADY
from ....types import FloatArray

__all__ = ["Box", "cast", "lay_front", "lay_moving", "lay_tubes", "restore"]

Picture = npt.NDArray[np.float32]
Box = tuple[int, int, int, int]
"""Rows and columns: from, to (exclusive)."""


@njit(cache=True, error_model="numpy", nogil=True)
def restore(clean: Picture, ground: Picture, box: Box) -> None:
    """Copy ``ground`` into ``clean`` within ``box``."""
    for k in range(clean.shape[0]):
        for v in range(box[0], box[1]):
            clean[k, v, box[2] : box[3]] = ground[k, v, box[2] : box[3]]


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def cast(clean: Picture, shade: Picture, coarse: int, box: Box) -> None:
    """Darken ``clean`` within ``box`` by ``shade`` (rows, columns), one number for ``coarse`` x ``coarse`` pixels.

    Linear between them: a shadow softer than three of their steps shows nothing of it. ``shade`` is empty afterwards.
    """
    one = np.float32(1.0)
    rows, columns = shade.shape
    blend = np.empty(columns, np.float32)
    left = np.empty(box[3] - box[2], np.float32)
    for v in range(box[0], box[1]):
        y = min(max((v + 0.5) / coarse - 0.5, 0.0), rows - 1.001)
        y0 = int(y)
        fy = np.float32(y - y0)
        for x in range(columns):
            blend[x] = shade[y0, x] + (shade[y0 + 1, x] - shade[y0, x]) * fy
        for i in range(left.size):
            x = min(max((box[2] + i + 0.5) / coarse - 0.5, 0.0), columns - 1.001)
            x0 = int(x)
            left[i] = one - (blend[x0] + (blend[x0 + 1] - blend[x0]) * np.float32(x - x0))
        for k in range(clean.shape[0]):
            row = clean[k, v, box[2] : box[3]]
            for i in range(left.size):
                row[i] *= left[i]
    shade[:] = np.float32(0.0)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def lay_tubes(clean: Picture, light: Picture, drawn: Picture, box: Box) -> None:
    """Lay ``drawn`` (h, w, 1 + c), lit by ``light`` (h, w), over ``clean``; ``drawn`` is empty afterwards."""
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            cover = drawn[v, u, 0]
            if cover != 0.0:
                for k in range(clean.shape[0]):
                    clean[k, v, u] += drawn[v, u, 1 + k] * light[v, u] - cover * clean[k, v, u]
                    drawn[v, u, 1 + k] = 0.0
                drawn[v, u, 0] = 0.0


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def lay_front(clean: Picture, front: Picture, box: Box) -> None:
    """Lay ``front`` (c + 1, h, w), already lit, over ``clean``."""
    c = clean.shape[0]
    for v in range(box[0], box[1]):
        left = front[c, v, box[2] : box[3]]
        for k in range(c):
            row, own = clean[k, v, box[2] : box[3]], front[k, v, box[2] : box[3]]
            for u in range(row.size):
                row[u] = row[u] * left[u] + own[u]


@njit(cache=True, error_model="numpy", nogil=True)
def _half(shift: float) -> tuple[int, int, int, int, np.float32]:
    """A shift in px -> phase and whole px of the two neighbours in a half-pixel grid, and the second's weight."""
    doubled = 2.0 * shift
    low = math.floor(doubled)
    first, second = int(low), int(low) + 1
    return first & 1, first >> 1, second & 1, second >> 1, np.float32(doubled - low)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _gather(
    sprite: Picture,
    planes: tuple[int, int],
    v: int,
    lows: int,
    highs: int,
    du: float,
    dv: float,
    weight: np.float32,
    rows: Picture,
) -> None:
    """Add ``weight`` times ``planes`` of ``sprite`` for columns [``lows``, ``highs``) of row ``v`` to ``rows``."""
    if highs <= lows:
        return
    py0, y0, py1, y1, fy = _half(dv)
    px0, x0, px1, x1, fx = _half(du)
    one = np.float32(1.0)
    w00, w01 = weight * (one - fy) * (one - fx), weight * (one - fy) * fx
    w10, w11 = weight * fy * (one - fx), weight * fy * fx
    size = highs - lows
    for k in range(planes[0], planes[1]):
        a = sprite[py0, px0, k, v + y0, lows + x0 : lows + x0 + size]
        b = sprite[py0, px1, k, v + y0, lows + x1 : lows + x1 + size]
        e = sprite[py1, px0, k, v + y1, lows + x0 : lows + x0 + size]
        f = sprite[py1, px1, k, v + y1, lows + x1 : lows + x1 + size]
        row = rows[k, lows:highs]
        for u in range(size):
            row[u] += w00 * a[u] + w01 * b[u] + w10 * e[u] + w11 * f[u]


@njit(cache=True, error_model="numpy", nogil=True)
def _gather_dented(
    sprite: Picture,
    v: int,
    lows: int,
    highs: int,
    du: float,
    dv: float,
    weight: np.float32,
    rows: Picture,
    middle: FloatArray,
    dent: FloatArray,
) -> None:
    """As `_gather`, with the sprite pushed along: ``middle`` (2,) px, ``dent`` (4,): direction, depth, width."""
    for u in range(lows, highs):
        ru, rv = u - middle[0], v - middle[1]
        deep = ru * dent[0] + rv * dent[1]
        side = ru * dent[1] - rv * dent[0]
        push = dent[2] * math.exp(-(side**2 + max(0.0, deep) ** 2) / dent[3] ** 2)
        at_v = min(max(v + dv - push * dent[1], 0.0), sprite.shape[3] - 2.0)
        at_u = min(max(u + du - push * dent[0], 0.0), sprite.shape[4] - 2.0)
        py0, y0, py1, y1, fy = _half(at_v)
        px0, x0, px1, x1, fx = _half(at_u)
        for k in range(sprite.shape[2]):
            low = sprite[py0, px0, k, y0, x0] * (1 - fx) + sprite[py0, px1, k, y0, x1] * fx
            high = sprite[py1, px0, k, y1, x0] * (1 - fx) + sprite[py1, px1, k, y1, x1] * fx
            rows[k, u] += weight * (low * (1 - fy) + high * fy)


@njit(cache=True, error_model="numpy", nogil=True)
def lay_moving(
    clean: Picture,
    light: Picture,
    sprite: Picture,
    spans: npt.NDArray[np.int64],
    shifts: FloatArray,
    middle: FloatArray,
    dent: FloatArray,
    dirty: npt.NDArray[np.int64],
) -> None:
    """Lay ``sprite`` (2, 2, c + 1, rows, columns) over ``clean``: the mean over ``shifts`` (m, 2).

    Its first two axes are half-pixel phases. A picture's pixel (u, v) shows the sprite at (u, v) + shift. ``spans``
    (rows, 4): where each row has something, from and to, and where it has light of its own. ``middle`` (m, 2): where
    the dent is, px; ``dent`` as in `_gather_dented`. ``dirty`` (4,) is widened.
    """
    c, h, w = clean.shape
    count = shifts.shape[0]
    weight = np.float32(1.0 / count)
    rows = np.zeros((c + 1, w), np.float32)
    high_row, high_column = spans.shape[0] - 2, sprite.shape[4] - 2
    reach = 2.5 * dent[3] + dent[2]
    ends = np.empty((2, 2), np.int64)
    for v in range(h):
        ends[:, 0], ends[:, 1] = w, 0
        for m in range(count):
            at = min(max(math.floor(v + shifts[m, 1]), 0), high_row)
            for y in range(at, at + 2):
                for part in range(2):
                    start, stop = spans[y, 2 * part], spans[y, 2 * part + 1]
                    if stop > start:
                        ends[part, 0] = min(ends[part, 0], math.floor(start - shifts[m, 0]) - 2)
                        ends[part, 1] = max(ends[part, 1], math.floor(stop - shifts[m, 0]) + 3)
        pushed = False
        if dent[2] > 0.0:
            for m in range(count):
                pushed = pushed or abs(v - middle[m, 1]) < reach
        lows, highs = max(ends[0, 0], 0), min(ends[0, 1], w)
        for m in range(count):
            # What would lie outside the sprite is nothing: the sprite's border is as empty or as full as its margin.
            lows = max(lows, math.ceil(-shifts[m, 0]) + 1)
            highs = min(highs, math.floor(high_column - shifts[m, 0]))
            if v + shifts[m, 1] < 0.0 or v + shifts[m, 1] >= high_row:
                highs = 0
        if highs <= lows:
            continue
        rows[:, lows:highs] = 0.0
        for m in range(count):
            du, dv = shifts[m, 0], shifts[m, 1]
            first, last = highs, highs
            if pushed:
                first = min(max(int(middle[m, 0] - reach), lows), highs)
                last = min(max(int(middle[m, 0] + reach), first), highs)
                _gather_dented(sprite, v, first, last, du, dv, weight, rows, middle[m], dent)
            # Where there is shadow only, there is no light of the sprite's own to gather.
            own, end = max(lows, ends[1, 0]), min(highs, ends[1, 1])
            _gather(sprite, (c, c + 1), v, lows, first, du, dv, weight, rows)
            _gather(sprite, (c, c + 1), v, last, highs, du, dv, weight, rows)
            _gather(sprite, (0, c), v, own, min(first, end), du, dv, weight, rows)
            _gather(sprite, (0, c), v, max(last, own), end, du, dv, weight, rows)
        _lay_row(clean, light, rows, v, lows, highs)
        dirty[0], dirty[1] = min(dirty[0], v), max(dirty[1], v + 1)
        dirty[2], dirty[3] = min(dirty[2], lows), max(dirty[3], highs)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _lay_row(clean: Picture, light: Picture, rows: Picture, v: int, lows: int, highs: int) -> None:
    c = clean.shape[0]
    lit, left = light[v, lows:highs], rows[c, lows:highs]
    for k in range(c):
        row, own = clean[k, v, lows:highs], rows[k, lows:highs]
        for u in range(row.size):
            row[u] = row[u] * left[u] + own[u] * lit[u]
