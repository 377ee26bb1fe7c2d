"""The attenuation of a tube that is seen from its side: planes across its axis at the nodes part the pixels."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._compile import STEADY
from ....types import FloatArray, IntArray
from .._columns import columns
from ._profile import POINTS_PER_M, STEPS_PER_PX

__all__ = ["add_slabs"]

Picture = npt.NDArray[np.float32]

_ROOM = 1032
"""Most pixels of a slab that are drawn in one go."""


class _Stretch(NamedTuple):
    """A tube between two nodes, in the picture.

    ``axis``: where it begins, and the coefficients of its cubic, as u, v pairs. ``sizes``: arc length where it begins,
    its length, m; half its width, px; how far a disc's rim leans, px; m along it that a pixel shows. ``discs``: shares
    at both ends that are drawn as discs; ``thicker``: path through it over that through a tube across the ray.
    """

    axis: tuple[float, float, float, float, float, float, float, float]
    sizes: tuple[float, float, float, float, float]
    discs: tuple[float, float]
    thicker: float


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def _lay_slab(
    drawn: Picture,
    heap: FloatArray,
    kept: int,
    stretch: _Stretch,
    table: Picture,
    half_px: float,
    amount: FloatArray,
    size: FloatArray,
    active: IntArray,
) -> None:
    """Add to ``drawn`` what ``kept`` pixels of a slab take; ``heap``: their u, v, and how far from its two planes.

    What needs no table goes through vector instructions, with roots and divisions: all numbers lie in one array, a
    fixed way apart, so that the compiler sees that they do not overlap.
    """
    last, top = table.shape[1] - 2, size.size - 2
    ax, ay, x1, y1, x2, y2, x3, y3 = stretch.axis
    start_s, length_m, wide, lean, metres = stretch.sizes
    for i in range(kept):
        u, v, ahead, left = heap[i], heap[i + _ROOM], heap[i + 2 * _ROOM], heap[i + 3 * _ROOM]
        # Exact for a circle's arc: the share of the way at which the axis passes beside the pixel.
        t = ahead / (ahead + left)
        c = min(max(t, 0.0), 1.0)
        qx, qy = ((x3 * c + x2) * c + x1) * c + ax, ((y3 * c + y2) * c + y1) * c + ay
        gx, gy = (3 * x3 * c + 2 * x2) * c + x1, (3 * y3 * c + 2 * y2) * c + y1
        across = ((v - qy) * gx - (u - qx) * gy) / math.sqrt(gx * gx + gy * gy)
        share = across / wide
        smear = (0.6 + lean * math.sqrt(max(1.0 - share * share, 0.0))) * metres * POINTS_PER_M
        heap[i + 2 * _ROOM], heap[i + 3 * _ROOM] = c, (start_s + t * length_m) * POINTS_PER_M
        heap[i + 4 * _ROOM], heap[i + 5 * _ROOM] = abs(across) * half_px, smear
    for i in range(kept):
        c, middle, smear = heap[i + 2 * _ROOM], heap[i + 3 * _ROOM], heap[i + 5 * _ROOM]
        thick = size[min(max(int(middle), 0), top)]
        column = heap[i + 4 * _ROOM] / (wide * max(thick, 0.2)) * STEPS_PER_PX
        k = int(column)
        if k > last:
            continue
        part = column - k
        low_s, high_s = max(middle - smear, 0.0), max(middle + smear, 0.0)
        e, f = min(int(low_s), top), min(int(high_s), top)
        fe, ff = min(low_s - e, 1.0), min(high_s - f, 1.0)
        value = 0.0
        for m in active:
            much = amount[m, f] + (amount[m, f + 1] - amount[m, f]) * ff
            much -= amount[m, e] + (amount[m, e + 1] - amount[m, e]) * fe
            value += much * (table[m, k] + (table[m, k + 1] - table[m, k]) * part)
        value *= 1.0 - stretch.discs[0] - c * (stretch.discs[1] - stretch.discs[0])
        v, u = int(heap[i + _ROOM]), int(heap[i])
        drawn[v, u] += value * thick * stretch.thicker * POINTS_PER_M / (2.0 * smear)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def add_slabs(
    drawn: Picture,
    spans: IntArray,
    focal: float,
    nodes: FloatArray,
    discs: FloatArray,
    radius_m: float,
    table: Picture,
    half_px: float,
    reach_px: float,
    amount: FloatArray,
    size: FloatArray,
) -> None:
    """`add_tube` for tubes that are seen from the side: planes across the axis at the nodes part the pixels.

    What changes along the tube is smeared over the aperture and over how far its discs lean.
    """
    h, w = drawn.shape
    n = nodes.shape[0]
    materials = table.shape[0]
    top = size.size - 2
    active, heap = np.empty(materials, np.int64), np.empty(6 * _ROOM)
    s = 0.0
    for i in range(n - 1):
        j = i + 1
        dx, dy, dz = nodes[j, 0] - nodes[i, 0], nodes[j, 1] - nodes[i, 1], nodes[j, 2] - nodes[i, 2]
        length_m = math.sqrt(dx * dx + dy * dy + dz * dz)
        px_per_m = focal * 2.0 / (nodes[i, 2] + nodes[j, 2])
        start_s = s
        s += length_m
        if discs[i] + discs[j] == 2.0:
            continue
        wide = radius_m * px_per_m
        far = reach_px * wide / half_px
        ax, ay, bx, by = nodes[i, 3], nodes[i, 4], nodes[j, 3], nodes[j, 4]
        if max(ax, bx) < -far or min(ax, bx) > w + far or max(ay, by) < -far or min(ay, by) > h + far:
            continue
        chord = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        p, q = math.sqrt(nodes[i, 5] ** 2 + nodes[i, 6] ** 2), math.sqrt(nodes[j, 5] ** 2 + nodes[j, 6] ** 2)
        tx, ty, ox, oy = nodes[i, 5] / p, nodes[i, 6] / p, nodes[j, 5] / q, nodes[j, 6] / q
        metres = length_m / chord  # along the tube, a pixel of the picture
        thicker = metres * px_per_m
        lean = wide * math.sqrt(max(1.0 - 1.0 / (thicker * thicker), 0.0))
        before, after = (2.0 if i == 0 else 0.0), (2.0 if j == n - 1 else 0.0)  # the ends' blurred edges
        # Only what there is of materials on this stretch is looked up; the smear reaches over its ends.
        margin = (0.6 + lean + 2.0) * metres
        first = min(max(int((start_s - margin) * POINTS_PER_M), 0), top)
        final = min(max(int((s + margin) * POINTS_PER_M) + 1, 0), top + 1)
        count = 0
        for m in range(materials):
            if amount[m, final] != amount[m, first]:
                active[count] = m
                count += 1
        if count == 0:
            continue
        # The axis is a cubic of the share of the way: Horner's coefficients.
        x1, y1 = nodes[i, 5], nodes[i, 6]
        x2, y2 = 3 * (bx - ax) - 2 * x1 - nodes[j, 5], 3 * (by - ay) - 2 * y1 - nodes[j, 6]
        x3, y3 = 2 * (ax - bx) + x1 + nodes[j, 5], 2 * (ay - by) + y1 + nodes[j, 6]
        mx, my = 0.5 * (ax + bx), 0.5 * (ay + by)
        cx, cy = (bx - ax) / chord, (by - ay) / chord
        bow = 0.15 * chord * abs(tx * oy - ty * ox) + 0.5
        axis, sizes = (ax, ay, x1, y1, x2, y2, x3, y3), (start_s, length_m, wide, lean, metres)
        stretch = _Stretch(axis, sizes, (discs[i], discs[j]), thicker)
        kept = 0
        for v in range(max(0, int(min(ay, by) - far - 2.0)), min(h, int(max(ay, by) + far + 2.0) + 2)):
            low, high = max(0, int(min(ax, bx) - far - 2.0)), min(w, int(max(ax, bx) + far + 2.0) + 2)
            low, high = columns(low, high, tx, (v - ay) * ty - ax * tx + before)
            low, high = columns(low, high, -ox, (by - v) * oy + bx * ox + after)
            level = (v - my) * cx + mx * cy
            low, high = columns(low, high, -cy, level + far + bow)
            low, high = columns(low, high, cy, far + bow - level)
            if low >= high:
                continue
            spans[v, 0] = min(spans[v, 0], low)
            spans[v, 1] = max(spans[v, 1], high)
            for u in range(low, high):
                ahead, left = (u - ax) * tx + (v - ay) * ty, (bx - u) * ox + (by - v) * oy
                if ahead < -before or left <= -after:
                    continue
                heap[kept], heap[kept + _ROOM], heap[kept + 2 * _ROOM], heap[kept + 3 * _ROOM] = u, v, ahead, left
                kept += 1
                if kept == _ROOM:
                    _lay_slab(drawn, heap, kept, stretch, table, half_px, amount, size, active[:count])
                    kept = 0
        _lay_slab(drawn, heap, kept, stretch, table, half_px, amount, size, active[:count])
