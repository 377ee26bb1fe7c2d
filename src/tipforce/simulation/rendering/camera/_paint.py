"""All that is painted once a session."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from .._random import gauss_table
from ._front import paint_front
from ._ground import illumination, paint_ground
from ._layers import Box
from ._phantom import Phantom, TissueHome, paint_phantom
from ._project import Focus
from ._scene import CameraScene
from ._tubes import Tube, make_instrument, make_tube

__all__ = ["Painted", "paint"]

Picture = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """A session's still parts; pictures are (c, h, w) float32, grey levels, lit but for the phantom's.

    ``light`` (h, w); ``front`` (c + 1, h, w) or None: what stands in front, last the share of the view that is left;
    ``front_box``: where that is anything.
    ``px_per_m``: at the base. ``gauss``: see `gauss_table`.
    """

    scene: CameraScene
    camera: CameraModel
    focus: Focus
    px_per_m: float
    ground: Picture
    light: Picture
    front: Picture | None
    front_box: Box
    phantom: Phantom | None
    catheter: Tube
    second: Tube | None
    gauss: Picture


def paint(
    scene: CameraScene, camera: CameraModel, length_m: float, tissue: TissueHome | None, width: int, height: int
) -> Painted:
    """Paint everything for pictures of ``width`` x ``height``."""
    channels = 3 if scene.colour else 1
    _, slopes = camera.project_with_slopes(np.zeros((1, 3)))
    px_per_m = float(np.sqrt(abs(np.linalg.det(slopes[0, :, :2]))))
    depth = float(camera.camera_from_world.translation_m[2])
    lens, finer = scene.lens, width / 640.0
    # The blur is given in the base frame's plane; the sharpest that the lens gets lies ``sharpest_m`` above it.
    sharp = math.sqrt(max(lens.blur_px**2 - (lens.defocus_px_per_m * lens.sharpest_m) ** 2, 0.25))
    focus = Focus(sharp * finer, depth - lens.sharpest_m, lens.defocus_px_per_m * finer)
    here, below = focus.sigma_px(depth), focus.sigma_px(depth + scene.ground.depth_m)
    light = illumination(scene, width, height)
    axis = camera.project(np.array([[0.0, 0.0, 0.0], [length_m, 0.0, 0.0]]))
    ground, _ = paint_ground(scene, width, height, px_per_m, axis).seen(below)
    front = paint_front(scene, camera, width, height, px_per_m, here)
    if front is not None:
        front = np.concatenate([_channels(front[:3], channels) * light, front[3:]])
    phantom = None
    if tissue is not None:
        phantom = paint_phantom(scene, camera, tissue, width, height, channels, here)
    return Painted(
        scene,
        camera,
        focus,
        px_per_m,
        np.ascontiguousarray(_channels(ground, channels) * light),
        light,
        front,
        _box_of(front),
        phantom,
        make_tube(scene, scene.catheter, length_m, px_per_m, focus, depth, scene.seed),
        make_instrument(scene, px_per_m, focus, depth),
        gauss_table(),
    )


def _channels(levels: Picture, channels: int) -> Picture:
    """RGB levels (3, h, w) as they are, or as the one plane of a grey camera."""
    return levels if channels == 3 else np.tensordot(np.array([[0.299, 0.587, 0.114]], np.float32), levels, axes=1)


def _box_of(front: Picture | None) -> Box:
    there = np.zeros((1, 1), np.bool_) if front is None else front[-1] < 0.999
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    if not rows.size:
        return 0, 0, 0, 0
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
