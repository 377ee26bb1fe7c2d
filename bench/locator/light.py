"""Other light on an image: it varies the properties that a network must not use."""

import math

import cv2
import numpy as np
import numpy.typing as npt

_GREY = np.array([[0.299], [0.587], [0.114]], np.float32)


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
