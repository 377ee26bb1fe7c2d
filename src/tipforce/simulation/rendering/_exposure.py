"""Motion during one exposure, and the content of its image: common to camera and fluoroscope."""

import math
from dataclasses import dataclass

import numpy as np

from ...types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TissueState:
    """Position of the tissue during an exposure.

    Attributes:
        shift_m: (m, 3) way from home at instants evenly spread over the exposure.
        indentation_m: depth to which the tip sinks in.
        touch_m: (3,) point of contact; None: no contact.
    """

    shift_m: FloatArray
    indentation_m: float = 0.0
    touch_m: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TissueHome:
    """Position of the tissue at rest.

    Attributes:
        surface_m: (3,) a point of the surface without indentation.
        into: (3,) unit vector into the tissue.
    """

    surface_m: FloatArray
    into: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ImageTruth:
    """The visible catheter at mid-exposure.

    Attributes:
        mask: (h, w) pixels of which the catheter covers more than half while nothing covers the catheter.
        centreline_px: (n, 2) axis, projected through the lens, at the shape's own nodes, base to the tip's apex; pixel
            centres at integers. The middle between the two outlines is within 0.005 px of it (perspective shows a
            little more of the tube's far side).
        visible: (n,) whether a node is in the image with nothing in front.
        visible_share: share of the length that is visible.
    """

    mask: BoolArray
    centreline_px: FloatArray
    visible: BoolArray
    visible_share: float


def sample_exposure(shapes: FloatArray, count: int) -> FloatArray:
    """Interpolates the moving shape at ``count`` instants of one exposure, whose mean image has the blur of the camera.

    The instants are evenly spaced about mid-exposure, and their variance in time is that of the whole exposure. With
    the middles of equal parts it would be smaller, and the image sharper than that of a camera.

    Args:
        shapes: (m, n, 3) positions of n points in metres at m evenly spaced instants, from the start of the exposure to
            its end.
        count: number of instants; 1: mid-exposure.

    Returns:
        (count, n, 3) positions in metres, linear between the given ones.
    """
    m = shapes.shape[0]
    if m == 1:
        return shapes if count == 1 else shapes.repeat(count, axis=0)
    # Instants of this spacing, in exposures, have the variance 1/12 of a whole exposure.
    spacing = 0.0 if count == 1 else 1.0 / math.sqrt(count**2 - 1)
    position = (0.5 + (np.arange(count) - 0.5 * (count - 1)) * spacing) * (m - 1)
    low = np.minimum(position.astype(int), m - 2)
    share = (position - low)[:, None, None]
    return shapes[low] * (1.0 - share) + shapes[low + 1] * share
