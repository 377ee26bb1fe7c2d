"""Changes of an image that do not move the catheter: they vary the properties that a network must not use."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from tipforce.types import FloatArray

__all__ = ["lit_otherwise", "with_tubes"]

_GREY = np.array([[0.299], [0.587], [0.114]], np.float32)


def with_tubes(
    image: npt.NDArray[np.uint8], line: FloatArray, diameter_px: float, length_px: float, rng: np.random.Generator
) -> npt.NDArray[np.uint8]:
    """``image`` (h, w, 3) with one to three other tubes, bars or cables behind the catheter along ``line``."""
    height, width = image.shape[:2]
    keep = np.zeros((height, width), np.uint8)
    _draw(keep, line, round(1.25 * diameter_px), (255.0,))
    drawn = image.copy()
    for _ in range(rng.integers(1, 4)):
        t = np.linspace(0.0, 1.0, 24)
        angle = rng.uniform(0.0, 2.0 * math.pi) + rng.normal(0.0, 1.2) * t + rng.normal(0.0, 1.0) * t * t
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        tube = (
            rng.uniform((0.0, 0.0), (width, height)) + np.cumsum(way, axis=0) * rng.uniform(0.2, 1.6) * length_px / 24
        )
        thick = max(1, round(diameter_px * rng.uniform(0.5, 2.4)))
        kind = rng.random()
        if kind < 0.5:
            colour = image.reshape(-1, 3)[rng.integers(height * width)].astype(np.float64)
        else:
            colour = rng.uniform(0.0, 255.0, 3) if kind < 0.65 else np.repeat(rng.uniform(0.0, 255.0), 3)
        _draw(drawn, tube, thick, colour)
        if thick > 2 and rng.random() < 0.5:
            across = np.column_stack([-way[:, 1], way[:, 0]]) * rng.uniform(-0.3, 0.3) * thick
            _draw(drawn, tube + across, thick // 3, np.clip(colour + rng.normal(0.0, 50.0), 0.0, 255.0))
    drawn = cv2.GaussianBlur(drawn, (3, 3), 0)
    share = keep[..., None].astype(np.float32) / 255.0
    return (share * image + (1.0 - share) * drawn).astype(np.uint8)


def _draw(image: npt.NDArray[np.uint8], line: FloatArray, thick: int, colour: npt.ArrayLike) -> None:
    points = np.round(16.0 * line).astype(np.int32)
    cv2.polylines(image, [points], False, tuple(np.asarray(colour).tolist()), max(1, thick), cv2.LINE_AA, 4)


def lit_otherwise(image: npt.NDArray[np.float32], rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """``image`` (h, w, 3) in another light, polarity or tint, blurred or noisy; grey levels, not clipped."""
    height, width = image.shape[:2]
    if rng.random() < 0.15:
        image = 255.0 - image
    if rng.random() < 0.3:
        image = np.repeat(image @ _GREY, 3, axis=2)
    elif rng.random() < 0.3:
        image = image[..., rng.permutation(3)]
    if rng.random() < 0.5:
        image = 255.0 * np.clip(image / 255.0, 0.0, 1.0) ** math.exp(rng.normal(0.0, 0.35))
    if rng.random() < 0.5:
        image = image * np.exp(rng.normal(0.0, 0.08, 3))
    if rng.random() < 0.3:
        light = rng.uniform(0.6, 1.4, (3, 3)).astype(np.float32)
        image = image * cv2.resize(light, (width, height), interpolation=cv2.INTER_CUBIC)[..., None]
    if rng.random() < 0.3:
        image = cv2.GaussianBlur(np.asarray(image, np.float32), (0, 0), rng.uniform(0.3, 1.3))
    if rng.random() < 0.5:
        image = image + rng.normal(0.0, rng.uniform(1.0, 9.0), (height, width, 3 if rng.random() < 0.5 else 1))
    return np.asarray(image, np.float32)
