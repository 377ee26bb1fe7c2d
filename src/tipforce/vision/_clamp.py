"""A clamp that is advanced by a known way: the catheter is looked at as a camera on the clamp would see it."""

import numpy as np

from ..types import Image

INWARD = {"left": (1, 0), "bottom": (0, -1), "right": (-1, 0), "top": (0, 1)}
"""By the border that the shaft comes from: direction (u, v) into the image."""


def image_from_clamp(image: Image, base_side: str, advance_px: int) -> Image:
    """Returns ``image`` (h, w[, 3]) as a camera sees it that has moved ``advance_px`` inward; the border is repeated.

    >>> image_from_clamp(np.array([[1, 2, 3]], np.uint8), "left", 1)
    array([[2, 3, 3]], dtype=uint8)
    """
    if not advance_px:
        return image
    du, dv = INWARD[base_side]
    rows, columns = (
        np.clip(np.arange(size) + step * advance_px, 0, size - 1)
        for size, step in zip(image.shape[:2], (dv, du), strict=True)
    )
    moved = image.take(columns, axis=1) if du else image.take(rows, axis=0)
    return np.ascontiguousarray(moved)
