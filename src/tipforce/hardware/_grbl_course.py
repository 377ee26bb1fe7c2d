"""Sends a trajectory to a GRBL controller as short jogs that the planner joins into one smooth motion."""

import math
from collections import deque
from collections.abc import Callable, Mapping

Course = Callable[[float], Mapping[str, float]]
"""Time since the start in s -> position of each axis at this time, by name, in its own unit."""

SEGMENT_S = 0.025
"""Duration of a jog."""
AHEAD_S = 0.25
"""Time by which jogs are sent ahead: the planner holds 15 moves, 0.375 s, and needs them to brake in time."""
MAX_UNANSWERED_BYTES = 120
"""Most bytes of the receive buffer, which holds 127, for lines to which the controller has not responded yet."""
MAX_LINE_BYTES = 50
LATENESS_TIME_CONSTANT_S = 0.5
"""Time constant of the estimate of the lateness."""
MIN_POWER = 1.0
"""Square of a speed in units per s; slower motion shows little of the lateness."""
CATCH_UP_PER_S = 1.0
"""Share of the lateness that is corrected within a second."""
MAX_SPEED_CHANGE = 0.1
"""Largest relative change of the speed of the trajectory."""


class CourseStream:
    """Makes the jogs of a trajectory in time, counts the responses of the controller, and corrects the lateness.

    Args:
        course: the motion; at 0 s the axes are at rest at its beginning.
        line_of: returns the line of a jog to given positions that takes a given time in s.
        start_s: beginning of the trajectory, on the clock of `due` and `read`; no line is sent before, because the
            controller moves as soon as it has a jog.
    """

    def __init__(self, course: Course, line_of: Callable[[Mapping[str, float], float], str], start_s: float) -> None:
        self._course, self._line_of, self._start_s = course, line_of, start_s
        self._sent_s = 0.0
        self._unanswered: deque[int] = deque()
        self.late_s = 0.0
        """Lateness of the axes, estimated from their positions."""
        self._power = 0.0
        self._read_s: float | None = None

    @property
    def ended(self) -> bool:
        """Whether `end` was called."""
        return self._sent_s == math.inf

    def end(self) -> None:
        """Ends the trajectory: no more lines are sent; the responses to the sent ones are still expected."""
        self._sent_s = math.inf

    def due(self, now_s: float) -> list[str]:
        """Returns the lines to send now; the receive buffer has room for them."""
        lines: list[str] = []
        if now_s < self._start_s:
            return lines
        until_s = now_s - self._start_s + AHEAD_S
        while self._sent_s < until_s and sum(self._unanswered) + MAX_LINE_BYTES <= MAX_UNANSWERED_BYTES:
            faster = min(max(CATCH_UP_PER_S * self.late_s, -MAX_SPEED_CHANGE), MAX_SPEED_CHANGE)
            line = self._line_of(self._course(self._sent_s + SEGMENT_S), SEGMENT_S / (1.0 + faster))
            self._sent_s += SEGMENT_S
            self._unanswered.append(len(line))
            lines.append(line)
        return lines

    @property
    def unanswered(self) -> int:
        """Number of lines to which the controller has not responded yet."""
        return len(self._unanswered)

    def answered(self) -> bool:
        """Processes an ``ok``; returns whether it was for a line of the trajectory."""
        if self._unanswered:
            self._unanswered.popleft()
            return True
        return False

    def read(self, places: Mapping[str, float], now_s: float) -> None:
        """Updates the estimate of the lateness: position error = speed x lateness, least squares over axes and time.

        Args:
            places: position of each axis, by name, in its own unit.
            now_s: time of these positions, on the clock of ``start_s``.
        """
        course_s = now_s - self._start_s
        seconds, self._read_s = (0.0 if self._read_s is None else now_s - self._read_s), now_s
        if course_s < SEGMENT_S:
            return
        planned, before, after = (self._course(course_s + side) for side in (0.0, -SEGMENT_S, SEGMENT_S))
        late_power = power = 0.0
        for axis, planned_position in planned.items():
            speed = (after[axis] - before[axis]) / (2.0 * SEGMENT_S)
            late_power += (planned_position - places[axis]) * speed
            power += speed * speed
        # weight of this reading: larger the longer ago the last one was
        share = -math.expm1(-seconds / LATENESS_TIME_CONSTANT_S)
        self._power += share * (power - self._power)
        self.late_s += share * (late_power - self.late_s * power) / max(self._power, MIN_POWER)
