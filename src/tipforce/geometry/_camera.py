"""A camera model: a pinhole with lens distortion."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..types import BasePose, FloatArray, Projection, frozen
from ._lens import project, straighten
from ._pose import Pose

MAX_SKEW = 1e-3
"""Largest cosine between the axes of pixels that count as rectangular."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraModel:
    """Pinhole with Brown-Conrady distortion, as in OpenCV.

    Points are (n, 3) in metres, pixels (n, 2).

    Attributes:
        focal_px: (2,) fx, fy; a negative fx mirrors the image, as in X-ray images, which are shown from the side of the
            detector.
        centre_px: (2,) u, v of the optical axis; u right, v down, pixel centres at integers.
        distortion: (5,) k1, k2, p1, p2, k3.
        camera_from_world: converts world points to the camera's frame: x right, y down, z ahead.
        row: (21,) all parameters, for the hot loops.

    Raises:
        ValueError: a number is not finite, or a focal length is 0 or (fy) negative.

    >>> camera = CameraModel(np.array([800.0, 800.0]), np.array([319.5, 239.5]))
    >>> camera.project([[0.01, -0.02, 0.4]])
    array([[339.5, 199.5]])
    """

    focal_px: FloatArray
    centre_px: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))
    camera_from_world: Pose = field(default_factory=Pose.identity)
    row: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Checks the values, makes the arrays read-only, and collects them in ``row``."""
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
        """Returns a camera that faces the plane z = 0 of the base frame; its world is the base frame.

        In that plane, without distortion, it gives the pixels of ``base``: ``base.to_image(points / scale)``. To turn
        it: ``camera.seen_from(camera_from_base @ tilt)``.

        Args:
            base: pose of the base frame in the image.
            scale_m_per_px: scale in the plane z = 0.
            distance_m: distance of the pinhole from that plane.
            centre_px: (2,) u, v of the optical axis.
            distortion: (5,) k1, k2, p1, p2, k3.
        """
        focal = distance_m / scale_m_per_px
        centre = frozen("centre_px", centre_px, (2,))
        c, s = math.cos(base.angle_rad), math.sin(base.angle_rad)
        turn = np.array([[c, -s, 0.0], [-s, -c, 0.0], [0.0, 0.0, -1.0]])
        translation = np.append((base.origin_px - centre) * scale_m_per_px, distance_m)
        return cls(np.array([focal, focal]), centre, frozen("distortion", distortion, (5,)), Pose(turn, translation))

    @classmethod
    def from_projection(cls, projection: ArrayLike, max_skew: float = MAX_SKEW) -> "CameraModel":
        """Returns the camera without distortion of a projection matrix, the inverse of `projection_matrix`.

        Args:
            projection: (3, 4) matrix; the world's origin is in front of the camera.
            max_skew: largest cosine between the axes of the pixels that is ignored.

        Returns:
            The camera; fx is negative where the matrix mirrors the image.

        Raises:
            ValueError: the matrix is no perspective projection with rectangular pixels.

        >>> camera = CameraModel(np.array([-800.0, 810.0]), np.array([320.0, 240.0]))
        >>> camera = camera.seen_from(Pose.from_euler([0.3, 0.2, 0.1], [0.01, 0.02, 0.7]))
        >>> CameraModel.from_projection(camera.projection_matrix).focal_px.round(6)
        array([-800.,  810.])
        """
        matrix = frozen("projection", projection, (3, 4))
        third_row_size = float(np.linalg.norm(matrix[2, :3]))
        largest = float(np.linalg.norm(matrix[:2, :3], axis=1).max())
        if not (np.isfinite(matrix).all() and third_row_size * 1e6 > largest and matrix[2, 3] != 0):
            raise ValueError("projection: expected a perspective projection, got one without a finite distance")
        # A projection matrix has any scale and sign: K[2, 2] = 1, and the world's origin is ahead of the camera.
        matrix = matrix / (math.copysign(third_row_size, float(matrix[2, 3])))
        ahead, centre = matrix[2, :3], matrix[:2, :3] @ matrix[2, :3]
        across, down = matrix[:2, :3] - np.outer(centre, ahead)
        focal = np.array([float(np.linalg.norm(across)), float(np.linalg.norm(down))])
        if not (focal > 1e-6).all() or abs(across @ down) > max_skew * focal[0] * focal[1]:
            raise ValueError("projection: expected rectangular pixels, got a matrix with skewed axes")
        y_axis = down / focal[1]
        x_axis = np.cross(y_axis, ahead)
        focal[0] *= math.copysign(1.0, float(across @ x_axis))
        rotation = np.array([x_axis, y_axis, ahead])
        offset = (matrix[:2, 3] - centre * matrix[2, 3]) / focal
        return cls(focal, centre, camera_from_world=Pose(rotation, np.append(offset, matrix[2, 3])))

    def seen_from(self, camera_from_world: Pose) -> "CameraModel":
        """Returns the same camera at another pose."""
        return CameraModel(self.focal_px, self.centre_px, self.distortion, camera_from_world)

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) intrinsics K."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def projection_matrix(self) -> FloatArray:
        """(3, 4) K [R | t]: world -> homogeneous pixels of the same camera without distortion."""
        pose = self.camera_from_world
        return self.matrix @ np.column_stack([pose.rotation, pose.translation_m])

    @property
    def projection(self) -> Projection:
        """`projection_matrix` as ``bench.toml`` holds it, with eight digits."""
        a, b, c = ([float(f"{x:.8g}") for x in row] for row in self.projection_matrix)
        return (a[0], a[1], a[2], a[3]), (b[0], b[1], b[2], b[3]), (c[0], c[1], c[2], c[3])

    @property
    def position_m(self) -> FloatArray:
        """(3,) position of the pinhole in the world."""
        return self.camera_from_world.inverse().translation_m

    def project(self, points_m: ArrayLike) -> FloatArray:
        """Projects (n, 3) world points to (n, 2) pixels; NaN behind the camera or where the lens is not one to one."""
        points = _rows("points_m", points_m, 3)
        pixels = np.empty((len(points), 2))
        project(self.row, points, pixels, np.empty((1, 2, 3)))
        return pixels

    def project_with_slopes(self, points_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Returns the result of `project`, and (n, 2, 3) derivatives of u and v by the world point in px / m."""
        points = _rows("points_m", points_m, 3)
        pixels, slopes = np.empty((len(points), 2)), np.empty((len(points), 2, 3))
        project(self.row, points, pixels, slopes)
        return pixels, slopes

    def undistort(self, pixels: ArrayLike) -> FloatArray:
        """Converts (n, 2) observed pixels to those of the camera without distortion; NaN where there is no such ray."""
        return self._normalised(pixels) * self.focal_px + self.centre_px

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Returns (n, 3) unit directions of the rays of (n, 2) observed pixels, in the world; NaN without a ray."""
        normalised = self._normalised(pixels)
        ahead = np.column_stack([normalised, np.ones(len(normalised))])
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        return ahead @ self.camera_from_world.rotation

    def on_plane(
        self, pixels: ArrayLike, point_m: ArrayLike = (0.0, 0.0, 0.0), normal: ArrayLike = (0.0, 0.0, 1.0)
    ) -> FloatArray:
        """Returns the points in which the rays of observed pixels meet a plane.

        Args:
            pixels: (n, 2) observed pixels.
            point_m: (3,) a point of the plane, in the world.
            normal: (3,) normal of the plane, in the world.

        Returns:
            (n, 3) world points; NaN where a ray does not meet the plane ahead of the camera.
        """
        rays, origin = self.rays(pixels), self.position_m
        plane_normal = frozen("normal", normal, (3,))
        along_normal = rays @ plane_normal
        distance = float((frozen("point_m", point_m, (3,)) - origin) @ plane_normal)
        ray_length = np.divide(distance, along_normal, out=np.full(len(rays), np.nan), where=along_normal != 0)
        ray_length[~(ray_length > 0)] = np.nan
        return origin + ray_length[:, None] * rays

    def _normalised(self, pixels: ArrayLike) -> FloatArray:
        """Returns (n, 2) x / z and y / z of the rays of (n, 2) observed pixels, in the camera's frame."""
        observed = _rows("pixels", pixels, 2)
        normalised = np.empty_like(observed)
        straighten(self.row, observed, normalised)
        return normalised


def _rows(name: str, values: ArrayLike, width: int) -> FloatArray:
    """Returns ``values`` as a contiguous (n, width) array of float64; another shape raises ValueError."""
    rows = np.ascontiguousarray(values, np.float64)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name}: expected shape (n, {width}), got {rows.shape}")
    return rows
