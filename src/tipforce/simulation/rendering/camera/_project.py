"""From the axis in space to the nodes that are drawn: resampling, outlines through the lens, blur by depth."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline

from ....geometry import CameraModel
from ....types import FloatArray
from ._tube import PLACE

__all__ = ["Focus", "TubeNodes", "instants", "project_tube"]

_STRETCH_M = 1.2e-3
"""About this far apart lie the nodes: 6 px at 0.2 mm/px."""


@dataclass(frozen=True, slots=True)
class Focus:
    """Blur of a point by its depth: sigma^2 = ``sharp_px``^2 + (``px_per_m`` (depth - ``depth_m``))^2.

    ``depth_m``: distance from the camera, along its axis, of what is sharpest.
    """

    sharp_px: float
    depth_m: float
    px_per_m: float

    def sigma_px(self, depth_m: float) -> float:
        """Standard deviation of the blur at ``depth_m`` from the camera."""
        return math.hypot(self.sharp_px, self.px_per_m * (depth_m - self.depth_m))


@dataclass(frozen=True, slots=True, eq=False)
class TubeNodes:
    """``nodes`` (instants, n, 8), see `PLACE`; arc length at the first of them and between two of them, metres."""

    nodes: FloatArray
    start_m: float
    step_m: float


@lru_cache(maxsize=64)
def _operators(count: int, at: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Matrices (m, count): values and slopes at the places ``at`` (in steps) of the spline through ``count`` nodes."""
    spline = CubicSpline(np.arange(count), np.eye(count))
    return spline(np.array(at)), spline(np.array(at), 1)


def instants(shapes: FloatArray, count: int) -> FloatArray:
    """(m, n, 3) shapes evenly spread over the exposure, first at its start, last at its end -> (count, n, 3).

    Evenly spread about mid-exposure with the variance of the exposure itself, linear between the given ones. The
    middles of equal parts would have less: their mean would be sharper than what the camera sees.
    """
    m = shapes.shape[0]
    if m == 1:
        return shapes if count == 1 else shapes.repeat(count, axis=0)
    spread = 0.0 if count == 1 else 1.0 / math.sqrt(count**2 - 1)
    at = (0.5 + (np.arange(count) - 0.5 * (count - 1)) * spread) * (m - 1)
    low = np.minimum(at.astype(int), m - 2)
    share = (at - low)[:, None, None]
    return shapes[low] * (1.0 - share) + shapes[low + 1] * share


@njit(cache=True, error_model="numpy", nogil=True)
def _sides(points: FloatArray, slopes_3d: FloatArray, position: FloatArray, radius: float, sides: FloatArray) -> None:
    """Points of the tube where its outline is seen from ``position``: (m, 3) axis and its slopes -> (2, m, 3).

    There the line of sight touches: normal . (point - position + radius normal) = 0, normal across the axis.
    """
    for i in range(points.shape[0]):
        tx, ty, tz = slopes_3d[i, 0], slopes_3d[i, 1], slopes_3d[i, 2]
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
        tx, ty, tz = tx / size, ty / size, tz / size
        x, y, z = points[i, 0] - position[0], points[i, 1] - position[1], points[i, 2] - position[2]
        along = x * tx + y * ty + z * tz
        x, y, z = x - along * tx, y - along * ty, z - along * tz
        far = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / far, y / far, z / far
        nx, ny, nz = ty * z - tz * y, tz * x - tx * z, tx * y - ty * x
        back = -radius * radius / far
        side = radius * math.sqrt(1.0 - (radius / far) ** 2)
        for k in range(2):
            sign = side if k else -side
            sides[k, i, 0] = points[i, 0] + back * x + sign * nx
            sides[k, i, 1] = points[i, 1] + back * y + sign * ny
            sides[k, i, 2] = points[i, 2] + back * z + sign * nz


def project_tube(
    shapes: FloatArray, length_m: float, radius_m: float, behind_m: float, camera: CameraModel, focus: Focus
) -> TubeNodes:
    """Nodes of a tube whose axis has ``shapes`` (instants, n, 3), base to the tip's apex, uniform in arc length.

    The tube goes on straight for ``behind_m`` behind the base; it ends in a dome. What is called the axis in the
    picture is the middle between its two outlines; the projected axis lies within 0.005 px of it.
    """
    count, n = shapes.shape[:2]
    stretches = max(4, math.ceil((length_m - radius_m) / _STRETCH_M))
    step = (length_m - radius_m) / stretches
    place = tuple(float(x) for x in np.arange(stretches + 1) * step / length_m * (n - 1))
    values, rises = _operators(n, place)
    points = np.empty((count, stretches + 2, 3))
    rising = np.empty_like(points)
    points[:, 1:] = values @ shapes
    rising[:, 1:] = (rises * ((n - 1) * step / length_m)) @ shapes
    rising[:, 0] = rising[:, 1]
    points[:, 0] = points[:, 1] - rising[:, 1] * (behind_m / step)
    points, rising = points.reshape(-1, 3), rising.reshape(-1, 3)
    sides = np.empty((2, len(points), 3))
    _sides(points, rising, camera.position_m, radius_m, sides)
    outline = camera.project(sides.reshape(-1, 3)).reshape(2, -1, 2)
    _, slopes = camera.project_with_slopes(points)
    nodes = np.empty((len(points), PLACE))
    nodes[:, :2] = 0.5 * (outline[0] + outline[1])
    nodes[:, 4:6] = (slopes @ rising[:, :, None])[:, :, 0]
    nodes[:, 2:4] = nodes[:, 4:6] / np.hypot(nodes[:, 4], nodes[:, 5])[:, None]
    nodes[:, 6] = 0.5 * np.hypot(*(outline[1] - outline[0]).T)
    pose = camera.camera_from_world
    depth = points @ pose.rotation[2] + pose.translation_m[2]
    nodes[:, 7] = np.hypot(focus.sharp_px, focus.px_per_m * (depth - focus.depth_m))
    if not np.isfinite(nodes).all():
        raise ValueError("a tube reaches behind the camera or beyond what its lens can show; is the shape in metres?")
    # The stretch behind the base is longer than the others, but nothing changes along it.
    return TubeNodes(nodes.reshape(count, -1, PLACE), -step, step)
