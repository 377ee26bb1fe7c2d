"""The `fine` method: ordered tracing from base to tip with sub-pixel edges on both flanks.

Only the pixels around the two flanks are ever read. A frame goes through four steps, each in its own file: entries
on the base line (`_fine_entry`), tracing (`_fine_trace`), a smooth curve and its tip (`_fine_fit`), and here the
judgement whether what was found is the catheter.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..types import BasePose, CentrelinePx, Image, IntArray, Status
from ._fine_aim import ACROSS, ROWS
from ._fine_entry import find_entries
from ._fine_solve import RESULT_SIZE, WORK_SIZE, solve_shaft
from ._fine_trace import END_BORDER, END_LOST, END_SHORT
from ._settings import BaseSide, VisionSettings
from ._sighting import Sighting

__all__ = ["FineTracer", "Trace", "base_line"]

_PASSES = ((0, 1), (4, 1), (8, 1), (12, 1), (18, 1))
"""How far inside the base line entries are looked for, and every how many pixels along it."""
_MAX_TRACED = 6
_CLEAR_TIP = 0.35
"""Beside the border only a drop of this share of the shaft's contrast is taken for its tip."""
_DOUBT = 15.0
"""Evidence of something that goes on beyond the end and was not followed, from which on the end is not believed."""
_UNLIKE = 20.0
"""Grey levels by which a metal end may be off, on average, from how it looks in the session's other pictures."""
_SCATTER, _THIN_PX = 0.026, 6.0
"""The centres may lie off a smooth curve by this share of the diameter; on thinner shafts whole pixels show."""
_PALE = 40.0
"""While the diameter is open, a shaft of this contrast counts half as much as one of the strongest."""
_LEAST_GIVE = 0.4
"""No length is known better than to this share of the radius."""
_NO_LOOK = np.zeros((0, 0))
_OBLIQUE = 1.6
"""A shaft that enters at 50 degrees is this much wider along the border than across its axis."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One candidate followed to its end."""

    status: Status
    detail: str
    score: float
    diameter_px: float
    contrast: float
    confidence: float
    length_px: float
    base: tuple[float, float, float]


def base_line(box: tuple[int, int, int, int], side: BaseSide) -> tuple[tuple[int, ...], float]:
    """The line of pixels along ``side`` of ``box``, as `find_entries` wants it, and the heading into the picture."""
    u0, v0, u1, v1 = box
    match side:
        case "left":
            return (u0, v0, 0, 1, v1 - v0, 1, 0), 0.0
        case "right":
            return (u1 - 1, v0, 0, 1, v1 - v0, -1, 0), math.pi
        case "top":
            return (u0, v0, 1, 0, u1 - u0, 0, 1), math.pi / 2
        case _:
            return (u0, v1 - 1, 1, 0, u1 - u0, 0, -1), -math.pi / 2


class FineTracer:
    """Sees one frame after another with the same settings; holds buffers, but no memory of what it saw.

    ``settings``: polarity and base side must be settled (not "auto").
    """

    def __init__(self, settings: VisionSettings) -> None:
        self.settings = settings
        self._box = np.zeros(4)
        self._line = np.zeros(8)
        self._slope = np.zeros(8)
        self._edges = np.zeros(256, dtype=np.int64)
        self._entries = np.zeros((12, 4))
        self._start = np.zeros(7, dtype=np.int64)
        self._stations = np.zeros((1200, 6))
        self._result = np.zeros(RESULT_SIZE)
        self._points = np.zeros((settings.points, 2))
        self._best = np.zeros((settings.points, 2))
        self._plan = np.zeros(12)
        self._work = np.zeros(WORK_SIZE + 2 * settings.points)
        self._look = np.array(settings.end_look, dtype=np.float64).reshape(ROWS, -1) if settings.end_look else _NO_LOOK
        self._size = (0, 0)
        self._area = (0, 0, 0, 0)
        # of the base line: its pixels, the heading into the picture; the lines that are searched (`_resize`)
        self._base = 0, 0.0
        self._lines: list[tuple[int, int, IntArray]] = []

    def see(self, image: Image) -> Sighting:
        """The catheter in ``image`` (h, w) or (h, w, 3) RGB, uint8; or the reason why it was not found."""
        trace, reason = self.look(image)
        if trace is None:
            return Sighting(Status.NO_CATHETER, reason)
        if trace.status is not Status.VALID:
            return Sighting(trace.status, trace.detail)
        u, v, angle = trace.base
        return Sighting(
            Status.VALID,
            "",
            CentrelinePx(self._best),
            BasePose(np.array([u, v]), angle),
            trace.diameter_px,
            trace.confidence,
        )

    def look(self, image: Image) -> tuple[Trace | None, str]:
        """The best trace of ``image`` (valid or not), or None and why there is none."""
        settings = self.settings
        if image.shape[:2] != self._size:
            self._resize(image.shape[0], image.shape[1])
        pixels = image.reshape(-1) if image.flags.c_contiguous else np.ascontiguousarray(image).reshape(-1)
        channels = 1 if image.ndim == 2 else 3
        row = image.shape[1] * channels
        sign = 1.0 if settings.polarity == "light" else -1.0
        known = settings.diameter_px or 0.0
        n_line, heading = self._base
        if known:
            low, high = max(2.0, 0.72 * known - 1.0), _OBLIQUE * 1.1 * known + 1.0
        else:
            low, high = 3.0, (0.9 if settings.base_region else 0.3) * n_line
        threshold = -1.0 if settings.threshold is None else float(settings.threshold)
        best: Trace | None = None
        wrong = 0.0
        for depth, every, line in self._lines:
            self._start = line
            count = find_entries(
                pixels, row, channels, line, sign, low if known == 0.0 else 2.0,
                high / every, threshold, 12.0, self._line, self._slope, self._edges, self._entries,
            )  # fmt: skip
            traced = 0
            for k in range(count):
                at, width, contrast, inside = self._entries[k].tolist()
                width *= every
                if width < low - every + 1:
                    wrong = wrong or width
                    continue
                if traced == _MAX_TRACED:
                    break
                traced += 1
                self._result[3] = sign * inside
                trace = self._follow(pixels, row, channels, sign, heading, at, width, contrast, known, depth)
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

    def _follow(
        self, pixels: Any, row: int, channels: int, sign: float, heading: float, at: float, width: float,
        contrast: float, known: float, depth: int,
    ) -> Trace:  # fmt: skip
        settings = self.settings
        expected = settings.length_px or 0.0
        give = max(settings.length_tolerance * expected, _LEAST_GIVE * 0.5 * known)
        start = self._start
        u = float(start[0] + at * start[2])
        v = float(start[1] + at * start[3])
        self._plan[:] = (
            sign, u, v, heading, width, contrast, known, settings.max_gap_px, depth, settings.base_columns,
            expected, give,
        )  # fmt: skip
        look = self._look if self._look.shape[1] == ACROSS * channels else _NO_LOOK
        n, end = solve_shaft(
            pixels, row, channels, self._box, self._plan, look, self._stations, self._result, self._points, self._work
        )
        _, diameter, typical, _, gap, blind, length, drop, base_u, base_v, angle, rms, last_u, last_v, doubt, unlike = (
            self._result.tolist()
        )
        confidence = max(0.0, 1.0 - blind / max(length, 1.0))
        status, detail = Status.VALID, ""
        score = length * confidence / (1.0 + 2.0 * rms / max(diameter, 1.0))
        if not known:
            # a shaft together with its shadow is as long as the shaft, but its flanks are pale
            score *= typical / (typical + _PALE)
        if end == END_SHORT or length < 2.5 * diameter or confidence < 0.4:
            return Trace(status, "", 0.0, diameter if n > 6 else 0.0, typical, confidence, length, (0, 0, 0))
        if known and abs(diameter / known - 1.0) > 0.28:
            return Trace(status, "", 0.0, diameter, typical, confidence, length, (0, 0, 0))
        where = f"({last_u:.0f}, {last_v:.0f})"
        if end == END_LOST:
            status = Status.CUT_OFF
            detail = (
                f"the catheter is lost at {where}: it goes on behind a gap of about {gap:.0f} px, "
                f"longer than max_gap_px = {settings.max_gap_px:g}"
            )
            score *= 0.2
        elif (end == END_BORDER and gap <= settings.max_gap_px) or (
            abs(drop) < _CLEAR_TIP * typical and self._beside_border(last_u, last_v, diameter)
        ):
            # what ends so near to the border may as well be a ring, with the rest of the shaft outside
            status = Status.CUT_OFF
            side = self._side_near(last_u, last_v)
            detail = f"the catheter leaves the picture at the {side}, near {where}, before its tip is seen"
            score *= 0.2
        elif expected and abs(length - expected) > 1.4 * give:
            status = Status.CUT_OFF
            detail = f"what is seen ends at {where} after {length:.0f} px; the catheter is {expected:.0f} px long"
            score *= 0.2
        elif doubt > _DOUBT:
            status = Status.CUT_OFF
            detail = f"the shaft ends at {where}, but something goes on there that cannot be told from the catheter"
            score *= 0.2
        elif unlike > _UNLIKE:
            status = Status.CUT_OFF
            detail = (
                f"the end near {where} differs by {unlike:.0f} grey levels from how it looks in other pictures: "
                "something covers it, or it lies elsewhere"
            )
            score *= 0.2
        elif rms > _SCATTER * diameter and diameter > _THIN_PX:
            status = Status.NO_CATHETER
            detail = f"the flanks found scatter by {rms:.2f} px about a smooth curve: too blurred, or not a shaft"
            score *= 0.2
        return Trace(status, detail, score, diameter, typical, confidence, length, (base_u, base_v, -angle))

    def _why_not(self, wrong: float) -> str:
        settings = self.settings
        kind = "light" if settings.polarity == "light" else "dark"
        place = "in the base region" if settings.base_region else f"at the {settings.base_side} border"
        if wrong and settings.diameter_px:
            return f"what enters {place} is {wrong:.1f} px wide, the catheter is {settings.diameter_px:.1f} px"
        return f"nothing {kind} with two parallel flanks enters {place}"

    def _beside_border(self, u: float, v: float, diameter: float) -> bool:
        u0, v0, u1, v1 = self._area
        return min(u - u0, v - v0, u1 - 1 - u, v1 - 1 - v) < diameter + 2.0

    def _side_near(self, u: float, v: float) -> str:
        u0, v0, u1, v1 = self._area
        return min((u - u0, "left"), (v - v0, "top"), (u1 - u, "right"), (v1 - v, "bottom"))[1]

    def _depth(self, region: tuple[int, int, int, int], along_u: int) -> int:
        u0, v0, u1, v1 = self._clip(region)
        inward = u1 - u0 if along_u else v1 - v0
        return max(0, inward - 4)

    def _clip(self, box: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
        u0, v0, u1, v1 = self._area
        return max(u0, box[0]), max(v0, box[1]), min(u1, box[2]), min(v1, box[3])

    def _resize(self, height: int, width: int) -> None:
        self._size = (height, width)
        self._area = (0, 0, width, height)
        if self.settings.roi:
            self._area = self._clip(self.settings.roi)
        self._box[:] = self._area
        region = self.settings.base_region or self._area
        (u, v, du, dv, n_line, eu, ev), heading = base_line(self._clip(region), self.settings.base_side)
        self._base = n_line, heading
        # a stout shaft is not overlooked by reading every second pixel only; what fails is looked for in all of them
        coarse = min(4, max(1, int((self.settings.diameter_px or 0.0) / 6.0)))
        passes = _PASSES if coarse == 1 else ((0, coarse), *_PASSES)
        self._lines = [
            (depth, every, np.array([u + eu * depth, v + ev * depth, du * every, dv * every, n_line // every, eu, ev]))
            for depth, every in passes
            if depth <= self._depth(region, eu)
        ]
        longest = max(height, width)
        self._line = np.zeros(longest)
        self._slope = np.zeros(longest)
