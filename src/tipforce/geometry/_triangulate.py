"""Points in space from two or more views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..types import FloatArray, frozen
from ._camera import CameraModel
from ._lens import triangulate as _triangulate


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """``points_m`` (n, 3) in the world, ``covariance_m2`` (n, 3, 3), ``residual_px`` (n, views, 2): seen - projected.

    NaN where fewer than two views see a point or their rays are as good as parallel.
    """

    points_m: FloatArray
    covariance_m2: FloatArray
    residual_px: FloatArray


def triangulate(cameras: Sequence[CameraModel], pixels: ArrayLike, noise_px: ArrayLike = 1.0) -> Triangulated:
    """Each point where the sum of its squared distances in the images, over the noise, is least.

    ``pixels`` (n, views, 2): the same n points in each view, NaN where a view does not see one. ``noise_px``: standard
    deviation of u and v, one for all or one a view. The linear solution (Hartley and Zisserman, 12.2) is refined
    by Gauss-Newton through the distorting lenses; the covariance is the inverse of its normal matrix: cameras exact.

    Raises ValueError for fewer than two cameras or arrays of another shape.

    >>> from tipforce.geometry import Pose
    >>> left = CameraModel(np.array([800.0, 800.0]), np.array([320.0, 240.0]))
    >>> right = left.seen_from(Pose.from_euler([0.0, 0.0, 0.0], [-0.1, 0.0, 0.0]))
    >>> found = triangulate([left, right], [[[340.0, 200.0], [140.0, 200.0]]], noise_px=0.5)
    >>> found.points_m.round(6), np.sqrt(np.diag(found.covariance_m2[0])).round(6)
    (array([[ 0.01, -0.02,  0.4 ]]), array([0.000226, 0.00019 , 0.001414]))
    """
    if len(cameras) < 2:
        raise ValueError(f"triangulate: expected two cameras or more, got {len(cameras)}")
    seen = np.ascontiguousarray(pixels, np.float64)
    if seen.ndim != 3 or seen.shape[1:] != (len(cameras), 2):
        raise ValueError(f"pixels: expected shape (n, {len(cameras)}, 2), got {seen.shape}")
    sigma = frozen("noise_px", np.broadcast_to(np.asarray(noise_px, np.float64), (len(cameras),)), (len(cameras),))
    if not (sigma > 0).all():
        raise ValueError(f"noise_px: expected positive numbers, got {sigma.tolist()}")
    points, covariance, residual = np.empty((len(seen), 3)), np.empty((len(seen), 3, 3)), np.empty_like(seen)
    _triangulate(np.stack([camera.row for camera in cameras]), seen, sigma, points, covariance, residual)
    return Triangulated(points, covariance, residual)
