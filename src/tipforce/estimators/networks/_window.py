"""The square part of a picture around the catheter that `compact` looks at, and how it is cut out in one pass.

The window follows the sheet beside the bench: its side is a multiple of the catheter's nominal length in the picture's
scale, so that a long and a short catheter fill it alike; it starts at the border that the base lies at, and is turned
so that the base is on the left. Nothing has to be found in the picture first.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from ..._compile import STEADY
from ...types import Image, SessionInfo

__all__ = ["LENGTHS", "Window", "cut", "widened", "window_of"]

SIDES = ("left", "bottom", "right", "top")
"""Borders that the base may lie at; the picture is turned clockwise by as many quarter turns as their place here."""

LENGTHS = 1.35
"""Side of the window in nominal lengths of the catheter: it shows what the tip touches, too."""


@dataclass(frozen=True, slots=True)
class Window:
    """``corner`` (u, v): the border's end of the window's middle line, image points; ``size_px``: its side.

    ``turns``: quarter turns clockwise that bring the base to the left.
    """

    corner: tuple[float, float]
    size_px: float
    turns: int


_QUARTERS = ((1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (0.0, 1.0))
"""Direction (u, v) from the base's border into the picture."""


def window_of(
    info: SessionInfo,
    view: str,
    shape: tuple[int, ...],
    side: str | None,
    lengths: float = LENGTHS,
    across: float = 0.5,
) -> Window:
    """The window in a session's images of ``view``, of ``shape`` (h, w[, 3]), with the base at ``side`` or None.

    Without a scale or a length it is the largest square at that border; without a side, the smallest that holds the
    whole picture. ``across``: where along the border the base lies, as a share from its left or upper end.
    """
    height, width = shape[:2]
    along, beside = (width, height) if side in ("left", "right", None) else (height, width)
    catheter, scale = info.catheter, info.view(view).metres_per_px
    size = float(max(along, beside) if side is None else min(along, beside))
    if side is not None and scale is not None and catheter.flexible_length_m is not None:
        size = lengths * (catheter.flexible_length_m + (catheter.rigid_length_m or 0.0)) / scale
    if side is None:
        return Window((0.5 * (width - size) - 0.5, 0.5 * height - 0.5), size, 0)
    turns = SIDES.index(side)
    starts = (
        (-0.5, across * height - 0.5),
        (across * width - 0.5, height - 0.5),
        (width - 0.5, across * height - 0.5),
        (across * width - 0.5, -0.5),
    )
    return Window(starts[turns], size, turns)


def cut(image: Image, window: Window, size: int) -> Image:
    """(size, size) grey levels of ``image`` (h, w[, 3]) in ``window``: means over areas; its border goes on beyond."""
    out = np.empty((size, size), np.uint8)
    picture = image if image.ndim == 3 else image[:, :, None]
    cos, sin = _QUARTERS[window.turns]
    _cut(picture, window.corner[0], window.corner[1], cos, sin, window.size_px, out)
    return out


def widened(window: Window, share: float) -> Window:
    """The window with the same middle and ``share`` times its side."""
    cos, sin = _QUARTERS[window.turns]
    back = 0.5 * (share - 1.0) * window.size_px
    return Window((window.corner[0] - cos * back, window.corner[1] - sin * back), share * window.size_px, window.turns)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=STEADY)
def _cut(image: Image, u0: float, v0: float, cos: float, sin: float, side: float, out: Image) -> None:
    """Separable: weights along and across are those of boxes as wide as a pixel of ``out``, at least one pixel."""
    size = out.shape[0]
    height, width, channels = image.shape
    scale = side / size
    reach = max(scale, 1.0)
    most = math.ceil(reach) + 2
    columns = np.empty((2, size, most), np.int64)
    weights = np.empty((2, size, most), np.float32)
    counts = np.empty((2, size), np.int64)
    for axis in range(2):
        limit = width if axis == 0 else height
        # on which of the picture's axes "along" and "across" of the window lie
        for k in range(size):
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
            for place in range(first, first + most):
                share = min(high, place + 0.5) - max(low, place - 0.5)
                if share <= 1e-9:
                    continue
                columns[axis, k, number] = min(max(place, 0), limit - 1)
                weights[axis, k, number] = share
                total += share
                number += 1
            for place in range(number):
                weights[axis, k, place] /= total
            counts[axis, k] = number
    red, green, blue = np.float32(0.299), np.float32(0.587), np.float32(0.114)
    row = np.empty(width, np.float32)
    low_u, high_u = width, -1
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
            # a runs along the picture's u, b along its v: back to along and across of the window
            if cos != 0.0:
                out[b, a] = value
            else:
                out[a, b] = value
