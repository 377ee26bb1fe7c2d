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
    """Points in space; NaN if fewer than two views show a point or their rays are nearly parallel.

    Attributes:
        points_m: (n, 3) points in the world.
        covariance_m2: (n, 3, 3) their covariance.
        residual_px: (n, views, 2) observed - projected pixels.
    """

    points_m: FloatArray
    covariance_m2: FloatArray
    residual_px: FloatArray


def triangulate(cameras: Sequence[CameraModel], pixels: ArrayLike, noise_px: ArrayLike = 1.0) -> Triangulated:
    """Finds the points with the least sum of squared distances in the images, over the noise.

    The linear solution (Hartley and Zisserman, 12.2) is refined by Gauss-Newton through the distorting lenses; the
    covariance is the inverse of its normal matrix, for exact cameras.

    Args:
        cameras: two or more cameras.
        pixels: (n, views, 2) the same n points in each view; NaN where a view does not show a point.
        noise_px: standard deviation of u and v, one number for all views or one per view.

    Returns:
        Points, their covariances, and the residuals in the images.

    Raises:
        ValueError: there are fewer than two cameras, an array has another shape, or the noise is not positive.

    >>> from tipforce.geometry import Pose
    >>> left = CameraModel(np.array([800.0, 800.0]), np.array([320.0, 240.0]))
    >>> right = left.seen_from(Pose.from_euler([0.0, 0.0, 0.0], [-0.1, 0.0, 0.0]))
    >>> found = triangulate([left, right], [[[340.0, 200.0], [140.0, 200.0]]], noise_px=0.5)
    >>> found.points_m.round(6), np.sqrt(np.diag(found.covariance_m2[0])).round(6)
    (array([[ 0.01, -0.02,  0.4 ]]), array([0.000226, 0.00019 , 0.001414]))
    """
    if len(cameras) < 2:
        raise ValueError(f"triangulate: expected two cameras or more, got {len(cameras)}")
    observed = np.ascontiguousarray(pixels, np.float64)
    if observed.ndim != 3 or observed.shape[1:] != (len(cameras), 2):
        raise ValueError(f"pixels: expected shape (n, {len(cameras)}, 2), got {observed.shape}")
    sigma = frozen("noise_px", np.broadcast_to(np.asarray(noise_px, np.float64), (len(cameras),)), (len(cameras),))
    if not (sigma > 0).all():
        raise ValueError(f"noise_px: expected positive numbers, got {sigma.tolist()}")
    count = len(observed)
    points, covariance, residual = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty_like(observed)
    _triangulate(np.stack([camera.row for camera in cameras]), observed, sigma, points, covariance, residual)
    return Triangulated(points, covariance, residual)
