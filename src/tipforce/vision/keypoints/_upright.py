"""The image as the network sees it: the base's side on the left, the catheter's stated length a fixed number of px."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ...types import BaseSide, FloatArray, Image

LENGTH_PX = 84.0
"""Stated length of the catheter, rigid tip included, in px of the network's image."""
STRIDE = 4
"""Px of the network's image to one cell of its heatmaps."""
_MULTIPLE = 16
"""The network halves its image four times."""
_QUARTER_TURNS = {"left": 0, "top": 1, "right": 2, "bottom": 3}
_CONTRAST_FLOOR = 6.0
"""Grey levels added to the standard deviation, so that noise in an even image is not amplified."""


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """``image`` (h, w, 3) uint8, turned and resized; maps points between it and the image it was made of."""

    image: npt.NDArray[np.uint8]
    size: tuple[int, int]
    """Width and height of the original."""
    turns: int
    """Quarter turns, counter-clockwise in the displayed image."""
    factor: tuple[float, float]
    """Px of this image to one of the turned original: along u and v."""

    def from_original(self, points: FloatArray) -> FloatArray:
        """(n, 2) px of the original -> px of this image."""
        u, v = points[:, 0], points[:, 1]
        right, bottom = self.size[0] - 1, self.size[1] - 1
        turned = ((u, v), (v, right - u), (right - u, bottom - v), (bottom - v, u))[self.turns]
        return np.column_stack([(x + 0.5) * f - 0.5 for x, f in zip(turned, self.factor, strict=True)])

    def to_original(self, points: FloatArray) -> FloatArray:
        """(n, 2) px of this image -> px of the original."""
        a, b = ((points[:, k] + 0.5) / self.factor[k] - 0.5 for k in (0, 1))
        right, bottom = self.size[0] - 1, self.size[1] - 1
        return np.column_stack(((a, b), (right - b, a), (right - a, bottom - b), (b, bottom - a))[self.turns])


def upright(image: Image, base_side: BaseSide, length_px: float) -> Upright:
    """Turns and resizes ``image``, (h, w) or (h, w, 3) uint8, whose catheter is ``length_px`` long as stated."""
    turns = _QUARTER_TURNS[base_side]
    turned = np.rot90(image, turns)
    height, width = turned.shape[:2]
    scale = LENGTH_PX / length_px
    size = max(8, round(width * scale)), max(8, round(height * scale))
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(np.ascontiguousarray(turned), size, interpolation=way), np.uint8)
    if small.ndim == 2:
        small = np.repeat(small[:, :, None], 3, axis=2)
    return Upright(small, (image.shape[1], image.shape[0]), turns, (size[0] / width, size[1] / height))


def normalised(image: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """(3, h, w) input of the network: zero mean and unit contrast, padded with zeros to sides that it can halve."""
    values = image.astype(np.float32)
    values = (values - values.mean()) / (values.std() + _CONTRAST_FLOOR)
    height, width = values.shape[:2]
    padded = np.zeros((3, -(-height // _MULTIPLE) * _MULTIPLE, -(-width // _MULTIPLE) * _MULTIPLE), np.float32)
    padded[:, :height, :width] = values.transpose(2, 0, 1)
    return padded
