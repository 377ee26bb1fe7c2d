"""The tissue phantom, painted once a session: a silicone pad on a plate, on a round force sensor, on a stage's arm."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....mechanics import face_depths
from ....types import FloatArray
from .._exposure import TissueHome
from ._canvas import FINER, FloatImage, Part, Patch, SceneCanvas, canvas_px, multi_scale_noise, soften
from ._scene import CameraScene

MARGIN_M = 24e-3
"""How far the phantom may move from its home and still be whole."""
_VECTOR = 32
"""Pixels that one vector instruction of the blur processes, at most."""
RIM_MARGIN_M = 1.5e-3
"""A rim is wider than the pad by this, on either side."""
STEP_HEIGHT_M = 1e-3
"""Height of the step from one part to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Phantom:
    """A painted phantom.

    Attributes:
        sprite: (2, 2, c + 1, rows, columns) layer by half-pixel phase in v and u.
        spans: (rows, 4) spans of the sprite's rows, see `lay_moving`.
        margin_px: position in the sprite minus position in the image, at home.
        home_m: (3,) point of the surface at home, base frame.
        into_px: (2,) unit vector into the tissue, in the image.
        px_per_m: scale at the surface.
    """

    sprite: FloatImage
    spans: npt.NDArray[np.int64]
    margin_px: float
    home_m: FloatArray
    into_px: FloatArray
    px_per_m: float


def paint_phantom(
    scene: CameraScene, camera: CameraModel, home: TissueHome, width: int, height: int, channels: int, sigma_px: float
) -> Phantom:
    """Paints the phantom at its home, blurred and unlit.

    Args:
        scene: the scene.
        camera: camera that sees the base frame.
        home: surface of the phantom at rest, base frame.
        width: width of the image in px.
        height: height of the image in px.
        channels: 1 for a grey sprite, 3 for RGB.
        sigma_px: standard deviation of the image's blur.

    Returns:
        The phantom as `lay_moving` draws it.
    """
    appearance = scene.tissue
    home_px, slopes = (a[0] for a in camera.project_with_slopes(home.surface_m[None]))
    into_image = slopes @ home.into
    px_per_m = float(np.sqrt(abs(np.linalg.det(slopes[:, :2]))))  # from the area of a small square at the surface
    into = into_image / np.linalg.norm(into_image)
    margin = math.ceil(MARGIN_M * px_per_m)  # the canvas extends beyond the image, because the phantom moves
    canvas = SceneCanvas.empty(width + 2 * margin, height + 2 * margin, px_per_m, scene)
    rng = np.random.default_rng([scene.seed, 2])
    origin = canvas_px(home_px + margin)
    along = np.array([-into[1], into[0]])
    unit = canvas.px_per_m

    def box(deep_from: float, deep_to: float, half: float, corner: float, face: float | None = None) -> Patch:
        """Returns the cover of a part: depths into the tissue, half width, radius of corners and face, all in m."""
        return _rounded(canvas, origin, into, along, (deep_from, deep_to, -half, half, corner), unit, face)

    shape = box(0.0, appearance.pad_m[0], appearance.pad_m[1], appearance.corner_m, appearance.face_radius_m)
    if appearance.carrier:
        _lay_carrier(canvas, box, shape, (origin, into, along), 1.5 * (width + height) / px_per_m)
    else:
        canvas.darken(shape, scene.ground.depth_m)
    mottle = 1.0 + appearance.mottle * multi_scale_noise(rng, shape.shape, (8.0, 30.0, 90.0), 0.7)[shape.part]
    # Light comes out again near the edges of silicone, and its wet skin mirrors the lamps in soft patches.
    part = shape.part
    blurred_cover = soften(shape.within((slice(0, canvas.shape[0]), slice(0, canvas.shape[1]))), 1.1e-3 * unit)[part]
    glow = 1.0 + 0.22 * np.clip(1.6 - 1.6 * blurred_cover, 0.0, 1.0)
    shine = np.clip(multi_scale_noise(rng, shape.shape, (16.0, 50.0), 0.8)[part] - 2.0, 0.0, 1.0)
    lit = mottle * glow * canvas.bevel(shape, 5.0)
    paint = np.asarray(appearance.colour, np.float32) * lit[..., None] + np.float32(60.0) * shine[..., None]
    canvas.lay(shape, paint.astype(np.float32, copy=False), height_m=STEP_HEIGHT_M)
    if appearance.rim_m > 0.0:
        rim = box(-appearance.rim_m, 0.7 * appearance.pad_m[0], appearance.pad_m[1] + RIM_MARGIN_M, 0.5e-3)
        level = appearance.plate_grey
        canvas.lay(rim, (level, level, level), height_m=STEP_HEIGHT_M, shading=canvas.bevel(rim, 2.0))
    if appearance.opacity < 1.0:
        canvas.fade(appearance.opacity)
    return Phantom(*_sprite(canvas, channels, sigma_px), margin + 0.25, home.surface_m, into, px_per_m)


def _lay_carrier(
    canvas: SceneCanvas,
    box: Callable[[float, float, float, float], Patch],
    shape: Patch,
    axes: tuple[FloatArray, FloatArray, FloatArray],
    reach_m: float,
) -> None:
    """Lays the plate, the round force sensor and the stage's arm behind the pad, with the shadows of all parts.

    ``box`` makes the cover of a part, see `paint_phantom`; ``shape``: cover of the pad; ``axes``: origin (2,) in canvas
    pixels, unit vectors (2,) into the tissue and along its face. The arm ends ``reach_m`` deep, outside of the image.
    """
    scene, appearance, unit = canvas.scene, canvas.scene.tissue, canvas.px_per_m
    origin, into, along = axes
    pad_m, plate_m = appearance.pad_m[0], appearance.pad_m[0] + appearance.plate_m[0]
    body_m = plate_m + appearance.body_m[0]
    arm = box(body_m - 2e-3, reach_m, appearance.arm_half_m, 1e-3)
    sensor = box(plate_m - 1e-3, body_m, appearance.body_m[1], 2e-3)
    plate = box(pad_m - 1e-3, plate_m, appearance.plate_m[1], 0.6e-3)
    # All parts have about the same height: their shadow falls on the ground, and little on their neighbours.
    canvas.darken(arm.joined(sensor).joined(plate.joined(shape)), scene.ground.depth_m)
    # A darker groove along the middle of the arm.
    groove = 0.10 * np.exp(-((_aside(arm.part, origin, along) / (0.18 * appearance.arm_half_m * unit)) ** 2))
    bright = (canvas.bevel(arm, 3.0) * (1 - groove)).astype(np.float32)
    canvas.lay(arm, (appearance.arm_grey, appearance.arm_grey, appearance.arm_grey), shading=bright)
    bright = canvas.bevel(sensor, 2.0) * _cylinder(scene, sensor.part, origin, along, appearance.body_m[1] * unit)
    canvas.lay(
        sensor,
        (appearance.body_grey, appearance.body_grey, 1.02 * appearance.body_grey),
        height_m=STEP_HEIGHT_M,
        shading=bright,
    )
    plate_colour = (appearance.plate_grey, appearance.plate_grey, appearance.plate_grey)
    canvas.lay(plate, plate_colour, height_m=STEP_HEIGHT_M, shading=canvas.bevel(plate, 1.8))
    for side in (-0.8, 0.8):  # a screw head near each end of the plate
        screw_px = origin + unit * ((0.5 * (pad_m + plate_m)) * into + side * appearance.plate_m[1] * along)
        head = canvas.disc(screw_px, min(1.6e-3, 0.42 * appearance.plate_m[0]) * unit)
        dark_grey = 0.55 * appearance.plate_grey
        canvas.lay(head, (dark_grey, dark_grey, dark_grey), height_m=0.5e-3, shading=canvas.bevel(head, 1.2))


def _places(part: Part, origin: FloatArray) -> tuple[FloatImage, FloatImage]:
    """Returns u (1, w) and v (h, 1) of the part's pixels, from ``origin``."""
    v, u = (np.arange(side.start, side.stop).astype(np.float32) for side in part)
    across: FloatImage = u - np.float32(origin[0])
    down: FloatImage = v - np.float32(origin[1])
    return across[None], down[:, None]


def _aside(part: Part, origin: FloatArray, along: FloatArray) -> FloatImage:
    u, v = _places(part, origin)
    return np.asarray(u * np.float32(along[0]) + v * np.float32(along[1]), np.float32)


def _cylinder(scene: CameraScene, part: Part, origin: FloatArray, along: FloatArray, radius: float) -> FloatImage:
    """Returns the shading of a turned metal cylinder seen from its side."""
    x = np.clip(_aside(part, origin, along) / np.float32(radius), -1.0, 1.0)
    lamp = scene.light.lamps[0].direction
    lean = np.float32(lamp[0] * along[0] + lamp[1] * along[1])
    shading = 0.62 + 0.38 * np.sqrt(1 - x**2) + 0.35 * np.exp(-(((x - 0.6 * lean) / 0.13) ** 2)) + 0.15 * x * lean
    return shading.astype(np.float32)


def _rounded(
    canvas: SceneCanvas,
    origin: FloatArray,
    into: FloatArray,
    along: FloatArray,
    box: tuple[float, float, float, float, float],
    unit: float,
    face_radius_m: float | None = None,
) -> Patch:
    """Returns the anti-aliased cover of a box with rounded corners, bent like the tissue's face.

    ``origin`` (2,): point of the surface in canvas pixels; ``into``, ``along`` (2,): unit vectors into the tissue and
    along its face; ``box``: first and last depth, first and last position along the face, radius of the corners, in m;
    ``unit``: canvas pixels for each metre. The cover follows from a pixel's signed distance to the outline.
    """
    corners = origin + unit * np.array([deep * into + side * along for deep in box[:2] for side in box[2:4]])
    half_m = np.array([max(map(abs, box[2:4]))])
    sagitta_m = 0.0 if face_radius_m is None else abs(float(face_depths(face_radius_m, half_m)[0]))
    part = canvas.box(corners, 2.0 + sagitta_m * unit)
    low, high, left, right, corner = (np.float32(x * unit) for x in box)
    u, v = _places(part, origin)
    deep = u * np.float32(into[0]) + v * np.float32(into[1])
    side = u * np.float32(along[0]) + v * np.float32(along[1])
    if face_radius_m is not None:  # straighten the face
        deep = deep - (face_depths(face_radius_m, side / unit) * unit).astype(np.float32)
    deep = np.abs(deep - 0.5 * (low + high)) - 0.5 * (high - low) + corner
    side = np.abs(side - 0.5 * (left + right))
    side += corner - 0.5 * (right - left)
    outside_px = np.hypot(np.maximum(deep, 0), np.maximum(side, 0)) + np.minimum(np.maximum(deep, side), 0) - corner
    return Patch.of(canvas.shape, part, np.clip(np.float32(0.5) - outside_px, 0.0, 1.0))


def _sprite(canvas: SceneCanvas, channels: int, sigma_px: float) -> tuple[FloatImage, npt.NDArray[np.int64]]:
    """Returns the blurred sprite, split into half-pixel phases, and the spans of its rows; see `Phantom`.

    ``channels``: 1 for grey, 3 for RGB; ``sigma_px``: blur of the image at the phantom, px.
    """
    # Sampling between half pixels blurs a little too: up to 1/16 px^2, on average 1/24.
    sigma = FINER * max(0.0, sigma_px**2 - 1 / 24 - 1 / 48) ** 0.5
    part = _painted_part(canvas, math.ceil(8.0 * sigma) + 4)
    levels, transmittance = np.ascontiguousarray(canvas.levels[part]), np.ascontiguousarray(canvas.transmittance[part])
    planes = [cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY)] if channels == 1 else list(cv2.split(levels))
    planes.append(transmittance)
    if sigma > 0.0:  # in small images the sampling's own is all there is
        planes = [cv2.GaussianBlur(plane, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE) for plane in planes]
    rows, columns = canvas.shape[0] // FINER, canvas.shape[1] // FINER
    sprite = np.zeros((FINER, FINER, channels + 1, rows, columns), np.float32)
    sprite[:, :, -1] = 1.0
    top, bottom, first, last = (end // FINER for side in part for end in (side.start, side.stop))
    for k, plane in enumerate(planes):
        for y in range(FINER):
            for x in range(FINER):
                sprite[y, x, k, top:bottom, first:last] = plane[y::FINER, x::FINER]
    spans = np.zeros((rows, 4), np.int64)
    inside = sprite[..., top:bottom, first:last]
    # Spans with content (some light from behind is lost), then spans with own light.
    for kind, phases in enumerate((inside[:, :, -1] < 0.998, inside[:, :, 0] > 0.02)):
        present = phases[0, 0] | phases[0, 1] | phases[1, 0] | phases[1, 1]
        row_has = present.any(axis=1)
        found_rows = top + np.flatnonzero(row_has)
        spans[found_rows, 2 * kind] = first + present[row_has].argmax(axis=1)
        spans[found_rows, 2 * kind + 1] = last - present[row_has, ::-1].argmax(axis=1)
    return sprite, spans


def _painted_part(canvas: SceneCanvas, reach: int) -> Part:
    """Returns the painted part and ``reach`` px more, to whole pixels of the image.

    It begins at a multiple of the vector instructions' width, so that a blur of it rounds as one of the whole would.
    """
    ends = [
        (min(painted[axis].start for painted in canvas.changed), max(painted[axis].stop for painted in canvas.changed))
        for axis in (0, 1)
    ]
    rows, columns = (
        slice(max(0, low - reach) // _VECTOR * _VECTOR, min(size, -(-(high + reach) // FINER) * FINER))
        for (low, high), size in zip(ends, canvas.shape, strict=True)
    )
    return rows, columns
