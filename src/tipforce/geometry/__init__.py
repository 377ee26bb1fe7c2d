"""Curves by arc length and their coefficients; rigid motions, cameras, and points in space from several views."""

from ._c_arm import CArm
from ._camera import CameraModel
from ._curves import (
    angle_matrix,
    arc_length,
    curve_from_angle,
    fit_polynomial,
    resampled,
    tangents_and_normals,
    turning_angles,
)
from ._epipolar import epipolar_angles
from ._pose import Pose
from ._triangulate import Triangulated, triangulate

__all__ = [
    "CArm",
    "CameraModel",
    "Pose",
    "Triangulated",
    "angle_matrix",
    "arc_length",
    "curve_from_angle",
    "epipolar_angles",
    "fit_polynomial",
    "resampled",
    "tangents_and_normals",
    "triangulate",
    "turning_angles",
]
