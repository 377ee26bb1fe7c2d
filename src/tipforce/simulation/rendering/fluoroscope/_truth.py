"""What is to be seen of the catheter in an X-ray picture, exactly."""

import math

import numpy as np
from numba import njit

from ....geometry import CameraModel
from ....types import BoolArray, FloatArray
from ..camera import PictureTruth

__all__ = ["picture_truth"]


@njit(cache=True, error_model="numpy", nogil=True)
def _cover(mask: BoolArray, pixels: FloatArray, half_px: FloatArray) -> None:
    h, w = mask.shape
    for i in range(pixels.shape[0] - 1):
        au, av, bu, bv = pixels[i, 0], pixels[i, 1], pixels[i + 1, 0], pixels[i + 1, 1]
        far = max(half_px[i], half_px[i + 1])
        du, dv = bu - au, bv - av
        square = du * du + dv * dv
        for v in range(max(0, math.ceil(min(av, bv) - far)), min(h, math.floor(max(av, bv) + far) + 1)):
            for u in range(max(0, math.ceil(min(au, bu) - far)), min(w, math.floor(max(au, bu) + far) + 1)):
                t = ((u - au) * du + (v - av) * dv) / square if square > 0 else 0.0
                t = min(max(t, 0.0), 1.0)
                half = half_px[i] + t * (half_px[i + 1] - half_px[i])
                if (u - au - t * du) ** 2 + (v - av - t * dv) ** 2 <= half * half:
                    mask[v, u] = True


def _covered(camera: CameraModel, points_m: FloatArray, radius_m: float, height: int, width: int) -> BoolArray:
    """(h, w): pixels whose ray through the middle passes a tube of ``radius_m`` along ``points_m`` (n, 3), world.

    The tube ends in a hemisphere of its own radius at the last point.
    """
    steps = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    # The middle of the dome lies one radius before its apex.
    even = np.linspace(0.0, max(arc[-1] - radius_m, 0.0), 2 * len(arc))
    middle = np.stack([np.interp(even, arc, points_m[:, k]) for k in range(3)], axis=1)
    depth = camera.camera_from_world.apply(middle)[:, 2]
    mask = np.zeros((height, width), np.bool_)
    pixels = camera.project(middle)
    if np.isfinite(pixels).all():
        _cover(mask, pixels, radius_m * float(camera.focal_px[1]) / depth)
    return mask


def picture_truth(camera: CameraModel, points_m: FloatArray, radius_m: float, height: int, width: int) -> PictureTruth:
    """Truth of a picture of a catheter along ``points_m`` (n, 3), in the camera's world.

    Nothing hides what X-rays pass: visible is what lies in the picture, however faint it may be.
    """
    centreline = camera.project(points_m)
    near = np.rint(np.nan_to_num(centreline, nan=-9.0))
    visible = np.asarray(((near >= 0) & (near < (width, height))).all(axis=1), np.bool_)
    weight = np.ones(len(visible))
    weight[[0, -1]] = 0.5
    mask = _covered(camera, points_m, radius_m, height, width)
    return PictureTruth(mask, centreline, visible, float(visible @ weight / weight.sum()))
