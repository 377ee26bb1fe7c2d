"""One frame before noise: ground, shadows, tissue, instruments, catheter, and what stands in front, in this order."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ....types import FloatArray, Image
from ._layers import Box, cast, lay_front, lay_moving, lay_tubes, restore
from ._paint import Painted
from ._project import TubeNodes, instants
from ._tube import add_shadow, add_tube
from ._tubes import Tube, instrument_shape

__all__ = ["Desk", "TissueState", "compose", "draw_tube", "lay_phantom"]

Picture = npt.NDArray[np.float32]

_TUBE_STEP_PX, _TISSUE_STEP_PX = 1.0, 1.3
"""Motion blur is a mean of pictures this far apart. At a blur of 0.8 px the steps are 1e-5 and 1e-3 of the contrast."""
_MOST_INSTANTS = 24
_NOTHING: Box = (0, 0, 0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class TissueState:
    """``shift_m`` (m, 3): how far the tissue is from home at instants evenly spread over the exposure.

    ``dent_m``: how deep the tip sinks in; ``touch_m`` (3,): where, if it does.
    """

    shift_m: FloatArray
    dent_m: float = 0.0
    touch_m: FloatArray | None = None


@dataclass(slots=True, eq=False)
class Desk:
    """Buffers of one thread; outside ``dirty``, ``clean`` (c, h, w) is the ground, and the others are empty."""

    clean: Picture
    drawn: Picture
    shade: Picture
    planes: Image
    dirty: Box = _NOTHING

    @classmethod
    def for_pictures_of(cls, painted: Painted) -> "Desk":
        """An empty desk."""
        c, h, w = painted.ground.shape
        drawn, shade = np.zeros((h, w, c + 1), np.float32), np.zeros((h, w), np.float32)
        return cls(painted.ground.copy(), drawn, shade, np.empty((c, h, w), np.uint8))


def compose(painted: Painted, desk: Desk, shapes_m: FloatArray, tissue: TissueState | None, time_s: float) -> None:
    """Leave the light of one frame in ``desk.clean``."""
    restore(desk.clean, painted.ground, desk.dirty)
    dirty = _NOTHING
    scene, camera, focus = painted.scene, painted.camera, painted.focus
    shapes = instants(shapes_m, _count(shapes_m, _TUBE_STEP_PX / painted.px_per_m))
    nodes = painted.catheter.nodes(shapes, camera, focus)
    dirty = _joined(dirty, _cast_shadows(painted, desk, nodes, scene.ground.depth_m))
    second, instrument = painted.second, scene.instrument
    other: TubeNodes | None = None
    if second is not None and instrument is not None:
        other = second.nodes(instrument_shape(scene, instrument, time_s)[None], camera, focus)
        high = scene.ground.depth_m + instrument_shape(scene, instrument, 0.0)[0, 2]
        dirty = _joined(dirty, _cast_shadows(painted, desk, other, high))
        if not instrument.in_front:
            dirty = _joined(dirty, _lay_tube(painted, desk, second, other))
    over = scene.tissue.over_tip
    if painted.phantom is not None and tissue is not None and not over:
        dirty = _joined(dirty, lay_phantom(desk.clean, painted, painted.phantom.sprite, tissue))
    dirty = _joined(dirty, _lay_tube(painted, desk, painted.catheter, nodes))
    if painted.phantom is not None and tissue is not None and over:
        dirty = _joined(dirty, lay_phantom(desk.clean, painted, painted.phantom.sprite, tissue))
    if second is not None and other is not None and instrument is not None and instrument.in_front:
        dirty = _joined(dirty, _lay_tube(painted, desk, second, other))
    if painted.front is not None:
        lay_front(desk.clean, painted.front, painted.front_box)
        dirty = _joined(dirty, painted.front_box)
    desk.dirty = dirty


def draw_tube(desk: Desk, tube: Tube, nodes: TubeNodes) -> Box:
    """The mean of ``nodes`` over the exposure into ``desk.drawn``; where."""
    profile = tube.profile
    for moment in nodes.nodes:
        add_tube(
            desk.drawn,
            moment,
            1.0 / len(nodes.nodes),
            profile.table,
            profile.half_width_px,
            profile.reach_px,
            tube.blurs,
            nodes.start_m,
            nodes.step_m,
            tube.along,
        )
    return _around(nodes.nodes, profile.reach_px * 1.1 + 2.0, np.zeros(2), desk.shade.shape)


def lay_phantom(clean: Picture, painted: Painted, sprite: Picture, tissue: TissueState) -> Box:
    """The tissue with its shadow over ``clean`` (c, h, w), from ``sprite``, which may be another than the painted."""
    phantom = painted.phantom
    assert phantom is not None
    home = painted.camera.project(phantom.home_m[None])[0]
    shift = instants(tissue.shift_m[:, None], _count(tissue.shift_m[:, None], _TISSUE_STEP_PX / painted.px_per_m))[:, 0]
    moved = painted.camera.project(phantom.home_m + shift) - home
    dent = np.array([*phantom.into_px, 0.0, 1.0])
    middle = np.zeros((len(moved), 2))
    if tissue.dent_m > 0.0 and tissue.touch_m is not None and not painted.scene.tissue.over_tip:
        dent[2] = tissue.dent_m * phantom.px_per_m
        dent[3] = 1.2 * painted.scene.catheter.radius_m * phantom.px_per_m + 0.7 * dent[2]
        middle[:] = painted.camera.project(tissue.touch_m[None])[0]
    dirty = np.array([clean.shape[1], 0, clean.shape[2], 0])
    shifts = phantom.margin_px - moved
    lay_moving(clean, painted.light, sprite, phantom.spans, shifts, middle, dent, dirty)
    return (int(dirty[0]), int(dirty[1]), int(dirty[2]), int(dirty[3])) if dirty[1] > dirty[0] else _NOTHING


def _count(shapes_m: FloatArray, step_m: float) -> int:
    """Instants that motion blur needs for ``shapes_m`` (m, n, 3) to be no farther apart than ``step_m``."""
    way = float(np.abs(np.diff(shapes_m, axis=0)).max(axis=(1, 2), initial=0.0).sum())
    return 1 if way < 0.25 * step_m else min(_MOST_INSTANTS, max(2, math.ceil(way / step_m)))


def _lay_tube(painted: Painted, desk: Desk, tube: Tube, nodes: TubeNodes) -> Box:
    box = draw_tube(desk, tube, nodes)
    lay_tubes(desk.clean, painted.light, desk.drawn, box)
    return box


def _cast_shadows(painted: Painted, desk: Desk, nodes: TubeNodes, depth_m: float) -> Box:
    """The tube's shadows on the ground ``depth_m`` below it; they are soft, and take mid-exposure for all of it."""
    middle = nodes.nodes[len(nodes.nodes) // 2]
    dirty = _NOTHING
    sigma = max(0.8, math.hypot(painted.scene.shadow_sigma_m(depth_m) * painted.px_per_m, middle[-1, 7]))
    # The softer a shadow, the coarser it may be drawn.
    coarse = min(16, max(1, int(sigma / 3.0)))
    h, w = desk.shade.shape
    shade = desk.shade[: -(-h // coarse) + 1, : -(-w // coarse) + 1]
    small = middle.copy()
    small[:, :2] = (middle[:, :2] + 0.5) / coarse - 0.5
    small[:, 4:] /= coarse
    for right_m, down_m, strength in painted.scene.shadow_falls_m(depth_m):
        fall = np.array([right_m, down_m]) * painted.px_per_m
        add_shadow(shade, small, fall / coarse, sigma / coarse, strength)
        box = _around(middle[None], middle[-1, 6] + 3.0 * sigma + 2.0 * coarse + 2.0, fall, (h, w))
        cast(desk.clean, shade, coarse, box)
        dirty = _joined(dirty, box)
    return dirty


def _around(nodes: FloatArray, reach: float, moved: FloatArray, shape: tuple[int, ...]) -> Box:
    """The box around ``nodes`` (m, n, 8), ``reach`` px wider and ``moved`` by (2,), within the picture."""
    low = nodes[..., :2].min(axis=(0, 1)) + moved - reach
    high = nodes[..., :2].max(axis=(0, 1)) + moved + reach + 2.0
    (u0, v0), (u1, v1) = np.maximum(low, 0.0), np.maximum(high, 0.0)
    v0, v1, u0, u1 = min(int(v0), shape[0]), min(int(v1), shape[0]), min(int(u0), shape[1]), min(int(u1), shape[1])
    return (v0, v1, u0, u1) if v1 > v0 and u1 > u0 else _NOTHING


def _joined(a: Box, b: Box) -> Box:
    """The box around both."""
    if a[1] <= a[0]:
        return b
    if b[1] <= b[0]:
        return a
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])
