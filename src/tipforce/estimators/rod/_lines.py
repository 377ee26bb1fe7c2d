"""From a detected shape to the line that the rod is fitted to: metres, the base on the left, y up."""

import math

import numpy as np
from numba import njit

from ...mechanics.planar import Line
from ...types import CentrelinePx, FloatArray
from ...vision import INWARD

POINTS = 22
"""Points of the line: one about every ten pixels of a shaft; neighbours' errors are correlated over 14."""


@njit(cache=True, nogil=True)
def _line(
    points_px: FloatArray, scale: float, c: float, s: float, u0: float, v0: float, advance_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    n = points_px.shape[0]
    arc = np.zeros(n)
    for i in range(1, n):
        arc[i] = arc[i - 1] + math.hypot(points_px[i, 0] - points_px[i - 1, 0], points_px[i, 1] - points_px[i - 1, 1])
    points, normals, from_tip = np.empty((POINTS, 2)), np.empty((POINTS, 2)), np.empty(POINTS)
    for k in range(POINTS):
        i = round(k * (n - 1) / (POINTS - 1))
        u, v = points_px[i, 0] - u0, points_px[i, 1] - v0
        before, after = max(i - 1, 0), min(i + 1, n - 1)
        du, dv = points_px[after, 0] - points_px[before, 0], points_px[after, 1] - points_px[before, 1]
        if i == 0:  # one-sided, second order
            du = 4.0 * points_px[1, 0] - 3.0 * points_px[0, 0] - points_px[2, 0]
            dv = 4.0 * points_px[1, 1] - 3.0 * points_px[0, 1] - points_px[2, 1]
        elif i == n - 1:
            du = 3.0 * points_px[i, 0] - 4.0 * points_px[i - 1, 0] + points_px[i - 2, 0]
            dv = 3.0 * points_px[i, 1] - 4.0 * points_px[i - 1, 1] + points_px[i - 2, 1]
        size = math.hypot(du, dv)
        points[k, 0], points[k, 1] = scale * (c * u - s * v) - advance_m, scale * (-s * u - c * v)
        tx, ty = (c * du - s * dv) / size, (-s * du - c * dv) / size
        normals[k, 0], normals[k, 1] = -ty, tx
        from_tip[k] = scale * (arc[n - 1] - arc[i])
    return points, normals, from_tip


_NO_PAST = np.zeros(2)


class LineFrame:
    """The frame of a session's lines: origin in the middle of the image's border that the shaft comes from, x inward.

    The origin goes with the clamp where that is advanced.

    ``size_px``: width and height; ``base_side``: of the detection; ``scale_m_per_px``: nominal.
    """

    def __init__(self, size_px: tuple[int, int], base_side: str, scale_m_per_px: float) -> None:
        width, height = size_px
        self.key = (size_px, base_side, scale_m_per_px)
        self.scale_m_per_px = scale_m_per_px
        self._c, down = INWARD[base_side]
        self._s = -down
        middle_u, middle_v = 0.5 * (width - 1), 0.5 * (height - 1)
        reach = 0.5 * (width if self._c else height)
        self._u, self._v = middle_u - reach * self._c, middle_v + reach * self._s
        self._middle_m = scale_m_per_px * reach

    def line(self, centreline: CentrelinePx, advance_m: float = 0.0) -> Line:
        """Returns the line of at least three points, base to tip. ``advance_m``: of the clamp, along x."""
        points, normals, from_tip = _line(
            centreline.points, self.scale_m_per_px, self._c, self._s, self._u, self._v, advance_m
        )
        return Line(points, normals, from_tip, np.array([self._middle_m - advance_m, 0.0]), _NO_PAST)
