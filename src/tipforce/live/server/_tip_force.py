"""The force at the tip along and across the tip: axial, lateral, and the contact angle."""

import math
from dataclasses import dataclass

import numpy as np

from ...estimators.uncertainty import GAUSS_90
from ...types import FloatArray, ForceEstimate


@dataclass(frozen=True, slots=True)
class TipForce:
    """Force at the tip, split by the direction of the tip.

    Attributes:
        axial_n: along the tip's axis, compression positive.
        lateral_n: magnitude of the rest.
        angle_deg: angle between the tip's axis and the direction in which the tip presses. It is the contact angle if
            friction is small: 0 if the tip is perpendicular to the tissue, 90 if it is parallel to it.
        angle_error_deg: half of the angle's 90 % interval, to first order; NaN if the covariance is not known.
    """

    axial_n: float
    lateral_n: float
    angle_deg: float
    angle_error_deg: float


def tip_force(estimate: ForceEstimate) -> TipForce | None:
    """Splits a force by the direction of the tip; returns None if force or direction is not known.

    Where only the detected shape states the direction of the tip, a known component perpendicular to the image counts
    as lateral.

    Args:
        estimate: an estimate with the direction of the tip, in space or by its detected ``shape``.
    """
    if not (estimate.valid and estimate.known[:2].all()):
        return None
    axis = estimate.tip_axis
    if axis is None and estimate.shape is not None and estimate.shape.tip_axis is not None:
        axis = np.append(estimate.shape.tip_axis, 0.0)
    if axis is None:
        return None
    force = np.where(estimate.known, estimate.force_n, 0.0)
    size = float(np.linalg.norm(force))
    axial = float(-force @ axis)  # the tissue pushes against the tip's direction: compression is positive
    across = force + axial * axis  # the rest, perpendicular to the tip
    lateral = float(np.linalg.norm(across))
    return TipForce(
        axial_n=axial,
        lateral_n=lateral,
        angle_deg=math.degrees(math.atan2(lateral, axial)) if size > 0.0 else math.nan,
        angle_error_deg=_angle_error_deg(estimate, axis, across, size),
    )


def _angle_error_deg(estimate: ForceEstimate, axis: FloatArray, across: FloatArray, size: float) -> float:
    """Returns half of the 90 % interval of the angle between tip and force, in degrees, to first order.

    A small change of the force turns it by the change's component perpendicular to the force, in the plane of tip and
    force, over the magnitude of the force. The covariance gives the standard deviation of that component.

    Args:
        estimate: the estimate, with the covariance of its known components.
        axis: (3,) unit vector along the tip, base frame.
        across: (3,) part of the force across the tip, in newtons.
        size: magnitude of the force in newtons.

    Returns:
        The error; NaN without a force or without a covariance.
    """
    if not size > 0.0:
        return math.nan
    lateral = float(np.linalg.norm(across))
    # an axial force has no lateral direction: one in the image plane is taken
    sideways = across / lateral if lateral > 1e-9 * size else np.array([-axis[1], axis[0], 0.0])
    known = estimate.known
    force = np.where(known, estimate.force_n, 0.0)
    turning = (-float(force @ axis) * sideways + lateral * axis)[known] / size  # unit vector perpendicular to the force
    variance = float(turning @ estimate.covariance_n2[np.ix_(known, known)] @ turning)
    return math.degrees(GAUSS_90 * math.sqrt(max(0.0, variance)) / size) if math.isfinite(variance) else math.nan
