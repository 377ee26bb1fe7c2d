"""Converts linear light to the image of a random camera: exposure, blur, noise, sharpening, compression."""

import math
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
from bench.locator.ground import pixels

Float32 = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]

_NOISE_ROWS = 1024


@cache
def _noise_bank() -> Float32:
    """Normal noise (rows, rows, 3), drawn once a process; windows are taken from it at random."""
    return np.random.default_rng(12345).normal(size=(_NOISE_ROWS, _NOISE_ROWS, 3)).astype(np.float32)


def noise(rng: np.random.Generator, height: int, width: int) -> Float32:
    """Normal noise (h, w, 3)."""
    top, left = rng.integers(0, _NOISE_ROWS - height), rng.integers(0, _NOISE_ROWS - width)
    return _noise_bank()[top : top + height, left : left + width, rng.permutation(3)]


def motion_blur(image: Float32, rng: np.random.Generator, longest_px: float) -> Float32:
    """``image`` moved by up to ``longest_px`` during its exposure."""
    length, turn = rng.uniform(1.0, longest_px), rng.uniform(0.0, math.pi)
    size = 2 * math.ceil(0.5 * length) + 1
    kernel = np.zeros((size, size), np.float32)
    middle, way = 0.5 * (size - 1), 0.5 * length * np.array([math.cos(turn), math.sin(turn)])
    ends = [tuple(np.round(16 * (middle + sign * way)).astype(int).tolist()) for sign in (-1.0, 1.0)]
    cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
    return np.asarray(cv2.filter2D(image, -1, kernel / max(float(kernel.sum()), 1e-6)), np.float32)


def photograph(light: Float32, rng: np.random.Generator) -> Image:
    """The image (h, w, 3) uint8 that a random camera makes of ``light`` (h, w, 3)."""
    height, width = light.shape[:2]
    level = max(float(np.quantile(light[::8, ::8], 0.9)), 0.02)
    exposed = light * np.float32(math.exp(rng.normal(-0.35, 0.4)) / level)
    exposed *= np.exp(rng.normal(0.0, 0.1, 3)).astype(np.float32)
    if rng.random() < 0.5:
        exposed = cv2.GaussianBlur(exposed, (0, 0), rng.uniform(0.3, 1.5))
    if rng.random() < 0.2:
        exposed = motion_blur(exposed, rng, 6.0)
    if rng.random() < 0.12:  # glare of a lamp or a cover plate
        spot = rng.uniform(0.0, 1.0, 2) * (width, height)
        v, u = pixels(height, width)
        wide = rng.uniform(0.02, 0.3) * width
        glare = np.exp(-(((u - spot[0]) / wide) ** 2) - ((v - spot[1]) / (wide * rng.uniform(0.2, 2.0))) ** 2)
        exposed = exposed + rng.uniform(0.1, 1.0) * glare[..., None].astype(np.float32)
    curve = 1.0 / rng.uniform(1.6, 2.6)
    image = 255.0 * np.clip(exposed, 0.0, 1.0) ** np.float32(curve)
    return finish(image, rng)


def finish(image: Float32, rng: np.random.Generator) -> Image:
    """Adds colour processing, noise, sharpening and compression to ``image`` (h, w, 3), grey levels."""
    height, width = image.shape[:2]
    if rng.random() < 0.3:
        image = np.repeat(image @ np.array([[0.299], [0.587], [0.114]], np.float32), 3, axis=2)
    elif rng.random() < 0.25:
        grey = image.mean(axis=2, keepdims=True)
        image = grey + (image - grey) * rng.uniform(0.2, 1.6)
    strength = rng.choice([0.5, 2.0, 5.0, 10.0]) * rng.uniform(0.5, 1.5)
    grain = noise(rng, height, width)
    if rng.random() < 0.5:
        grain = cv2.GaussianBlur(grain, (3, 3), 0) * 2.0
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
    drawn = np.clip(image, 0.0, 255.0).astype(np.uint8)
    if rng.random() < 0.5:
        quality = int(rng.integers(25, 96))
        coded = cv2.imencode(".jpg", drawn[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        drawn = np.ascontiguousarray(cv2.imdecode(coded, cv2.IMREAD_COLOR)[..., ::-1])
    return drawn
