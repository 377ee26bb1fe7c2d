"""A course for a GRBL controller: short jogs that the planner joins into one smooth motion."""

import math
from collections import deque
from collections.abc import Callable, Mapping

Course = Callable[[float], Mapping[str, float]]
"""Time since the start in s -> where each axis shall be then, by name, in its own unit."""

SEGMENT_S = 0.025
"""A jog covers so much time."""
AHEAD_S = 0.25
"""So far ahead jogs are sent: the planner holds 15 moves, 0.375 s, and has to see where it can brake."""
_RECEIVE_BYTES = 120
"""Lines that the controller has not answered yet take at most so much of its receive buffer, which holds 127."""
_LONGEST_LINE = 50
_MEMORY_S = 0.5
"""Time constant with which it is learnt how late the axes are."""
_LEAST_POWER = 1.0
"""Square of a speed in units per s, below which motion says little of a lateness."""
_CATCH_UP = 1.0
"""Share of the lateness that is made up for within a second."""
_MOST_CATCH_UP = 0.1
"""At most so much faster or slower than the course."""


class CourseStream:
    """Makes the jogs of a course in time, counts what the controller has answered, and keeps the course's time.

    Args:
        course: the motion; at 0 s the axes are at rest at its beginning.
        line_of: a jog to these places in so many seconds, as a line of the controller.
        start_s: when the course begins, on the clock of `due` and `read`; nothing is sent before, for the controller
            sets out as soon as it has a jog.
    """

    def __init__(self, course: Course, line_of: Callable[[Mapping[str, float], float], str], start_s: float) -> None:
        self._course, self._line_of, self._start_s = course, line_of, start_s
        self._sent_s = 0.0
        self._unanswered: deque[int] = deque()
        self.late_s = 0.0
        """How late the axes are, as learnt from what they read back."""
        self._power = 0.0
        self._read_s: float | None = None

    @property
    def ended(self) -> bool:
        """Whether `end` was called."""
        return self._sent_s == math.inf

    def end(self) -> None:
        """No more lines; what was sent is still to be answered."""
        self._sent_s = math.inf

    def due(self, now_s: float) -> list[str]:
        """Returns the lines that are to be sent now; the receive buffer has room for them."""
        lines: list[str] = []
        if now_s < self._start_s:
            return lines
        until_s = now_s - self._start_s + AHEAD_S
        while self._sent_s < until_s and sum(self._unanswered) + _LONGEST_LINE <= _RECEIVE_BYTES:
            faster = min(max(_CATCH_UP * self.late_s, -_MOST_CATCH_UP), _MOST_CATCH_UP)
            line = self._line_of(self._course(self._sent_s + SEGMENT_S), SEGMENT_S / (1.0 + faster))
            self._sent_s += SEGMENT_S
            self._unanswered.append(len(line))
            lines.append(line)
        return lines

    @property
    def unanswered(self) -> int:
        """Lines that the controller has not answered yet."""
        return len(self._unanswered)

    def answered(self) -> bool:
        """Takes an ``ok``; returns whether it was for a line of the course."""
        if self._unanswered:
            self._unanswered.popleft()
            return True
        return False

    def read(self, places: Mapping[str, float], now_s: float) -> None:
        """Learns how late the axes are.

        Args:
            places: where each axis is, by name, in its own unit.
            now_s: when it was there, on the clock of ``start_s``.
        """
        at_s = now_s - self._start_s
        seconds, self._read_s = (0.0 if self._read_s is None else now_s - self._read_s), now_s
        if at_s < SEGMENT_S:
            return
        wanted, before, after = (self._course(at_s + side) for side in (0.0, -SEGMENT_S, SEGMENT_S))
        behind = power = 0.0
        for axis, place in wanted.items():
            speed = (after[axis] - before[axis]) / (2.0 * SEGMENT_S)
            behind += (place - places[axis]) * speed
            power += speed * speed
        share = -math.expm1(-seconds / _MEMORY_S)
        self._power += share * (power - self._power)
        self.late_s += share * (behind - self.late_s * power) / max(self._power, _LEAST_POWER)
