"""The attenuation of a bent tube in space, as the detector sees it.

A tube seen from its side is drawn pixel by pixel: each finds its place along and across the axis. One that leans toward
the source is a row of thin discs across its axis, each of which lays its share of the path length on the ellipse that
it covers; between the two, one fades into the other. So foreshortened and crossing tubes come out right, and all
attenuations simply add.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._compile import STEADY
from ....types import FloatArray, IntArray
from ._left import left_of
from ._profile import POINTS_PER_M, STEPS_PER_PX
from ._slabs import add_slabs

__all__ = ["add_tube", "fold_instant", "join_taken", "no_spans"]

Picture = npt.NDArray[np.float32]

_LEAN = 0.8
"""Square of the cosine between axis and ray beyond which a tube is drawn as discs: 27 degrees from the ray."""
_STEP_PX = 0.3
"""Discs lie no farther apart than this in the picture: their sum is even to 0.3 %."""
_SOFT_PX = 1.0
"""Half the width over which a disc is smeared along the axis: the pixel's own aperture and the focal spot."""


def no_spans(height: int) -> IntArray:
    """(h, 2): in every row, nothing drawn."""
    spans = np.zeros((height, 2), np.int64)
    spans[:, 0] = 1 << 30
    return spans


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _bell(x: float) -> float:
    """A smooth step from 0 at -1 to 1 at 1."""
    if x <= -1.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    t = 0.5 * (x + 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _seen(camera: FloatArray, points: FloatArray, nodes: FloatArray) -> None:
    """World ``points`` (n > 2, 3) -> ``nodes`` (n, 7): x, y, z of the camera; u, v; their slope by node number."""
    n = points.shape[0]
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            nodes[i, k] = camera[9 + 3 * k] * x + camera[10 + 3 * k] * y + camera[11 + 3 * k] * z + camera[18 + k]
        nodes[i, 3] = camera[0] * nodes[i, 0] / nodes[i, 2] + camera[2]
        nodes[i, 4] = camera[1] * nodes[i, 1] / nodes[i, 2] + camera[3]
    for i in range(n):
        for k in (3, 4):
            if i == 0:
                slope = -1.5 * nodes[0, k] + 2.0 * nodes[1, k] - 0.5 * nodes[2, k]
            elif i == n - 1:
                slope = 1.5 * nodes[i, k] - 2.0 * nodes[i - 1, k] + 0.5 * nodes[i - 2, k]
            else:
                slope = 0.5 * (nodes[i + 1, k] - nodes[i - 1, k])
            nodes[i, k + 2] = slope


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def _add_disc(
    drawn: Picture,
    spans: IntArray,
    at: tuple[float, float, float, float],
    lean_px: float,
    bend: float,
    scale: float,
    half_px: float,
    reach: float,
    weights: FloatArray,
    table: Picture,
) -> None:
    """One disc at u, v with the unit tangent (tu, tv) = ``at``; ``lean_px``: how far its rim leans along the tangent.

    ``scale``: the disc's radius over the table's, ``half_px``; ``reach`` of the table, px; ``weights`` (materials,) of
    its rows.
    """
    h, w = drawn.shape
    qu, qv, tu, tv = at
    far = reach * scale
    half = half_px * scale
    along = lean_px + _SOFT_PX
    tall = abs(tv) * along + abs(tu) * far
    per_step = STEPS_PER_PX / scale
    last = table.shape[1] - 2
    for v in range(max(0, math.ceil(qv - tall)), min(h, math.floor(qv + tall) + 1)):
        y = v - qv
        low, high = -1e9, 1e9
        if abs(tu) > 1e-9:
            a, b = (-along - y * tv) / tu, (along - y * tv) / tu
            low, high = max(low, min(a, b)), min(high, max(a, b))
        if abs(tv) > 1e-9:
            a, b = (y * tu - far) / tv, (y * tu + far) / tv
            low, high = max(low, min(a, b)), min(high, max(a, b))
        first, end = max(0, math.ceil(qu + low)), min(w, math.floor(qu + high) + 1)
        if first >= end:
            continue
        spans[v, 0] = min(spans[v, 0], first)
        spans[v, 1] = max(spans[v, 1], end)
        for u in range(first, end):
            x = u - qu
            across = y * tu - x * tv
            column = abs(across) * per_step
            k = int(column)
            if k > last:
                continue
            part = column - k
            value = 0.0
            for m in range(weights.size):
                if weights[m] != 0.0:
                    value += weights[m] * (table[m, k] + (table[m, k + 1] - table[m, k]) * part)
            e = x * tu + y * tv
            if lean_px > 0.25:
                share = across / half
                q = max(lean_px * math.sqrt(max(1.0 - share * share, 0.0)), 0.25)
                value *= (_bell((e + q) / _SOFT_PX) - _bell((e - q) / _SOFT_PX)) / (2.0 * q)
            else:
                t = 1.0 - (e / _SOFT_PX) ** 2
                value *= 0.9375 / _SOFT_PX * t * t
            drawn[v, u] += value * (1.0 - bend * across)


@njit(cache=True, error_model="numpy", nogil=True)
def _add_discs(
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
    """`add_tube` for tubes that lean toward the source: a row of thin discs."""
    h, w = drawn.shape
    n = nodes.shape[0]
    weights = np.empty(table.shape[0])
    top = size.size - 2
    s = 0.0
    for i in range(n - 1):
        j = i + 1
        dx, dy, dz = nodes[j, 0] - nodes[i, 0], nodes[j, 1] - nodes[i, 1], nodes[j, 2] - nodes[i, 2]
        length_m = math.sqrt(dx * dx + dy * dy + dz * dz)
        px_per_m = focal * 2.0 / (nodes[i, 2] + nodes[j, 2])
        wide = radius_m * px_per_m
        far = wide + 6.0
        start_s = s
        s += length_m
        if (
            discs[i] + discs[j] == 0.0
            or max(nodes[i, 3], nodes[j, 3]) < -far
            or min(nodes[i, 3], nodes[j, 3]) > w + far
            or max(nodes[i, 4], nodes[j, 4]) < -far
            or min(nodes[i, 4], nodes[j, 4]) > h + far
            or min(nodes[i, 2], nodes[j, 2]) <= 0.0
        ):
            continue
        seen_px = math.sqrt((nodes[j, 3] - nodes[i, 3]) ** 2 + (nodes[j, 4] - nodes[i, 4]) ** 2)
        mx, my, mz = (
            0.5 * (nodes[i, 0] + nodes[j, 0]),
            0.5 * (nodes[i, 1] + nodes[j, 1]),
            0.5 * (nodes[i, 2] + nodes[j, 2]),
        )
        cosine = abs(dx * mx + dy * my + dz * mz) / (length_m * math.sqrt(mx * mx + my * my + mz * mz))
        step_px = _STEP_PX * (1.0 + min(1.0, wide * cosine))  # leaning discs are smeared more
        count = max(1, math.ceil(max(seen_px / step_px, length_m * px_per_m / 2.0)))
        turn = nodes[i, 5] * nodes[j, 6] - nodes[i, 6] * nodes[j, 5]
        norm = math.sqrt((nodes[i, 5] ** 2 + nodes[i, 6] ** 2) * (nodes[j, 5] ** 2 + nodes[j, 6] ** 2))
        bend = 0.0
        if norm > 0.0 and seen_px > 0.2:
            bend = math.asin(max(-1.0, min(1.0, turn / norm))) / seen_px
            bend = max(-0.5 / wide, min(0.5 / wide, bend))
        step = length_m / count
        for c in range(count):
            t = (c + 0.5) / count
            t2, t3 = t * t, t * t * t
            h1, h2, h3, h4 = 2 * t3 - 3 * t2 + 1, t3 - 2 * t2 + t, 3 * t2 - 2 * t3, t3 - t2
            g1, g2, g4 = 6 * t2 - 6 * t, 3 * t2 - 4 * t + 1, 3 * t2 - 2 * t
            qu = h1 * nodes[i, 3] + h2 * nodes[i, 5] + h3 * nodes[j, 3] + h4 * nodes[j, 5]
            qv = h1 * nodes[i, 4] + h2 * nodes[i, 6] + h3 * nodes[j, 4] + h4 * nodes[j, 6]
            tu = g1 * (nodes[i, 3] - nodes[j, 3]) + g2 * nodes[i, 5] + g4 * nodes[j, 5]
            tv = g1 * (nodes[i, 4] - nodes[j, 4]) + g2 * nodes[i, 6] + g4 * nodes[j, 6]
            norm = math.sqrt(tu * tu + tv * tv)
            if norm > 1e-9:
                tu, tv = tu / norm, tv / norm
            else:
                tu, tv = 1.0, 0.0
            from_s = (start_s + c * step) * POINTS_PER_M
            to_s = from_s + step * POINTS_PER_M
            a, b = min(int(from_s), top), min(int(to_s), top)
            fa, fb = min(from_s - a, 1.0), min(to_s - b, 1.0)
            thick = size[(a + b) // 2]
            mine = discs[i] + t * (discs[j] - discs[i])
            empty = True
            for m in range(weights.size):
                before = amount[m, a] + (amount[m, a + 1] - amount[m, a]) * fa
                weights[m] = (amount[m, b] + (amount[m, b + 1] - amount[m, b]) * fb - before) * px_per_m * thick * mine
                empty = empty and weights[m] == 0.0
            if empty:
                continue
            scale = max(thick, 0.2) * wide / half_px
            _add_disc(
                drawn, spans, (qu, qv, tu, tv), thick * wide * cosine, bend, scale, half_px, reach_px, weights, table
            )


@njit(cache=True, error_model="numpy", nogil=True)
def _part(nodes: FloatArray, discs: FloatArray) -> tuple[bool, bool]:
    """``discs`` (n,): 1 at nodes of stretches that are seen more from their end, else 0; whether some are 1, are 0."""
    discs[:] = 0.0
    for i in range(nodes.shape[0] - 1):
        along, total, size = 0.0, 0.0, 0.0
        for k in range(3):
            d = nodes[i + 1, k] - nodes[i, k]
            along += d * nodes[i, k]
            total += d * d
            size += nodes[i, k] * nodes[i, k]
        if along * along > _LEAN * total * size:
            discs[i] = discs[i + 1] = 1.0
    return discs.max() > 0.0, discs.min() < 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def add_tube(
    drawn: Picture,
    spans: IntArray,
    camera: FloatArray,
    points: FloatArray,
    radius_m: float,
    table: Picture,
    half_px: float,
    reach_px: float,
    amount: FloatArray,
    size: FloatArray,
) -> None:
    """Add the attenuation of a tube along ``points`` (n, 3), world, m, uniform in arc length, to ``drawn`` (h, w).

    ``spans`` (h, 2) grows to hold what is touched. ``camera``: `CameraModel.row` (no distortion is looked at);
    ``table``, ``half_px``, ``reach_px``: `Profiles`; ``amount``, ``size``: `Course`.
    """
    nodes = np.empty((points.shape[0], 7))
    _seen(camera, points, nodes)
    discs = np.empty(points.shape[0])
    some, others = _part(nodes, discs)
    if some:
        _add_discs(drawn, spans, camera[1], nodes, discs, radius_m, table, half_px, reach_px, amount, size)
    if others:
        add_slabs(drawn, spans, camera[1], nodes, discs, radius_m, table, half_px, reach_px, amount, size)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def fold_instant(drawn: Picture, spans: IntArray, mean: Picture, weight: float) -> None:
    """Add ``weight`` times what ``drawn`` takes from the light, 1 - exp(-drawn), to ``mean``; empty ``drawn``."""
    share, over = np.float32(weight), np.float32(1.0 / 64.0)
    for v in range(drawn.shape[0]):
        first, end = spans[v, 0], spans[v, 1]
        if first < end:
            row, out = drawn[v, first:end], mean[v, first:end]
            for u in range(row.size):
                out[u] += share * (np.float32(1.0) - left_of(row[u] * over))
                row[u] = np.float32(0.0)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def join_taken(tube: Picture, spans: IntArray, taken: Picture) -> None:
    """What one behind the other takes: 1 - (1 - ``taken``) (1 - ``tube``), into ``taken``; empty ``tube``."""
    for v in range(tube.shape[0]):
        for u in range(spans[v, 0], spans[v, 1]):
            taken[v, u] += tube[v, u] * (np.float32(1.0) - taken[v, u])
            tube[v, u] = np.float32(0.0)
