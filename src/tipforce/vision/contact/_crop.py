"""The part of an image around the tip, turned so that the catheter comes from the left."""

import math

import cv2
import numpy as np

from ...types import FloatArray, Image

SIDE_PX = 112
"""Side of the network's image in pixels."""
PIXEL_M = 0.25e-3
"""Its scale."""
BEHIND_M = 17e-3
"""How far it reaches behind the tip, along the shaft: a soft tissue is pressed in by up to 20 mm."""


def crop_tip(
    image: Image,
    tip_px: FloatArray,
    angle_rad: float,
    metres_per_px: float,
    side_px: int = SIDE_PX,
    pixel_m: float = PIXEL_M,
) -> Image:
    """Returns the grey levels around the tip. Beyond the image its border is repeated.

    Args:
        image: (h, w) or (h, w, 3) uint8.
        tip_px: (2,) position of the tip (u, v).
        angle_rad: direction of the tip's axis in the image, from u towards v.
        metres_per_px: scale of the image.
        side_px: side of the result in pixels.
        pixel_m: scale of the result.

    Returns:
        (side_px, side_px) uint8; the tip's axis points to the right.
    """
    step = pixel_m / metres_per_px
    coarser = max(1, round(step / 1.5))
    reach = 0.75 * side_px * step + 2.0 * coarser
    height, width = image.shape[:2]
    left, top = (max(0, math.floor(tip_px[k] - reach)) for k in range(2))
    left, top = min(left, width - 1), min(top, height - 1)
    right, bottom = (max(1, math.ceil(tip_px[k] + reach)) for k in range(2))
    part = image[top : max(bottom, top + 1), left : max(right, left + 1)]
    if part.ndim == 3:
        part = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY)
    if coarser > 1:
        size = max(1, part.shape[1] // coarser), max(1, part.shape[0] // coarser)
        part = cv2.resize(part[: size[1] * coarser, : size[0] * coarser], size, interpolation=cv2.INTER_AREA)
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array([[cos, -sin], [sin, cos]]) * step
    centre = np.array([BEHIND_M / pixel_m + 0.5 * (side_px - SIDE_PX * PIXEL_M / pixel_m), 0.5 * (side_px - 1)])
    start = (np.asarray(tip_px, float) - (left, top) + 0.5) / coarser - 0.5
    matrix = np.column_stack([turn / coarser, start - turn @ centre / coarser])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(part, matrix, (side_px, side_px), flags=flags, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )
