"""The catheter's line as few points that a person drags, and as the smooth curve through them.

The page draws the same curve: ``page/spline.js``.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from ..geometry import resampled
from ..types import FloatArray

LINE_POINTS = 64
"""Points of a line that is passed to the training."""
MAX_DEVIATION_PX = 1.0
"""Largest distance between a detected line and the curve through the few points that replace it, px."""
MIN_HANDLES, MAX_HANDLES = 4, 12
_DENSE = 400


def curve_through(points_px: FloatArray, count: int = LINE_POINTS) -> FloatArray:
    """Returns points on the natural cubic spline through ``points_px``, uniform in arc length.

    The parameter of the spline grows with the square root of each chord (centripetal), so the curve has no loop between
    points that are close to each other.

    Args:
        points_px: (k, 2) points in order, k >= 2; neighbours differ.
        count: number of points that are returned.

    Returns:
        (count, 2) points; the first and the last are those of ``points_px``.

    >>> curve_through(np.array([[0.0, 0.0], [8.0, 0.0]]), 3).tolist()
    [[0.0, 0.0], [4.0, 0.0], [8.0, 0.0]]
    """
    points = np.asarray(points_px, np.float64)
    if len(points) == 2:
        return resampled(points, count)
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(np.linalg.norm(np.diff(points, axis=0), axis=1)))])
    dense = CubicSpline(knots, points, bc_type="natural")(np.linspace(0.0, knots[-1], _DENSE))
    return resampled(dense, count)


def handles_of(line_px: FloatArray) -> FloatArray:
    """Returns as few points of a line as suffice: the curve through them is within `MAX_DEVIATION_PX` of the line.

    Args:
        line_px: (n, 2) points of a line, n >= 2.

    Returns:
        (k, 2) points, `MIN_HANDLES` to `MAX_HANDLES` of them; the first and the last are those of the line.
    """
    line = resampled(np.asarray(line_px, np.float64), 4 * LINE_POINTS)
    for count in range(MIN_HANDLES, MAX_HANDLES):
        handles = resampled(line, count)
        if float(np.linalg.norm(curve_through(handles, len(line)) - line, axis=1).max()) <= MAX_DEVIATION_PX:
            return handles
    return resampled(line, MAX_HANDLES)


def line_distance_px(line_px: FloatArray, other_px: FloatArray) -> float:
    """Returns the median distance of the points of one line to those of another with as many points, px."""
    return float(np.median(np.linalg.norm(line_px - other_px, axis=1)))
