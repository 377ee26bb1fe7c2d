"""What may happen to a picture before it is seen: it moves, light changes, it blurs, it grains, things come in."""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from ..types import Image

__all__ = ["Blur", "Disc", "ImageOperation", "Light", "Noise", "Warp"]


class ImageOperation(Protocol):
    """From a picture to what is seen of it; the same for the same numbers. Comparable and hashable."""

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:
        """``image`` (h, w[, 3]) uint8 -> the same shape; ``seed``: of what is drawn, one for each picture."""
        ...


@dataclass(frozen=True, slots=True)
class Warp:
    """Turned counter-clockwise as shown and enlarged, both about the middle, then moved; borders are replicated."""

    right_px: float = 0.0
    down_px: float = 0.0
    turn_deg: float = 0.0
    zoom: float = 1.0

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:  # noqa: ARG002 - nothing is drawn
        """The picture bilinearly sampled."""
        height, width = image.shape[:2]
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), self.turn_deg, self.zoom)
        matrix[:, 2] += self.right_px, self.down_px
        return cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class Light:
    """Grey levels times ``factor``, and times 1 - ``slope`` at the left border to 1 + ``slope`` at the right."""

    factor: float = 1.0
    slope: float = 0.0

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:  # noqa: ARG002 - nothing is drawn
        """The picture, saturated at 255."""
        ramp = self.factor * np.linspace(1 - self.slope, 1 + self.slope, image.shape[1], dtype=np.float32)
        return _bytes(image * (ramp if image.ndim == 2 else ramp[:, None]))


@dataclass(frozen=True, slots=True)
class Blur:
    """A Gaussian of ``sigma_px``."""

    sigma_px: float

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:  # noqa: ARG002 - nothing is drawn
        """The picture out of focus."""
        return cv2.GaussianBlur(image, (0, 0), self.sigma_px, borderType=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class Noise:
    """White Gaussian noise of ``sigma`` grey levels, each colour's its own."""

    sigma: float

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:
        """The picture with the noise that ``seed`` draws."""
        grain = np.random.default_rng(seed).standard_normal(image.shape, dtype=np.float32)
        return _bytes(image + self.sigma * grain)


@dataclass(frozen=True, slots=True)
class Disc:
    """An even disc in front of everything, its diameter a ``share`` of the picture's height, anywhere, of any grey."""

    share: float

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:
        """The picture with the disc where ``seed`` draws it."""
        draw = np.random.default_rng(seed)
        height, width = image.shape[:2]
        middle = int(draw.integers(width)), int(draw.integers(height))
        radius, grey = max(1, round(0.5 * self.share * height)), float(draw.integers(256))
        return cv2.circle(image.copy(), middle, radius, (grey, grey, grey), cv2.FILLED, cv2.LINE_AA)  # type: ignore[return-value]


def _bytes(image: np.ndarray) -> Image:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
