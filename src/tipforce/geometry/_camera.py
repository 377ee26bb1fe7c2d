"""A camera as a pinhole behind a distorting lens."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..types import BasePose, FloatArray, frozen
from ._lens import project, straighten
from ._pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class CameraModel:
    """Pinhole with Brown-Conrady distortion, as OpenCV has it.

    ``focal_px`` (2,): fx, fy; a negative fx mirrors the image, as X-ray images are: shown as if seen from the
    detector, made from the focal spot. ``centre_px`` (2,): u, v of the optical axis; u right, v down, pixel centres at
    integers. ``distortion`` (5,): k1, k2, p1, p2, k3. ``camera_from_world`` takes world points into the camera's
    frame: x right, y down, z ahead. Points are (n, 3) in metres, pixels (n, 2).

    Raises ValueError where a number has no meaning.

    >>> camera = CameraModel(np.array([800.0, 800.0]), np.array([319.5, 239.5]))
    >>> camera.project([[0.01, -0.02, 0.4]])
    array([[339.5, 199.5]])
    """

    focal_px: FloatArray
    centre_px: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))
    camera_from_world: Pose = field(default_factory=Pose.identity)
    row: FloatArray = field(init=False, repr=False)
    """(21,): all of it, as the hot loops take it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "focal_px", frozen("focal_px", self.focal_px, (2,)))
        object.__setattr__(self, "centre_px", frozen("centre_px", self.centre_px, (2,)))
        object.__setattr__(self, "distortion", frozen("distortion", self.distortion, (5,)))
        pose = self.camera_from_world
        parts = (self.focal_px, self.centre_px, self.distortion, pose.rotation.ravel(), pose.translation_m)
        object.__setattr__(self, "row", frozen("row", np.concatenate(parts), (21,)))
        if not (np.isfinite(self.row).all() and self.focal_px[0] != 0 and self.focal_px[1] > 0):
            raise ValueError(
                f"a camera needs finite numbers and positive focal lengths (fx may be negative), got {self}"
            )

    @classmethod
    def facing(
        cls,
        base: BasePose,
        scale_m_per_px: float,
        distance_m: float,
        centre_px: ArrayLike,
        distortion: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> "CameraModel":
        """The camera that looks squarely at the base frame's plane z = 0 from ``distance_m``; world = base frame.

        In that plane, without distortion, it sees what ``base`` says: ``base.to_image(points / scale)``. Turn it by a
        pose of your own: ``camera.seen_from(camera_from_base @ tilt)``.
        """
        focal = distance_m / scale_m_per_px
        centre = frozen("centre_px", centre_px, (2,))
        c, s = math.cos(base.angle_rad), math.sin(base.angle_rad)
        turn = np.array([[c, -s, 0.0], [-s, -c, 0.0], [0.0, 0.0, -1.0]])
        place = np.append((base.origin_px - centre) * scale_m_per_px, distance_m)
        return cls(np.array([focal, focal]), centre, frozen("distortion", distortion, (5,)), Pose(turn, place))

    def seen_from(self, camera_from_world: Pose) -> "CameraModel":
        """The same camera at another place."""
        return CameraModel(self.focal_px, self.centre_px, self.distortion, camera_from_world)

    @property
    def matrix(self) -> FloatArray:
        """(3, 3): intrinsics K."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def projection_matrix(self) -> FloatArray:
        """(3, 4): K [R | t], world -> homogeneous pixels of the same camera without distortion."""
        pose = self.camera_from_world
        return self.matrix @ np.column_stack([pose.rotation, pose.translation_m])

    @property
    def position_m(self) -> FloatArray:
        """(3,): the pinhole, in the world."""
        return self.camera_from_world.inverse().translation_m

    def project(self, points_m: ArrayLike) -> FloatArray:
        """(n, 3) world points -> (n, 2) pixels; NaN behind the camera and where the lens's polynomial folds back."""
        points = _rows("points_m", points_m, 3)
        pixels = np.empty((len(points), 2))
        project(self.row, points, pixels, np.empty((1, 2, 3)))
        return pixels

    def project_with_slopes(self, points_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """As `project`, and (n, 2, 3): derivatives of u and v with the world point, px / m."""
        points = _rows("points_m", points_m, 3)
        pixels, slopes = np.empty((len(points), 2)), np.empty((len(points), 2, 3))
        project(self.row, points, pixels, slopes)
        return pixels, slopes

    def undistort(self, pixels: ArrayLike) -> FloatArray:
        """(n, 2) seen pixels -> (n, 2): where the camera would see the same without distortion; NaN: no such ray."""
        return self._normalised(pixels) * self.focal_px + self.centre_px

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """(n, 2) seen pixels -> (n, 3) unit directions in the world, from `position_m`; NaN: no such ray."""
        normalised = self._normalised(pixels)
        ahead = np.column_stack([normalised, np.ones(len(normalised))])
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        return ahead @ self.camera_from_world.rotation

    def on_plane(
        self, pixels: ArrayLike, point_m: ArrayLike = (0.0, 0.0, 0.0), normal: ArrayLike = (0.0, 0.0, 1.0)
    ) -> FloatArray:
        """(n, 2) seen pixels -> (n, 3) world points on the plane through ``point_m`` with ``normal``.

        NaN where the ray does not meet the plane ahead of the camera.
        """
        rays, origin = self.rays(pixels), self.position_m
        across = frozen("normal", normal, (3,))
        slope = rays @ across
        level = float((frozen("point_m", point_m, (3,)) - origin) @ across)
        reach = np.divide(level, slope, out=np.full(len(rays), np.nan), where=slope != 0)
        reach[~(reach > 0)] = np.nan
        return origin + reach[:, None] * rays

    def _normalised(self, pixels: ArrayLike) -> FloatArray:
        """(n, 2) seen pixels -> (n, 2): x / z and y / z of their rays in the camera's frame."""
        seen = _rows("pixels", pixels, 2)
        normalised = np.empty_like(seen)
        straighten(self.row, seen, normalised)
        return normalised


def _rows(name: str, values: ArrayLike, width: int) -> FloatArray:
    rows = np.ascontiguousarray(values, np.float64)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name}: expected shape (n, {width}), got {rows.shape}")
    return rows
