"""Epipolar geometry of two views."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..types import FloatArray
from ._camera import CameraModel


def epipolar_angles(cameras: Sequence[CameraModel], pixels: ArrayLike) -> FloatArray:
    """Returns the angle of each pixel's epipolar plane about the line through both pinholes.

    The angles of the same point of the object are equal in both views (Hartley and Zisserman, 9.1).

    Args:
        cameras: the two cameras.
        pixels: (n, 2, 2) pixels of n points: point, view, u and v.

    Returns:
        (n, 2) angles in rad, about the mean direction of both optical axes; NaN where a pixel is.

    Raises:
        ValueError: there are not two cameras, they are at the same position, or look along the line between them.

    >>> from tipforce.geometry import Pose
    >>> left = CameraModel(np.array([800.0, 800.0]), np.array([320.0, 240.0]))
    >>> right = left.seen_from(Pose.from_euler([0.0, 0.0, 0.0], [-0.1, 0.0, 0.0]))
    >>> left_angle, right_angle = epipolar_angles([left, right], [[[340.0, 200.0], [140.0, 200.0]]])[0]
    >>> bool(abs(left_angle - right_angle) < 1e-12)
    True
    """
    first, second = cameras
    baseline = second.position_m - first.position_m
    forward = first.camera_from_world.rotation[2] + second.camera_from_world.rotation[2]
    length = float(np.linalg.norm(baseline))
    if not length > 0:
        raise ValueError("epipolar_angles: the two cameras are at the same position")
    baseline = baseline / length
    forward = forward - baseline * (baseline @ forward)
    if not np.linalg.norm(forward) > 1e-6:
        raise ValueError("epipolar_angles: the two cameras look along the line between them")
    forward = forward / np.linalg.norm(forward)
    across = np.cross(baseline, forward)
    points = np.asarray(pixels, np.float64)
    rays = np.stack([camera.rays(points[:, view]) for view, camera in enumerate(cameras)], axis=1)
    return np.arctan2(rays @ across, rays @ forward)
