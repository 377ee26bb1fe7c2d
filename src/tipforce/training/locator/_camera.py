"""Random changes that a camera makes to an image: colour processing, noise, sharpening, motion blur, compression."""

import math
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ...types import Image

Float32 = npt.NDArray[np.float32]
GreyLevels = npt.NDArray[np.floating[Any]]

NOISE_BANK_PX = 1024
"""Side of the image of noise that windows are taken from."""


@cache
def _noise_bank() -> Float32:
    """Returns normal noise (NOISE_BANK_PX, NOISE_BANK_PX, 3), drawn once a process."""
    return np.random.default_rng(12345).normal(size=(NOISE_BANK_PX, NOISE_BANK_PX, 3)).astype(np.float32)


def _noise(rng: np.random.Generator, height: int, width: int) -> Float32:
    """Returns normal noise (height, width, 3)."""
    top, left = rng.integers(0, NOISE_BANK_PX - height), rng.integers(0, NOISE_BANK_PX - width)
    return _noise_bank()[top : top + height, left : left + width, rng.permutation(3)]


def motion_blur(image: Float32, rng: np.random.Generator, longest_px: float) -> Float32:
    """Returns an image that moved during its exposure.

    Args:
        image: (h, w, 3) grey levels.
        rng: source of length and direction of the motion.
        longest_px: longest motion.
    """
    length, turn = rng.uniform(1.0, longest_px), rng.uniform(0.0, math.pi)
    size = 2 * math.ceil(0.5 * length) + 1
    kernel = np.zeros((size, size), np.float32)
    middle, half = 0.5 * (size - 1), 0.5 * length * np.array([math.cos(turn), math.sin(turn)])
    ends = [tuple(np.round(16 * (middle + sign * half)).astype(int).tolist()) for sign in (-1.0, 1.0)]
    cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
    return np.asarray(cv2.filter2D(image, -1, kernel / max(float(kernel.sum()), 1e-6)), np.float32)


def camera_image(image: GreyLevels, rng: np.random.Generator) -> Image:
    """Returns an image with random colour processing, noise, sharpening and compression.

    Args:
        image: (h, w, 3) grey levels of 0..255, RGB.
        rng: source of randomness.
    """
    height, width = image.shape[:2]
    if rng.random() < 0.3:
        image = np.repeat(image @ np.array([[0.299], [0.587], [0.114]], np.float32), 3, axis=2)
    elif rng.random() < 0.25:
        grey = image.mean(axis=2, keepdims=True)
        image = grey + (image - grey) * rng.uniform(0.2, 1.6)
    strength = rng.choice([0.5, 2.0, 5.0, 10.0]) * rng.uniform(0.5, 1.5)
    grain = _noise(rng, height, width)
    if rng.random() < 0.5:
        grain = np.asarray(cv2.GaussianBlur(grain, (3, 3), 0), np.float32) * 2.0
    if rng.random() < 0.5:
        grain = np.repeat(grain[..., :1], 3, axis=2)
    image = image + strength * grain
    if rng.random() < 0.2:
        image = image + rng.uniform(0.3, 1.5) * (image - cv2.GaussianBlur(image, (0, 0), rng.uniform(0.8, 2.0)))
    if rng.random() < 0.04:  # the fields of an interlaced camera
        image = image.copy()
        image[1::2] = np.roll(image[1::2], int(rng.integers(-4, 5)), axis=1)
    if rng.random() < 0.03:
        image = 255.0 - image
    levels = np.clip(image, 0.0, 255.0).astype(np.uint8)
    if rng.random() < 0.5:
        quality = int(rng.integers(25, 96))
        coded = cv2.imencode(".jpg", levels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        decoded = cv2.imdecode(coded, cv2.IMREAD_COLOR)
        assert decoded is not None
        levels = np.ascontiguousarray(decoded[..., ::-1], np.uint8)
    return levels
