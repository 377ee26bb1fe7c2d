"""The statements of the contact network about one image."""

import math
from dataclasses import dataclass

from ...types import FloatArray

DEPTH_M = 0.5e-3
"""Depths are stated as ``asinh(depth / DEPTH_M)``: their error grows with the depth."""
TOUCHED_LOGIT, CLEAR_LOGIT = 0.80, 0.59
_DEPTH, _DEPTH_STD, _TOWARDS_TIP = 1.31, 0.73, 2.2
"""The training images: log odds of a touched and of a clear tissue against one that is not visible, mean and standard
deviation of the depth, and concentration of the directions about the one along the tip's axis. Where the network sees
nothing it gives these, which are no measurement."""
_LARGEST_LOGIT = 20.0
_NO_DEPTH_STD, _LEAST_INFORMATION = 10.0, 0.1
_LEAST_LOG_STD, _LARGEST_LOG_STD = -4.0, 3.0


@dataclass(frozen=True, slots=True)
class ContactReading:
    """The geometry of the contact at the tip.

    Attributes:
        touched: likelihood of the image if the tip touches a tissue that is visible in this session, over that if the
            tissue of this session is never visible.
        clear: the same if the tip does not touch it.
        depth: ``asinh(d / DEPTH_M)`` of the depth d to which the tip presses into the tissue, if it touches.
        depth_std: its standard deviation.
        turn_rad: direction of the tissue's force, counted from the tip's axis, in the image from u towards v.
        strength: concentration of the von Mises distribution of this direction; 0: nothing is known of it.
    """

    touched: float
    clear: float
    depth: float
    depth_std: float
    turn_rad: float
    strength: float

    @classmethod
    def of(cls, outputs: FloatArray) -> "ContactReading":
        """Returns the image's own statement: the network's outputs without the distribution of its training images.

        Args:
            outputs: (7,) logits of a touched, a clear and an invisible tissue; mean and logarithm of the standard
                deviation of the depth; a vector (2,) along the direction, whose length is the concentration.
        """
        touched, clear, unseen, depth, log_std, x, y = (float(each) for each in outputs)
        touched, clear, x = touched - unseen - TOUCHED_LOGIT, clear - unseen - CLEAR_LOGIT, x + _TOWARDS_TIP
        information = math.exp(-2.0 * min(_LARGEST_LOG_STD, max(_LEAST_LOG_STD, log_std)))
        own = information - _DEPTH_STD**-2
        if own < _LEAST_INFORMATION:
            information, own = _DEPTH_STD**-2 + _NO_DEPTH_STD**-2, _NO_DEPTH_STD**-2
            depth = _DEPTH
        return cls(
            math.exp(max(-_LARGEST_LOGIT, min(_LARGEST_LOGIT, touched))),
            math.exp(max(-_LARGEST_LOGIT, min(_LARGEST_LOGIT, clear))),
            (information * depth - _DEPTH / _DEPTH_STD**2) / own,
            own**-0.5,
            math.atan2(y, x),
            math.hypot(x, y),
        )
