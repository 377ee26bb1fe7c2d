"""Draws plain tubes on an even ground, with blur and noise."""

import cv2
import numpy as np
import pytest

from tipforce.types import Image

SIZE, SCALE = (320, 240), 4
"""Width and height of the images, px, and the finer scale on which they are drawn."""

SIDES_AND_LIGHT = [
    ("left", False), ("top", True),
    *(pytest.param(side, False, marks=pytest.mark.slow) for side in ("right", "top", "bottom")),
    *(pytest.param(side, True, marks=pytest.mark.slow) for side in ("left", "right", "bottom")),
]  # fmt: skip
"""Sides of the base, and whether the tube is lighter than the ground: all eight; the quick tests take two."""


def draw_tubes(seed: int, *tubes: tuple[np.ndarray, float, float], light: bool = False) -> Image:
    """An image of tubes: points (n, 2) px, diameter in px, grey level; ``light``: in negative."""
    rng = np.random.default_rng(seed)
    image = np.full((SIZE[1] * SCALE, SIZE[0] * SCALE), 200.0)
    for points, diameter, grey in tubes:
        fine = (points + 0.5) * SCALE
        way = np.gradient(fine, axis=0)
        aside = 0.5 * SCALE * diameter * np.column_stack([-way[:, 1], way[:, 0]])
        aside /= np.linalg.norm(way, axis=1)[:, None]
        outline = np.vstack([fine + aside, (fine - aside)[::-1]])
        cv2.fillPoly(image, [np.rint(outline * 16).astype(np.int32)], grey, cv2.LINE_8, 4)
    small = cv2.GaussianBlur(cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    noisy = np.clip(np.rint(small + rng.normal(0.0, 2.0, small.shape)), 0, 255).astype(np.uint8)
    return 255 - noisy if light else noisy
