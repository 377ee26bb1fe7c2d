"""What stands between the camera and the shaft: strips of tape, brackets and cables across it."""

import math

import numpy as np

from ....geometry import CameraModel
from ._canvas import FINER, Canvas, band, multi_scale_noise, soften
from ._patch import Patch, Picture
from ._scene import CameraScene, Cover

__all__ = ["paint_front"]

_HEIGHT_M = 4e-3


def paint_front(
    scene: CameraScene, camera: CameraModel, width: int, height: int, px_per_m: float, sigma_px: float
) -> Picture | None:
    """(4, h, w): unlit levels times cover, and the share of the view behind that is left; None without covers."""
    if not scene.covers:
        return None
    rng = np.random.default_rng([scene.seed, 3])
    canvas = Canvas.empty(width, height, px_per_m, scene)
    for cover in scene.covers:
        _lay_cover(canvas, camera, cover, rng)
    levels, left = canvas.seen(sigma_px)
    return np.concatenate([levels, left[None]])


def _lay_cover(canvas: Canvas, camera: CameraModel, cover: Cover, rng: np.random.Generator) -> None:
    middle = 0.5 * (cover.from_m + cover.to_m)
    lean = np.array([math.sin(cover.slant_rad), math.cos(cover.slant_rad), 0.0])
    reach = rng.uniform(8e-3, 30e-3, 2)
    far = 0.2 if cover.kind == "cable" else 0.0
    ends = np.array([-(reach[0] + far), reach[1] + far])[:, None] * lean + np.array([middle, 0.0, 0.0])
    seen = camera.project(ends) * FINER + 0.5 * (FINER - 1)
    half = 0.5 * (cover.to_m - cover.from_m) * math.cos(cover.slant_rad) * canvas.px_per_m
    shape = canvas.outline(band(seen[0], seen[1], half))
    if cover.kind == "cable":
        bright = canvas.bevel(shape, 0.6 * half)
    elif cover.kind == "tape":
        worn = multi_scale_noise(rng, shape.shape, (4.0, 25.0), 0.8)[shape.part]
        bright = canvas.bevel(shape, 1.2) * (1 + 0.04 * worn)
    else:
        worn = multi_scale_noise(rng, shape.shape, (3.0, 60.0), 0.9)[shape.part]
        bright = canvas.bevel(shape, 2.5) * (1 + 0.02 * worn)
    canvas.lay(shape, cover.colour, height_m=_HEIGHT_M, shading=bright.astype(np.float32))
    if cover.kind == "bracket":
        for end in seen + (0.2, -0.2) * np.diff(seen, axis=0).repeat(2, axis=0):
            head = canvas.disc(end, min(0.6 * half, 2e-3 * canvas.px_per_m))
            canvas.lay(head, (95, 95, 98), height_m=1e-3, shading=canvas.bevel(head, 1.5))
            hole = canvas.disc(end, 0.3 * half)
            part = hole.around(8.0)
            canvas.lay(Patch.of(hole.shape, part, soften(hole.within(part), 1.0)), (25, 25, 25))
