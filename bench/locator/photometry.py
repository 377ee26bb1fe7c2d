"""Converts linear light to the image of a random camera: exposure, blur, noise, sharpening, compression."""

import math

import cv2
import numpy as np
import numpy.typing as npt
from bench.locator.ground import pixels

from tipforce.training.locator import camera_image, motion_blur

Float32 = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]


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
    return camera_image(image, rng)
