"""Everything that is painted once a session, and objects in front of the shaft: tape, brackets and cables."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from ....geometry import CameraModel
from .._exposure import TissueHome
from .._random import gauss_table
from ._background import illumination, paint_background, paint_front_objects
from ._canvas import Box, FloatImage, Patch, SceneCanvas, band, canvas_px, multi_scale_noise, soften
from ._phantom import Phantom, paint_phantom
from ._scene import CameraScene, CoverPlate, Occluder
from ._tube_model import Focus, Tube, make_instrument, make_tube

_HEIGHT_M = 4e-3
"""Height of covers above the catheter, which determines their shadows."""


def _over(front: FloatImage | None, behind: FloatImage | None) -> FloatImage | None:
    """Composes two layers (c + 1, h, w) to one, ``front`` before ``behind``."""
    if front is None or behind is None:
        return behind if front is None else front
    return np.concatenate([front[:-1] + front[-1:] * behind[:-1], front[-1:] * behind[-1:]])


def _lay_cover(canvas: SceneCanvas, camera: CameraModel, cover: CoverPlate, rng: np.random.Generator) -> None:
    """Lays a plate on the canvas; it covers all from its edge to beyond the image's border."""
    into = np.array([math.cos(cover.into_rad), math.sin(cover.into_rad)])
    along = np.array([-into[1], into[0]])
    edge_point = np.array(cover.edge_m)
    far = 0.1  # half of it would leave any image
    corners = [
        edge_point + end * cover.half_m * along + depth_m * into
        for end, depth_m in ((-1, 0), (1, 0), (1, far), (-1, far))
    ]
    shape = canvas.outline(canvas_px(camera.project(np.column_stack([np.array(corners), np.zeros(4)]))))
    worn = multi_scale_noise(rng, shape.shape, (3.0, 60.0, 300.0), 0.9)[shape.part]
    bright = canvas.bevel(shape, 2.5) * (1 + 0.03 * worn)
    canvas.lay(shape, cover.colour, height_m=_HEIGHT_M, shading=bright.astype(np.float32))


def _tube_layer(
    tube: Tube, length_m: float, camera: CameraModel, focus: Focus, light: FloatImage, *, cut: bool
) -> FloatImage:
    """Returns the layer of a lit straight tube that ends at the base: (c + 1, h, w) levels and visible share behind.

    `Tube.nodes` adds a straight part before the start of every tube. With ``cut`` it is removed, by an edge as blurred
    as the image, and the tube is ``length_m`` long.
    """
    line = np.column_stack([np.linspace(-length_m, 0.0, _LINE), np.zeros((_LINE, 2))])
    nodes = tube.nodes(line[None], camera, focus)
    drawn = np.zeros((*light.shape, (tube.along.shape[1] - 1) // 2 + 1), np.float32)
    tube.draw(drawn, nodes)
    if cut:
        start, next_point = camera.project(line[[0, 1]])
        direction = (next_point - start) / np.linalg.norm(next_point - start)
        v, u = np.mgrid[0 : light.shape[0], 0 : light.shape[1]]
        past_start_px = (u - start[0]) * direction[0] + (v - start[1]) * direction[1]
        drawn *= ndtr(past_start_px / float(nodes.nodes[0, 0, 7])).astype(np.float32)[..., None]
    cover = np.clip(drawn[..., 0], 0.0, 1.0)
    return np.concatenate([(drawn[..., 1:] * light[..., None]).transpose(2, 0, 1), 1.0 - cover[None]])


_LINE = 33
"""Points of a straight tube."""
SHEATH_LENGTH_M = 60e-3
"""Length of a sheath that is drawn behind its mouth; `Tube.nodes` adds nearly as much: to beyond the border."""


def _sheath_layer(
    scene: CameraScene, camera: CameraModel, focus: Focus, px_per_m: float, depth_m: float, light: FloatImage
) -> FloatImage | None:
    """Returns the layer (c + 1, h, w) of the sheath up to its mouth at the base, and of a stopper on it; None: none."""
    sheath = scene.sheath
    if sheath is None:
        return None
    parts = [(sheath.appearance, SHEATH_LENGTH_M)]
    if sheath.fitting == "stopper":
        finish = replace(sheath.appearance.finish, shaft=sheath.fitting_colour)
        stopper = replace(sheath.appearance, radius_m=_STOPPER_WIDER * sheath.appearance.radius_m, finish=finish)
        parts.append((stopper, sheath.fitting_m))
    layer: FloatImage | None = None
    for appearance, length in parts:
        tube = make_tube(scene, appearance, length, px_per_m, focus, depth_m, scene.seed + 2)
        layer = _over(_tube_layer(tube, length, camera, focus, light, cut=length < SHEATH_LENGTH_M), layer)
    return layer


_STOPPER_WIDER = 1.7


def paint_foreground(
    scene: CameraScene, camera: CameraModel, width: int, height: int, px_per_m: float, sigma_px: float
) -> FloatImage | None:
    """Paints the covers in front of the catheter.

    Args:
        scene: the scene.
        camera: camera that sees the base frame.
        width: width of the image in px.
        height: height of the image in px.
        px_per_m: scale of the image at the catheter.
        sigma_px: standard deviation of the image's blur.

    Returns:
        (4, h, w) unlit levels times cover, and the visible share of the view behind; None without covers.
    """
    if not scene.occluders and scene.cover is None:
        return None
    rng = np.random.default_rng([scene.seed, 3])
    canvas = SceneCanvas.empty(width, height, px_per_m, scene)
    for cover in scene.occluders:
        _lay_occluder(canvas, camera, cover, rng)
    if scene.cover is not None:
        _lay_cover(canvas, camera, scene.cover, rng)
    levels, left = canvas.seen(sigma_px)
    return np.concatenate([levels, left[None]])


def _lay_occluder(canvas: SceneCanvas, camera: CameraModel, cover: Occluder, rng: np.random.Generator) -> None:
    """Lays a strip of tape, a cable or a bracket with two screws across the shaft; a cable crosses the whole image."""
    middle_m = 0.5 * (cover.from_m + cover.to_m)
    along = np.array([math.sin(cover.slant_rad), math.cos(cover.slant_rad), 0.0])
    lengths_m = rng.uniform(8e-3, 30e-3, 2)
    extra_m = 0.2 if cover.kind == "cable" else 0.0
    ends_m = np.array([-(lengths_m[0] + extra_m), lengths_m[1] + extra_m])[:, None] * along + (middle_m, 0.0, 0.0)
    ends_px = canvas_px(camera.project(ends_m))
    half_width_px = 0.5 * (cover.to_m - cover.from_m) * math.cos(cover.slant_rad) * canvas.px_per_m
    shape = canvas.outline(band(ends_px[0], ends_px[1], half_width_px))
    if cover.kind == "cable":
        shading = canvas.bevel(shape, 0.6 * half_width_px)
    elif cover.kind == "tape":
        wear = multi_scale_noise(rng, shape.shape, (4.0, 25.0), 0.8)[shape.part]
        shading = canvas.bevel(shape, 1.2) * (1 + 0.04 * wear)
    else:
        wear = multi_scale_noise(rng, shape.shape, (3.0, 60.0), 0.9)[shape.part]
        shading = canvas.bevel(shape, 2.5) * (1 + 0.02 * wear)
    canvas.lay(shape, cover.colour, height_m=_HEIGHT_M, shading=shading.astype(np.float32))
    if cover.kind == "bracket":
        # A dark hole in a screw head, at a fifth of the length from each end.
        for screw_px in ends_px + (0.2, -0.2) * np.diff(ends_px, axis=0).repeat(2, axis=0):
            head = canvas.disc(screw_px, min(0.6 * half_width_px, 2e-3 * canvas.px_per_m))
            canvas.lay(head, (95, 95, 98), height_m=1e-3, shading=canvas.bevel(head, 1.5))
            hole = canvas.disc(screw_px, 0.3 * half_width_px)
            part = hole.around(8.0)
            canvas.lay(Patch.of(hole.shape, part, soften(hole.within(part), 1.0)), (25, 25, 25))


@dataclass(frozen=True, slots=True, eq=False)
class StaticLayers:
    """A session's still parts; images are (c, h, w) float32, grey levels, lit except for the phantom's.

    Attributes:
        scene: the scene.
        camera: camera model; its world is the base frame.
        focus: blur by depth.
        px_per_m: scale at the base.
        ground: (c, h, w) table with objects.
        light: (h, w) brightness of the light.
        foreground: (c + 1, h, w) objects in front, and the visible share of the layers behind; None: none.
        foreground_box: box around them.
        phantom: the phantom; None: none.
        catheter: constant parts of the catheter.
        second: constant parts of the second instrument; None: none.
        gauss: `gauss_table`.
    """

    scene: CameraScene
    camera: CameraModel
    focus: Focus
    px_per_m: float
    ground: FloatImage
    light: FloatImage
    foreground: FloatImage | None
    foreground_box: Box
    phantom: Phantom | None
    catheter: Tube
    second: Tube | None
    gauss: FloatImage


def make_static_layers(
    scene: CameraScene, camera: CameraModel, length_m: float, tissue: TissueHome | None, width: int, height: int
) -> StaticLayers:
    """Draws once all parts of the images of a session that do not move, and prepares the drawing of the tubes.

    Args:
        scene: appearance of the session.
        camera: camera at the size of the images.
        length_m: length of the catheter from the base to the tip.
        tissue: the tissue at rest; None: the scene has no phantom.
        width: width of the images in px.
        height: height of the images in px.

    Returns:
        Images of background, light, foreground and phantom in grey levels, and the profiles of the tubes.
    """
    channels = 3 if scene.colour else 1
    _, slopes = camera.project_with_slopes(np.zeros((1, 3)))
    px_per_m = float(np.sqrt(abs(np.linalg.det(slopes[0, :, :2]))))
    base_depth_m = float(camera.camera_from_world.translation_m[2])
    lens, finer = scene.lens, width / 640.0  # the blur of the scene is in px of an image of 640 columns
    # The blur is given in the base frame's plane; the sharpest plane of the lens is ``sharpest_m`` above it.
    sharpest_px = math.sqrt(max(lens.blur_px**2 - (lens.defocus_px_per_m * lens.sharpest_m) ** 2, 0.25))
    focus = Focus(sharpest_px * finer, base_depth_m - lens.sharpest_m, lens.defocus_px_per_m * finer)
    blur_px, ground_blur_px = focus.sigma_px(base_depth_m), focus.sigma_px(base_depth_m + scene.ground.depth_m)
    light = illumination(scene, width, height)
    axis_px = camera.project(np.array([[0.0, 0.0, 0.0], [length_m, 0.0, 0.0]]))
    ground, _ = paint_background(scene, width, height, px_per_m, axis_px).seen(ground_blur_px)
    foreground = paint_foreground(scene, camera, width, height, px_per_m, blur_px)
    if foreground is not None:
        foreground = np.concatenate([_channels(foreground[:3], channels) * light, foreground[3:]])
    foreground = _over(foreground, _sheath_layer(scene, camera, focus, px_per_m, base_depth_m, light))
    if scene.front_objects:
        levels, transmittance = paint_front_objects(scene, width, height, px_per_m, axis_px)
        foreground = _over(np.concatenate([_channels(levels, channels) * light, transmittance[None]]), foreground)
    phantom = None
    if tissue is not None:
        phantom = paint_phantom(scene, camera, tissue, width, height, channels, blur_px)
    ground = np.ascontiguousarray(_channels(ground, channels) * light)
    catheter = make_tube(scene, scene.catheter, length_m, px_per_m, focus, base_depth_m, scene.seed)
    second = make_instrument(scene, px_per_m, focus, base_depth_m)
    return StaticLayers(
        scene, camera, focus, px_per_m, ground, light, foreground, _box_of(foreground), phantom, catheter, second,
        gauss_table(),
    )  # fmt: skip


def _channels(levels: FloatImage, channels: int) -> FloatImage:
    """Returns RGB levels (3, h, w) as they are, or as the one plane of a grey camera."""
    return levels if channels == 3 else np.tensordot(np.array([[0.299, 0.587, 0.114]], np.float32), levels, axes=1)


def _box_of(foreground: FloatImage | None) -> Box:
    """Returns the box around the pixels in which the foreground hides anything; empty without a foreground."""
    there = np.zeros((1, 1), np.bool_) if foreground is None else foreground[-1] < 0.999
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    if not rows.size:
        return 0, 0, 0, 0
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
