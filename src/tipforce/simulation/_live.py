"""A simulated session in progress: events as they arrive, drives that take commands, simulated or real time."""

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import cached_property
from typing import Any, Self

import numpy as np

from .._system.contexts import ClosedAtExit
from ..types import (
    ADVANCE,
    KNOB,
    STAGE_ACROSS,
    STAGE_FORWARD,
    Actuation,
    AxisLimits,
    Clock,
    Commanded,
    Event,
    IntArray,
    SimulatedClock,
    SystemClock,
    refuse_unknown,
)
from ._bench import SimulatedBench
from ._ground_truth import Truth, collect_truth
from ._settings import AnySimulationSettings
from .world import Drive, Session, Trajectory, TrajectoryIntegrator, WorldSettings, instants_until

_PER_UNIT = {ADVANCE: 1e3, KNOB: 1.0, STAGE_FORWARD: 1e3, STAGE_ACROSS: 1e3}
"""Factor from the unit of a drive (m or degrees) to that of commands and readings (mm or degrees)."""
_DIGITS = {ADVANCE: 4, KNOB: 2, STAGE_FORWARD: 4, STAGE_ACROSS: 4}
"""Decimals of a reading."""


class SimulatedActuators(ClosedAtExit):
    """The `Actuators` of a session: ``advance_mm``, ``knob_deg`` where there is a knob, and the stage's two axes.

    Each axis follows the session's own programme until it is commanded or stopped. A command counts from the first
    instant after ``clock``'s time; its effect begins after the axis's delay.

    Args:
        settings: settings of the world.
        run: the trajectory in progress.
        clock: clock of the commands.
        reach: simulates the trajectory up to an instant, exclusive.
        lock: lock that is held meanwhile, so that commands may come from another thread than the one that takes events.
    """

    def __init__(
        self,
        settings: WorldSettings,
        run: TrajectoryIntegrator,
        clock: Clock,
        reach: Callable[[int], None],
        lock: AbstractContextManager[Any],
    ) -> None:
        """Sets up the axes; there is no knob axis if the device has no knob."""
        self._run, self._clock, self._reach, self._lock = run, clock, reach, lock
        drives = {ADVANCE: run.clamp, KNOB: run.knob, STAGE_FORWARD: run.forward, STAGE_ACROSS: run.across}
        if settings.actuation.gain_per_m_deg == 0.0:
            del drives[KNOB]
        self._drives: dict[str, Drive] = drives
        self._home = dict.fromkeys(drives, 0.0) | {ADVANCE: settings.clamp.home_m}
        self._limits = {name: self._limits_of(name) for name in drives}
        self._open = True

    @property
    def limits(self) -> Mapping[str, AxisLimits]:
        """Limits of each axis, in mm or degrees."""
        return dict(self._limits)

    def command(self, targets: Mapping[str, float]) -> Commanded:
        """Sends axes to targets; see `Actuators.command`.

        Args:
            targets: target of each axis, by name.

        Returns:
            The command as it takes effect.

        Raises:
            RuntimeError: the bench is closed.
            ValueError: an axis is unknown or a value is not finite.
        """
        with self._lock:
            accepted = Commanded.of(self._now_ns(), targets, self._limits)
            for name, target in accepted.targets.items():
                self._command_axis(name, accepted.stamp_ns, target / _PER_UNIT[name] - self._home[name])
            return accepted

    def read(self) -> Actuation:
        """Returns the positions of the axes at the clock's time, in whole steps."""
        now_ns = self._now_ns()
        trajectory = self._run.trajectory
        row = min(instants_until(now_ns * 1e-9), trajectory.time_s.size) - 1
        self._reach(row + 1)
        positions = {
            ADVANCE: trajectory.advance_m[row],
            KNOB: trajectory.knob_deg[row],
            STAGE_FORWARD: trajectory.stage_m[row, 0],
            STAGE_ACROSS: trajectory.stage_m[row, 1],
        }
        values = {
            name: round(_PER_UNIT[name] * (float(positions[name]) + self._home[name]), _DIGITS[name])
            for name in self._drives
        }
        return Actuation(now_ns, values)

    def stop(self, *axes: str) -> None:
        """Stops these axes, or all; see `Actuators.stop`."""
        refuse_unknown(axes, self._limits)
        with self._lock:
            now = self._now_ns()
            for name in axes or self._drives:
                self._command_axis(name, now, math.nan)

    def close(self) -> None:
        """Stops all axes; they do not move again."""
        if self._open:
            self.stop()
        self._open = False

    def _now_ns(self) -> int:
        if not self._open:
            raise RuntimeError("the bench is closed; its axes stand still")
        return self._clock.now_ns()

    def _limits_of(self, name: str) -> AxisLimits:
        model, home = self._drives[name].model, self._home[name]
        limits = model.low + home, model.high + home, model.max_speed, model.max_acceleration
        return AxisLimits(*(_PER_UNIT[name] * x for x in limits))

    def _command_axis(self, name: str, now_ns: int, target: float) -> None:
        drive = self._drives[name]
        drive.command(max(instants_until(now_ns * 1e-9), self._run.done - drive.late), target)


_FIRST_IMAGE_STREAM = 3
"""The first stream of images in a schedule."""
_BEHIND_NS = 50_000_000
"""If a simulation in real time is late by more than this, its clock is set back: on a slow computer it runs slower."""
_PACE_NS = 5_000_000_000
"""Time over which the pace is measured."""
_HALT_NS = 2_000_000_000
"""A longer delay is not due to a slow computer: code was compiled, or no thread took the events."""


class RealTimeClock(SystemClock):
    """The machine's clock, which is set back where the simulation is late; it starts at ``start_ns``."""

    def __init__(self, start_ns: int) -> None:
        super().__init__(start_ns)
        self._machine = SystemClock()
        self._began_ns = self._machine.now_ns()
        self._lost: deque[tuple[int, int]] = deque()

    def wait_for(self, at_ns: int) -> None:
        """Sets the clock back to ``at_ns`` if that was more than 50 ms ago: the simulation was too slow.

        The lost time is counted in `pace`, except a single long delay: code was compiled, or nobody took the events.
        """
        behind_ns = self.now_ns() - at_ns
        if behind_ns <= _BEHIND_NS:
            return
        self._zero_ns += behind_ns
        if behind_ns < _HALT_NS:
            now_ns = self._machine.now_ns()
            self._lost.append((now_ns, behind_ns))
            while self._lost[0][0] < now_ns - _PACE_NS:
                self._lost.popleft()

    @property
    def pace(self) -> float:
        """Seconds of this clock per second of the machine's clock, over the last five; 1 on a fast computer."""
        now_ns = self._machine.now_ns()
        lost_ns = sum(lost_here for at_ns, lost_here in tuple(self._lost) if at_ns >= now_ns - _PACE_NS)
        return max(0.0, 1.0 - lost_ns / min(_PACE_NS, max(1, now_ns - self._began_ns)))


class _LiveSource(SimulatedBench):
    """A session of ``plan`` that is simulated while its events are read, in the order of their arrival."""

    def __init__(self, plan: SimulatedBench, run: TrajectoryIntegrator, *, real_time: bool, images: bool) -> None:
        """Starts the clock at the first event or at 0; the simulation is ahead of it by a drive's shortest delay."""
        super().__init__(plan.preset_settings, plan.seed, plan.number)
        self._plan, self.run, self._images = plan, run, images
        self._next = 0
        self.lock = threading.RLock()
        self._late = min(drive.late for drive in run.drives)
        self._order = self.schedule()
        start_ns = min(0, self._order[0][0])
        self.clock: Clock = RealTimeClock(start_ns) if real_time else SimulatedClock(start_ns)

    @property
    def session(self) -> Session:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The drawn session: the ground truth."""
        return self._plan.session

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory up to now."""
        return self.run.trajectory

    def _rows_known(self) -> int:
        return self.run.final

    def _delays_ns(self) -> tuple[int, ...]:
        clock = self.settings.world.clock
        image = 0.5 * self.imaging.exposure_s + clock.camera_delay_s
        delays = (clock.force_delay_s, clock.drive_delay_s, clock.drive_delay_s, image)
        return tuple(round(1e9 * delay) for delay in delays)

    @cached_property
    def _instants_needed(self) -> tuple[IntArray, ...]:
        """By stream: the number of instants of the trajectory that must have been simulated for each event."""
        readings = self.readings
        needed = (readings.need_force, readings.stage.need, readings.joints.need)
        return *(need + 2 for need in needed), *(self._frames_need(view)[self.arrived(view)] for view in self.views)

    def _frames_need(self, view: str) -> IntArray:
        """Returns (n,) the number of instants that must have been simulated for each frame of ``view``."""
        end_s = self.frame_s + 1e-9 * self.delay_ns(view) + 0.5 * self.imaging.exposure_s
        low, _ = self.interpolator.place(end_s)
        return low + 2

    def reach(self, rows: int, now_ns: int | None = None) -> None:
        """Simulates the first ``rows`` instants, and those that no command from ``now_ns`` on can change.

        A command has its effect after the delay of its drive: the simulation may be ahead of the clock by the shortest.
        """
        with self.lock:
            if rows > self.run.done:
                now = self.clock.now_ns() if now_ns is None else now_ns
                self.run.advance(max(rows, instants_until(now * 1e-9) + self._late))
                self.readings.take(self.trajectory, self.run.final)

    def frames_so_far(self) -> IntArray:
        """Returns the indices (n,) of the frames whose exposure has been simulated in every view."""
        return np.flatnonzero(self._frames_need(self.views[-1]) <= self.run.done)

    def __iter__(self) -> Iterator[Event]:
        """Yields the events in the order of their arrival; the trajectory is simulated as far as each of them needs."""
        while self._next < len(self._order):
            at_ns, stream, row = self._order[self._next]
            self._next += 1
            if stream >= _FIRST_IMAGE_STREAM and not self._images:
                continue
            self.reach(int(self._instants_needed[stream][row]), at_ns)
            event = self.event(stream, row)
            if isinstance(self.clock, RealTimeClock):
                self.clock.wait_for(at_ns)
            self.clock.sleep_until_ns(at_ns)
            yield event


class LiveSimulation:
    """Session ``session`` of ``seed`` on the bench of ``settings``, in progress. A context manager.

    While no drive is commanded the events are the same bytes as those of `SimulatedBench`. A command changes the
    session from its own time on, after the drive's delay. On simulated time, the same commands after the same events
    give the same bytes. Each new ``with`` statement starts the session again; the first one takes some seconds, because
    the session is drawn and solved before. docs/simulation.md has a closed loop.

    Args:
        settings: settings of the bench; None: those of the preset ``bench-2021``.
        seed: seed of all random numbers.
        session: number of the session, from 0.
        real_time: whether time is that of the machine. On a slow computer the session then runs slower
            (`RealTimeClock.pace`). Otherwise time is simulated: it is the time of the last event.
        images: whether images are drawn.
    """

    def __init__(
        self,
        settings: AnySimulationSettings | None = None,
        seed: int = 0,
        session: int = 0,
        *,
        real_time: bool = False,
        images: bool = True,
    ) -> None:
        """Stores the arguments; the session starts with the ``with`` statement."""
        self._plan = SimulatedBench(settings, seed, session)
        self._real_time, self._images = real_time, images
        self._begun: tuple[_LiveSource, SimulatedActuators] | None = None

    def __enter__(self) -> Self:
        """Starts the session from its beginning."""
        run = self._plan.session.begin()
        source = _LiveSource(self._plan, run, real_time=self._real_time, images=self._images)
        self._begun = (
            source,
            SimulatedActuators(self._plan.settings.world, run, source.clock, source.reach, source.lock),
        )
        return self

    def __exit__(self, *error: Any) -> None:
        self.actuators.__exit__(*error)

    @property
    def settings(self) -> AnySimulationSettings:
        """The settings of this session's bench."""
        return self._plan.settings

    def _entered(self) -> tuple[_LiveSource, SimulatedActuators]:
        if self._begun is None:
            raise RuntimeError("the bench is not open: use it in a with statement")
        return self._begun

    @property
    def source(self) -> SimulatedBench:
        """The events, each once, in the order of their arrival (see ``ClockSettings`` for the delays).

        Time passes while they are read. A second iteration continues with the next event.
        """
        return self._entered()[0]

    @property
    def actuators(self) -> SimulatedActuators:
        """The drives."""
        return self._entered()[1]

    @property
    def clock(self) -> Clock:
        """Time on the camera's clock."""
        return self._entered()[0].clock

    def true_force_n(self) -> float:
        """Returns the tissue's force on the tip at the clock's time, in newtons: for evaluation only."""
        source, _ = self._entered()
        row = min(instants_until(source.clock.now_ns() * 1e-9), source.run.final) - 1
        return float(np.linalg.norm(source.trajectory.contact.force_n[max(0, row)]))

    def truth(self) -> Truth:
        """Returns the ground truth of every frame up to now, with the commands of the drives; for evaluation only."""
        source = self._entered()[0]
        return collect_truth(source, source.frames_so_far())
