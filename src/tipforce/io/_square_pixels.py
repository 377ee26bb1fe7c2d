"""Stretches images whose pixels are not square, as a file states, until they are."""

from fractions import Fraction

import cv2
import numpy as np

from ..errors import FileFormatError
from ..types import Image
from ._image_size import check_pixels

_MAX_ASPECT = 4
"""Pixels that are more elongated than this are taken as a fault in the file."""


def square_pixels(image: Image, aspect: Fraction, where: str) -> Image:
    """Returns ``image`` with square pixels: stretched along the direction in which its pixels are longer.

    Args:
        image: (h, w) or (h, w, 3), uint8.
        aspect: width of a stored pixel divided by its height.
        where: the file, for the message.

    Raises:
        FileFormatError: the pixels are more than four times as long as wide, or the image becomes too large.
    """
    height, width = image.shape[:2]
    if not Fraction(1, _MAX_ASPECT) <= aspect <= _MAX_ASPECT:
        raise FileFormatError(
            f"{where}: states pixels of {aspect.numerator} : {aspect.denominator}, at most {_MAX_ASPECT} : 1 are read; "
            "where they are square, say so: ffmpeg -i VIDEO -vf setsar=1 -crf 10 SQUARE.mp4"
        )
    size = square_size(width, height, aspect)
    if size == (width, height):
        return image
    check_pixels(*size, where)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def square_size(width: int, height: int, aspect: Fraction) -> tuple[int, int]:
    """Returns width and height of an image after its pixels are made square.

    Args:
        width: width of the stored image.
        height: height of the stored image.
        aspect: width of a stored pixel divided by its height.
    """
    return round(width * max(aspect, Fraction(1))), round(height * max(1 / aspect, Fraction(1)))
