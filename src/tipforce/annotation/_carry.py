"""Carries the line of a finished frame to a similar frame by optical flow."""

import cv2
import numpy as np

from ..types import FloatArray, Image
from ._spline import curve_through, handles_of

WINDOW_PX = (31, 31)
LEVELS = 4
"""Levels of the image pyramid; with `WINDOW_PX` motions of up to 240 px can be followed."""
MAX_RETURN_PX = 2.0
"""A point that is followed to the other image and back is followed rightly within this distance, px."""
MIN_FOLLOWED_SHARE = 0.5
"""Where fewer points are followed, the line is carried without motion."""
_STATIONS = 48


def carried_line(points_px: FloatArray, from_image: Image, to_image: Image) -> FloatArray:
    """Returns the line of one image, moved to another image of the same scene.

    Points are followed by the pyramidal Lucas-Kanade method, to the other image and back: a point counts if it returns
    to its start within `MAX_RETURN_PX`. Between the points that count the motion is interpolated.

    Args:
        points_px: (k, 2) points of the line in ``from_image``, base to tip.
        from_image: (h, w) grey or (h, w, 3) RGB, uint8.
        to_image: likewise.

    Returns:
        (m, 2) points that a person can drag; unmoved where the motion cannot be followed.
    """
    if from_image.shape[:2] != to_image.shape[:2]:
        return points_px
    line = curve_through(points_px, _STATIONS)
    from_grey, to_grey = _grey(from_image), _grey(to_image)
    start = line.astype(np.float32)[:, None]  # (n, 1, 2), as OpenCV wants it
    moved, followed = _followed(from_grey, to_grey, start)
    returned, followed_back = _followed(to_grey, from_grey, moved)
    error_px = np.linalg.norm((returned - start)[:, 0], axis=1)
    good = np.flatnonzero(followed & followed_back & (error_px <= MAX_RETURN_PX))
    if len(good) < MIN_FOLLOWED_SHARE * len(line):
        return points_px
    shift = (moved - start)[:, 0]
    stations = np.arange(len(line))
    motion = np.column_stack([np.interp(stations, good, shift[good, axis]) for axis in (0, 1)])
    return handles_of(line + motion)


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)  # type: ignore[return-value]


def _followed(first: Image, second: Image, start: "np.ndarray") -> "tuple[np.ndarray, np.ndarray]":  # type: ignore[type-arg]
    """Returns the (n, 1, 2) points in the second image, and (n,) whether each was found."""
    empty = np.empty_like(start)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(first, second, start, empty, winSize=WINDOW_PX, maxLevel=LEVELS)
    return moved, found[:, 0] > 0
