"""The twin's drives, commanded as a real bench's are."""

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Self

from ..types import ADVANCE, KNOB, STAGE_ACROSS, STAGE_FORWARD, Actuation, AxisLimits, Clock, Commanded, refuse_unknown
from .world import CourseRun, Drive, WorldSettings, instants_until

__all__ = ["SimulatedActuators"]

_PER_UNIT = {ADVANCE: 1e3, KNOB: 1.0, STAGE_FORWARD: 1e3, STAGE_ACROSS: 1e3}
_DIGITS = {ADVANCE: 4, KNOB: 2, STAGE_FORWARD: 4, STAGE_ACROSS: 4}


class SimulatedActuators:
    """`Actuators` of a run of the twin: ``advance_mm``, ``knob_deg`` where there is a knob, and the stage's two axes.

    Each plays the session's own programme until it is commanded or stopped. A command counts from the first instant
    after ``clock``'s time; its effect begins after the axis's delay. ``reach`` lets the course happen up to an instant,
    exclusive, and holds ``lock`` meanwhile, so that another thread than the one that takes events may command.
    """

    def __init__(
        self,
        settings: WorldSettings,
        run: CourseRun,
        clock: Clock,
        reach: Callable[[int], None],
        lock: AbstractContextManager[Any],
    ) -> None:
        self._run, self._clock, self._reach, self._lock = run, clock, reach, lock
        drives = {ADVANCE: run.clamp, KNOB: run.knob, STAGE_FORWARD: run.forward, STAGE_ACROSS: run.across}
        if settings.actuation.gain_per_m_deg == 0.0:
            del drives[KNOB]
        self._drives: dict[str, Drive] = drives
        self._limits = {name: _limits(drive, _PER_UNIT[name]) for name, drive in drives.items()}
        self._open = True

    @property
    def limits(self) -> Mapping[str, AxisLimits]:
        """What each axis keeps to, in mm or degrees."""
        return dict(self._limits)

    def command(self, targets: Mapping[str, float]) -> Commanded:
        """Send axes on their way; see `Actuators.command`. Raises RuntimeError once the bench is closed."""
        with self._lock:
            taken = Commanded.of(self._now_ns(), targets, self._limits)
            for name, target in taken.targets.items():
                self._tell(name, taken.stamp_ns, target / _PER_UNIT[name])
            return taken

    def read(self) -> Actuation:
        """Where the axes are at the clock's time, in whole steps."""
        now = self._now_ns()
        course = self._run.course
        row = min(instants_until(now * 1e-9), course.time_s.size) - 1
        self._reach(row + 1)
        places = {
            ADVANCE: course.advance_m[row],
            KNOB: course.knob_deg[row],
            STAGE_FORWARD: course.stage_m[row, 0],
            STAGE_ACROSS: course.stage_m[row, 1],
        }
        values = {name: round(_PER_UNIT[name] * float(places[name]), _DIGITS[name]) for name in self._drives}
        return Actuation(now, values)

    def stop(self, *axes: str) -> None:
        """Bring these axes, or all, to rest; see `Actuators.stop`."""
        refuse_unknown(axes, self._limits)
        with self._lock:
            now = self._now_ns()
            for name in axes or self._drives:
                self._tell(name, now, math.nan)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            self.stop()
        self._open = False

    def _now_ns(self) -> int:
        if not self._open:
            raise RuntimeError("the bench is closed; its axes stand still")
        return self._clock.now_ns()

    def _tell(self, name: str, now_ns: int, target: float) -> None:
        drive = self._drives[name]
        drive.command(max(instants_until(now_ns * 1e-9), self._run.done - drive.late), target)


def _limits(drive: Drive, per_unit: float) -> AxisLimits:
    model = drive.model
    return AxisLimits(*(per_unit * x for x in (model.low, model.high, model.max_speed, model.max_acceleration)))
