"""The tracer: from a frame to the best candidate, and the decision whether it is the catheter."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError
from ...types import BasePose, CentrelinePx, DetectedShape, FloatArray, Image, Status
from .._probability import probability_right
from .._settings import BaseSide, Box, ResolvedVision, VisionSettings
from ._entries import BaseLine, find_entries
from ._evidence import Evidence, line_evidence
from ._solve import STATIONS, WORK_SIZE, ShaftFit, solve_shaft
from ._stations import END_BORDER, END_LOST, END_SHORT
from ._tip_template import TEMPLATE_COLUMNS, TEMPLATE_ROWS
from ._trace import Candidate

SEARCH_PASSES = ((0, 1), (4, 1), (8, 1), (12, 1), (18, 1))
"""Distances inside the base line at which entries are searched, and the step along it, in px."""
MAX_TRACED_ENTRIES = 6
MIN_CLEAR_TIP_SHARE = 0.35
"""Beside the border only a drop of this share of the shaft's contrast counts as its tip."""
MAX_UNFOLLOWED_FLOORS = 15.0
"""With more evidence of something beyond the end that was not followed, the end is not accepted."""
MAX_TIP_DIFFERENCE_GREY = 20.0
"""Largest mean difference of a metal tip from its template, in grey levels."""
MAX_SCATTER_DIAMETERS, THIN_SHAFT_PX = 0.026, 6.0
"""Largest distance of the centres from a smooth curve; the limit does not apply to shafts below the second value."""
HALF_SCORE_CONTRAST_GREY = 40.0
"""While the diameter is unknown, the score of a shaft of this contrast is halved."""
MAX_LEARNT_TOLERANCE = 0.06
"""A length with a smaller tolerance was learnt in images; metadata alone state it to 8 %."""
MIN_TOLERANCE_RADII = 0.4
"""Smallest tolerance of a length."""
REJECTED_SCORE_FACTOR = 0.2
"""Factor of the score of a rejected candidate: others are preferred."""
MIN_SIDE_PX = 4
"""Smallest side of the searched region, and shortest base line."""
NO_TEMPLATE = np.zeros((0, 0))
MAX_OBLIQUE_RATIO = 1.6
"""A shaft that enters at 50 degrees is this much wider along the border than across its axis."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One candidate, traced to its end."""

    status: Status
    detail: str
    score: float
    diameter_px: float
    contrast: float
    confidence: float
    length_px: float
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """u, v in px, and the angle in radians, counter-clockwise."""
    probability: float = math.nan
    """Probability that a valid line is right."""


def _base_line(box: Box, side: BaseSide) -> tuple[BaseLine, float]:
    """Returns the line of pixels along ``side`` of ``box``, and the heading into the image in radians, v down."""
    u0, v0, u1, v1 = box
    match side:
        case "left":
            return BaseLine(u0, v0, 0, 1, v1 - v0, 1, 0), 0.0
        case "right":
            return BaseLine(u1 - 1, v0, 0, 1, v1 - v0, -1, 0), math.pi
        case "top":
            return BaseLine(u0, v0, 1, 0, u1 - u0, 0, 1), math.pi / 2
        case _:
            return BaseLine(u0, v1 - 1, 1, 0, u1 - u0, 0, -1), -math.pi / 2


def _search_line(base: BaseLine, depth: int, every: int) -> BaseLine:
    """Returns the line ``depth`` px inside ``base``, with only every ``every``-th of its pixels."""
    return base._replace(
        u=base.u + base.inward_u * depth,
        v=base.v + base.inward_v * depth,
        du=base.du * every,
        dv=base.dv * every,
        pixels=base.pixels // every,
    )


def _within(box: Box, outer: Box) -> Box:
    return max(box[0], outer[0]), max(box[1], outer[1]), min(box[2], outer[2]), min(box[3], outer[3])


def _extent(box: Box) -> tuple[int, int]:
    return box[2] - box[0], box[3] - box[1]


class Tracer:
    """Traces the catheter in one frame after another with the same settings.

    Holds buffers, but no memory of earlier frames: the result depends on the image and the settings alone.

    Args:
        vision: resolved settings; or plain ones that state polarity and base side, else InputError is raised.
    """

    def __init__(self, vision: ResolvedVision | VisionSettings) -> None:
        settings = vision if isinstance(vision, ResolvedVision) else ResolvedVision.stated(vision)
        self.settings = settings
        self._line = np.zeros(8)
        self._slope = np.zeros(8)
        self._edges = np.zeros(256, dtype=np.int64)
        self._entries = np.zeros((12, 4))
        self._stations = np.zeros((STATIONS, 6))
        self._points = np.zeros((settings.points, 2))
        self._best = np.zeros((settings.points, 2))
        self._work = np.zeros(WORK_SIZE + 2 * settings.points)
        self._template = NO_TEMPLATE
        if settings.tip_template:
            self._template = np.array(settings.tip_template, dtype=np.float64).reshape(TEMPLATE_ROWS, -1)
        self._size = (0, 0)
        self._area = (0, 0, 0, 0)
        # set by `_resize`: the heading of the base line into the image, its pixels, and the lines to search with their
        # depth in px and step
        self._heading = 0.0
        self._base_pixels = 0
        self._lines: list[tuple[int, int, tuple[int, ...]]] = []

    @property
    def points(self) -> FloatArray:
        """(k, 2): u, v in px of the centreline that `best_trace` returned last; overwritten by the next."""
        return self._best

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter in ``image`` (h, w) or (h, w, 3) RGB, uint8; or the reason why it was not found."""
        if self.settings.refused:
            return DetectedShape(Status.NO_CATHETER, self.settings.refused)
        trace, reason = self.best_trace(image)
        if trace is None:
            return DetectedShape(Status.NO_CATHETER, reason)
        if trace.status is not Status.VALID:
            return DetectedShape(trace.status, trace.detail)
        u, v, angle = trace.base
        return DetectedShape(
            Status.VALID,
            "",
            CentrelinePx(self._best),
            BasePose(np.array([u, v]), angle),
            trace.diameter_px,
            trace.confidence,
            probability_right=trace.probability,
        )

    def best_trace(self, image: Image) -> tuple[Trace | None, str]:
        """Returns the best trace of ``image`` (valid or not), or None and the reason why there is none."""
        settings = self.settings
        if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
            raise InputError(f"expected an image of uint8, (h, w) or (h, w, 3), got {image.dtype} {image.shape}")
        if image.shape[:2] != self._size:
            self._resize(image.shape[0], image.shape[1])
        if not self._lines:
            searched = "base_region or roi" if settings.base_region or settings.roi else "the image"
            rows, columns = self._size
            return None, f"{searched} is too small for a catheter, or is outside the image of {columns} x {rows} px"
        frame = self._frame(image)
        sign = 1.0 if settings.polarity == "light" else -1.0
        known = settings.diameter_px or 0.0
        if known:
            low, high = max(2.0, 0.72 * known - 1.0), MAX_OBLIQUE_RATIO * 1.1 * known + 1.0
        else:
            low, high = 3.0, (0.9 if settings.base_region else 0.3) * self._base_pixels
        threshold = -1.0 if settings.threshold is None else float(settings.threshold)
        best: Trace | None = None
        wrong = 0.0
        for depth, every, line in self._lines:
            first_u, first_v, step_u, step_v, *_ = line
            count = find_entries(
                frame, line, sign, low if known == 0.0 else 2.0, high / every, threshold, 12.0,
                self._line, self._slope, self._edges, self._entries,
            )  # fmt: skip
            traced = 0
            for at, width, contrast, inside in self._entries[:count].tolist():
                width *= every
                if width < low - every + 1:
                    wrong = wrong or width
                    continue
                if traced == MAX_TRACED_ENTRIES:
                    break
                traced += 1
                u, v = first_u + at * step_u, first_v + at * step_v
                trace = self._trace(frame, (u, v), width, contrast, sign * inside, depth)
                if trace.score > (best.score if best else 0.0):
                    best = trace
                    self._points, self._best = self._best, self._points
                elif trace.score == 0.0 and trace.diameter_px:
                    wrong = wrong or trace.diameter_px
                if best is not None and best.status is Status.VALID and best.confidence > 0.7 and known:
                    return best, ""
            if best is not None:
                return best, ""
        return None, self._why_not(wrong)

    def _frame(self, image: Image) -> tuple[Any, ...]:
        """Returns the fields of a `Raster`."""
        pixels = image.reshape(-1) if image.flags.c_contiguous else np.ascontiguousarray(image).reshape(-1)
        channels = 1 if image.ndim == 2 else 3
        left, top, right, bottom = self._area
        return pixels, image.shape[1] * channels, channels, float(left), float(top), float(right), float(bottom)

    def _trace(
        self, frame: tuple[Any, ...], at: tuple[float, float], width: float, contrast: float, level: float, depth: int
    ) -> Trace:
        """Traces the entry ``at`` (u, v) on a line ``depth`` px inside the base line, and judges the result."""
        settings = self.settings
        known = settings.diameter_px or 0.0
        expected = settings.length_px or 0.0
        candidate = Candidate(
            sign=1.0 if settings.polarity == "light" else -1.0,
            u=at[0],
            v=at[1],
            heading=self._heading,
            width=width,
            contrast=contrast,
            level=level,
            diameter=known,
            max_gap=settings.max_gap_px,
            depth=float(depth),
            base_length=float(settings.base_columns),
            length=expected,
            tolerance=max(settings.length_tolerance * expected, MIN_TOLERANCE_RADII * 0.5 * known),
        )
        template = self._template if self._template.shape[1] == TEMPLATE_COLUMNS * frame[2] else NO_TEMPLATE
        fit: ShaftFit = solve_shaft(frame, tuple(candidate), template, self._stations, self._points, self._work)
        diameter, typical = fit.diameter, fit.contrast
        confidence = max(0.0, 1.0 - fit.blind / max(fit.length, 1.0))
        score = fit.length * confidence / (1.0 + 2.0 * fit.rms / max(diameter, 1.0))
        if not known:
            # a shaft together with its shadow is as long as the shaft, but its flanks are pale
            score *= typical / (typical + HALF_SCORE_CONTRAST_GREY)
        if fit.end == END_SHORT or fit.length < 2.5 * diameter or confidence < 0.4:
            return Trace(Status.VALID, "", 0.0, diameter if fit.n > 6 else 0.0, typical, confidence, fit.length)
        if known and abs(diameter / known - 1.0) > 0.28:
            return Trace(Status.VALID, "", 0.0, diameter, typical, confidence, fit.length)
        status, detail = self._judge(fit, expected, candidate.tolerance)
        if status is not Status.VALID:
            score *= REJECTED_SCORE_FACTOR
        where = f"({fit.last_u:.0f}, {fit.last_v:.0f})"
        base = (fit.base_u, fit.base_v, -fit.base_angle)
        probability = math.nan
        if status is Status.VALID:
            evidence = Evidence(*line_evidence(frame, self._points, 0.5 * diameter))
            probability = probability_right(
                *evidence,
                length_known=bool(expected) and settings.length_tolerance < MAX_LEARNT_TOLERANCE,
                difference=fit.difference,
                scatter=fit.rms / max(diameter, 1.0),
            )
            if probability < settings.least_probability:
                status, detail = (
                    Status.CUT_OFF,
                    (
                        f"the line that ends at {where} is the catheter with a probability of {probability:.0%} only: "
                        f"both flanks are visible on {evidence.seen_end:.0%} of its last stretch"
                    ),
                )
                score *= REJECTED_SCORE_FACTOR
        return Trace(status, detail, score, diameter, typical, confidence, fit.length, base, probability)

    def _judge(self, fit: ShaftFit, expected: float, tolerance: float) -> tuple[Status, str]:
        """Decides whether a traced shaft is the whole catheter; if not, says why."""
        settings = self.settings
        where = f"({fit.last_u:.0f}, {fit.last_v:.0f})"
        if fit.end == END_LOST:
            return Status.CUT_OFF, (
                f"the catheter is lost at {where}: it goes on behind a gap of about {fit.gap:.0f} px, "
                f"longer than max_gap_px = {settings.max_gap_px:g}"
            )
        left_image = fit.end == END_BORDER and fit.gap <= settings.max_gap_px
        # an end so near to the border may be a ring, with the rest of the shaft outside
        no_clear_tip = abs(fit.drop) < MIN_CLEAR_TIP_SHARE * fit.contrast
        if left_image or (no_clear_tip and self._beside_border(fit.last_u, fit.last_v, fit.diameter)):
            side = self._side_near(fit.last_u, fit.last_v)
            return (
                Status.CUT_OFF,
                f"the catheter leaves the image at the {side}, near {where}, before its tip is visible",
            )
        if expected and abs(fit.length - expected) > 1.4 * tolerance:
            return Status.CUT_OFF, (
                f"the visible shaft ends at {where} after {fit.length:.0f} px; the catheter is {expected:.0f} px long"
            )
        if fit.rest > MAX_UNFOLLOWED_FLOORS:
            return Status.CUT_OFF, (f"the shaft ends at {where}, but an object of the same appearance continues there")
        if fit.difference > MAX_TIP_DIFFERENCE_GREY:
            return Status.CUT_OFF, (
                f"the tip near {where} differs by {fit.difference:.0f} grey levels from other images: "
                "an object covers it, or the tip is elsewhere"
            )
        if fit.rms > MAX_SCATTER_DIAMETERS * fit.diameter and fit.diameter > THIN_SHAFT_PX:
            return Status.NO_CATHETER, (
                f"the flanks found scatter by {fit.rms:.2f} px about a smooth curve: too blurred, or not a shaft"
            )
        return Status.VALID, ""

    def _why_not(self, wrong: float) -> str:
        settings = self.settings
        kind = "light" if settings.polarity == "light" else "dark"
        place = "in the base region" if settings.base_region else f"at the {settings.base_side} border"
        if wrong and settings.diameter_px:
            return (
                f"the shaft that enters {place} is {wrong:.1f} px wide, the catheter is {settings.diameter_px:.1f} px"
            )
        return f"nothing {kind} with two parallel flanks enters {place}"

    def _beside_border(self, u: float, v: float, diameter: float) -> bool:
        u0, v0, u1, v1 = self._area
        return min(u - u0, v - v0, u1 - 1 - u, v1 - 1 - v) < diameter + 2.0

    def _side_near(self, u: float, v: float) -> str:
        u0, v0, u1, v1 = self._area
        return min((u - u0, "left"), (v - v0, "top"), (u1 - u, "right"), (v1 - v, "bottom"))[1]

    def _resize(self, height: int, width: int) -> None:
        """Sets searched area, search lines and buffers for frames of ``height`` and ``width`` in px.

        Leaves no search line where area or base line is too small, or the frame ends within 2 px inside the base line.
        """
        settings = self.settings
        self._size = (height, width)
        self._lines = []
        whole = (0, 0, width, height)
        self._area = _within(settings.roi or whole, whole)
        region = _within(settings.base_region or self._area, self._area)
        base, self._heading = _base_line(region, settings.base_side)
        self._base_pixels = base.pixels
        inner_u, inner_v = base.u + 2 * base.inward_u, base.v + 2 * base.inward_v
        inside = 0 <= inner_u < width and 0 <= inner_v < height
        if min(*_extent(self._area), base.pixels) < MIN_SIDE_PX or min(_extent(region)) < 1 or not inside:
            return  # the kernels check no index
        region_width, region_height = _extent(region)
        inward_px = region_width if base.inward_u else region_height
        # every second pixel is enough for a thick shaft; a failed search is repeated on all pixels
        coarse = min(4, max(1, int((settings.diameter_px or 0.0) / 6.0)))
        passes = SEARCH_PASSES if coarse == 1 else ((0, coarse), *SEARCH_PASSES)
        self._lines = [
            (depth, every, tuple(_search_line(base, depth, every)))
            for depth, every in passes
            if depth <= max(0, inward_px - 4)
        ]
        longest = max(height, width)
        self._line = np.zeros(longest)
        self._slope = np.zeros(longest)
