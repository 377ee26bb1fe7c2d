"""The smooth centreline through a rod's nodes."""

from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from ...mechanics import SpatialRod
from ...types import FloatArray

__all__ = ["smooth_lines"]


@lru_cache(maxsize=16)
def _weights(segments: int, flexible_m: float, length_m: float, points: int) -> tuple[FloatArray, FloatArray]:
    """(points, segments + 3): of the shaft's nodes and its end slopes; (points,): way beyond the shaft's end."""
    arc = np.linspace(0.0, flexible_m, segments + 1)
    unit = np.eye(segments + 3)
    spline = CubicSpline(arc, unit[: segments + 1], bc_type=((1, unit[-2]), (1, unit[-1])))  # pyright: ignore[reportArgumentType]
    wanted = np.linspace(0.0, length_m, points)
    return spline(np.minimum(wanted, flexible_m)), np.maximum(wanted - flexible_m, 0.0)


def smooth_lines(
    rod: SpatialRod, quaternions: FloatArray, points: int, advance_m: float | FloatArray = 0.0
) -> FloatArray:
    """(k, segments + 1, 4) -> (k, points, 3): base to tip, uniform in arc length, base frame.

    ``advance_m`` (k,): how far the clamp has moved along x.

    A cubic spline through the ends of the shaft's segments, tangent to clamp and electrode, then the straight
    electrode: the corners of a polyline with segments of a millimetre would lie 0.01 px beside it.
    """
    nodes = rod.nodes_m(quaternions, advance_m)
    axis = (nodes[:, -1:] - nodes[:, -2:-1]) / rod.rigid_length_m
    clamp = np.tile([1.0, 0.0, 0.0], (len(nodes), 1, 1))
    weights, beyond = _weights(rod.segments, rod.flexible_length_m, rod.length_m, points)
    return weights @ np.concatenate([nodes[:, :-1], clamp, axis], axis=1) + beyond[:, None] * axis
