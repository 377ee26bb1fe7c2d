"""The attenuation of a bent tube in space, as the detector sees it.

A tube seen from its side is drawn pixel by pixel: each finds its place along and across the axis; planes across the
axis at the nodes part the pixels. One that leans toward the source is a row of thin discs across its axis, each of
which lays its share of the path length on the ellipse that it covers; between the two, one fades into the other. So
foreshortened and crossing tubes come out right, and all attenuations simply add.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import FloatArray, IntArray
from .._raster import columns

STEPS_PER_PX = 16
POINTS_PER_M = 50_000.0
"""Steps of the values that vary along a tube: 20 um; between them they are linear."""
FloatImage = npt.NDArray[np.float32]
_LEAN = 0.8
"""Square of the cosine between axis and ray beyond which a tube is drawn as discs: 27 degrees from the ray."""
MAX_STEP_PX = 0.3
"""Largest distance of discs in the image: their sum is even to 0.3 %."""
_SOFT_PX = 1.0
"""Half the width over which a disc is smeared along the axis: the pixel's own aperture and the focal spot."""


def no_spans(height: int) -> IntArray:
    """Returns spans (h, 2) of rows in which nothing is drawn."""
    spans = np.zeros((height, 2), np.int64)
    spans[:, 0] = 1 << 30
    return spans


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _bell(x: float) -> float:
    """Returns a smooth step from 0 at -1 to 1 at 1."""
    if x <= -1.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    t = 0.5 * (x + 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _seen(camera: FloatArray, points: FloatArray, nodes: FloatArray) -> None:
    """Converts ``points`` (n > 2, 3) in the world of ``camera``, a `CameraModel.row`, to ``nodes`` (n, 7).

    For the columns of the nodes see `add_side_view`; the derivatives are differences of second order.
    """
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
    drawn: FloatImage,
    spans: IntArray,
    at: tuple[float, float, float, float],
    lean_px: float,
    bend: float,
    scale: float,
    half_px: float,
    reach: float,
    weights: FloatArray,
    table: FloatImage,
) -> None:
    """Adds the attenuation of one thin disc of a tube, which appears as an ellipse, to ``drawn`` (h, w).

    ``at``: u, v of its middle in px, and the unit tangent tu, tv of the tube's axis in the image; ``lean_px``: half the
    length of the ellipse along the tangent; ``bend``: curvature of the axis, 1/px; ``scale``: the disc's radius over
    the table's, ``half_px``; ``reach`` of the table, px; ``weights`` (materials,) of the table's rows.
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
        # Columns of this row within `along` of the middle along the tangent, and within `far` across it.
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
            # The path length is spread along the tangent over the width of the ellipse here, with soft ends.
            ahead = x * tu + y * tv
            if lean_px > 0.25:
                share = across / half
                q = max(lean_px * math.sqrt(max(1.0 - share * share, 0.0)), 0.25)
                value *= (_bell((ahead + q) / _SOFT_PX) - _bell((ahead - q) / _SOFT_PX)) / (2.0 * q)
            else:
                fall = 1.0 - (ahead / _SOFT_PX) ** 2
                value *= 0.9375 / _SOFT_PX * fall * fall  # (1 - e^2)^2, whose integral from -1 to 1 is 1 / 0.9375
            drawn[v, u] += value * (1.0 - bend * across)  # discs are closer together on the inner side of a bend


@njit(cache=True, error_model="numpy", nogil=True)
def _add_discs(
    drawn: FloatImage,
    spans: IntArray,
    focal: float,
    nodes: FloatArray,
    discs: FloatArray,
    radius_m: float,
    table: FloatImage,
    half_px: float,
    reach_px: float,
    amount: FloatArray,
    size: FloatArray,
) -> None:
    """Adds the attenuation of a tube that leans toward the source: a row of thin discs; see `add_side_view`."""
    h, w = drawn.shape
    n = nodes.shape[0]
    weights = np.empty(table.shape[0])
    top = size.size - 2
    arc_m = 0.0
    for i in range(n - 1):
        j = i + 1
        dx, dy, dz = nodes[j, 0] - nodes[i, 0], nodes[j, 1] - nodes[i, 1], nodes[j, 2] - nodes[i, 2]
        length_m = math.sqrt(dx * dx + dy * dy + dz * dz)
        px_per_m = focal * 2.0 / (nodes[i, 2] + nodes[j, 2])
        radius_px = radius_m * px_per_m
        far = radius_px + 6.0
        start_m = arc_m
        arc_m += length_m
        if (
            discs[i] + discs[j] == 0.0
            or max(nodes[i, 3], nodes[j, 3]) < -far
            or min(nodes[i, 3], nodes[j, 3]) > w + far
            or max(nodes[i, 4], nodes[j, 4]) < -far
            or min(nodes[i, 4], nodes[j, 4]) > h + far
            or min(nodes[i, 2], nodes[j, 2]) <= 0.0
        ):
            continue
        chord_px = math.sqrt((nodes[j, 3] - nodes[i, 3]) ** 2 + (nodes[j, 4] - nodes[i, 4]) ** 2)
        mx, my = 0.5 * (nodes[i, 0] + nodes[j, 0]), 0.5 * (nodes[i, 1] + nodes[j, 1])
        mz = 0.5 * (nodes[i, 2] + nodes[j, 2])
        # Of the angle between the axis and the ray through the middle of the segment.
        cosine = abs(dx * mx + dy * my + dz * mz) / (length_m * math.sqrt(mx * mx + my * my + mz * mz))
        step_px = MAX_STEP_PX * (1.0 + min(1.0, radius_px * cosine))  # leaning discs are smeared more
        count = max(1, math.ceil(max(chord_px / step_px, length_m * px_per_m / 2.0)))
        turn = nodes[i, 5] * nodes[j, 6] - nodes[i, 6] * nodes[j, 5]
        norm = math.sqrt((nodes[i, 5] ** 2 + nodes[i, 6] ** 2) * (nodes[j, 5] ** 2 + nodes[j, 6] ** 2))
        bend = 0.0
        if norm > 0.0 and chord_px > 0.2:
            bend = math.asin(max(-1.0, min(1.0, turn / norm))) / chord_px
            bend = max(-0.5 / radius_px, min(0.5 / radius_px, bend))
        step = length_m / count
        for disc in range(count):
            # Position (qu, qv) and tangent (tu, tv) of the disc in the image: a Hermite cubic between the nodes.
            t = (disc + 0.5) / count
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
            # Amount of each material between both sides of the disc: a difference of the cumulative profile.
            first_point = (start_m + disc * step) * POINTS_PER_M
            last_point = first_point + step * POINTS_PER_M
            a, b = min(int(first_point), top), min(int(last_point), top)
            fa, fb = min(first_point - a, 1.0), min(last_point - b, 1.0)
            thick = size[(a + b) // 2]
            share = discs[i] + t * (discs[j] - discs[i])
            empty = True
            for m in range(weights.size):
                before = amount[m, a] + (amount[m, a + 1] - amount[m, a]) * fa
                weights[m] = (amount[m, b] + (amount[m, b + 1] - amount[m, b]) * fb - before) * px_per_m * thick * share
                empty = empty and weights[m] == 0.0
            if empty:
                continue
            scale = max(thick, 0.2) * radius_px / half_px
            _add_disc(
                drawn,
                spans,
                (qu, qv, tu, tv),
                thick * radius_px * cosine,
                bend,
                scale,
                half_px,
                reach_px,
                weights,
                table,
            )


@njit(cache=True, error_model="numpy", nogil=True)
def _part(nodes: FloatArray, discs: FloatArray) -> tuple[bool, bool]:
    """Writes 1 into ``discs`` (n,) at both nodes of a segment that leans toward the source (see `_LEAN`), else 0.

    ``nodes`` (n, 7): see `add_side_view`. Returns whether any node is 1 (drawn as discs), and whether any is 0.
    """
    discs[:] = 0.0
    for i in range(nodes.shape[0] - 1):
        dot, square_length, square_distance = 0.0, 0.0, 0.0
        for k in range(3):
            step = nodes[i + 1, k] - nodes[i, k]
            dot += step * nodes[i, k]
            square_length += step * step
            square_distance += nodes[i, k] * nodes[i, k]
        if dot * dot > _LEAN * square_length * square_distance:
            discs[i] = discs[i + 1] = 1.0
    return discs.max() > 0.0, discs.min() < 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def add_tube(
    drawn: FloatImage,
    spans: IntArray,
    camera: FloatArray,
    points: FloatArray,
    radius_m: float,
    table: FloatImage,
    half_px: float,
    reach_px: float,
    amount: FloatArray,
    size: FloatArray,
) -> None:
    """Adds the attenuation of a tube to an image.

    Args:
        drawn: (h, w) attenuation that is changed.
        spans: (h, 2) first column and end of the touched pixels in each row; they are widened.
        camera: `CameraModel.row`; distortion is ignored.
        points: (n, 3) axis in metres, in the camera's world, uniform in arc length.
        radius_m: radius of the tube.
        table: ``table`` of the `SectionProfile`.
        half_px: its radius in px.
        reach_px: its reach in px.
        amount: (materials, k) ``amount`` of the `AxialProfile`.
        size: (k,) its relative radius.
    """
    nodes = np.empty((points.shape[0], 7))
    _seen(camera, points, nodes)
    discs = np.empty(points.shape[0])
    any_disc, any_side_view = _part(nodes, discs)
    if any_disc:
        _add_discs(drawn, spans, camera[1], nodes, discs, radius_m, table, half_px, reach_px, amount, size)
    if any_side_view:
        add_side_view(drawn, spans, camera[1], nodes, discs, radius_m, table, half_px, reach_px, amount, size)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def fold_instant(drawn: FloatImage, spans: IntArray, mean: FloatImage, weight: float) -> None:
    """Adds the weighted absorption of one instant, 1 - exp(-attenuation), to a mean.

    Args:
        drawn: (h, w) attenuation of the instant; all 0 afterwards.
        spans: (h, 2) first column and end of the touched pixels in each row.
        mean: (h, w) absorption that is changed.
        weight: share of the instant in the exposure.
    """
    share, over = np.float32(weight), np.float32(1.0 / 64.0)
    for v in range(drawn.shape[0]):
        first, end = spans[v, 0], spans[v, 1]
        if first < end:
            row, out = drawn[v, first:end], mean[v, first:end]
            for u in range(row.size):
                out[u] += share * (np.float32(1.0) - transmittance(row[u] * over))
                row[u] = np.float32(0.0)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def join_taken(tube: FloatImage, spans: IntArray, taken: FloatImage) -> None:
    """Joins the absorption of two tubes, 1 - (1 - ``taken``) (1 - ``tube``), in ``taken``.

    Args:
        tube: (h, w) absorption of a tube; all 0 afterwards.
        spans: (h, 2) first column and end of its pixels in each row.
        taken: (h, w) absorption that is changed.
    """
    for v in range(tube.shape[0]):
        for u in range(spans[v, 0], spans[v, 1]):
            taken[v, u] += tube[v, u] * (np.float32(1.0) - taken[v, u])
            tube[v, u] = np.float32(0.0)


_CAPACITY = 1032
"""Most pixels of a slab that are drawn in one go."""


class _Segment(NamedTuple):
    """A tube between two nodes, in the image.

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
    drawn: FloatImage,
    heap: FloatArray,
    kept: int,
    stretch: _Segment,
    table: FloatImage,
    half_px: float,
    amount: FloatArray,
    size: FloatArray,
    active: IntArray,
) -> None:
    """Adds the attenuation of one segment (``stretch``) of a tube at ``kept`` pixels to ``drawn`` (h, w).

    ``heap`` has six blocks of `_CAPACITY` numbers: u, v, distance ahead of the segment's first plane and before its
    second one in px, and two for results. The first loop has no table look-ups, so that the compiler makes vector
    instructions of it; blocks at fixed distances show the compiler that they do not overlap. ``active``: numbers of the
    materials in this segment; the other arguments: see `add_side_view`.
    """
    last, top = table.shape[1] - 2, size.size - 2
    ax, ay, x1, y1, x2, y2, x3, y3 = stretch.axis
    start_s, segment_m, radius_px, lean, metres = stretch.sizes
    for i in range(kept):
        u, v, ahead, before_end = heap[i], heap[i + _CAPACITY], heap[i + 2 * _CAPACITY], heap[i + 3 * _CAPACITY]
        # Exact for a circle's arc: the share of the way at which the axis passes beside the pixel.
        t = ahead / (ahead + before_end)
        c = min(max(t, 0.0), 1.0)
        # Nearest point (qx, qy) of the axis, and its tangent (gx, gy).
        qx, qy = ((x3 * c + x2) * c + x1) * c + ax, ((y3 * c + y2) * c + y1) * c + ay
        gx, gy = (3 * x3 * c + 2 * x2) * c + x1, (3 * y3 * c + 2 * y2) * c + y1
        across = ((v - qy) * gx - (u - qx) * gy) / math.sqrt(gx * gx + gy * gy)
        share = across / radius_px
        smear = (0.6 + lean * math.sqrt(max(1.0 - share * share, 0.0))) * metres * POINTS_PER_M
        heap[i + 2 * _CAPACITY], heap[i + 3 * _CAPACITY] = c, (start_s + t * segment_m) * POINTS_PER_M
        heap[i + 4 * _CAPACITY], heap[i + 5 * _CAPACITY] = abs(across) * half_px, smear
    for i in range(kept):
        c, middle, smear = heap[i + 2 * _CAPACITY], heap[i + 3 * _CAPACITY], heap[i + 5 * _CAPACITY]
        relative_radius = size[min(max(int(middle), 0), top)]
        column = heap[i + 4 * _CAPACITY] / (radius_px * max(relative_radius, 0.2)) * STEPS_PER_PX
        k = int(column)
        if k > last:
            continue
        part = column - k
        low_s, high_s = max(middle - smear, 0.0), max(middle + smear, 0.0)
        e, f = min(int(low_s), top), min(int(high_s), top)
        fe, ff = min(low_s - e, 1.0), min(high_s - f, 1.0)
        value = 0.0
        for m in active:
            length_m = amount[m, f] + (amount[m, f + 1] - amount[m, f]) * ff
            length_m -= amount[m, e] + (amount[m, e + 1] - amount[m, e]) * fe
            value += length_m * (table[m, k] + (table[m, k + 1] - table[m, k]) * part)
        value *= 1.0 - stretch.discs[0] - c * (stretch.discs[1] - stretch.discs[0])
        v, u = int(heap[i + _CAPACITY]), int(heap[i])
        drawn[v, u] += value * relative_radius * stretch.thicker * POINTS_PER_M / (2.0 * smear)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def add_side_view(
    drawn: FloatImage,
    spans: IntArray,
    focal: float,
    nodes: FloatArray,
    discs: FloatArray,
    radius_m: float,
    table: FloatImage,
    half_px: float,
    reach_px: float,
    amount: FloatArray,
    size: FloatArray,
) -> None:
    """Adds the attenuation of a tube that is seen from the side: planes across the axis at the nodes part the pixels.

    Values that change along the tube are smeared over the aperture and over the lean of its discs.

    Args:
        drawn: (h, w) attenuation that is changed.
        spans: (h, 2) first column and end of the touched pixels in each row; they are widened.
        focal: focal length in px.
        nodes: (n, 7) x, y, z in metres in the camera's frame; u, v; their derivative by the node's number (2).
        discs: (n,) share of the attenuation at each node that is drawn as discs, not here.
        radius_m: radius of the tube.
        table: ``table`` of the `SectionProfile`.
        half_px: its radius in px.
        reach_px: its reach in px.
        amount: (materials, k) ``amount`` of the `AxialProfile`.
        size: (k,) its relative radius.
    """
    h, w = drawn.shape
    n = nodes.shape[0]
    materials = table.shape[0]
    top = size.size - 2
    active, heap = np.empty(materials, np.int64), np.empty(6 * _CAPACITY)
    arc_m = 0.0
    for i in range(n - 1):
        j = i + 1
        dx, dy, dz = nodes[j, 0] - nodes[i, 0], nodes[j, 1] - nodes[i, 1], nodes[j, 2] - nodes[i, 2]
        length_m = math.sqrt(dx * dx + dy * dy + dz * dz)
        px_per_m = focal * 2.0 / (nodes[i, 2] + nodes[j, 2])
        start_m = arc_m
        arc_m += length_m
        if discs[i] + discs[j] == 2.0:  # all of this segment is drawn as discs
            continue
        radius_px = radius_m * px_per_m
        far = reach_px * radius_px / half_px
        ax, ay, bx, by = nodes[i, 3], nodes[i, 4], nodes[j, 3], nodes[j, 4]
        if max(ax, bx) < -far or min(ax, bx) > w + far or max(ay, by) < -far or min(ay, by) > h + far:
            continue
        chord = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        p, q = math.sqrt(nodes[i, 5] ** 2 + nodes[i, 6] ** 2), math.sqrt(nodes[j, 5] ** 2 + nodes[j, 6] ** 2)
        tx, ty, ox, oy = nodes[i, 5] / p, nodes[i, 6] / p, nodes[j, 5] / q, nodes[j, 6] / q
        metres = length_m / chord  # of the tube that a pixel of the image shows
        thicker = metres * px_per_m  # path through the leaning tube over that through a tube across the ray
        lean = radius_px * math.sqrt(max(1.0 - 1.0 / (thicker * thicker), 0.0))  # of a disc's rim along the axis, px
        before, after = (2.0 if i == 0 else 0.0), (2.0 if j == n - 1 else 0.0)  # the ends' blurred edges
        # Only the materials on this piece are looked up; the smear reaches over its ends.
        margin = (0.6 + lean + 2.0) * metres
        first = min(max(int((start_m - margin) * POINTS_PER_M), 0), top)
        final = min(max(int((arc_m + margin) * POINTS_PER_M) + 1, 0), top + 1)
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
        bow = 0.15 * chord * abs(tx * oy - ty * ox) + 0.5  # largest distance of the axis from its chord, px
        axis, sizes = (ax, ay, x1, y1, x2, y2, x3, y3), (start_m, length_m, radius_px, lean, metres)
        stretch = _Segment(axis, sizes, (discs[i], discs[j]), thicker)
        kept = 0
        for v in range(max(0, int(min(ay, by) - far - 2.0)), min(h, int(max(ay, by) + far + 2.0) + 2)):
            low, high = max(0, int(min(ax, bx) - far - 2.0)), min(w, int(max(ax, bx) + far + 2.0) + 2)
            # Columns between the planes at both nodes, and within `far` of the axis.
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
                ahead, before_end = (u - ax) * tx + (v - ay) * ty, (bx - u) * ox + (by - v) * oy
                if ahead < -before or before_end <= -after:
                    continue
                heap[kept], heap[kept + _CAPACITY] = u, v
                heap[kept + 2 * _CAPACITY], heap[kept + 3 * _CAPACITY] = ahead, before_end
                kept += 1
                if kept == _CAPACITY:
                    _lay_slab(drawn, heap, kept, stretch, table, half_px, amount, size, active[:count])
                    kept = 0
        _lay_slab(drawn, heap, kept, stretch, table, half_px, amount, size, active[:count])


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY, inline="always")
def transmittance(x: np.float32) -> np.float32:
    """Returns exp(-64 ``x``): the series of exp(-``x``) up to its fourth power, squared six times."""
    one, half, third, quarter = np.float32(1.0), np.float32(0.5), np.float32(1.0 / 3.0), np.float32(0.25)
    y = one - x * (one - half * x * (one - third * x * (one - quarter * x)))
    y *= y
    y *= y
    y *= y
    y *= y
    y *= y
    y *= y
    return y
