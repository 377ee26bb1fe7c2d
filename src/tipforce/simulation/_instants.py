"""The course of a session at any time, between the instants at which it was computed."""

import numpy as np

from ..types import FloatArray, IntArray
from .rendering.camera import TissueState
from .world import LEAD_S, STEP_S, Course, Pace, Rig, smooth_lines

__all__ = ["Instants"]

_POINTS = 97
"""Of the true centreline: half a millimetre apart."""


class Instants:
    """A course may still be growing; it is asked for what has happened already.

    It knows nothing of the bench, whose pictures hold it: a bench that is no longer used goes at once, with all that
    is painted.
    """

    def __init__(self, course: Course, rig: Rig, pace: Pace) -> None:
        self._course, self._rig, self._pace = course, rig, pace

    def place(self, time_s: FloatArray) -> tuple[IntArray, FloatArray]:
        """Instant before each time, and how far it is from there to the next."""
        place = (time_s + LEAD_S) / (STEP_S * self._pace.every)
        low = np.clip(np.floor(place).astype(np.int64), 0, self._course.time_s.size - 2)
        return low, place - low

    def nearest(self, time_s: FloatArray) -> IntArray:
        """(k,) the course's instants nearest to ``time_s``."""
        low, share = self.place(time_s)
        return low + (share >= 0.5)

    def at(self, values: FloatArray, time_s: FloatArray) -> FloatArray:
        """``values`` (m, ...) of the course at ``time_s`` (k,): linear between instants."""
        low, share = self.place(time_s)
        part = share.reshape(-1, *[1] * (values.ndim - 1))
        return values[low] * (1 - part) + values[low + 1] * part

    def lines_m(self, time_s: FloatArray) -> FloatArray:
        """(k, points, 3): the centreline at ``time_s`` (k,), base frame, base to apex, uniform in arc length."""
        low, share = self.place(time_s)
        course, rod = self._course, self._rig.rod
        before, after = (
            smooth_lines(rod, course.contact.quaternions[rows], _POINTS, course.advance_m[rows])
            for rows in (low, low + 1)
        )
        return before + share[:, None, None] * (after - before)

    def exposure(self, middle_s: float, length_s: float, count: int) -> tuple[FloatArray, TissueState]:
        """Shapes (count, points, 3) and tissue, evenly over an exposure; of one instant: its middle."""
        times = middle_s + 0.5 * length_s * (np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1))
        course = self._course
        now = np.array([middle_s])
        tissue = TissueState(
            shift_m=self.at(course.wall_m, times) - self._rig.touch_m,
            dent_m=float(self.at(course.contact.indentation_m, now)[0]),
            touch_m=self.at(course.contact.touch_m, now)[0],
        )
        return self.lines_m(times), tissue
