"""From an image of any size to the image of a network: the whole image resized, or a window around the catheter.

The window of `compact` follows the session's metadata: its side is a multiple of the catheter's nominal length at the
image's scale, so that a long and a short catheter fill it alike. It begins at the border at which the base is, and is
rotated so that the base is on the left. Nothing needs to be detected in the image first.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from ..._system.compilation import STEADY
from ...errors import InputError
from ...types import Image, SessionInfo
from ...vision import INWARD

RESNET_SIZE_PX = 224
"""Side of the image of the thesis's network."""

BASE_SIDES = ("left", "bottom", "right", "top")
"""Borders that the base may be at; the index is the number of clockwise quarter turns of the image."""

MAX_WINDOW_IMAGES = 100.0
"""Largest window in sizes of the image; a larger one means that the length or the scale is not in metres."""

WINDOW_LENGTHS = 1.35
"""Side of the window in nominal lengths of the catheter: it also shows the tissue at the tip."""


MIN_PIXEL_CORRELATION = 0.1
"""Smallest correlation of pixels that are side by side: 0.00 +- 0.01 in white noise, as of a lost signal; at least 0.98
in 14 images of real cameras and 0.81 in 30 real X-ray images."""
MIN_CONTRAST = 1.0
"""Smallest standard deviation of the pixels, in grey levels, of an image that may show an object: at least 20 in 44
real images and 16 in 44 of the presets."""
_CORRELATED_ROWS = 24
"""Number of rows that are compared, evenly spread: all of a large image take 2 ms."""


def without_structure(image: Image) -> str:
    """Returns the reason why an image (h, w) or (h, w, 3) shows no object; "" for an image that may show one.

    >>> without_structure(np.random.default_rng(0).integers(0, 256, (60, 80), np.uint8))
    'is noise: neighbouring pixels are not correlated'
    >>> without_structure(np.zeros((60, 80), np.uint8))
    'is uniform: all pixels are nearly alike'
    >>> without_structure(np.tile(np.arange(80, dtype=np.uint8), (60, 1)))
    ''
    """
    step = max(1, image.shape[0] // _CORRELATED_ROWS)
    rows = image[::step] if image.ndim == 2 else image[::step, :, 1]
    left, right = rows[:, :-1].astype(np.float32), rows[:, 1:].astype(np.float32)
    left -= left.mean()
    right -= right.mean()
    power = math.sqrt(float(np.vdot(left, left)) * float(np.vdot(right, right)))
    if power < MIN_CONTRAST**2 * left.size:
        return "is uniform: all pixels are nearly alike"
    if float(np.vdot(left, right)) < MIN_PIXEL_CORRELATION * power:
        return "is noise: neighbouring pixels are not correlated"
    return ""


@dataclass(frozen=True, slots=True)
class Window:
    """A square part of an image.

    Attributes:
        origin: (u, v) of the base: the middle of the window's side at the border of the image.
        size_px: side in image pixels.
        turns: clockwise quarter turns that bring the base to the left.
        at_base: whether the border of the base is known.
    """

    origin: tuple[float, float]
    size_px: float
    turns: int
    at_base: bool = True


def catheter_window(
    info: SessionInfo,
    view: str,
    shape: tuple[int, ...],
    side: str | None,
    lengths: float = WINDOW_LENGTHS,
    across: float = 0.5,
) -> Window:
    """Returns the window around the catheter.

    Without a scale or a length it is the largest square at the base's border; without a side, the smallest that holds
    the whole image.

    Args:
        info: metadata of the session.
        view: name of the view.
        shape: (h, w[, 3]) of its images.
        side: border at which the base is; None: not known.
        lengths: side of the window in nominal lengths of the catheter.
        across: position of the base along the border, as a share from its left or upper end.

    Raises:
        InputError: the catheter would be far larger than the image.
    """
    height, width = shape[:2]
    catheter, scale = info.catheter, info.view(view).metres_per_px
    size = float(max(width, height) if side is None else min(width, height))
    if side is not None and scale is not None and catheter.flexible_length_m is not None:
        length_m = catheter.flexible_length_m + (catheter.rigid_length_m or 0.0)
        size = lengths * length_m / scale
        if size > MAX_WINDOW_IMAGES * max(width, height):
            raise InputError(
                f"a catheter of {length_m:g} m at views.{view}.metres_per_px = {scale:g} would be "
                f"{length_m / scale:.3g} px long in images of {width} x {height}: state both in metres in bench.toml"
            )
    if side is None:
        return Window((0.5 * (width - size) - 0.5, 0.5 * height - 0.5), size, 0, at_base=False)
    turns = BASE_SIDES.index(side)
    # pixel centres are at integers: the borders of the image are at -0.5 and width - 0.5
    u, v = across * width - 0.5, across * height - 0.5
    origins = ((-0.5, v), (u, height - 0.5), (width - 0.5, v), (u, -0.5))  # as in BASE_SIDES
    return Window(origins[turns], size, turns)


def crop_window(image: Image, window: Window, size: int) -> Image:
    """Returns the grey levels of a window, averaged over areas. Beyond the image its border is repeated.

    Args:
        image: (h, w[, 3]).
        window: the part of the image.
        size: side of the result in pixels.

    Returns:
        (size, size) uint8, with the base at the left.
    """
    out = np.empty((size, size), np.uint8)
    channels_last = image if image.ndim == 3 else image[:, :, None]
    cos, sin = INWARD[BASE_SIDES[window.turns]]  # direction from the border of the base into the image
    _crop(channels_last, window.origin[0], window.origin[1], float(cos), float(sin), window.size_px, out)
    return out


def enlarged(window: Window, factor: float) -> Window:
    """Returns a window with the same centre and another side.

    Args:
        window: the window.
        factor: new side over the old one.
    """
    cos, sin = INWARD[BASE_SIDES[window.turns]]
    back = 0.5 * (factor - 1.0) * window.size_px
    origin = window.origin[0] - cos * back, window.origin[1] - sin * back
    return replace(window, origin=origin, size_px=factor * window.size_px)


def moved(window: Window, inward_px: float) -> Window:
    """Returns the window that has followed the base inward, from its border of the image.

    Args:
        window: the window at the border.
        inward_px: distance of the base from the border in px.
    """
    cos, sin = INWARD[BASE_SIDES[window.turns]]
    origin = window.origin[0] + cos * inward_px, window.origin[1] + sin * inward_px
    return replace(window, origin=origin)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def _crop(image: Image, u0: float, v0: float, cos: float, sin: float, side: float, out: Image) -> None:
    """Resamples a window, turned by quarter turns, to the grey image ``out``; see `crop_window`.

    Each pixel is the mean over a box as wide as a pixel of ``out``, at least one image pixel. The box is separable:
    first its pixels and weights along the image's u and v are listed, then rows are averaged, then columns. The base
    side of the window, ``side`` px long, has its middle at (``u0``, ``v0``); (``cos``, ``sin``) points inward from it.
    """
    size = out.shape[0]
    height, width, channels = image.shape
    scale = side / size
    reach = max(scale, 1.0)
    most = math.ceil(reach) + 2
    columns = np.empty((2, size, most), np.int64)  # first axis: u, v of the image
    weights = np.empty((2, size, most), np.float32)
    counts = np.empty((2, size), np.int64)
    for axis in range(2):
        limit = width if axis == 0 else height
        for k in range(size):
            # centre of pixel k: the image's axis is that along the window, or the one across it
            along = (k + 0.5) * scale
            across = along - 0.5 * side
            if axis == 0:
                centre = u0 + cos * along if cos != 0.0 else u0 - sin * across
            else:
                centre = v0 + sin * along if sin != 0.0 else v0 + cos * across
            low, high = centre - 0.5 * reach, centre + 0.5 * reach
            first = math.floor(low + 0.5)
            number = 0
            total = 0.0
            for pixel in range(first, first + most):
                share = min(high, pixel + 0.5) - max(low, pixel - 0.5)
                if share <= 1e-9:
                    continue
                columns[axis, k, number] = min(max(pixel, 0), limit - 1)
                weights[axis, k, number] = share
                total += share
                number += 1
            for k_pixel in range(number):
                weights[axis, k, k_pixel] /= total
            counts[axis, k] = number
    red, green, blue = np.float32(0.299), np.float32(0.587), np.float32(0.114)
    row = np.empty(width, np.float32)
    low_u, high_u = width, -1  # the part of a row that is needed
    for k in range(size):
        for n in range(counts[0, k]):
            low_u = min(low_u, columns[0, k, n])
            high_u = max(high_u, columns[0, k, n])
    for b in range(size):
        for u in range(low_u, high_u + 1):
            row[u] = 0.0
        for n in range(counts[1, b]):
            v, weight = columns[1, b, n], weights[1, b, n]
            if channels == 3:
                for u in range(low_u, high_u + 1):
                    row[u] += weight * (
                        np.float32(red) * image[v, u, 0]
                        + np.float32(green) * image[v, u, 1]
                        + np.float32(blue) * image[v, u, 2]
                    )
            else:
                for u in range(low_u, high_u + 1):
                    row[u] += weight * image[v, u, 0]
        for a in range(size):
            total = np.float32(0.0)
            for n in range(counts[0, a]):
                total += weights[0, a, n] * row[columns[0, a, n]]
            value = np.uint8(min(max(total + np.float32(0.5), np.float32(0.0)), np.float32(255.0)))
            # a runs along the image's u, b along its v: back to along and across of the window
            if cos != 0.0:
                out[b, a] = value
            else:
                out[a, b] = value


def resize_to_resnet(image: Image) -> Image:
    """Resizes all of ``image`` to (224, 224, 3), without its aspect ratio, as in the thesis.

    Grey images are repeated in three channels. Each pixel is the mean over the area that it covers: a thin catheter
    must not fall between the rows.

    >>> resize_to_resnet(np.full((480, 640), 7, np.uint8)).shape
    (224, 224, 3)
    """
    (height, width), size = image.shape[:2], RESNET_SIZE_PX
    if height < size or width < size:
        resized = cv2.resize(image, (size, size), interpolation=cv2.INTER_LINEAR)
    else:
        channels = 1 if image.ndim == 2 else image.shape[2]
        resized = np.empty((size, size) if image.ndim == 2 else (size, size, channels), np.uint8)
        rows = np.ascontiguousarray(image).reshape(height, -1)
        weights = *_area_weights(height, 1), *_area_weights(width, channels)
        _average_areas(rows, channels, *weights, resized.reshape(size, -1))
    return np.asarray(resized if resized.ndim == 3 else cv2.cvtColor(resized, cv2.COLOR_GRAY2RGB), np.uint8)


@cache
def _area_weights(length: int, channels: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    """Returns the weights that resize an axis of ``length`` pixels, of ``channels`` values each, to `RESNET_SIZE_PX`.

    Returns:
        (size * channels,) index of the first old value under each new value; and (taps, size * channels) weights of
        that old value and the next ones, which are ``channels`` apart.
    """
    scale = length / RESNET_SIZE_PX
    taps = int(np.ceil(scale)) + 1
    start = np.arange(RESNET_SIZE_PX) * scale
    # 1e-9: a start that is an integer but for rounding belongs to that pixel
    first = np.clip(np.floor(start + 1e-9), 0, max(length - taps, 0)).astype(np.int32)
    taps = min(taps, length)
    pixel = first + np.arange(taps)[:, None]
    covered = np.maximum(np.minimum(start + scale, pixel + 1) - np.maximum(start, pixel), 0.0) / scale
    values = np.repeat(first * channels, channels) + np.tile(np.arange(channels), RESNET_SIZE_PX)
    return values.astype(np.int32), np.repeat(covered, channels, axis=1).astype(np.float32)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def _average_areas(
    image: Image, channels: int, top: npt.NDArray[np.int32], down: npt.NDArray[np.float32],
    left: npt.NDArray[np.int32], across: npt.NDArray[np.float32], out: Image,
) -> None:  # fmt: skip
    """Resizes an image (h, w * channels) to ``out`` by averaging over areas, with the weights of `_area_weights`.

    First rows are averaged (``top``: first old row of each new one, ``down``: weights), then values along rows
    (``left``: first old value of each new one, ``across``: weights).
    """
    row = np.empty(image.shape[1], np.float32)
    mean = np.empty(out.shape[1], np.float32)
    for y in range(out.shape[0]):
        line = image[top[y]]  # outside of the loops, or they are not vectorised
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
            mean[x] = np.float32(0.5)  # for rounding
        for k in range(across.shape[0]):
            for x in range(mean.size):
                mean[x] += across[k, x] * row[left[x] + k * channels]
        for x in range(mean.size):
            out[y, x] = np.uint8(mean[x])


def modality(info: SessionInfo, view: str) -> str:
    """Returns the modality of the images of ``view``; a camera where none is stated."""
    return info.view(view).modality or "camera"


UNLIKE = {
    "camera": "these are images of a camera, and the model was trained on X-ray images",
    "xray": "these are X-ray images, and the model was trained on those of a camera",
}
"""Sentence for images of another modality than those of the training, by the modality."""
