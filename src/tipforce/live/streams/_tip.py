"""Pose of the tip in the base frame, in millimetres, for programs that draw it."""

from dataclasses import dataclass

import numpy as np

from ...types import FloatArray, SessionInfo
from .._update import LiveUpdate

TIP_SHARE = 0.05
"""The last share of the detected catheter that defines the direction of the tip: one point is too noisy."""


@dataclass(frozen=True, slots=True)
class TipPose:
    """Position and direction of the tip in the base frame.

    Attributes:
        position_mm: x, y of the tip.
        direction: unit vector along the tip.
    """

    position_mm: tuple[float, float]
    direction: tuple[float, float]

    @property
    def matrix(self) -> FloatArray:
        """(4, 4) from the tip's frame to the base frame, in mm; the tip's x axis points along it, z is the base's."""
        (x, y), (cos, sin) = self.position_mm, self.direction
        return np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def tip_pose(update: LiveUpdate, info: SessionInfo) -> TipPose | None:
    """Returns the pose of the tip that ``update`` detected.

    Args:
        update: the update.
        info: session metadata, with the scale of the image.

    Returns:
        None if the estimate is not valid, no shape was detected, or the session does not state the scale of the image;
        also for a projection, whose scale is not constant.
    """
    shape = update.estimate.shape
    if not update.estimate.valid or shape is None or shape.centreline is None or shape.base is None:
        return None
    view = info.view(next(iter(update.reads or update.frames), "camera"))
    if view.metres_per_px is None or view.projection is not None:
        return None
    points = shape.base.to_base(shape.centreline.points)  # (n, 2) px in the base frame
    tip = points[-1]
    along = tip - points[-1 - max(1, round(TIP_SHARE * (len(points) - 1)))]
    length = float(np.hypot(*along))
    if length == 0.0:
        return None
    x_mm, y_mm = (tip * view.metres_per_px * 1e3).tolist()
    cosine, sine = (along / length).tolist()
    return TipPose((x_mm, y_mm), (cosine, sine))
