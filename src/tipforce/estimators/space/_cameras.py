"""Cameras of the views, lines in their pixels, and the pose of the base with which a session starts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...types import CentrelinePx, FloatArray, SessionInfo
from ..session import POINTS

_ISOCENTRE = np.array([0.0, 0.0, 0.0, 1.0])
_NEAR_ORIGIN = 1e-3
"""Weight of the origin of the projections' frame, where the rays leave a direction open."""
_MOST_BACK = 0.2
"""The clamp is at most this share of the length away from the first detected point."""
_LEAST_SINE = 0.1
"""Smallest sine of the angle between two planes that give a direction together."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewLine:
    """A detected line of one view.

    Attributes:
        points: (`POINTS`, 2) u, v in px, base to tip.
        normals: (`POINTS`, 2) unit normals: the tangent, turned from u to v.
        length_px: length of the line.
    """

    points: FloatArray
    normals: FloatArray
    length_px: float

    @classmethod
    def of(cls, centreline: CentrelinePx) -> "ViewLine":
        """Returns `POINTS` points and normals of a detected centreline, evenly spaced in its points' index."""
        points = centreline.points
        sampled = np.rint(np.linspace(0.0, len(points) - 1.0, POINTS)).astype(np.int64)
        tangents = np.gradient(points, axis=0, edge_order=2 if len(points) > 2 else 1)[sampled]
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        length_px = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
        return cls(np.ascontiguousarray(points[sampled]), np.ascontiguousarray(normals), length_px)

    @property
    def tangents(self) -> FloatArray:
        """(`POINTS`, 2) unit tangents, base to tip."""
        return np.column_stack([self.normals[:, 1], -self.normals[:, 0]])


def camera_of(info: SessionInfo, view: str, size_px: tuple[int, int]) -> FloatArray:
    """Returns the projection (3, 4) of a view from metres to pixels.

    A view whose projection is not stated is a parallel projection with its scale; x points right, y up.

    Args:
        info: the session metadata.
        view: name of the view.
        size_px: width and height of its images.

    Raises:
        InputError: neither projection nor scale is stated.
    """
    stated = info.view(view)
    if stated.projection is not None:
        camera = np.array(stated.projection, np.float64)
        return camera / np.linalg.norm(camera[2])
    if stated.metres_per_px is None:
        raise InputError(f"views.{view}.projection is not stated, nor is metres_per_px; add one of them to bench.toml")
    (width, height), scale = size_px, stated.metres_per_px
    return np.array(
        [
            [1.0 / scale, 0.0, 0.0, 0.5 * (width - 1)],
            [0.0, -1.0 / scale, 0.0, 0.5 * (height - 1)],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _gradients(camera: FloatArray, point_m: FloatArray) -> FloatArray:
    """Returns the derivatives (2, 3) of u and v in px/m at a point (3,)."""
    u, v, w = camera @ np.append(point_m, 1.0)
    return (camera[:2, :3] - np.outer([u / w, v / w], camera[2, :3])) / w


def toward_viewer(camera: FloatArray, point_m: FloatArray) -> FloatArray:
    """Returns the direction (3,) from a point (3,) to the viewer of the displayed image."""
    right, down = _gradients(camera, point_m)
    direction = -np.cross(right, down)
    return direction / np.linalg.norm(direction)


def axes_of_image(camera: FloatArray) -> FloatArray:
    """Returns three unit vectors in columns (3, 3): to the right in the image, down in it, and the viewing direction.

    They hold at the origin of the projection's frame, and are in that frame.
    """
    ahead = -toward_viewer(camera, np.zeros(3))
    right = _gradients(camera, np.zeros(3))[0]
    right -= (right @ ahead) * ahead
    right /= np.linalg.norm(right)
    return np.asarray(np.column_stack([right, np.cross(ahead, right), ahead]), np.float64)


def _meeting_point(cameras: Sequence[FloatArray], pixels: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """Triangulates a point by least squares: the point (3,) in m whose images are nearest to a pixel of each view.

    With one view the ray leaves the depth open; the weak weight of the origin (`_NEAR_ORIGIN`) then decides it.

    Returns:
        The point, and the misfit in px.
    """
    equations, sides = [np.eye(3) * _NEAR_ORIGIN], [np.zeros(3)]
    for camera, pixel in zip(cameras, pixels, strict=True):
        rays = camera[:2] - np.outer(pixel, camera[2])
        rays = rays / (camera[2] @ _ISOCENTRE)  # residuals in px at the depth of the origin
        equations.append(rays[:, :3])
        sides.append(-rays[:, 3])
    matrix, side = np.vstack(equations), np.concatenate(sides)
    point_m = np.asarray(np.linalg.lstsq(matrix, side, rcond=None)[0], np.float64)
    return point_m, float(np.linalg.norm((matrix @ point_m - side)[3:]))


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The frame in which a session's base is found: its origin, and its axes in columns, in the projections' frame."""

    origin_m: FloatArray
    axes: FloatArray

    def camera(self, camera: FloatArray) -> FloatArray:
        """Returns the projection (3, 4) from this frame to pixels."""
        return np.column_stack([camera[:, :3] @ self.axes, camera @ np.append(self.origin_m, 1.0)])

    @classmethod
    def of(cls, cameras: list[FloatArray], lines: list[ViewLine], length_m: float, viewer: FloatArray) -> "Reference":
        """Returns the frame of the base by the lines of the first instant, without an estimate of its error.

        x is along the base tangent, z points to the camera of the first view.

        Args:
            cameras: (3, 4) projections of the views that show a line.
            lines: their lines.
            length_m: length of shaft and tip.
            viewer: (3,) direction to the camera of the session's first view.
        """
        first = lines[0]
        base = _meeting_point(cameras[:1], [first.points[0]])[0]
        if len(lines) > 1:  # the two lines may begin at different points: find the one that fits the first line's base
            points = [_meeting_point(cameras[:2], [first.points[0], point]) for point in lines[1].points]
            base = min(points, key=lambda each: each[1])[0]
        # the base tangent is in the plane through each camera and its line: the planes' intersection
        planes = [_plane_through(camera, line, base) for camera, line in zip(cameras, lines, strict=True)]
        along = np.cross(planes[0], viewer)
        if len(planes) > 1:
            intersection = np.cross(planes[0], planes[1])
            if np.linalg.norm(intersection) > _LEAST_SINE:
                along = intersection
        along /= np.linalg.norm(along)
        if (_gradients(cameras[0], base) @ along) @ first.tangents[0] < 0.0:
            along = -along
        across = np.cross(viewer, along)
        across /= np.linalg.norm(across)
        # a line that is shorter than the shaft begins in front of the clamp
        missing_m = length_m - first.length_px / scale_at(cameras[0], base)
        back_m = max(-_MOST_BACK * length_m, min(_MOST_BACK * length_m, missing_m))
        return cls(base - back_m * along, np.column_stack([along, across, np.cross(along, across)]))


def _plane_through(camera: FloatArray, line: ViewLine, point_m: FloatArray) -> FloatArray:
    """Returns the unit normal (3,) of the plane through the camera and the line's first piece."""
    tangent = line.tangents[:3].mean(axis=0)
    normal = np.array([-tangent[1], tangent[0]]) @ _gradients(camera, point_m)
    return normal / np.linalg.norm(normal)


def turns(angles_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns rotations about x, then y, then z, of the fixed axes, and their derivatives by the angles.

    Args:
        angles_rad: (count, 3) angles about x, y and z.

    Returns:
        (count, 3, 3) rotations, and (count, 3, 3, 3) derivatives, the angle first.
    """
    count = len(angles_rad)
    parts, slopes = np.zeros((3, count, 3, 3)), np.zeros((3, count, 3, 3))  # about each axis, and derivatives
    cosine, sine = np.cos(angles_rad), np.sin(angles_rad)
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3  # the axes of the plane that is turned
        parts[axis, :, axis, axis] = 1.0
        parts[axis, :, i, i] = parts[axis, :, j, j] = cosine[:, axis]
        parts[axis, :, j, i], parts[axis, :, i, j] = sine[:, axis], -sine[:, axis]
        slopes[axis, :, i, i] = slopes[axis, :, j, j] = -sine[:, axis]
        slopes[axis, :, j, i], slopes[axis, :, i, j] = cosine[:, axis], -cosine[:, axis]
    x, y, z = parts
    whole = z @ y @ x
    derivatives = np.stack([z @ y @ slopes[0], z @ slopes[1] @ x, slopes[2] @ y @ x], axis=1)
    return whole, derivatives


def scale_at(camera: FloatArray, point_m: FloatArray) -> float:
    """Returns the pixels per metre of a view at a point (3,)."""
    return float(np.linalg.norm(_gradients(camera, point_m), axis=1).mean())


def base_axes_px(camera: FloatArray, turn: FloatArray) -> FloatArray:
    """Returns the directions (3, 2) of the base frame's axes in an image; an axis parallel to it has the length 1.

    Args:
        camera: (3, 4) projection from the reference frame to pixels.
        turn: (3, 3) of the base in the reference frame.
    """
    along = _gradients(camera, np.zeros(3))
    return np.asarray((along @ turn).T / np.linalg.norm(along, axis=1).mean(), np.float64)
