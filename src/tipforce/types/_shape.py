"""Shapes of the catheter: pixel curves and metre curves are different types."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ._arrays import BoolArray, FloatArray, frozen
from ._status import Status

TIP_SHARE = 0.04
"""The last share of the centreline that defines the tip's axis: about the length of an ablation electrode."""


@dataclass(frozen=True, slots=True, eq=False)
class BasePose:
    """Pose of the base frame in the image: thesis fig. 18, O and L.

    Attributes:
        origin_px: (2,) u (right), v (down), px.
        angle_rad: direction of the base tangent in the displayed image, rad counter-clockwise from "right".

    >>> up = BasePose(np.array([100.0, 400.0]), math.pi / 2)
    >>> np.round(up.to_base(np.array([[100.0, 300.0], [90.0, 400.0]])), 6) + 0.0
    array([[100.,   0.],
           [  0.,  10.]])
    """

    origin_px: FloatArray
    angle_rad: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin_px", frozen("origin_px", self.origin_px, (2,)))

    @property
    def axes_px(self) -> FloatArray:
        """(2, 2): rows are the base frame's x and y axes in image coordinates (u, v)."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return np.array([[c, -s], [-s, -c]])

    def to_base(self, points_px: FloatArray) -> FloatArray:
        """Converts (n, 2) image points to the base frame, still in pixels (thesis eq. 1)."""
        return (points_px - self.origin_px) @ self.axes_px.T

    def to_image(self, points_base: FloatArray) -> FloatArray:
        """Converts (n, 2) base-frame points in pixels to image points: the inverse of `to_base`."""
        return points_base @ self.axes_px + self.origin_px


@dataclass(frozen=True, slots=True, eq=False)
class CentrelinePx:
    """A centreline in the image.

    Attributes:
        points: (n, 2) u, v in pixels, base to tip, uniform in arc length; pixel centres at integers.
    """

    points: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen("points", self.points, (None, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class DetectedShape:
    """The catheter's shape in one image, or the reason why it was not found.

    Attributes:
        status: `Status.VALID`, or why there is no shape.
        detail: the reason in one line.
        centreline: the centreline; None unless the status is valid.
        base: pose of the base frame; None unless the status is valid.
        diameter_px: median diameter of the shaft, px.
        confidence: share of the length of the shaft where both flanks were detected, 0 to 1.
        fitted_px: (k, 2) image points to which a polynomial is fitted where these are not the centreline: the
            single-pixel line of thesis algorithm 1, one point a column.
        probability_right: probability that tip and line are where they were detected, 0 to 1; NaN where the method does
            not estimate it.
        seen: (n,) whether the catheter is visible at each point of the centreline, not hidden behind an object; None
            where the method finds visible lines only.
        covariance_px2: (n, 2, 2) covariance of each point of the centreline, px^2; None where it is not estimated.
    """

    status: Status
    detail: str = ""
    centreline: CentrelinePx | None = None
    base: BasePose | None = None
    diameter_px: float = math.nan
    confidence: float = 0.0
    fitted_px: FloatArray | None = None
    probability_right: float = math.nan
    seen: BoolArray | None = None
    covariance_px2: FloatArray | None = None

    @property
    def tip_seen(self) -> bool:
        """Whether the tip is visible; False where nothing was found."""
        return self.found and (self.seen is None or bool(self.seen[-1]))

    @property
    def tip_axis(self) -> FloatArray | None:
        """(2,) unit vector along the tip, base frame: of the last `TIP_SHARE`, since one point is too noisy."""
        if self.centreline is None or self.base is None:
            return None
        points = self.centreline.points
        steps = max(1, round(TIP_SHARE * (len(points) - 1)))
        if len(points) <= steps:
            return None
        along = self.base.axes_px @ (points[-1] - points[-1 - steps])
        length = float(np.linalg.norm(along))
        return along / length if length > 0.0 else None

    @property
    def tip_std_px(self) -> float:
        """Standard deviation of the tip in its least certain direction, px; 0 where it is not estimated."""
        if self.covariance_px2 is None:
            return 0.0
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance_px2[-1])[-1]))

    @property
    def std_along_and_across_px(self) -> tuple[FloatArray, FloatArray] | None:
        """Standard deviations (n,) of the points along the centreline and across it, px; None: not estimated."""
        if self.centreline is None or self.covariance_px2 is None:
            return None
        tangents = np.gradient(self.centreline.points, axis=0)
        tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9)
        along = np.einsum("ni,nij,nj->n", tangents, self.covariance_px2, tangents)  # variances, px^2
        across = np.trace(self.covariance_px2, axis1=1, axis2=2) - along
        # rounding makes a variance of 0 negative
        return np.sqrt(np.maximum(along, 0.0)), np.sqrt(np.maximum(across, 0.0))

    def moved(self, by_px: FloatArray) -> "DetectedShape":
        """Returns the same shape, shifted by (u, v) ``by_px`` in the image."""
        if self.centreline is None or not np.any(by_px):
            return self
        base = self.base and replace(self.base, origin_px=self.base.origin_px + by_px)
        fitted_px = None if self.fitted_px is None else self.fitted_px + by_px
        return replace(self, centreline=CentrelinePx(self.centreline.points + by_px), base=base, fitted_px=fitted_px)

    @property
    def found(self) -> bool:
        """Whether there is a centreline."""
        return self.status is Status.VALID
