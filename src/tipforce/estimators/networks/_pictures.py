"""From a picture of any size to what a network takes."""

import cv2
import numpy as np

from ...types import Image

__all__ = ["SIDE", "whole_picture"]

SIDE = 224
"""Pixels, of the thesis's network."""


def whole_picture(image: Image) -> Image:
    """(224, 224, 3): all of ``image``, its aspect not kept, as in the thesis; grey is repeated in three channels.

    >>> whole_picture(np.full((480, 640), 7, np.uint8)).shape
    (224, 224, 3)
    """
    # areas, not points: a shaft of few pixels must not fall between the rows
    small = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    grey = small if small.ndim == 3 else np.repeat(small[:, :, None], 3, axis=2)
    return np.asarray(grey, np.uint8)
