"""The force at the tip in the tip's own directions: axial, lateral, and the contact angle."""

import math
from dataclasses import dataclass

import numpy as np

from ...estimators.uncertainty import GAUSS_90
from ...types import DetectedShape, FloatArray, ForceEstimate

TIP_SHARE = 0.04
"""The tip's axis is that of so much of the centreline at its end: about the length of an ablation electrode."""


@dataclass(frozen=True, slots=True)
class TipForce:
    """``axial_n``: along the tip's axis, compression positive; ``lateral_n``: size of the rest, in newtons.

    ``angle_deg``: between the tip's axis and the direction in which the tip presses, the contact angle where friction
    is small: 0 when the tip is perpendicular to the tissue, 90 when it lies along it. ``angle_error_deg``: half of its
    90 % interval to first order; NaN where the covariance is not known.
    """

    axial_n: float
    lateral_n: float
    angle_deg: float
    angle_error_deg: float


def tip_force(estimate: ForceEstimate) -> TipForce | None:
    """Splits a force by the direction of the tip; None where force or direction is not known.

    A component across the image counts as lateral where it is known, for the tip is seen in the image's plane alone.

    Args:
        estimate: of one instant; its ``shape`` tells the direction.
    """
    shape = estimate.shape
    if not (estimate.valid and estimate.known[:2].all() and shape is not None and shape.found):
        return None
    axis = _tip_axis(shape)
    if axis is None:
        return None
    force = np.where(estimate.known, estimate.force_n, 0.0)
    size = float(np.linalg.norm(force))
    axial = float(-force @ axis)
    across = force + axial * axis
    lateral = float(np.linalg.norm(across))
    return TipForce(
        axial_n=axial,
        lateral_n=lateral,
        angle_deg=math.degrees(math.atan2(lateral, axial)) if size > 0.0 else math.nan,
        angle_error_deg=_angle_error_deg(estimate, axis, across, size),
    )


def _tip_axis(shape: DetectedShape) -> FloatArray | None:
    """(3,) unit vector from base to tip at the tip, base frame."""
    assert shape.centreline is not None
    assert shape.base is not None
    points = shape.centreline.points
    back = max(1, round(TIP_SHARE * (len(points) - 1)))
    if len(points) <= back:
        return None
    along = shape.base.axes_px @ (points[-1] - points[-1 - back])
    length = float(np.linalg.norm(along))
    return np.append(along, 0.0) / length if length > 0.0 else None


def _angle_error_deg(estimate: ForceEstimate, axis: FloatArray, across: FloatArray, size: float) -> float:
    """From the covariance of the component that turns the force within the plane of tip and force."""
    lateral = float(np.linalg.norm(across))
    sideways = across / lateral if lateral > 1e-9 * size else np.array([-axis[1], axis[0], 0.0])
    force = np.where(estimate.known, estimate.force_n, 0.0)
    turning = -float(force @ axis) * sideways + lateral * axis
    if not size > 0.0:
        return math.nan
    known = estimate.known
    turning = turning[known] / size
    variance = float(turning @ estimate.covariance_n2[np.ix_(known, known)] @ turning)
    return math.degrees(GAUSS_90 * math.sqrt(max(0.0, variance)) / size) if math.isfinite(variance) else math.nan
