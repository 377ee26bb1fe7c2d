"""One frame before noise: background, shadows, tissue, instruments, catheter and foreground, in this order.

A layer holds, for each pixel, its own light times cover, and in its last plane the visible share of the layers behind
it (so a shadow is a layer without light of its own). ``clean`` (c, h, w) is changed in place.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import FloatArray, Image
from .._exposure import TissueState, sample_exposure
from ._canvas import Box
from ._static_layers import StaticLayers
from ._tube_kernels import add_shadow
from ._tube_model import Tube, TubeNodes, instrument_shape

FloatImage = npt.NDArray[np.float32]


@njit(cache=True, error_model="numpy", nogil=True)
def restore(clean: FloatImage, ground: FloatImage, box: Box) -> None:
    """Copies the ground into a part of the image.

    Args:
        clean: (c, h, w) image that is written.
        ground: (c, h, w) ground.
        box: part of the image.
    """
    for k in range(clean.shape[0]):
        for v in range(box[0], box[1]):
            clean[k, v, box[2] : box[3]] = ground[k, v, box[2] : box[3]]


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def cast(clean: FloatImage, shade: FloatImage, coarse: int, box: Box) -> None:
    """Darkens a part of the image by a shadow, which is interpolated linearly between its coarse pixels.

    A shadow softer than three coarse pixels shows no trace of them.

    Args:
        clean: (c, h, w) image that is changed.
        shade: (rows, columns) share of the light that is hidden, by coarse pixel; all 0 afterwards.
        coarse: image pixels for each coarse pixel, in either direction.
        box: part of the image.
    """
    one = np.float32(1.0)
    rows, columns = shade.shape
    shade_row = np.empty(columns, np.float32)  # a row of the shadow, interpolated between two coarse rows
    passing = np.empty(box[3] - box[2], np.float32)
    for v in range(box[0], box[1]):
        coarse_v = min(max((v + 0.5) / coarse - 0.5, 0.0), rows - 1.001)
        row_above = int(coarse_v)
        row_share = np.float32(coarse_v - row_above)
        for x in range(columns):
            shade_row[x] = shade[row_above, x] + (shade[row_above + 1, x] - shade[row_above, x]) * row_share
        for i in range(passing.size):
            x = min(max((box[2] + i + 0.5) / coarse - 0.5, 0.0), columns - 1.001)
            low = int(x)
            passing[i] = one - (shade_row[low] + (shade_row[low + 1] - shade_row[low]) * np.float32(x - low))
        for k in range(clean.shape[0]):
            row = clean[k, v, box[2] : box[3]]
            for i in range(passing.size):
                row[i] *= passing[i]
    shade[:] = np.float32(0.0)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def lay_tubes(clean: FloatImage, light: FloatImage, drawn: FloatImage, box: Box) -> None:
    """Composes a tube over the image.

    Args:
        clean: (c, h, w) image that is changed.
        light: (h, w) brightness of the light.
        drawn: (h, w, 1 + c) cover and unlit levels times cover; all 0 afterwards.
        box: part of the image.
    """
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            cover = drawn[v, u, 0]
            if cover != 0.0:
                for k in range(clean.shape[0]):
                    clean[k, v, u] += drawn[v, u, 1 + k] * light[v, u] - cover * clean[k, v, u]
                    drawn[v, u, 1 + k] = 0.0
                drawn[v, u, 0] = 0.0


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def lay_foreground(clean: FloatImage, front: FloatImage, box: Box) -> None:
    """Composes the foreground over the image.

    Args:
        clean: (c, h, w) image that is changed.
        front: (c + 1, h, w) lit levels times cover, and the visible share of the layers behind.
        box: part of the image.
    """
    c = clean.shape[0]
    for v in range(box[0], box[1]):
        transmittance = front[c, v, box[2] : box[3]]
        for k in range(c):
            row, layer = clean[k, v, box[2] : box[3]], front[k, v, box[2] : box[3]]
            for u in range(row.size):
                row[u] = row[u] * transmittance[u] + layer[u]


@njit(cache=True, error_model="numpy", nogil=True)
def _half(shift: float) -> tuple[int, int, int, int, np.float32]:
    """Returns for a shift in px: phase (0: whole, 1: half) and whole px of both neighbours, and the second's weight.

    The neighbours are the next smaller and the next larger multiple of half a pixel.
    """
    doubled = 2.0 * shift
    low = math.floor(doubled)
    first, second = int(low), int(low) + 1
    return first & 1, first >> 1, second & 1, second >> 1, np.float32(doubled - low)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _gather(
    sprite: FloatImage,
    planes: tuple[int, int],
    v: int,
    lows: int,
    highs: int,
    du: float,
    dv: float,
    weight: np.float32,
    rows: FloatImage,
) -> None:
    """Adds a part of a row of the sprite, moved by (``du``, ``dv``) px, to ``rows`` (c + 1, w), times ``weight``.

    The planes from ``planes[0]`` to ``planes[1]`` (exclusive) are interpolated between half pixels for the columns
    [``lows``, ``highs``) of row ``v`` of the image. ``sprite``: see `lay_moving`.
    """
    if highs <= lows:
        return
    py0, y0, py1, y1, fy = _half(dv)
    px0, x0, px1, x1, fx = _half(du)
    one = np.float32(1.0)
    w00, w01 = weight * (one - fy) * (one - fx), weight * (one - fy) * fx
    w10, w11 = weight * fy * (one - fx), weight * fy * fx
    size = highs - lows
    for k in range(planes[0], planes[1]):
        at_00 = sprite[py0, px0, k, v + y0, lows + x0 : lows + x0 + size]
        at_01 = sprite[py0, px1, k, v + y0, lows + x1 : lows + x1 + size]
        at_10 = sprite[py1, px0, k, v + y1, lows + x0 : lows + x0 + size]
        at_11 = sprite[py1, px1, k, v + y1, lows + x1 : lows + x1 + size]
        row = rows[k, lows:highs]
        for u in range(size):
            row[u] += w00 * at_00[u] + w01 * at_01[u] + w10 * at_10[u] + w11 * at_11[u]


@njit(cache=True, error_model="numpy", nogil=True)
def _gather_indented(
    sprite: FloatImage,
    v: int,
    lows: int,
    highs: int,
    du: float,
    dv: float,
    weight: np.float32,
    rows: FloatImage,
    middle: FloatArray,
    indentation: FloatArray,
) -> None:
    """Does the same as `_gather`, for all planes, where the tip has pushed the sprite's surface in.

    The surface moves by a Gaussian of the distance from ``middle``; deeper in the tissue the movement fades in the same
    way. ``middle`` (2,) and ``indentation`` (4,): see `lay_moving`; the other arguments: see `_gather`.
    """
    for u in range(lows, highs):
        ru, rv = u - middle[0], v - middle[1]  # px; `deep` and `side` are its parts into the tissue and across
        deep = ru * indentation[0] + rv * indentation[1]
        side = ru * indentation[1] - rv * indentation[0]
        push = indentation[2] * math.exp(-(side**2 + max(0.0, deep) ** 2) / indentation[3] ** 2)
        at_v = min(max(v + dv - push * indentation[1], 0.0), sprite.shape[3] - 2.0)
        at_u = min(max(u + du - push * indentation[0], 0.0), sprite.shape[4] - 2.0)
        py0, y0, py1, y1, fy = _half(at_v)
        px0, x0, px1, x1, fx = _half(at_u)
        for k in range(sprite.shape[2]):
            low = sprite[py0, px0, k, y0, x0] * (1 - fx) + sprite[py0, px1, k, y0, x1] * fx
            high = sprite[py1, px0, k, y1, x0] * (1 - fx) + sprite[py1, px1, k, y1, x1] * fx
            rows[k, u] += weight * (low * (1 - fy) + high * fy)


@njit(cache=True, error_model="numpy", nogil=True)
def lay_moving(
    clean: FloatImage,
    light: FloatImage,
    sprite: FloatImage,
    spans: npt.NDArray[np.int64],
    shifts: FloatArray,
    middle: FloatArray,
    indentation: FloatArray,
    dirty: npt.NDArray[np.int64],
) -> None:
    """Composes a moving sprite over the image: the mean over the instants of the exposure.

    Args:
        clean: (c, h, w) image that is changed.
        light: (h, w) brightness of the light.
        sprite: (2, 2, c + 1, rows, columns) layer by half-pixel phase in v and u.
        spans: (rows, 4) first column and end of the sprite's content in each row, and of its content with own light.
        shifts: (m, 2) position in the sprite minus position in the image at each instant, px.
        middle: (m, 2) centre of the indentation at each instant, px.
        indentation: (4,) unit vector into the tissue (2), depth and width of the indentation in px; depth 0: none.
        dirty: (4,) first row, end row, first column and end column of the changed part; it is widened.
    """
    c, h, w = clean.shape
    count = shifts.shape[0]
    weight = np.float32(1.0 / count)
    rows = np.zeros((c + 1, w), np.float32)
    high_row, high_column = spans.shape[0] - 2, sprite.shape[4] - 2
    reach = 2.5 * indentation[3] + indentation[2]
    ends = np.empty((2, 2), np.int64)
    for v in range(h):
        # Columns of this row that the sprite covers at any instant: all its content, and its content with own light.
        ends[:, 0], ends[:, 1] = w, 0
        for m in range(count):
            sprite_row = min(max(math.floor(v + shifts[m, 1]), 0), high_row)
            for y in range(sprite_row, sprite_row + 2):
                for part in range(2):
                    start, stop = spans[y, 2 * part], spans[y, 2 * part + 1]
                    if stop > start:
                        ends[part, 0] = min(ends[part, 0], math.floor(start - shifts[m, 0]) - 2)
                        ends[part, 1] = max(ends[part, 1], math.floor(stop - shifts[m, 0]) + 3)
        indented = False
        if indentation[2] > 0.0:
            for m in range(count):
                indented = indented or abs(v - middle[m, 1]) < reach
        lows, highs = max(ends[0, 0], 0), min(ends[0, 1], w)
        for m in range(count):
            # Outside of the sprite there is nothing: the sprite's border is as empty or as full as its margin.
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
            if indented:
                first = min(max(int(middle[m, 0] - reach), lows), highs)
                last = min(max(int(middle[m, 0] + reach), first), highs)
                _gather_indented(sprite, v, first, last, du, dv, weight, rows, middle[m], indentation)
            # Where there is shadow only, there is no light of the sprite's own to gather.
            lit_low, lit_high = max(lows, ends[1, 0]), min(highs, ends[1, 1])
            _gather(sprite, (c, c + 1), v, lows, first, du, dv, weight, rows)
            _gather(sprite, (c, c + 1), v, last, highs, du, dv, weight, rows)
            _gather(sprite, (0, c), v, lit_low, min(first, lit_high), du, dv, weight, rows)
            _gather(sprite, (0, c), v, max(last, lit_low), lit_high, du, dv, weight, rows)
        _lay_row(clean, light, rows, v, lows, highs)
        dirty[0], dirty[1] = min(dirty[0], v), max(dirty[1], v + 1)
        dirty[2], dirty[3] = min(dirty[2], lows), max(dirty[3], highs)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _lay_row(clean: FloatImage, light: FloatImage, rows: FloatImage, v: int, lows: int, highs: int) -> None:
    """Composes columns [``lows``, ``highs``) of one gathered row (c + 1, w) over row ``v`` of the image."""
    c = clean.shape[0]
    lit, transmittance = light[v, lows:highs], rows[c, lows:highs]
    for k in range(c):
        row, layer = clean[k, v, lows:highs], rows[k, lows:highs]
        for u in range(row.size):
            row[u] = row[u] * transmittance[u] + layer[u] * lit[u]


_TUBE_STEP_PX, _TISSUE_STEP_PX = 1.0, 1.3
"""Motion blur is a mean of images this far apart. At a blur of 0.8 px the steps are 1e-5 and 1e-3 of the contrast."""
_MOST_INSTANTS = 24
_NOTHING: Box = (0, 0, 0, 0)


@dataclass(slots=True, eq=False)
class Buffers:
    """Buffers of one thread; outside ``dirty``, ``clean`` (c, h, w) is the ground, and the others are empty."""

    clean: FloatImage
    drawn: FloatImage
    shade: FloatImage
    planes: Image
    dirty: Box = _NOTHING

    @classmethod
    def for_layers(cls, layers: StaticLayers) -> "Buffers":
        """Allocates empty buffers."""
        c, h, w = layers.ground.shape
        drawn, shade = np.zeros((h, w, c + 1), np.float32), np.zeros((h, w), np.float32)
        return cls(layers.ground.copy(), drawn, shade, np.empty((c, h, w), np.uint8))


def compose(
    layers: StaticLayers, buffers: Buffers, shapes_m: FloatArray, tissue: TissueState | None, time_s: float
) -> None:
    """Composes one frame before noise in ``buffers.clean``.

    Args:
        layers: static layers of the session.
        buffers: buffers of this thread.
        shapes_m: (m, n, 3) axis of the catheter at m instants evenly spread over the exposure, base frame.
        tissue: position of the tissue; None: no tissue is drawn.
        time_s: time that determines the sway of the second instrument.
    """
    restore(buffers.clean, layers.ground, buffers.dirty)  # only the part that the last frame changed
    dirty = _NOTHING
    scene, camera, focus = layers.scene, layers.camera, layers.focus
    shapes = sample_exposure(shapes_m, _count(shapes_m, _TUBE_STEP_PX / layers.px_per_m))
    nodes = layers.catheter.nodes(shapes, camera, focus)
    dirty = _union(dirty, _cast_shadows(layers, buffers, nodes, scene.ground.depth_m))
    second, instrument = layers.second, scene.instrument
    second_nodes: TubeNodes | None = None
    if second is not None and instrument is not None:
        second_nodes = second.nodes(instrument_shape(scene, instrument, time_s)[None], camera, focus)
        depth_below_m = scene.ground.depth_m + instrument_shape(scene, instrument, 0.0)[0, 2]
        dirty = _union(dirty, _cast_shadows(layers, buffers, second_nodes, depth_below_m))
        if not instrument.in_front:
            dirty = _union(dirty, _lay_tube(layers, buffers, second, second_nodes))
    tissue_over_tip = scene.tissue.over_tip
    if layers.phantom is not None and tissue is not None and not tissue_over_tip:
        dirty = _union(dirty, lay_phantom(buffers.clean, layers, layers.phantom.sprite, tissue))
    dirty = _union(dirty, _lay_tube(layers, buffers, layers.catheter, nodes))
    if layers.phantom is not None and tissue is not None and tissue_over_tip:
        dirty = _union(dirty, lay_phantom(buffers.clean, layers, layers.phantom.sprite, tissue))
    if second is not None and second_nodes is not None and instrument is not None and instrument.in_front:
        dirty = _union(dirty, _lay_tube(layers, buffers, second, second_nodes))
    if layers.foreground is not None:
        lay_foreground(buffers.clean, layers.foreground, layers.foreground_box)
        dirty = _union(dirty, layers.foreground_box)
    buffers.dirty = dirty


def draw_tube(buffers: Buffers, tube: Tube, nodes: TubeNodes) -> Box:
    """Draws the mean of a tube over the exposure into ``buffers.drawn``.

    Args:
        buffers: buffers of this thread.
        tube: constant parts of the tube.
        nodes: its axis in the image at each instant.

    Returns:
        The part of the image that contains the tube.
    """
    tube.draw(buffers.drawn, nodes)
    return _box_around(nodes.nodes, tube.profile.reach_px * 1.1 + 2.0, np.zeros(2), buffers.shade.shape)


def lay_phantom(clean: FloatImage, layers: StaticLayers, sprite: FloatImage, tissue: TissueState) -> Box:
    """Composes the tissue with its shadow over the image.

    Args:
        clean: (c, h, w) image that is changed.
        layers: static layers of the session, with a phantom.
        sprite: (2, 2, c + 1, rows, columns) sprite of the phantom, or another of this shape.
        tissue: position of the tissue.

    Returns:
        The part of the image that was changed.
    """
    phantom = layers.phantom
    assert phantom is not None
    home = layers.camera.project(phantom.home_m[None])[0]
    shift = sample_exposure(
        tissue.shift_m[:, None], _count(tissue.shift_m[:, None], _TISSUE_STEP_PX / layers.px_per_m)
    )[:, 0]
    moved = layers.camera.project(phantom.home_m + shift) - home
    indentation = np.array([*phantom.into_px, 0.0, 1.0])  # depth 0: none
    middle = np.zeros((len(moved), 2))
    if tissue.indentation_m > 0.0 and tissue.touch_m is not None and not layers.scene.tissue.over_tip:
        indentation[2] = tissue.indentation_m * phantom.px_per_m
        # The indentation is wider than the tip, the more so the deeper it is.
        indentation[3] = 1.2 * layers.scene.catheter.radius_m * phantom.px_per_m + 0.7 * indentation[2]
        middle[:] = layers.camera.project(tissue.touch_m[None])[0]
    dirty = np.array([clean.shape[1], 0, clean.shape[2], 0])
    shifts = phantom.margin_px - moved
    lay_moving(clean, layers.light, sprite, phantom.spans, shifts, middle, indentation, dirty)
    return (int(dirty[0]), int(dirty[1]), int(dirty[2]), int(dirty[3])) if dirty[1] > dirty[0] else _NOTHING


def _count(shapes_m: FloatArray, step_m: float) -> int:
    """Instants that motion blur needs for ``shapes_m`` (m, n, 3) to be no farther apart than ``step_m``."""
    distance_m = float(np.abs(np.diff(shapes_m, axis=0)).max(axis=(1, 2), initial=0.0).sum())
    return 1 if distance_m < 0.25 * step_m else min(_MOST_INSTANTS, max(2, math.ceil(distance_m / step_m)))


def _lay_tube(layers: StaticLayers, buffers: Buffers, tube: Tube, nodes: TubeNodes) -> Box:
    box = draw_tube(buffers, tube, nodes)
    lay_tubes(buffers.clean, layers.light, buffers.drawn, box)
    return box


def _cast_shadows(layers: StaticLayers, buffers: Buffers, nodes: TubeNodes, depth_m: float) -> Box:
    """Casts the tube's shadows on the ground ``depth_m`` below it; returns the part of the image that they change.

    The shadows are soft: the tube's position at mid-exposure is enough, without motion blur.
    """
    middle = nodes.nodes[len(nodes.nodes) // 2]
    dirty = _NOTHING
    sigma_px = max(0.8, math.hypot(layers.scene.shadow_sigma_m(depth_m) * layers.px_per_m, middle[-1, 7]))
    # The softer a shadow, the coarser the pixels (of ``coarse`` image pixels) in which it may be drawn.
    coarse = min(16, max(1, int(sigma_px / 3.0)))
    h, w = buffers.shade.shape
    shade = buffers.shade[: -(-h // coarse) + 1, : -(-w // coarse) + 1]
    coarse_nodes = middle.copy()  # the nodes in coarse pixels
    coarse_nodes[:, :2] = (middle[:, :2] + 0.5) / coarse - 0.5
    coarse_nodes[:, 4:] /= coarse
    for right_m, down_m, strength in layers.scene.shadow_falls_m(depth_m):
        fall_px = np.array([right_m, down_m]) * layers.px_per_m
        add_shadow(shade, coarse_nodes, fall_px / coarse, sigma_px / coarse, strength)
        box = _box_around(middle[None], middle[-1, 6] + 3.0 * sigma_px + 2.0 * coarse + 2.0, fall_px, (h, w))
        cast(buffers.clean, shade, coarse, box)
        dirty = _union(dirty, box)
    return dirty


def _box_around(nodes: FloatArray, reach: float, moved: FloatArray, shape: tuple[int, ...]) -> Box:
    """Returns the box around ``nodes`` (m, n, 8), ``reach`` px wider and moved by ``moved`` (2,), within the image."""
    low = nodes[..., :2].min(axis=(0, 1)) + moved - reach
    high = nodes[..., :2].max(axis=(0, 1)) + moved + reach + 2.0
    (u0, v0), (u1, v1) = np.maximum(low, 0.0), np.maximum(high, 0.0)
    v0, v1, u0, u1 = min(int(v0), shape[0]), min(int(v1), shape[0]), min(int(u0), shape[1]), min(int(u1), shape[1])
    return (v0, v1, u0, u1) if v1 > v0 and u1 > u0 else _NOTHING


def _union(a: Box, b: Box) -> Box:
    """Returns the box around both."""
    if a[1] <= a[0]:
        return b
    if b[1] <= b[0]:
        return a
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])
