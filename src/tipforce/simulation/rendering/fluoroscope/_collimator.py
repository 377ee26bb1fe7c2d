"""The collimator: blades, the round field of an image intensifier, and a wedge filter, as attenuation."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from ....types import BoolArray
from ._variety import Collimator

FloatImage = npt.NDArray[np.float32]
_LEAD = 6.0
"""Attenuation of a blade; scatter and glare are brighter than the light that passes."""


def collimator_attenuation(collimator: Collimator, penumbra_px: float, height: int, width: int) -> FloatImage:
    """Returns the attenuation (h, w) by blades, the border of a round field, and the wedge.

    Args:
        collimator: the collimator.
        penumbra_px: sigma of the blades' shadow.
        height: height of the image in px.
        width: width of the image in px.

    Returns:
        The attenuation.
    """
    total = _LEAD * cv2.GaussianBlur(_closed(collimator, height, width), (0, 0), max(penumbra_px, 0.3))
    if collimator.wedge:
        v, u = np.mgrid[0:height, 0:width].astype(np.float32)
        turn = math.radians(collimator.wedge_turn_deg)
        along = ((u / width - 0.5) * math.cos(turn) + (v / height - 0.5) * math.sin(turn)).astype(np.float32)
        total += collimator.wedge * np.clip((along - collimator.wedge_inset) / collimator.wedge_soft, 0.0, 1.0)
    return np.asarray(total, np.float32)


def open_field(collimator: Collimator, height: int, width: int) -> BoolArray:
    """Returns the pixels (h, w) that no blade covers.

    Args:
        collimator: the collimator.
        height: height of the image in px.
        width: width of the image in px.

    Returns:
        The pixels.
    """
    return _closed(collimator, height, width) < 0.5


def _closed(collimator: Collimator, height: int, width: int) -> FloatImage:
    """Returns the share (h, w) of each pixel that the blades and the border of a round field cover."""
    middle_px, size = np.array([0.5 * (width - 1), 0.5 * (height - 1)]), np.array([width, height], np.float64)
    open_255 = np.full((height, width), 255, np.uint8)
    left, right, top, bottom = collimator.inset
    if any(collimator.inset):
        # a blade that is not in view is far beyond the border, so that its turned edge stays out
        low = np.where(np.array([left, top]) > 0, np.array([left, top]) - 0.5, -1.0)
        high = np.where(np.array([right, bottom]) > 0, 0.5 - np.array([right, bottom]), 1.0)
        corners = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]) * size
        turn = math.radians(collimator.turn_deg)
        turned = corners @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        open_255[:] = 0
        # OpenCV takes corners in sixteenths of a pixel (4 bits).
        cv2.fillConvexPoly(open_255, np.round(16 * (turned + middle_px)).astype(np.int32), 255, cv2.LINE_AA, 4)
    if collimator.circle:
        disc = np.zeros_like(open_255)
        centre = (round(16 * middle_px[0]), round(16 * middle_px[1]))
        cv2.circle(disc, centre, round(16 * collimator.circle * width), 255, -1, cv2.LINE_AA, 4)
        open_255 = np.minimum(open_255, disc)
    return np.asarray(1.0 - open_255.astype(np.float32) / 255.0, np.float32)
