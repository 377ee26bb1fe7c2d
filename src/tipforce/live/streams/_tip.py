"""Pose of the tip in the base frame, in millimetres, for programs that draw it."""

from dataclasses import dataclass

import numpy as np

from ...types import FloatArray, SessionInfo
from .._update import LiveUpdate


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
    axis = shape.tip_axis
    if axis is None:
        return None
    x_mm, y_mm = (shape.base.to_base(shape.centreline.points[-1]) * view.metres_per_px * 1e3).tolist()
    cosine, sine = axis.tolist()
    return TipPose((x_mm, y_mm), (cosine, sine))
