"""Rigid motions in space."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..types import FloatArray, frozen


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A rotation, then a translation: p -> ``rotation`` (3, 3) p + ``translation_m`` (3,).

    The pose of frame A in frame B converts coordinates in A to coordinates in B; its columns are A's axes and its
    translation is A's origin, both in B. ``b_from_a`` is a good name for it, because ``c_from_b @ b_from_a`` is
    ``c_from_a``.

    Raises:
        ValueError: ``rotation`` is not a rotation, or a number is not finite.

    >>> quarter = Pose.from_euler([0.0, 0.0, math.pi / 2], [0.1, 0.0, 0.0])
    >>> np.round(quarter.apply([[0.02, 0.0, 0.0]]), 6)
    array([[0.1 , 0.02, 0.  ]])
    >>> np.round((quarter.inverse() @ quarter).translation_m, 6) + 0.0
    array([0., 0., 0.])
    """

    rotation: FloatArray
    translation_m: FloatArray

    def __post_init__(self) -> None:
        """Checks that the rotation is one; the arrays become read-only."""
        object.__setattr__(self, "rotation", frozen("rotation", self.rotation, (3, 3)))
        object.__setattr__(self, "translation_m", frozen("translation_m", self.translation_m, (3,)))
        deviation = float(np.abs(self.rotation @ self.rotation.T - np.eye(3)).max())
        if not (deviation < 1e-6 and np.linalg.det(self.rotation) > 0):
            raise ValueError(f"rotation: expected orthonormal columns and determinant 1, got {self.rotation.tolist()}")
        if not np.isfinite(self.translation_m).all():
            raise ValueError(f"translation_m: expected finite numbers, got {self.translation_m.tolist()}")

    @classmethod
    def identity(cls) -> "Pose":
        """Returns the motion that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_axis_angle(cls, axis_angle_rad: ArrayLike, translation_m: ArrayLike) -> "Pose":
        """Returns a turn about an axis by an angle (Rodrigues), then a translation.

        Args:
            axis_angle_rad: (3,) unit vector of the axis times the angle.
            translation_m: (3,) translation.
        """
        vector = frozen("axis_angle_rad", axis_angle_rad, (3,))
        return cls(_rodrigues(vector), frozen("translation_m", translation_m, (3,)))

    @classmethod
    def from_euler(cls, euler_rad: ArrayLike, translation_m: ArrayLike) -> "Pose":
        """Returns R = Rz(yaw) Ry(pitch) Rx(roll), then a translation.

        The turns are about the fixed axes x, then y, then z; equivalently about the moving axes z, then y', then x''.

        Args:
            euler_rad: (3,) roll, pitch, yaw.
            translation_m: (3,) translation.
        """
        about_x, about_y, about_z = np.diag(frozen("euler_rad", euler_rad, (3,)))
        rotation = _rodrigues(about_z) @ _rodrigues(about_y) @ _rodrigues(about_x)
        return cls(rotation, frozen("translation_m", translation_m, (3,)))

    @property
    def axis_angle_rad(self) -> FloatArray:
        """(3,) axis times angle in [0, pi], the inverse of `from_axis_angle`; at pi both signs are right."""
        # The quaternion is divided by its largest component, so the result is exact near 0 and pi.
        r = self.rotation
        trace = float(np.trace(r))
        squares = np.array([trace, r[0, 0], r[1, 1], r[2, 2]])
        largest = int(np.argmax(squares))
        outer = np.empty((4, 4))  # 4 q q', q = (w, x, y, z): any of its rows has the direction of q
        outer[0, 0] = 1 + trace
        outer[0, 1:] = outer[1:, 0] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        outer[1:, 1:] = r + r.T + (1 - trace) * np.eye(3)
        quaternion = outer[largest] / np.linalg.norm(outer[largest])
        if quaternion[0] < 0:
            quaternion = -quaternion
        sine = float(np.linalg.norm(quaternion[1:]))
        half_rad = math.atan2(sine, quaternion[0])
        return quaternion[1:] * (2 * half_rad / sine if sine > 0 else 2.0)

    def apply(self, points_m: ArrayLike) -> FloatArray:
        """Returns (..., 3) points after the motion."""
        return np.asarray(points_m, np.float64) @ self.rotation.T + self.translation_m

    def rotate(self, directions: ArrayLike) -> FloatArray:
        """Returns (..., 3) directions, forces or moments after the rotation; they are not translated."""
        return np.asarray(directions, np.float64) @ self.rotation.T

    def inverse(self) -> "Pose":
        """Returns the inverse motion."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)

    def __matmul__(self, other: "Pose") -> "Pose":
        """Returns the motion ``other``, then this one: ``(a @ b).apply(p) == a.apply(b.apply(p))``."""
        return Pose(self.rotation @ other.rotation, self.apply(other.translation_m))


def _rodrigues(vector: FloatArray) -> FloatArray:
    """Returns the rotation matrix (3, 3) about ``vector`` (3,) by its length in rad."""
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.sqrt(x * x + y * y + z * z)
    # sin(a) / a and (1 - cos(a)) / a^2, exact at 0 too; np.sinc contains a factor pi.
    sine_ratio, cosine_ratio = np.sinc(angle / math.pi), 0.5 * np.sinc(0.5 * angle / math.pi) ** 2
    return np.eye(3) + sine_ratio * cross + cosine_ratio * (cross @ cross)
