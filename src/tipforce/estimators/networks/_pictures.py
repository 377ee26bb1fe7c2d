"""From a picture of any size to what a network takes."""

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from ..._compile import STEADY
from ...types import Image

__all__ = ["SIDE", "whole_picture"]

SIDE = 224
"""Pixels, of the thesis's network."""


def whole_picture(image: Image) -> Image:
    """(224, 224, 3): all of ``image``, its aspect not kept, as in the thesis; grey is repeated in three channels.

    Each pixel is the mean over the area it covers: a shaft of few pixels must not fall between the rows.

    >>> whole_picture(np.full((480, 640), 7, np.uint8)).shape
    (224, 224, 3)
    """
    height, width = image.shape[:2]
    if height < SIDE or width < SIDE:
        made = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
    else:
        channels = 1 if image.ndim == 2 else image.shape[2]
        made = np.empty((SIDE, SIDE) if image.ndim == 2 else (SIDE, SIDE, channels), np.uint8)
        rows = np.ascontiguousarray(image).reshape(height, -1)
        _average(rows, channels, *_shares(height, 1), *_shares(width, channels), made.reshape(SIDE, -1))
    return np.asarray(made if made.ndim == 3 else cv2.cvtColor(made, cv2.COLOR_GRAY2RGB), np.uint8)


@cache
def _shares(length: int, channels: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    """How `SIDE` pixels along an axis cover ``length`` pixels of ``channels`` numbers each.

    For each number of the new pixels (SIDE * channels,) the first old one under it; and (taps, SIDE * channels) the
    shares of that and of the next ones, which are ``channels`` apart.
    """
    scale = length / SIDE
    taps = int(np.ceil(scale)) + 1
    start = np.arange(SIDE) * scale
    first = np.clip(np.floor(start + 1e-9), 0, max(length - taps, 0)).astype(np.int32)
    taps = min(taps, length)
    place = first + np.arange(taps)[:, None]
    covered = np.maximum(np.minimum(start + scale, place + 1) - np.maximum(start, place), 0.0) / scale
    numbers = np.repeat(first * channels, channels) + np.tile(np.arange(channels), SIDE)
    return numbers.astype(np.int32), np.repeat(covered, channels, axis=1).astype(np.float32)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def _average(
    image: Image,
    channels: int,
    top: npt.NDArray[np.int32],
    down: npt.NDArray[np.float32],
    left: npt.NDArray[np.int32],
    across: npt.NDArray[np.float32],
    made: Image,
) -> None:
    """Area means of ``image`` (h, w * channels): of rows first, all columns at once, then along each row."""
    row = np.empty(image.shape[1], np.float32)
    mean = np.empty(made.shape[1], np.float32)
    for y in range(made.shape[0]):
        line = image[top[y]]  # outside of the loops, or they are not made for many columns at once
        share = down[0, y]
        for x in range(row.size):
            row[x] = share * np.float32(line[x])
        for k in range(1, down.shape[0]):
            share = down[k, y]
            if share > 0:
                line = image[top[y] + k]
                for x in range(row.size):
                    row[x] += share * np.float32(line[x])
        for x in range(mean.size):
            mean[x] = np.float32(0.5)  # rounds
        for k in range(across.shape[0]):
            for x in range(mean.size):
                mean[x] += across[k, x] * row[left[x] + k * channels]
        for x in range(mean.size):
            made[y, x] = np.uint8(mean[x])
