"""Images with the true catheter in them, from which the locator learns."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...geometry import resampled
from ...types import BoolArray, FloatArray, Image

LABEL_POINTS = 65
"""Points of a true line, evenly spaced in arc length from base to tip."""
GROUND, CATHETER, SHEATH, INSTRUMENT, FRONT = range(5)
"""Kinds of pixels. FRONT is tissue, a rim or another object, not an instrument, in front of the catheter."""
NOT_CATHETER = 255
"""Kind of a pixel of which only is known that it is not the catheter."""
UNLABELLED = 254
"""Kind of a pixel of which nothing is known."""
OUTSIDE, HIDDEN, SEEN = range(3)
"""States of a point of a line: outside of the image, behind something, visible."""
HIDDEN_END_POINTS = 3
"""Points at the end of a line that count as hidden where the tip is: how far it is hidden is not marked."""
SIDES = ("left", "right", "top", "bottom")
"""Borders of an image."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImage:
    """An image of any size with its true catheter.

    Attributes:
        image: (h, w, 3) RGB.
        line_px: (LABEL_POINTS, 2) u, v px of the free catheter, base to tip. Without a catheter it is any line.
        state: (LABEL_POINTS,) OUTSIDE, HIDDEN or SEEN.
        mask: (h, w) pixels of the catheter; None where they are not known.
        side: index in SIDES of the border that the catheter comes from; -1 where it is not known.
        diameter_px: diameter of the shaft; NaN where it is not known.
        xray: whether it is an X-ray image.
        present: whether a catheter is in the image.
        ambiguous: whether other instruments are in the image, so that a prompt must say which one is meant.
    """

    image: Image
    line_px: FloatArray
    state: npt.NDArray[np.uint8]
    mask: BoolArray | None
    side: int
    diameter_px: float
    xray: bool = False
    present: bool = True
    ambiguous: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A square image of the size that the network is trained on, with its true catheter.

    Attributes:
        image: (h, w, 3) RGB.
        line: (LABEL_POINTS, 2) u, v px of the free catheter, base to tip; without meaning where none is present.
        state: (LABEL_POINTS,) OUTSIDE, HIDDEN or SEEN.
        kind: (h, w) kinds of the pixels.
        present: whether a catheter is in the image.
        decoys: lines of objects of the same kind, which only a prompt distinguishes from the catheter.
        side: index in SIDES of the border that the catheter comes from; -1 where it comes from none.
        diameter_px: diameter of the shaft; NaN where it is not known.
        ambiguous: whether other instruments are in the image, so that a prompt must say which one is meant.
    """

    image: Image
    line: FloatArray
    state: npt.NDArray[np.uint8]
    kind: npt.NDArray[np.uint8]
    present: bool
    decoys: tuple[FloatArray, ...]
    side: int
    diameter_px: float
    ambiguous: bool = False


def labelled_line(
    points_px: FloatArray, size_px: tuple[int, int], tip_hidden: bool
) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
    """Returns the line and the states of its points from points that a person marked.

    Args:
        points_px: (k, 2) u, v px from base to tip, joined by straight pieces.
        size_px: rows and columns of the image.
        tip_hidden: whether the tip is behind something; the last point of the network's line is then hidden.

    Returns:
        (LABEL_POINTS, 2) px, evenly spaced in arc length; (LABEL_POINTS,) states.
    """
    line = resampled(points_px, LABEL_POINTS)
    rows, columns = size_px
    inside = ((line > -0.5) & (line < (columns - 0.5, rows - 0.5))).all(axis=1)
    state = np.where(inside, SEEN, OUTSIDE).astype(np.uint8)
    if tip_hidden:
        state[-HIDDEN_END_POINTS:] = np.minimum(state[-HIDDEN_END_POINTS:], HIDDEN)
    return line, state


def border_behind(line_px: FloatArray, size_px: tuple[int, int]) -> int:
    """Returns the index in SIDES of the border that the line reaches first if it is extended backward from its base.

    Args:
        line_px: (n, 2) u, v px from base to tip.
        size_px: rows and columns of the image.
    """
    rows, columns = size_px
    backward = line_px[0] - line_px[min(4, len(line_px) - 1)]
    base = np.clip(line_px[0], 0.0, (columns - 1.0, rows - 1.0))
    distance = np.array([base[0], columns - 1.0 - base[0], base[1], rows - 1.0 - base[1]])
    speed = np.array([-backward[0], backward[0], -backward[1], backward[1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        return int(np.argmin(np.where(speed > 0.0, distance / speed, np.inf)))
