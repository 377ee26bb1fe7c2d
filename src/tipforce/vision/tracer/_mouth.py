"""Finds the mouth of a sheath: the point where a thin tube of a stated diameter comes out of a thicker one.

The sheath does not move, and neither does the shaft just beyond its mouth, where it is clamped. So the mouth is
searched in the median of a session's images: pairs of edges as far apart as the shaft is wide are searched on one line
after another, from the border inward, and joined to runs. A mouth is where a run begins behind a wider run.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...types import Image
from .._settings import BaseSide, Box, Polarity
from ._entries import find_entries

SEARCHED_SHARE = 0.6
"""Share of the image that is searched from the border on."""
MIN_SHAFT_DIAMETERS, MAX_SHAFT_DIAMETERS = 0.7, 1.35
"""Limits of the shaft's width along a line, which it may cross at an angle."""
MIN_SHEATH_DIAMETERS, MAX_SHEATH_DIAMETERS = 0.75, 4.0
"""Limits of the sheath's width along a line; with gloss and shadow a tube appears up to a quarter too thin."""
MIN_WIDTH_RATIO = 1.12
"""A sheath is wider than the shaft by at least this ratio, or has the other polarity."""
MIN_SHAFT_LENGTH_DIAMETERS, MIN_SHEATH_LENGTH_DIAMETERS = 1.5, 0.6
"""Smallest lengths of the shaft beyond the mouth and of the sheath before it."""
MAX_GAP_DIAMETERS = 0.5
"""A run ends behind a longer gap."""
MAX_SIDE_STEP_PX = 1.6
"""Largest step sideways from line to line, in addition to the slope of the run."""
MAX_BORDER_DIAMETERS = 2.0
"""A sheath begins within this distance of the border."""
MAX_FITTING_DIAMETERS = 7.0
"""Longest clamp or stopper between the sheath and the visible shaft."""
MAX_OFF_AXIS_DIAMETERS = 0.6
"""The shaft begins within this distance of the sheath's axis."""
MIN_CONTRAST_GREY = 10.0
"""Smallest contrast of a pair of edges."""


@dataclass(frozen=True, slots=True)
class Mouth:
    """Where a thin tube comes out of a thicker one; in px."""

    depth: float
    """Distance from the border."""
    along: float
    """Position of the tube's axis along the border."""
    run: float
    """Length over which the thin tube does not move."""
    sheath: float
    """Width of the thicker tube; 0 where none is visible."""
    polarity: Polarity
    """Polarity of the thin tube."""


@dataclass(slots=True)
class _Run:
    """Pairs of edges on one line after another: (depth, place along the border), and their mean width."""

    at: list[tuple[float, float]]
    width: float

    @property
    def first(self) -> float:
        return self.at[0][0]

    @property
    def last(self) -> float:
        return self.at[-1][0]

    @property
    def length(self) -> float:
        return self.last - self.first

    def add(self, depth: float, at: float, width: float) -> None:
        self.at.append((depth, at))
        self.width += (width - self.width) / len(self.at)

    def expected(self, depth: float) -> float:
        """Returns the place on a next line."""
        near = self.at[-12:]
        if len(near) < 4:
            return near[-1][1]
        slope = (near[-1][1] - near[0][1]) / (near[-1][0] - near[0][0])
        return near[-1][1] + slope * (depth - near[-1][0])

    def axis(self, depth: float) -> float:
        """Returns the place on any line, of the straight line through all of the run."""
        depths, places = np.array(self.at).T
        slope, offset = np.polyfit(depths, places, 1)
        return float(slope * depth + offset)


def _turned(image: Image, side: BaseSide) -> Image:
    """Returns ``image`` with ``side`` at the top, without reversing the direction along that side."""
    match side:
        case "top":
            return image
        case "bottom":
            return image[::-1]
        case "left":
            return image.T
        case _:
            return image[:, ::-1].T


def _entries(image: np.ndarray, depth: int, sign: float, low: float, high: float) -> list[list[float]]:
    """Returns the centres and widths in px of the pairs of edges along the row ``depth``."""
    rows, columns = image.shape
    frame = (image.reshape(-1), columns, 1, 0.0, 0.0, float(columns), float(rows))
    line, slope = np.zeros(columns), np.zeros(columns)
    edges, entries = np.zeros(256, np.int64), np.zeros((40, 4))
    start = (0, depth, 1, 0, columns, 0, 1)
    count = find_entries(frame, start, sign, low, high, -1.0, MIN_CONTRAST_GREY, line, slope, edges, entries)
    return entries[:count, :2].tolist()


def _join(active: list[_Run], done: list[_Run], depth: int, found: list[list[float]], gap: float) -> list[_Run]:
    """Joins the pairs ``found`` on a line to the runs; returns the runs that continue, and adds others to ``done``."""
    places = np.array([run.expected(depth) for run in active])
    widths = np.array([run.width for run in active])
    taken: set[int] = set()
    for at, width in found:
        off = np.where(np.abs(widths - width) < 0.25 * width + 1.0, np.abs(places - at), np.inf)
        k = int(np.argmin(off)) if len(off) else -1
        if k >= 0 and off[k] <= MAX_SIDE_STEP_PX and k not in taken:
            active[k].add(depth, at, width)
            taken.add(k)
        else:
            active.append(_Run([(depth, at)], width))
    done += [run for run in active if depth - run.last > gap]
    return [run for run in active if depth - run.last <= gap]


def find_mouths(images: Sequence[Image], side: BaseSide, diameter: float) -> list[Mouth]:
    """Finds where a thin tube comes out of a thicker one that enters at one side of the image.

    Args:
        images: (h, w) or (h, w, 3) images of one session and one size.
        side: side of the image at which the sheath enters.
        diameter: diameter of the thin tube in px.

    Returns:
        The mouths, the longest run first; then positions where such a tube begins without a visible sheath.
    """
    greys = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image for image in images]
    still = np.median(np.stack(greys), axis=0).astype(np.uint8)
    image = np.ascontiguousarray(_turned(still, side))
    gap = max(3.0, MAX_GAP_DIAMETERS * diameter)
    thin: list[tuple[_Run, float]] = []
    thick: list[tuple[_Run, float]] = []
    for sign in (1.0, -1.0):
        narrow: list[_Run] = []
        wide: list[_Run] = []
        narrow_done: list[_Run] = []
        wide_done: list[_Run] = []
        for depth in range(int(SEARCHED_SHARE * image.shape[0])):
            found = _entries(image, depth, sign, MIN_SHAFT_DIAMETERS * diameter, MAX_SHEATH_DIAMETERS * diameter)
            shafts = [pair for pair in found if pair[1] <= MAX_SHAFT_DIAMETERS * diameter]
            sheaths = [pair for pair in found if pair[1] >= MIN_SHEATH_DIAMETERS * diameter]
            narrow = _join(narrow, narrow_done, depth, shafts, gap)
            if depth > MAX_BORDER_DIAMETERS * diameter:
                # a sheath enters at the border
                sheaths = [
                    pair for pair in sheaths if any(abs(r.expected(depth) - pair[0]) <= MAX_SIDE_STEP_PX for r in wide)
                ]
            wide = _join(wide, wide_done, depth, sheaths, gap)
        thin += [(run, sign) for run in narrow_done + narrow if run.length >= MIN_SHAFT_LENGTH_DIAMETERS * diameter]
        thick += [(run, sign) for run in wide_done + wide if run.length >= MIN_SHEATH_LENGTH_DIAMETERS * diameter]
    mouths: list[Mouth] = []
    for shaft, sign in thin:
        depth, at = shaft.at[0]
        fits = [
            sheath
            for sheath, other in thick
            if sheath.first <= MAX_BORDER_DIAMETERS * diameter
            and -diameter < depth - sheath.last < MAX_FITTING_DIAMETERS * diameter
            and abs(sheath.axis(depth) - at) < MAX_OFF_AXIS_DIAMETERS * diameter + 0.05 * max(0.0, depth - sheath.last)
            and (other != sign or sheath.width > MIN_WIDTH_RATIO * shaft.width)
        ]
        sheath = max(fits, key=lambda run: run.length).width if fits else 0.0
        if depth > 0.0:
            mouths.append(Mouth(depth, at, shaft.length, sheath, "light" if sign > 0 else "dark"))
    return sorted(mouths, key=lambda mouth: (mouth.sheath == 0.0, -mouth.run))


def base_box(mouth: Mouth, side: BaseSide, diameter: float, size: tuple[int, int]) -> Box:
    """Returns the base region just beyond the mouth of a thicker tube, so that the base line cuts the thin tube.

    Args:
        mouth: the mouth.
        side: border of the image from which the catheter enters.
        diameter: diameter of the thin tube in px.
        size: (h, w) of the image in px.

    Returns:
        Left, top, right and bottom in px, inside the image.
    """
    rows, columns = size
    near, far = math.ceil(mouth.depth), math.ceil(mouth.depth + 3.0 * diameter)
    low, high = math.floor(mouth.along - 1.6 * diameter), math.ceil(mouth.along + 1.6 * diameter)
    match side:
        case "left":
            box = near, low, far, high
        case "right":
            box = columns - far, low, columns - near, high
        case "top":
            box = low, near, high, far
        case _:
            box = low, rows - far, high, rows - near
    return max(box[0], 0), max(box[1], 0), min(box[2], columns), min(box[3], rows)
