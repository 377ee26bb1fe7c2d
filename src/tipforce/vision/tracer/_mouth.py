"""Where a thin tube of a stated diameter comes out of something thicker: the mouth of a sheath.

What lies before the mouth stands still, and so does the shaft just beyond it, where it is clamped. So the mouth is
searched in the median of a session's images: line after line, farther and farther from the border, pairs of edges as
far apart as the shaft is thick are joined to runs. Where a run begins, and what lies before it is wider, is a mouth.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...types import Image
from .._settings import BaseSide, Box, Polarity
from ._entries import find_entries

_DEEPEST = 0.6
"""Share of the image that is searched from the border on."""
_NARROW, _WIDE = 0.7, 1.35
"""Widths of the shaft in diameters along the line, which it may cross at an angle."""
_WIDER, _WIDEST = 0.75, 4.0
"""Widths of what lies before the mouth, likewise; gloss and shadow make tubes look up to a quarter too thin."""
_STEP = 1.12
"""What lies before the mouth is wider by this ratio at least, or of the other polarity."""
_RUN, _SHEATH = 1.5, 0.6
"""Least lengths in diameters of the shaft beyond the mouth, and of what lies before it."""
_MISSES = 0.5
"""A run ends behind a gap of so many diameters."""
_SIDEWAYS = 1.6
"""Largest step sideways from line to line in px, beside the run's slope."""
_NEAR = 2.0
"""A sheath begins within so many diameters of the border."""
_FITTING = 7.0
"""Between the sheath and the shaft a clamp or a stopper may lie, so many diameters long."""
_OFF_AXIS = 0.6
"""The shaft begins within so many diameters of the sheath's axis."""
_LEAST = 10.0
"""Contrast in grey levels."""


@dataclass(frozen=True, slots=True)
class Mouth:
    """Where a thin tube comes out of a thicker one; in px."""

    depth: float
    """From the border, across it."""
    along: float
    """Of the tube's axis, along the border."""
    run: float
    """Length over which the thin tube stands still."""
    sheath: float
    """Width of the thicker tube; 0 where none is seen."""
    polarity: Polarity
    """Of the thin tube."""


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
    """Returns ``image`` with ``side`` at the top, without turning round what runs along it."""
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
    count = find_entries(frame, start, sign, low, high, -1.0, _LEAST, line, slope, edges, entries)
    return entries[:count, :2].tolist()


def _join(active: list[_Run], done: list[_Run], depth: int, found: list[list[float]], gap: float) -> list[_Run]:
    """Joins what was ``found`` on a line to the runs; returns those that go on, and adds the others to ``done``."""
    places = np.array([run.expected(depth) for run in active])
    widths = np.array([run.width for run in active])
    taken: set[int] = set()
    for at, width in found:
        off = np.where(np.abs(widths - width) < 0.25 * width + 1.0, np.abs(places - at), np.inf)
        k = int(np.argmin(off)) if len(off) else -1
        if k >= 0 and off[k] <= _SIDEWAYS and k not in taken:
            active[k].add(depth, at, width)
            taken.add(k)
        else:
            active.append(_Run([(depth, at)], width))
    done += [run for run in active if depth - run.last > gap]
    return [run for run in active if depth - run.last <= gap]


def find_mouths(images: Sequence[Image], side: BaseSide, diameter: float) -> list[Mouth]:
    """Returns where a tube of ``diameter`` px comes out of a thicker one that enters at ``side``, the likeliest first.

    Behind these stand the places where such a tube begins and no thicker one is seen, the longest first. ``images``:
    (h, w) or (h, w, 3), of one session and one size.
    """
    greys = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image for image in images]
    still = np.median(np.stack(greys), axis=0).astype(np.uint8)
    image = np.ascontiguousarray(_turned(still, side))
    gap = max(3.0, _MISSES * diameter)
    thin: list[tuple[_Run, float]] = []
    thick: list[tuple[_Run, float]] = []
    for sign in (1.0, -1.0):
        narrow: list[_Run] = []
        wide: list[_Run] = []
        narrow_done: list[_Run] = []
        wide_done: list[_Run] = []
        for depth in range(int(_DEEPEST * image.shape[0])):
            found = _entries(image, depth, sign, _NARROW * diameter, _WIDEST * diameter)
            shafts = [pair for pair in found if pair[1] <= _WIDE * diameter]
            sheaths = [pair for pair in found if pair[1] >= _WIDER * diameter]
            narrow = _join(narrow, narrow_done, depth, shafts, gap)
            if depth > _NEAR * diameter:
                # a sheath enters at the border
                sheaths = [pair for pair in sheaths if any(abs(r.expected(depth) - pair[0]) <= _SIDEWAYS for r in wide)]
            wide = _join(wide, wide_done, depth, sheaths, gap)
        thin += [(run, sign) for run in narrow_done + narrow if run.length >= _RUN * diameter]
        thick += [(run, sign) for run in wide_done + wide if run.length >= _SHEATH * diameter]
    mouths: list[Mouth] = []
    for shaft, sign in thin:
        depth, at = shaft.at[0]
        fits = [
            sheath
            for sheath, other in thick
            if sheath.first <= _NEAR * diameter
            and -diameter < depth - sheath.last < _FITTING * diameter
            and abs(sheath.axis(depth) - at) < _OFF_AXIS * diameter + 0.05 * max(0.0, depth - sheath.last)
            and (other != sign or sheath.width > _STEP * shaft.width)
        ]
        sheath = max(fits, key=lambda run: run.length).width if fits else 0.0
        if depth > 0.0:
            mouths.append(Mouth(depth, at, shaft.length, sheath, "light" if sign > 0 else "dark"))
    return sorted(mouths, key=lambda mouth: (mouth.sheath == 0.0, -mouth.run))


def base_box(mouth: Mouth, side: BaseSide, diameter: float, size: tuple[int, int]) -> Box:
    """Returns the base region just beyond ``mouth`` in an image of ``size`` (h, w), whose line at ``side`` cuts it."""
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
