"""Thesis algorithm 1 to the letter: threshold, base points, line, base frame, single-pixel line, polynomial."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..geometry import fit_polynomial, resampled
from ..types import BasePose, BoolArray, CentrelinePx, DetectedShape, FloatArray, Image, IntArray, Status
from ._settings import ResolvedVision, VisionSettings

DEGREE = 4
"""Degree of the polynomial, thesis eq. (2)."""
SOLID = 0.6
"""Base points fill at least this share of the band around them, and the band at most half of the border;
ground that was cut in two by its own noise fills half of its band."""


@dataclass(frozen=True, slots=True, eq=False)
class ClassicSteps:
    """The intermediate results of thesis algorithm 1, by its lines; None for the lines that were not reached.

    Points are (u, v) of the whole image.

    Attributes:
        status: status of the detection.
        detail: reason where nothing was found.
        grey: (h, w), line 4.
        threshold: c, line 5.
        binary: (h, w), True on the catheter, line 5.
        diameter_px: diameter of the shaft.
        coverage: share of the positions along the shaft that have pixels of it.
        base_px: (m, 2) points BS, lines 6 to 9.
        line_px: (2, 2) two points of the line L, lines 6 to 9.
        base: O and [R, T], lines 10 to 12.
        single_px: (k, 2) single-pixel line, base side first, line 13.
        single_local: (k, 2) the same in the base frame, line 14.
        coefficients: (5,), lines 15 and 16.
    """

    status: Status
    detail: str
    grey: Image
    threshold: int
    binary: BoolArray
    diameter_px: float = math.nan
    coverage: float = 0.0
    base_px: FloatArray | None = None
    line_px: FloatArray | None = None
    base: BasePose | None = None
    single_px: FloatArray | None = None
    single_local: FloatArray | None = None
    coefficients: FloatArray | None = None


class _Stop(Exception):
    """The algorithm ends early: a result, not an error."""

    def __init__(self, status: Status, detail: str) -> None:
        super().__init__(detail)
        self.status, self.detail = status, detail


class ClassicDetector:
    """Thesis algorithm 1: `detect` returns its result, `steps` all intermediate results.

    Where the thesis is silent: without a fixed threshold Otsu's is taken; the single-pixel line is the mean row of each
    column of catheter pixels; the line L is the least-squares line of row on column. The image of the thesis has the
    base on the left: for other sides the image is rotated, for a light catheter the threshold is inverted. "auto" means
    the left side, and the polarity with fewer pixels.

    One threshold parts the catheter from all else only where the image is as simple as the thesis's: dark shaft and
    tip, light even ground, light tissue, nothing else in view. Of the preset ``thesis-2021-plain`` it finds the shape
    in 165 of 165 frames, of ``bench-2021`` in 0 of 165 (docs/results/vision.md): there and elsewhere method 1 uses
    `tracer`.
    """

    def __init__(self, settings: VisionSettings | ResolvedVision) -> None:
        self.settings = settings

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter in ``image``, (h, w) grey or (h, w, 3) RGB.

        The centreline goes from O to the last column.
        """
        steps = self.steps(image)
        if steps.status is not Status.VALID or steps.base is None or steps.single_px is None:
            return DetectedShape(steps.status, steps.detail)
        local = steps.base.to_base(steps.single_px)
        from_base = np.vstack([np.zeros((1, 2)), local[local[:, 0] > 0.0]])
        centreline = resampled(steps.base.to_image(from_base), self.settings.points)
        return DetectedShape(
            status=Status.VALID,
            centreline=CentrelinePx(centreline),
            base=steps.base,
            diameter_px=steps.diameter_px,
            confidence=steps.coverage,
            fitted_px=steps.single_px,
        )

    def steps(self, image: Image) -> ClassicSteps:
        """Returns every intermediate result for one image, as in thesis fig. 17 and 18."""
        grey = grey_of(image)
        threshold, binary = self._threshold(grey)
        found: dict[str, Any] = {}
        status, detail = Status.VALID, ""
        try:
            self._search(binary, threshold, found)
        except _Stop as stop:
            status, detail = stop.status, stop.detail
        return ClassicSteps(status=status, detail=detail, grey=grey, threshold=threshold, binary=binary, **found)

    def _threshold(self, grey: Image) -> tuple[int, BoolArray]:
        """Computes line 5: c, and the mask of the catheter: density less than c."""
        roi = _box(self.settings.roi, grey)
        part = grey[roi]
        c = self.settings.threshold
        if c is None:
            c = int(cv2.threshold(part, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0]) + 1
        below = part < c
        polarity = self.settings.polarity
        dark = polarity == "dark" or (polarity == "auto" and 2 * np.count_nonzero(below) <= below.size)
        binary = np.zeros(grey.shape, dtype=np.bool_)
        binary[roi] = below if dark else ~below
        return c, binary

    def _search(self, binary: BoolArray, threshold: int, found: dict[str, Any]) -> None:
        settings = self.settings
        side = "left" if settings.base_side == "auto" else settings.base_side
        turn = _Turn(side, _box(settings.roi, binary))
        seen = turn.view(binary)
        first, last = 0, settings.base_columns
        where = f"the first {last} {turn.lines} at the {side} border"
        inside = np.ones(seen.shape, dtype=np.bool_)
        if settings.base_region is not None:
            inside = turn.view(_within(settings.base_region, binary))
            columns = np.flatnonzero(inside.any(axis=0))
            if not len(columns):
                raise _Stop(Status.NO_CATHETER, f"the base region {settings.base_region} is outside the image")
            first, last = int(columns[0]), int(columns[-1]) + 1
            where = f"the base region {settings.base_region}"

        # Lines 6 to 8: BS, the catheter pixels of the first N columns.
        rows, columns = np.nonzero((seen & inside)[:, first:last])
        columns = columns + first
        if len(np.unique(columns)) < 2:
            raise _Stop(Status.NO_CATHETER, f"no catheter pixels in {where} (threshold {threshold})")
        found["base_px"] = turn.to_image(columns, rows)
        # Line 9: L.
        slope, offset = fit_polynomial(columns.astype(np.float64), rows.astype(np.float64), 1)
        ends = np.array([first, last - 1.0])
        found["line_px"] = turn.to_image(ends, slope * ends + offset)
        away = np.abs(rows - slope * columns - offset)
        height = len(rows) / len(np.unique(columns))
        if 0.95 * height < SOLID * (2.0 * float(np.quantile(away, 0.95)) + 1.0) or 2.0 * height > len(seen):
            raise _Stop(
                Status.NO_CATHETER,
                f"the dark and light pixels in {where} form no shaft: threshold {threshold} does not part them",
            )
        # Lines 10 to 12: O, the base frame, [R, T] of thesis eq. (1).
        centre = turn.to_image(np.array([columns.mean()]), np.array([rows.mean()]))[0]
        along = turn.to_image(np.array([0.0, 1.0]), np.array([0.0, slope]))
        du, dv = along[1] - along[0]
        base = BasePose(centre, math.atan2(-dv, du))
        found["base"] = base

        # Line 13: one pixel a column.
        body = seen[:, first:]
        self._refuse_folds(body, first, turn, height)
        counts = np.count_nonzero(body, axis=0)
        filled = np.flatnonzero(counts)
        means = (np.arange(len(body)) @ body)[filled] / counts[filled]
        single = turn.to_image(filled + first, means)
        found["single_px"] = single
        found["coverage"] = len(filled) / (filled[-1] - filled[0] + 1.0)
        # A slanted shaft is cut by a column over its diameter divided by the cosine of the slant.
        slant = np.gradient(means, filled) if len(filled) > 1 else np.zeros(1)
        diameter = float(np.median(counts[filled] / np.hypot(1.0, slant)))
        found["diameter_px"] = diameter
        _refuse_cut(body, diameter, turn)
        # Line 14.
        local = base.to_base(single)
        found["single_local"] = local
        reach = np.maximum.accumulate(local[:, 0])
        if np.any(local[:, 0] < reach - 0.5 * diameter):
            raise _Stop(
                Status.NOT_A_FUNCTION,
                "in the base frame the shape bends past 90 degrees: no polynomial y(x) describes it",
            )
        if len(np.unique(local[:, 0])) <= DEGREE:
            raise _Stop(Status.NO_CATHETER, f"only {len(local)} {turn.lines} hold catheter pixels")
        # Lines 15 and 16.
        found["coefficients"] = fit_polynomial(
            np.ascontiguousarray(local[:, 0]), np.ascontiguousarray(local[:, 1]), DEGREE
        )

    @staticmethod
    def _refuse_folds(body: BoolArray, first: int, turn: "_Turn", height: float) -> None:
        """Stops for two runs of catheter pixels in one column: their mean row is on neither."""
        half = max(2, round(0.5 * height))
        # Opening and closing by half a shaft: specks and highlights are not the second run that is looked for.
        kernel = np.ones((half, 1), dtype=np.uint8)
        runs = cv2.morphologyEx(body.view(np.uint8), cv2.MORPH_CLOSE, kernel)
        runs = cv2.morphologyEx(runs, cv2.MORPH_OPEN, kernel)
        edges = np.diff(runs, axis=0, prepend=np.uint8(0)) == 1
        double = np.flatnonzero(np.count_nonzero(edges, axis=0) > 1)
        if len(double) >= half:
            raise _Stop(
                Status.NOT_A_FUNCTION,
                f"{turn.lines} {double[0] + first} to {double[-1] + first} from the base side hold two separate pieces "
                "of catheter: the shape bends past 90 degrees, or something else is in the image",
            )


class _Turn:
    """Rotates an image so that the base is on the left, and points back again."""

    def __init__(self, side: str, box: tuple[slice, slice]) -> None:
        self.upright = side in ("top", "bottom")
        self.mirrored = side in ("right", "bottom")
        self.box = box
        self.lines = "rows" if self.upright else "columns"

    def view(self, image: BoolArray) -> BoolArray:
        """Returns ``image`` within the box, base on the left."""
        part = image[self.box]
        part = part.T if self.upright else part
        return np.ascontiguousarray(part[:, ::-1] if self.mirrored else part)

    def to_image(self, columns: FloatArray | IntArray, rows: FloatArray | IntArray) -> FloatArray:
        """Returns (n, 2) image points (u, v) of columns and rows of `view`."""
        v, u = self.box
        along = np.asarray(columns, dtype=np.float64)
        across = np.asarray(rows, dtype=np.float64)
        if self.mirrored:
            along = ((v.stop - v.start) if self.upright else (u.stop - u.start)) - 1 - along
        pair = (across, along) if self.upright else (along, across)
        return np.column_stack([pair[0] + u.start, pair[1] + v.start])


def _refuse_cut(body: BoolArray, diameter: float, turn: _Turn) -> None:
    """Stops for a shaft that touches another border than that of the base: it leaves the image."""
    names = {"far": body[:, -1], "first": body[0, 1:], "last": body[-1, 1:]}
    for border, pixels in names.items():
        if np.count_nonzero(pixels) >= max(2.0, 0.5 * diameter):
            across = "columns" if turn.upright else "rows"
            which = "at the border opposite its base" if border == "far" else f"through the {border} of the {across}"
            raise _Stop(Status.CUT_OFF, f"the catheter leaves the searched region {which}: its tip is not seen")


def grey_of(image: Image) -> Image:
    """Returns (h, w) of an RGB or grey image: thesis algorithm 1, line 4."""
    return (
        np.ascontiguousarray(image)
        if image.ndim == 2
        else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
    )


def _box(roi: tuple[int, int, int, int] | None, image: npt.NDArray[Any]) -> tuple[slice, slice]:
    height, width = image.shape
    u0, v0, u1, v1 = roi or (0, 0, width, height)
    u0, v0 = min(max(0, u0), width - 1), min(max(0, v0), height - 1)
    return slice(v0, max(v0 + 1, min(height, v1))), slice(u0, max(u0 + 1, min(width, u1)))


def _within(box: tuple[int, int, int, int], image: BoolArray) -> BoolArray:
    inside = np.zeros(image.shape, dtype=np.bool_)
    u0, v0, u1, v1 = box
    inside[max(0, v0) : max(0, v1), max(0, u0) : max(0, u1)] = True
    return inside
