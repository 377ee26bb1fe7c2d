"""From a detected shape to the line that the rod is fitted to: metres, the base on the left, y up."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...mechanics.planar import Line
from ...types import BoolArray, CentrelinePx, DetectedShape, FloatArray
from ...vision import INWARD

POINTS = 22
"""Points of the line: one about every ten pixels of a shaft; neighbours' errors are correlated over 14."""


@njit(cache=True, nogil=True)
def _line(
    points_px: FloatArray, scale: float, c: float, s: float, u0: float, v0: float, advance_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Samples a centreline (n, 2) at `POINTS` points and changes it from pixels to metres, in the frame of the clamp.

    (``c``, ``s``): cosine and sine of the turn of the inward direction to x; (``u0``, ``v0``): the origin, px;
    ``scale``: metres per pixel. The origin moves with the clamp, which has advanced by ``advance_m``.

    Returns:
        (POINTS, 2) points, m; (POINTS, 2) unit normals to the left; (POINTS,) arc lengths from the tip, m.
    """
    n = points_px.shape[0]
    arc_px = np.zeros(n)
    for i in range(1, n):
        du, dv = points_px[i, 0] - points_px[i - 1, 0], points_px[i, 1] - points_px[i - 1, 1]
        arc_px[i] = arc_px[i - 1] + math.hypot(du, dv)
    points, normals, from_tip = np.empty((POINTS, 2)), np.empty((POINTS, 2)), np.empty(POINTS)
    for k in range(POINTS):
        i = round(k * (n - 1) / (POINTS - 1))
        u, v = points_px[i, 0] - u0, points_px[i, 1] - v0
        before, after = max(i - 1, 0), min(i + 1, n - 1)
        du, dv = points_px[after, 0] - points_px[before, 0], points_px[after, 1] - points_px[before, 1]
        if i == 0:  # at the ends: one-sided differences of second order
            du = 4.0 * points_px[1, 0] - 3.0 * points_px[0, 0] - points_px[2, 0]
            dv = 4.0 * points_px[1, 1] - 3.0 * points_px[0, 1] - points_px[2, 1]
        elif i == n - 1:
            du = 3.0 * points_px[i, 0] - 4.0 * points_px[i - 1, 0] + points_px[i - 2, 0]
            dv = 3.0 * points_px[i, 1] - 4.0 * points_px[i - 1, 1] + points_px[i - 2, 1]
        size = math.hypot(du, dv)
        points[k, 0], points[k, 1] = scale * (c * u - s * v) - advance_m, scale * (-s * u - c * v)  # v points down
        tangent_x, tangent_y = (c * du - s * dv) / size, (-s * du - c * dv) / size
        normals[k, 0], normals[k, 1] = -tangent_y, tangent_x
        from_tip[k] = scale * (arc_px[n - 1] - arc_px[i])
    return points, normals, from_tip


_NO_PAST = np.zeros(2)


@dataclass(frozen=True, slots=True, eq=False)
class StatedErrors:
    """Vision's statements about one line: its seen part, and the error of each point.

    Attributes:
        std_px: (`POINTS` + 1,) standard deviation of each point across the line, then of the tip along it, px.
        seen: (`POINTS` + 1,) whether each of them is measured: the point is visible; last, the tip is.
    """

    std_px: FloatArray
    seen: BoolArray

    @property
    def rows(self) -> int:
        """Number of measurements."""
        return int(self.seen.sum())

    @classmethod
    def of(cls, shape: DetectedShape) -> "StatedErrors | None":
        """Returns vision's statements about a detected shape, at the `POINTS` points that `LineFrame.line` takes.

        None where vision states neither errors nor hidden points; then every point is seen.
        """
        if shape.centreline is None or (shape.seen is None and shape.covariance_px2 is None):
            return None
        count = len(shape.centreline.points)
        sampled = np.rint(np.linspace(0.0, count - 1.0, POINTS)).astype(np.int64)
        seen = np.ones(count, np.bool_) if shape.seen is None else shape.seen
        std_px = np.zeros(POINTS + 1)
        if shape.std_along_and_across_px is not None:
            along, across = shape.std_along_and_across_px
            std_px[:-1], std_px[-1] = across[sampled], along[-1]
        return cls(std_px, np.append(seen[sampled], shape.tip_seen))


class LineFrame:
    """The frame of a session's lines: x points inward from the image's border that the shaft comes from.

    The origin goes with the clamp where that is advanced.

    Args:
        size_px: width and height of the image.
        base_side: border that the shaft comes from.
        scale_m_per_px: nominal scale.
        origin_px: (2,) u, v of the origin; None: the middle of that border.
    """

    def __init__(
        self, size_px: tuple[int, int], base_side: str, scale_m_per_px: float, origin_px: FloatArray | None = None
    ) -> None:
        width, height = size_px
        self.key = (size_px, base_side, scale_m_per_px)
        self.scale_m_per_px = scale_m_per_px
        self._c, down = INWARD[base_side]  # cosine and sine of the direction inward; v points down
        self._s = -down
        middle_u, middle_v = 0.5 * (width - 1), 0.5 * (height - 1)
        half_px = 0.5 * (width if self._c else height)  # from the middle of the image to the border
        self._u, self._v = middle_u - half_px * self._c, middle_v + half_px * self._s
        if origin_px is not None:
            self._u, self._v = origin_px.tolist()
        u, v = middle_u - self._u, middle_v - self._v
        self._middle_m = scale_m_per_px * np.array([self._c * u - self._s * v, -self._s * u - self._c * v])

    def line(self, centreline: CentrelinePx, advance_m: float = 0.0, *, from_clamp: bool = False) -> Line:
        """Returns a centreline as the line in metres to which the rod is fitted.

        Args:
            centreline: at least three points, base to tip.
            advance_m: advance of the clamp along x.
            from_clamp: see `Line`.
        """
        points, normals, from_tip = _line(
            centreline.points, self.scale_m_per_px, self._c, self._s, self._u, self._v, advance_m
        )
        middle = self._middle_m - (advance_m, 0.0)
        return Line(points, normals, from_tip, middle, _NO_PAST, from_clamp)
