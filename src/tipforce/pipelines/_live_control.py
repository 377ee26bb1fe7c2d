"""The loop on live estimates: a sink of the engine, a thread that commands the drives, and the operator's commands."""

import logging
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Self

from pydantic import Field

from ..control import ControlLoop, ControlSettings, ControlState, ControlTick, Path, SafetyAction
from ..errors import InputError, TipforceError
from ..live import LiveUpdate, LoopRun, LoopState, LoopStatus, Sink
from ..types import ADVANCE, KNOB, Actuators, Clock, SessionInfo
from ._control import Drives, Regime

_log = logging.getLogger(__name__)

AXES: dict[Drives, tuple[str, ...]] = {"advance": (ADVANCE,), "knob": (KNOB,), "both": (ADVANCE, KNOB)}
_Places = dict[str, Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]]
_OFF_MM = 0.5
"""Farther than this from the path, in mm of it, no run begins with drives that are faster than the limits."""
_SHORTEST_MM = 1.0
"""Two marks that are nearer are one place, marked twice."""
_JOIN_S = 1.0


class HoldSettings(ControlSettings):
    """Settings of a loop on live estimates: those of the control, the drives, and the path."""

    drives: Drives = "advance"
    contact: Regime = "perpendicular"
    """How the tip meets the tissue of a simulated bench."""
    start: _Places | None = None
    """Where the path begins; None: where the operator marks it, or as the simulated bench has it."""
    goal: _Places | None = None
    page_lost_s: Annotated[float, Field(ge=1.5, le=60)] = 3.0
    """With no page heard for so long nobody could press stop: the run ends, back to the start. Pages are heard each
    second."""


@dataclass(frozen=True, slots=True)
class _Marks:
    start: Mapping[str, float] | None
    goal: Mapping[str, float] | None

    def path(self) -> Path | None:
        """Returns the path; None where start or goal is missing.

        Raises:
            InputError: both are at one position, or differ in their axes.
        """
        return None if self.start is None or self.goal is None else Path(self.start, self.goal)


class _Estimates:
    """A `Sink`: the newest estimate to the loop."""

    name = "control"
    keeps_all = False

    def __init__(self, control: "LiveControl") -> None:
        self._control = control

    def start(self, info: SessionInfo, model: str) -> None:
        """Does nothing: updates contain all that the loop needs."""

    def put(self, update: LiveUpdate) -> None:
        """Passes an estimate on, also one of the watchdog, which is not valid."""
        self._control.take(update)

    def close(self) -> None:
        """Does nothing: a loop that gets no estimates any more draws the catheter back by itself."""


class LiveControl:
    """Drives a `ControlLoop` on the updates of a live engine, and has the commands for it. A context manager.

    ``sink``: takes the updates. A thread calls the loop's ``tick`` every ``settings.period_s``, also while
    the engine, the sink or a page are busy: without estimates the loop draws the catheter back by its own rule of
    staleness. Leaving it stops the drives. An error of the thread while the catheter moves counts as a stop,
    with the error as its reason. The drives are moved by the loop's `SafetyLayer` alone.

    Args:
        actuators: the drives; they may be connected later.
        clock: the engine's clock.
        settings: target, controller, limits, drives.
        marks: start and goal of the path, each a position by name of the drive in mm or degrees, where the settings
            hold none; without them the operator marks both.
        frame_period_s: time between images, as the source promises.
        silent_s: returns the time in s since a page was heard; None: runs continue without one.
        true_force_n: returns the magnitude of the true force on the tip now, in newtons, of a simulated bench; for the
            record only.

    Raises:
        InputError: start or goal has other axes than the drives, or both are one position.
    """

    def __init__(
        self,
        actuators: Actuators,
        clock: Clock,
        settings: HoldSettings,
        marks: tuple[Mapping[str, float], Mapping[str, float]] | None = None,
        *,
        frame_period_s: float = 1 / 30,
        silent_s: Callable[[], float] | None = None,
        true_force_n: Callable[[], float] | None = None,
    ) -> None:
        self.settings, self.silent_s = settings, silent_s
        self._true_force_n = true_force_n
        self.sink: Sink = _Estimates(self)
        self._actuators, self._clock, self._frame_period_s = actuators, clock, frame_period_s
        self._axes = AXES[settings.drives]
        """Names of the drives that move."""
        self._marks = self._first_marks(marks)
        self._limit_n = settings.safety.limit_n
        """The operator's limit, never above that of the settings."""
        self._lock = threading.RLock()
        """Held during a tick and during the commands that change the run; a stop does not wait for it."""
        self._loop: ControlLoop | None = None
        """None until there are drives and a path."""
        self._latest: LiveUpdate | None = None
        """The newest estimate, which a loop that is made later begins with."""
        self._stopped = False
        """Whether the drives were stopped, by the operator or after an error, and not released yet."""
        self._why_stopped = ""
        """Reason of the stop."""
        self._why_not_ready = ""
        """Error of the last tick while no run was on its way; empty if it had none."""
        self._runs: list[LoopRun] = []
        self._recording = False
        """Whether the newest of the runs is on its way, or was stopped and not released yet."""
        self._recorded_ns = clock.now_ns()
        """Time until which the newest run has been recorded."""
        self._ending = threading.Event()
        """Set when the thread shall end."""
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)
        self._status = LoopStatus(target_n=settings.target_n, limit_n=settings.safety.limit_n)

    def _first_marks(self, marks: tuple[Mapping[str, float], Mapping[str, float]] | None) -> _Marks:
        """Returns the marks of the settings, else ``marks``. Raises InputError if they make no path of the drives."""
        start, goal = marks or (None, None)
        first = _Marks(self.settings.start or start, self.settings.goal or goal)
        for mark in (first.start, first.goal):
            if mark is not None and set(mark) != set(self._axes):
                raise InputError(
                    f"hold.start and hold.goal: expected {' and '.join(self._axes)} as drives = {self.settings.drives} "
                    f"has it, got {' and '.join(mark) or 'nothing'}"
                )
        first.path()  # raises InputError where both are one position
        return first

    def take(self, update: LiveUpdate) -> None:
        """Gives an estimate of `sink`, valid or not, to the loop."""
        self._latest = update
        loop = self._loop
        if loop is not None:
            loop.update(update.estimate, update.captured_ns)

    # The thread

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        try:
            self.stop()
        except Exception as failure:  # a stage that is gone, or a simulated session that has ended, moves nothing
            _log.warning("the drives could not be stopped at the end: %s", failure)
        self._thread.join(_JOIN_S)

    def _run(self) -> None:
        """Commands the drives every ``period_s`` on the control thread; a late tick delays the ones after it."""
        period_ns = round(1e9 * self.settings.period_s)
        next_ns = self._clock.now_ns()
        while not self._ending.wait(max(0.0, (next_ns - self._clock.now_ns()) * 1e-9)):
            self._step()
            self._record()
            next_ns = max(next_ns + period_ns, self._clock.now_ns())

    def _step(self) -> None:
        """Reads the drives, commands them once if there is a loop, and updates the status for the page."""
        try:
            with self._lock:
                axes = self._positions()
                loop = self._connected()
                if loop is not None:
                    loop.safety.set_limit(self._limit_n)
                tick = None if loop is None or self._stopped else self._tick(loop)
                self._why_not_ready = ""
                self._status = self._status_of(loop, tick, axes)
        except Exception as error:  # drives are other people's code: after any error the catheter must not go on
            self._failed(error)

    def _record(self) -> None:
        """Adds the time since the last call to the newest run."""
        with self._lock:
            now_ns = self._clock.now_ns()
            if self._recording:
                true_n = math.nan if self._true_force_n is None else self._true_force_n()
                self._runs[-1].add(self.status, (now_ns - self._recorded_ns) * 1e-9, true_n)
                self._recording = self.running or self._stopped
            self._recorded_ns = now_ns

    def _positions(self) -> dict[str, float]:
        """Returns the position of each drive of the path, in mm or degrees. Raises InputError if one is missing."""
        values = self._actuators.read().values
        if missing := [axis for axis in self._axes if axis not in values]:
            raise InputError(f"drives: there is no axis {missing[0]}; there are {', '.join(values)}")
        return {axis: values[axis] for axis in self._axes}

    def _connected(self) -> ControlLoop | None:
        """Returns the loop, which is made as soon as there are drives and a path; None before that."""
        if self._loop is None and (path := self._marks.path()) is not None:
            loop = ControlLoop(self._actuators, self._clock, path, self.settings, self._frame_period_s)
            loop.safety.set_limit(self._limit_n)
            if self._latest is not None:
                loop.update(self._latest.estimate, self._latest.captured_ns)
            self._loop = loop
        return self._loop

    def _tick(self, loop: ControlLoop) -> ControlTick:
        moves = loop.resumes or loop.state in (ControlState.APPROACH, ControlState.CONTACT, ControlState.HOLD)
        if moves and self.silent_s is not None and (silent_s := self.silent_s()) > self.settings.page_lost_s:
            loop.retract(f"no page was heard for {silent_s:.0f} s, so nobody could stop the run")
        return loop.tick()

    def _failed(self, error: Exception) -> None:
        """Stops the drives after an error of a tick while they move; else keeps the error as a reason not to start."""
        message = str(error) if isinstance(error, TipforceError) else f"{type(error).__name__}: {error}"
        loop = self._loop
        if loop is not None and not self._stopped and (loop.resumes or loop.state is not ControlState.IDLE):
            _log.warning("the run was stopped: %s", message)
            try:
                self._brake()
            except Exception as failure:
                _log.warning("the drives could not be stopped: %s", failure)
            self._why_stopped = message
        else:
            self._why_not_ready = message
        self._status = self._status_of(loop, None, self._status.axes)

    def _status_of(self, loop: ControlLoop | None, tick: ControlTick | None, axes: Mapping[str, float]) -> LoopStatus:
        """Makes the status that the page shows; `status` adds the present force.

        Args:
            loop: the loop; None without drives or a path.
            tick: the tick that was just made; None where the loop was stopped, failed, or is missing.
            axes: last known position of each drive by name, in mm or degrees; empty before it was first read.

        Returns:
            The status. Its state is "stopped" from a stop until its release, else that of the loop, else "idle". Its
            reason is that of the stop, else the error of the last tick, else the loop's progress or the missing
            condition.
        """
        settings, marks = self.settings, self._marks
        state: LoopState = "idle"
        reason = self._why_not_ready
        if self._stopped:
            state, reason = "stopped", self._why_stopped
        elif loop is not None:
            state, reason = loop.state.value, reason or loop.progress or "ready"
        elif not reason:
            missing = [name for name, mark in (("start", marks.start), ("goal", marks.goal)) if mark is None]
            reason = f"mark {' and '.join(missing)}" if missing else "waiting for the drives"
        place_mm = loop.path.position_mm(axes) if loop is not None and axes else math.nan
        newest = self._runs[-1] if self._runs else None
        estimated, true = (None, None) if newest is None else (newest.estimated, newest.true)
        return LoopStatus(
            state=state,
            reason=reason,
            resumes=loop is not None and loop.resumes and not self._stopped,
            target_n=settings.target_n,
            wanted_n=tick.target_n if tick is not None and tick.state is ControlState.HOLD else math.nan,
            limit_n=self._limit_n,
            held=loop is not None and not self._stopped and loop.held,
            place_mm=round(place_mm, 2),
            length_mm=math.nan if loop is None else loop.path.length_mm,
            action="" if tick is None else tick.applied.action.value,
            peak_n=math.nan if estimated is None else estimated.peak_n,
            above_limit_s=math.nan if estimated is None else estimated.above_limit_s,
            true_peak_n=math.nan if true is None else true.peak_n,
            true_above_limit_s=math.nan if true is None else true.above_limit_s,
            axes=dict(axes),
            start=dict(marks.start or {}),
            goal=dict(marks.goal or {}),
        )

    # The operator's commands

    @property
    def status(self) -> LoopStatus:
        """State at the last tick; its force is the present one, also while the drives do not answer."""
        latest, status = self._latest, self._status
        if latest is None:
            return status
        estimate = latest.as_of(self._clock.now_ns()).estimate
        return replace(
            status,
            force_n=estimate.magnitude_n,
            upper_n=float(estimate.magnitude_interval_n[1]),
            held=status.held and estimate.valid,
        )

    @property
    def runs(self) -> Sequence[LoopRun]:
        """The runs in order; the newest may still be in progress."""
        return tuple(self._runs)

    @property
    def running(self) -> bool:
        """Whether the drives are commanded now, or will be without a further command."""
        loop = self._loop
        return loop is not None and not self._stopped and (loop.resumes or loop.state is not ControlState.IDLE)

    def set_limit(self, limit_n: float) -> None:
        """Sets the operator's limit, that of the alarm, as the loop's limit, also during a run.

        Raises:
            InputError: it is above ``settings.safety.limit_n``, which no button raises.
        """
        most_n = self.settings.safety.limit_n
        if not limit_n <= most_n:
            raise InputError(
                f"expected limit_n of at most {most_n:g}, where the loop draws the catheter back "
                f"(hold.safety.limit_n), got {limit_n:g}"
            )
        self._limit_n = limit_n  # taken by the next tick: no drive that hangs keeps the alarm from being set
        self._status = replace(self._status, limit_n=limit_n)

    def mark_start(self) -> None:
        """Begins the path where the drives are now. Raises InputError during a run."""
        self._mark(lambda here: _Marks(here, self._marks.goal))

    def mark_goal(self) -> None:
        """Ends the path where the drives are now. Raises InputError during a run."""
        self._mark(lambda here: _Marks(self._marks.start, here))

    def _mark(self, marks_of: Callable[[dict[str, float]], _Marks]) -> None:
        """Replaces the marks by ``marks_of`` the present positions; the loop is made anew for the new path.

        Raises:
            InputError: a run is on its way, or the path would be shorter than `_SHORTEST_MM`.
        """
        with self._lock:
            if self.running:
                raise InputError("a run is on its way; stop or retract it before a mark is set")
            marks = marks_of(self._positions())
            path = marks.path()
            if path is not None and path.length_mm < _SHORTEST_MM:
                raise InputError(
                    f"start and goal: expected {_SHORTEST_MM:g} mm of path or more, got {path.length_mm:.2f}"
                )
            self._marks, self._loop = marks, None

    def start(self) -> None:
        """Begins a run. Raises InputError, with the missing conditions, if it cannot."""
        with self._lock:
            self._need_released()
            if self.running:
                raise InputError("a run is on its way already")
            loop = self._connected()
            if loop is None:
                raise InputError(f"nothing to go along: {self._status.reason}")
            action, why = loop.safety.check()
            if action is not SafetyAction.PASS:
                raise InputError(f"not now: {why}")
            self._need_on_path(loop)
            loop.safety.rest()
            loop.restarts = 0
            loop.start()
            self._runs.append(LoopRun())
            self._recording = True

    def retract(self) -> None:
        """Ends the run, back to the marked start; also after a stop that was released."""
        with self._lock:
            self._need_released()
            loop = self._loop
            if loop is None:
                raise InputError(f"nothing to go back along: {self._status.reason}")
            idle = not self.running
            if idle:
                self._need_on_path(loop)
                loop.safety.rest()
            loop.retract()
            if idle and not self.running:
                raise InputError("no run is on its way; a start goes to the marked start first")

    def stop(self) -> None:
        """Brakes now; nothing moves before `release` and a command. Raises the errors of the drives."""
        self._why_stopped = "the stop key was pressed"
        self._brake()

    def _brake(self) -> None:
        """Brakes; it waits for no lock but that of a command that is being sent."""
        self._stopped = True
        loop = self._loop
        if loop is None:
            self._actuators.stop(*self._axes)
        else:
            loop.stop()

    def release(self) -> None:
        """Accepts commands again after a stop. Nothing moves before the next one."""
        with self._lock:
            if not self._stopped:
                raise InputError("nothing is stopped")
            if self._loop is not None:
                self._loop.stop()  # a command that came with the stop is not left to be carried out now
                self._loop.release()
            self._stopped = False

    def _need_released(self) -> None:
        if self._stopped:
            raise InputError(f"stopped ({self._why_stopped}); release it first")

    def _need_on_path(self, loop: ControlLoop) -> None:
        """Checks that each drive that is faster than the limits is on the path.

        The first command sends a drive to the path. The limits of speed act along the path only, so a fast drive that
        is off it would jump. A drive that is slower than the limits cannot.

        Raises:
            InputError: such a drive is farther from the path than `_OFF_MM` of it.
        """
        positions, path, limits = self._positions(), loop.path, self._actuators.limits
        nearest = path.targets(min(max(path.position_mm(positions), 0.0), path.length_mm))
        safety = self.settings.safety
        allowed_speeds = {ADVANCE: safety.max_advance_mm_per_s, KNOB: safety.max_knob_deg_per_s}
        for axis, target in nearest.items():
            tolerance = _OFF_MM * abs(path.slope(axis)) or _OFF_MM  # in the axis's unit; an axis may rest on the path
            if limits[axis].max_speed > allowed_speeds[axis] and abs(positions[axis] - target) > tolerance:
                raise InputError(
                    f"{axis}: {positions[axis]:.1f} is off the path from start to goal (there {target:.1f}); bring it "
                    "there, or mark start and goal anew"
                )
