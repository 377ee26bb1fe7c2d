"""The twin while it runs: events as they arrive, drives that may be commanded, time that is simulated or real."""

import threading
from collections.abc import Iterator
from functools import cached_property
from types import TracebackType
from typing import Self

import numpy as np

from ..types import Clock, Event, IntArray, SimulatedClock, SystemClock
from ._actuators import SimulatedActuators
from ._bench import SimulatedBench
from ._settings import AnySimulationSettings
from ._sidecar import Truth, truth_of
from .world import Course, CourseRun, Session, instants_until

__all__ = ["LiveSimulation"]

_PICTURES = 3
"""The first stream of pictures in a schedule."""


class _LiveSource(SimulatedBench):
    """A session of ``plan`` that happens while it is looked at: its events, in the order in which they arrive."""

    def __init__(self, plan: SimulatedBench, run: CourseRun, *, real_time: bool, pictures: bool) -> None:
        super().__init__(plan.settings, plan.seed, plan.number)
        self._plan, self.run, self._pictures = plan, run, pictures
        self._next = 0
        self.lock = threading.RLock()
        self._late = min(drive.late for drive in run.drives)
        self._order = self.schedule()
        start_ns = min(0, self._order[0][0])
        self.clock: Clock = SystemClock(start_ns) if real_time else SimulatedClock(start_ns)

    @property
    def session(self) -> Session:  # pyright: ignore[reportIncompatibleVariableOverride]
        """What is drawn: the truth."""
        return self._plan.session

    @property
    def course(self) -> Course:
        """What has happened so far."""
        return self.run.course

    def _rows_known(self) -> int:
        return self.run.settled

    def _delays_ns(self) -> tuple[int, ...]:
        clock = self.settings.world.clock
        picture = 0.5 * self.imaging.exposure_s + clock.camera_delay_s
        delays = (clock.force_delay_s, clock.drive_delay_s, clock.drive_delay_s, picture)
        return tuple(round(1e9 * delay) for delay in delays)

    @cached_property
    def _needs(self) -> tuple[IntArray, ...]:
        """By stream: how many instants of the course must have happened for each event."""
        readings = self.readings
        settled = (readings.need_force, readings.stage.need, readings.joints.need)
        return *(need + 2 for need in settled), *(self._frames_need[self.arrived(view)] for view in self.views)

    @cached_property
    def _frames_need(self) -> IntArray:
        """(n,): how many instants must have happened for each frame, whichever view it arrives in."""
        low, _ = self.instants.place(self.frame_s + 0.5 * self.imaging.exposure_s)
        return low + 2

    def reach(self, rows: int, now_ns: int | None = None) -> None:
        """Let the first ``rows`` instants happen, and those besides that no command from ``now_ns`` on can change."""
        with self.lock:
            if rows > self.run.done:
                now = self.clock.now_ns() if now_ns is None else now_ns
                self.run.advance(max(rows, instants_until(now * 1e-9) + self._late))
                self.readings.take(self.course, self.run.settled)

    def frames_so_far(self) -> IntArray:
        """(n,): the frames whose exposure has happened."""
        return np.flatnonzero(self._frames_need <= self.run.done)

    def __iter__(self) -> Iterator[Event]:
        while self._next < len(self._order):
            at_ns, stream, row = self._order[self._next]
            self._next += 1
            if stream >= _PICTURES and not self._pictures:
                continue
            self.reach(int(self._needs[stream][row]), at_ns)
            event = self.event(stream, row)
            self.clock.sleep_until_ns(at_ns)
            yield event


class LiveSimulation:
    """Session ``session`` of ``seed`` on the bench of ``settings``, as it happens. A context manager.

    ``source``: its events, in the order in which a program at the bench would have them (see ``ClockSettings`` for
    the delays); going on with it makes time go on. ``actuators``: its drives. ``clock``: simulated, which stands at
    the event that came last, or with ``real_time`` the machine's, which it waits for. Without ``pictures`` none are
    drawn.

    While nobody commands a drive the events are those of `SimulatedBench`, each of them the same bytes. A command
    changes what happens from its own time on, after the drive's delay. On simulated time the same commands after the
    same events give the same bytes. Entering it again begins the session anew; the first time takes some seconds, for
    the session is drawn and tried out before. docs/simulation.md has a closed loop.
    """

    def __init__(
        self,
        settings: AnySimulationSettings | None = None,
        seed: int = 0,
        session: int = 0,
        *,
        real_time: bool = False,
        pictures: bool = True,
    ) -> None:
        self._plan = SimulatedBench(settings, seed, session)
        self._real_time, self._pictures = real_time, pictures
        self._begun: tuple[_LiveSource, SimulatedActuators] | None = None

    def __enter__(self) -> Self:
        run = self._plan.session.begin()
        source = _LiveSource(self._plan, run, real_time=self._real_time, pictures=self._pictures)
        self._begun = (
            source,
            SimulatedActuators(self._plan.settings.world, run, source.clock, source.reach, source.lock),
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.actuators.__exit__(kind, error, trace)

    def _entered(self) -> tuple[_LiveSource, SimulatedActuators]:
        if self._begun is None:
            raise RuntimeError("the bench is not open: use it in a with statement")
        return self._begun

    @property
    def source(self) -> SimulatedBench:
        """The events, each once: who stops and goes on later gets the next one."""
        return self._entered()[0]

    @property
    def actuators(self) -> SimulatedActuators:
        """The drives."""
        return self._entered()[1]

    @property
    def clock(self) -> Clock:
        """Time on the camera's clock."""
        return self._entered()[0].clock

    def truth(self) -> Truth:
        """What really was in every frame so far: for evaluation only. What is told of drives is what was commanded."""
        source = self._entered()[0]
        return truth_of(source, source.frames_so_far())
