"""The statements of the contact network about one image."""

import math
from dataclasses import dataclass

from ...types import FloatArray

DEPTH_M = 0.5e-3
"""Depths are stated as ``asinh(depth / DEPTH_M)``: their error grows with the depth."""
_LEAST_LOG_STD, _LARGEST_LOG_STD = -4.0, 3.0


@dataclass(frozen=True, slots=True)
class ContactReading:
    """The geometry of the contact at the tip.

    Attributes:
        contact: probability that the tip touches a tissue, 0 to 1.
        depth: ``asinh(d / DEPTH_M)`` of the depth d to which the tip presses into the tissue, if it touches.
        depth_std: its standard deviation.
        turn_rad: direction of the tissue's force, counted from the tip's axis, in the image from u towards v.
        strength: concentration of the von Mises distribution of this direction; 0: nothing is known of it.
    """

    contact: float
    depth: float
    depth_std: float
    turn_rad: float
    strength: float

    @classmethod
    def of(cls, outputs: FloatArray) -> "ContactReading":
        """Returns the reading from the network's outputs.

        Args:
            outputs: (5,) logit of contact; mean and logarithm of the standard deviation of the depth; a vector (2,)
                along the direction, whose length is the concentration.
        """
        logit, depth, log_std, x, y = (float(each) for each in outputs)
        return cls(
            1.0 / (1.0 + math.exp(-max(-60.0, min(60.0, logit)))),
            depth,
            math.exp(min(_LARGEST_LOG_STD, max(_LEAST_LOG_STD, log_std))),
            math.atan2(y, x),
            math.hypot(x, y),
        )
