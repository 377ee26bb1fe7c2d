"""The loop closed on the simulated bench: an estimator, or the truth for comparison, holds a force on a moving wall."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, Self

import numpy as np

from ..alignment import ObservationQueue
from ..clinical import LIMIT_N, WINDOW_N
from ..control import LIFTED_LIMIT_N, ControlLoop, ControlSettings, ControlState, ControlTick, Path, SafetyAction
from ..estimators import Estimator
from ..simulation import AnySimulationSettings, LiveSimulation, SimulationSettings
from ..types import ADVANCE, KNOB, Actuation, Event, FloatArray, ForceEstimate, Wrench
from ._estimate import for_source

Regime = Literal["perpendicular", "oblique", "lateral"]
Drives = Literal["advance", "knob", "both"]
REGIMES: dict[str, tuple[float, float]] = {
    "perpendicular": (0.0, 20.0),
    "oblique": (20.0, 60.0),
    "lateral": (60.0, 75.0),
}
"""Contact angle in degrees: 0 where the tip points at the wall."""
_FREE_SHARE = {"perpendicular": (0.4, 0.55), "oblique": (0.1, 0.5), "lateral": (0.0, 0.06)}
"""Share of a beat without contact with the catheter half way along its path, so that the middle of it is used."""
MAX_BACK_MM, MAX_ADVANCE_MM = 8.0, 12.0
"""Distances by which the clamp may be drawn back and advanced from its first position."""
_KNOB_DEG = {"advance": None, "knob": (-20.0, 70.0), "both": (-14.0, 46.0)}
_BACK = (SafetyAction.OVER_LIMIT.value, SafetyAction.RETRACT.value)
"""With these the catheter is drawn back."""
_BEFORE_S = 40.0
"""Tare, approach and learning, before the seconds that are held."""
ESTIMATE_S = 10e-3
"""Time from an image to its estimate in simulated time, which does not run while an estimator works."""


def bench_of_regime(settings: AnySimulationSettings, regime: Regime, seconds: float) -> AnySimulationSettings:
    """Gives a bench the wall's motion, the drive and the camera of the closed-loop benchmark.

    Wall 4 mm at 1.2 Hz and breath 2 mm at 0.25 Hz along its normal, on the side to which the knob bends; advance at
    most 30 mm/s, 20 ms late; camera 30 Hz, a fluoroscope at its own rate, 40 ms late. All else is the preset's: tissue,
    friction, lateral motion, play and drift of the knob, light.

    Args:
        settings: settings of the preset.
        regime: name of the contact regime in `REGIMES`, which sets the contact angle.
        seconds: duration of the control, s.

    Returns:
        The changed settings; their session also contains the time before the control.
    """
    world = settings.world
    motion = {
        "beat_hz": (1.2, 1.2),
        "half_wave_share": 0.0,
        "by_hand_share": 0.0,
        "amplitude_m": (4e-3, 4e-3),
        "respiration_m": (2e-3, 2e-3),
        "respiration_hz": 0.25,
        "peak_force_n": (1e-3, 5.0),
        "peak_within_n": 10.0,  # the amplitude is stated, with any force that it makes
        "free_share": _FREE_SHARE[regime],
    }
    clamp: dict[str, float] = {"max_speed_m_per_s": 0.03, "delay_s": 20e-3, "logged": True}
    scene: dict[str, float] = {}
    if isinstance(settings, SimulationSettings) and settings.scene.variety is None:
        # drawn back as far as it goes, the base is where the metadata have it, next to the border
        clamp["home_m"] = 1e-3 * MAX_BACK_MM
        scene["base_inset_m"] = settings.scene.base_inset_m + clamp["home_m"]
    fps = 30.0 if isinstance(settings, SimulationSettings) else world.clock.fps
    parts = {
        "seconds": seconds + _BEFORE_S,
        "tare_s": 2.0,
        # a higher angle of the knob presses: the wall is never on the side from which the knob bends the tip away
        "wall": world.wall.model_copy(update={"contact_angle_deg": REGIMES[regime], "either_side": False}),
        "motion": world.motion.model_copy(update=motion),
        "clamp": world.clamp.model_copy(update=clamp),
        "clock": world.clock.model_copy(update={"fps": fps, "camera_delay_s": 40e-3}),
    }
    name = f"{settings.preset} {regime} moving wall"
    parts_of_bench = {"world": world.model_copy(update=parts), "scene": settings.scene.model_copy(update=scene)}
    return settings.model_copy(update={"preset": name, **parts_of_bench})


def path_of_drives(drives: Drives, home_mm: float) -> Path:
    """Returns the path of the closed-loop benchmark.

    Args:
        drives: the drives that move along it.
        home_mm: first position of the clamp, about which the advance moves.
    """
    start, goal = dict[str, float](), dict[str, float]()
    if drives != "knob":
        start[ADVANCE], goal[ADVANCE] = home_mm - MAX_BACK_MM, home_mm + MAX_ADVANCE_MM
    if (knob_deg := _KNOB_DEG[drives]) is not None:
        start[KNOB], goal[KNOB] = knob_deg
    return Path(start, goal)


@dataclass(slots=True)
class ControlRun:
    """Result of a run.

    Attributes:
        ticks: the n ticks of the loop in their order.
        true_n: (n,) magnitude of the true force at each tick in newtons, for evaluation only.
        restarts: number of times that the loop started again after a retraction.
        values: parameters of the simulated session by name: the catheter, the tissue's motion, the sensor's errors.
        settings: target, controller, limits.
    """

    ticks: list[ControlTick] = field(default_factory=list[ControlTick])
    true_n: FloatArray = field(default_factory=lambda: np.empty(0))
    restarts: int = 0
    values: dict[str, Any] = field(default_factory=dict[str, Any])
    settings: ControlSettings = field(default_factory=ControlSettings)

    @property
    def time_s(self) -> FloatArray:
        """(n,) time of each tick in s."""
        return np.array([tick.time_s for tick in self.ticks])

    @property
    def judged_limit_n(self) -> float:
        """The limit of the run; the default one where it was lifted."""
        limit_n = self.settings.safety.limit_n
        return limit_n if limit_n < LIFTED_LIMIT_N else LIMIT_N

    def figures(self, seconds: float) -> dict[str, float]:
        """Returns peaks and times above the limits of the whole run, and how well the target was held.

        Args:
            seconds: duration in s over which the target is judged, from the tick at which hold first wants it; without
                one the figures of the hold are missing.

        Returns:
            Forces in N, times in s. ``unforeseen``: number of times that the true force passed the limit before the
            retraction had begun.
        """
        time, limit_n = self.time_s, self.judged_limit_n
        step_s = np.diff(time, append=time[-1:])  # duration of each tick; 0 for the last
        upper = np.array([tick.upper_n for tick in self.ticks])
        back = np.isin([tick.applied.action.value for tick in self.ticks], _BACK)
        passes = np.flatnonzero((self.true_n[1:] > limit_n) & (self.true_n[:-1] <= limit_n))  # last ticks below it
        whole = {
            "judged_limit_n": limit_n,
            "peak_whole_run_n": float(self.true_n.max()),
            "peak_at_s": float(time[self.true_n.argmax()]),
            "above_limit_s": float(step_s[self.true_n > limit_n].sum()),
            "above_thesis_limit_s": float(step_s[self.true_n > WINDOW_N[1]].sum()),
            "peak_upper_n": float(np.fmax.reduce(upper, initial=0.0)),
            "passes": float(len(passes)),
            "unforeseen": float(np.count_nonzero(~back[passes])),
            "restarts": float(self.restarts),
        }
        held = np.array([tick.state is ControlState.HOLD for tick in self.ticks])
        target = self.settings.target_n
        wants_target = held & (np.array([tick.target_n for tick in self.ticks]) >= target)
        if not wants_target.any():
            return {"held_s": 0.0, **whole}
        start = float(time[wants_target][0])
        window = (time >= start) & (time < start + seconds)
        error = self.true_n[window] - target
        action = np.array([tick.applied.action.value for tick in self.ticks])[window]
        valid = np.array([tick.valid for tick in self.ticks])[window]
        return {
            **whole,
            "start_s": start,
            "held_s": float(np.mean(held[window])) * float(time[window][-1] - start),
            "rms_n": float(np.sqrt(np.mean(error**2))),
            "bias_n": float(error.mean()),
            "within_20_mn": float(np.mean(np.abs(error) <= 0.02)),
            "peak_n": float(self.true_n[window].max()),
            "not_valid_share": float(1.0 - valid.mean()),
            "over_limit_share": float(np.mean(action == SafetyAction.OVER_LIMIT)),
            "retract_share": float(np.mean(action == SafetyAction.RETRACT)),
        }


class _Feedback:
    """Estimates as they would come at the bench: some time after each image arrived."""

    def __init__(self, bench: LiveSimulation, late_ns: int) -> None:
        self._bench, self._late_ns = bench, late_ns
        self._waiting: deque[tuple[int, ForceEstimate]] = deque()

    def add(self, event: Event, now_ns: int) -> None:
        """Takes an event of the source."""

    def due(self, now_ns: int) -> Iterator[ForceEstimate]:
        """Yields the estimates that are ready by now."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            yield self._waiting.popleft()[1]


def _true_force_n(bench: LiveSimulation, time_s: FloatArray) -> FloatArray:
    """Returns the tissue's force on the tip (n, 3), in newtons, at times (n,)."""
    source = bench.source
    return source.interpolator.at(source.trajectory.contact.force_n, time_s)


class _TruthFeedback(_Feedback):
    """The true force at each image's mid-exposure, when the image would have come: for comparison only."""

    def __init__(self, bench: LiveSimulation, late_ns: int) -> None:
        super().__init__(bench, late_ns)
        source = bench.source
        arrival_s = 0.5 * source.imaging.exposure_s + source.settings.world.clock.camera_delay_s  # after mid-exposure
        arrived = source.arrived(source.views[0])
        # time at which the estimate is due, stamp and time of each image
        self._frames = deque(
            (int(stamp) + round(1e9 * arrival_s) + late_ns, int(stamp), float(time))
            for stamp, time in zip(source.stamp_ns[arrived], source.frame_s[arrived], strict=True)
        )

    def due(self, now_ns: int) -> Iterator[ForceEstimate]:
        """See `_Feedback`."""
        while self._frames and self._frames[0][0] <= now_ns:
            _, stamp_ns, time_s = self._frames.popleft()
            yield _exact(stamp_ns, _true_force_n(self._bench, np.array([time_s]))[0])


def _exact(stamp_ns: int, force_n: FloatArray) -> ForceEstimate:
    """Returns an estimate without error: its intervals have no width. ``force_n``: (3,) in N, base frame."""
    magnitude = float(np.linalg.norm(force_n))
    return ForceEstimate(
        stamp_ns=stamp_ns,
        force_n=force_n,
        known=np.ones(3, np.bool_),
        covariance_n2=np.zeros((3, 3)),
        interval_n=np.stack([force_n, force_n], axis=1),
        magnitude_n=magnitude,
        magnitude_interval_n=np.array([magnitude, magnitude]),
    )


class _EstimatorFeedback(_Feedback):
    def __init__(self, bench: LiveSimulation, late_ns: int, estimator: Estimator) -> None:
        super().__init__(bench, late_ns)
        estimator = for_source(estimator, bench.source)
        self._stream = estimator.start(bench.source.session_info)
        self._queue = ObservationQueue(estimator.views, wait_s=0.0, apart=not estimator.needs_all_views)

    def add(self, event: Event, now_ns: int) -> None:
        """See `_Feedback`."""
        if isinstance(event, Wrench) or (isinstance(event, Actuation) and event.stream == "stage"):
            return  # no estimator sees them
        for observation in self._queue.add(event):
            self._waiting.append((now_ns + self._late_ns, self._stream.update(observation).checked()))


class ControlSession:
    """One session of the bench with the loop closed, on simulated time; a context manager.

    Iterating over `events` lets time pass: an event that it yields has been through the loop. ``run`` is filled
    meanwhile, its true force by `finish`.

    Args:
        feedback: an estimator, or ``truth``: for comparison only.
        simulation: the bench of `live_bench`, not yet entered; it may have served another run before.
        control: target, controller, limits.
        drives: the drives that move along the path: ``advance``, ``knob`` or ``both``.
        seconds: the session ends this time after the target was first wanted.
        spoil: changes each estimate on its way to the loop, as for a test of invalid ones.

    Raises:
        InputError: the session lacks metadata that the estimator needs, or cannot be had.
    """

    def __init__(
        self,
        feedback: Estimator | Literal["truth"],
        simulation: LiveSimulation,
        control: ControlSettings,
        drives: Drives,
        *,
        seconds: float = math.inf,
        spoil: Callable[[ForceEstimate], ForceEstimate] | None = None,
    ) -> None:
        self.run = ControlRun(settings=control)
        self._spoil, self._seconds = spoil, seconds
        self._control = control
        self._drives: Drives = drives
        self.simulation = simulation
        self._feedback_of = feedback

    def __enter__(self) -> Self:
        """Begins the simulated session, and makes the feedback and the loop with its drives and clock."""
        bench = self.simulation.__enter__()
        late_ns, estimator = round(ESTIMATE_S * 1e9), self._feedback_of
        if isinstance(estimator, str):
            self._feedback: _Feedback = _TruthFeedback(bench, late_ns)
        else:
            self._feedback = _EstimatorFeedback(bench, late_ns, estimator)
        world = bench.source.settings.world
        path = path_of_drives(self._drives, 1e3 * world.clamp.home_m)
        self.loop = ControlLoop(bench.actuators, bench.clock, path, self._control, 1.0 / world.clock.fps)
        return self

    def __exit__(self, *error: Any) -> None:
        self.simulation.__exit__(*error)

    def events(self) -> Iterator[Event]:
        """Yields all events of the session, after each has been through the loop; the run starts immediately.

        Each event moves the simulated time on: estimates that are due go to the loop, which ticks once a period. The
        run ends ``seconds`` after the target was first wanted.
        """
        clock, loop, feedback = self.simulation.clock, self.loop, self._feedback
        period_ns, next_ns, held_ns = round(1e9 * self._control.period_s), 0, math.inf
        loop.start()
        for event in self.simulation.source:
            now = clock.now_ns()
            feedback.add(event, now)
            for estimate in feedback.due(now):
                loop.update(estimate if self._spoil is None else self._spoil(estimate))
            if now >= next_ns:
                next_ns = max(next_ns + period_ns, now)
                tick = loop.tick()
                self.run.ticks.append(tick)
                if tick.target_n >= self._control.target_n:
                    held_ns = min(held_ns, now)
            yield event
            if now - held_ns > 1e9 * self._seconds:
                loop.retract()
                return

    def finish(self) -> ControlRun:
        """Completes the result after the last event and returns it.

        `events` has filled the ticks. This adds the magnitude of the true force at the time of each tick, the number
        of restarts, and the parameters with which the session was simulated.
        """
        run = self.run
        run.true_n = np.linalg.norm(_true_force_n(self.simulation, run.time_s), axis=1)
        run.restarts = self.loop.restarts
        run.values = dict(self.simulation.source.values())
        return run


def live_bench(
    feedback: Estimator | Literal["truth"], settings: AnySimulationSettings, seed: int = 0, session: int = 0
) -> LiveSimulation:
    """Makes the simulated bench for a `ControlSession`.

    Args:
        feedback: an estimator, for which images are drawn; or "truth", without images.
        settings: the bench, as `bench_of_regime` returns it.
        seed: seed of the bench.
        session: number of the session.

    Returns:
        The bench, not yet entered.
    """
    return LiveSimulation(settings, seed, session, images=not isinstance(feedback, str))


def run_control(
    feedback: Estimator | Literal["truth"],
    simulation: LiveSimulation,
    control: ControlSettings,
    drives: Drives = "advance",
    *,
    seconds: float = math.inf,
    spoil: Callable[[ForceEstimate], ForceEstimate] | None = None,
) -> ControlRun:
    """Runs a `ControlSession` from its beginning to its end, without a recording.

    Args:
        feedback: an estimator, or "truth" for comparison.
        simulation: the bench of `live_bench`.
        control: target, controller, limits.
        drives: the drives that move along the path.
        seconds: the session ends this time in s after the target was first wanted.
        spoil: changes each estimate on its way to the loop.

    Returns:
        The finished run with its true forces.
    """
    with ControlSession(feedback, simulation, control, drives, seconds=seconds, spoil=spoil) as session:
        for _ in session.events():
            pass
        return session.finish()
