"""One session: its parameters are drawn, its motion is solved, it is run; drawn again where it is rejected.

Consecutive sessions share a catheter. It is drawn again where no motion brings it to the forces that are asked for.
That choice depends on the catheter's own random numbers alone, never on a session's, so all of its sessions find the
same one, in whatever order and process they are made.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ...errors import InputError
from ...types import FloatArray
from ._bench_model import BenchModel, build_bench_model
from ._motion_profile import APPROACH_S, LEAD_S, STEP_S, TRAIL_S, Motion, MotionProfile, compose_motion
from ._motion_solver import FAST, FINE, Resolution, rejection_reason, solve
from ._parameters import DeviceProperties, SessionParameters, sample_device, sample_kind, sample_parameters
from ._trajectory import Trajectory, TrajectoryIntegrator, integrate_trajectory
from .settings import WorldSettings

_TRIALS = 100
_REDRAWS = 50
_STEP_S = 8e-3


@dataclass(frozen=True, slots=True)
class SampledDevice:
    """``redraws``: how many catheters were drawn before this one and could not be used."""

    device: DeviceProperties
    redraws: int = 0


def catheter_of(settings: WorldSettings, seed: int, session: int) -> SampledDevice:
    """The catheter of a session.

    One that serves a single session is taken as drawn: that session finds out for itself. Raises InputError where no
    catheter reaches the forces.
    """
    if settings.shaft.sessions_per_catheter == 1:
        return SampledDevice(sample_device(settings, seed, session))
    return _shared(settings.model_dump_json(), seed, session // settings.shaft.sessions_per_catheter)


@lru_cache(maxsize=64)
def _shared(settings_json: str, seed: int, number: int) -> SampledDevice:
    settings = WorldSettings.model_validate_json(settings_json)
    first = number * settings.shaft.sessions_per_catheter
    for redraws in range(_REDRAWS):
        device = sample_device(settings, seed, first, redraws)
        if any(_reaches(settings, device, (seed, number, 6, redraws, trial)) for trial in range(_TRIALS)):
            return SampledDevice(device, redraws)
    raise InputError(
        f"catheter {number} of seed {seed}: none of {_REDRAWS} draws of it reaches the forces asked for; widen "
        "motion.peak_force_n or motion.amplitude_m, or change the ranges of the shaft"
    )


def _reaches(settings: WorldSettings, device: DeviceProperties, key: tuple[int, ...]) -> bool:
    """Whether one drawn session comes to the least of the wanted peak forces, over two breaths of largest amplitude."""
    rng = np.random.default_rng(key)
    if settings.motion.least_force_n:
        return _solvable(settings, sample_parameters(settings, device, rng), rng)
    brief = settings.model_copy(update={"tare_s": 0.0})
    bench_model = build_bench_model(brief, sample_parameters(brief, device, rng))
    motion_profile = compose_motion(bench_model, _two_breaths(settings, _STEP_S), rng)
    largest = settings.motion.amplitude_m[1]
    contact = integrate_trajectory(
        bench_model, motion_profile, Motion(largest, motion_profile.standoff_m(bench_model, largest))
    ).contact
    peak = float(np.linalg.norm(contact.force_n, axis=1).max())
    return bool(contact.converged.all()) and peak >= settings.motion.peak_force_n[0]


def _solvable(settings: WorldSettings, parameters: SessionParameters, rng: np.random.Generator) -> bool:
    """Whether some motion gives the session its smallest and its largest force over two breaths."""
    brief = settings.model_copy(update={"tare_s": 0.0})
    bench_model = build_bench_model(brief, parameters, FAST.trial_segment_m)
    motion_profile = compose_motion(bench_model, _two_breaths(settings, STEP_S), rng)
    resolution = replace(FAST, peak_n=settings.motion.peak_within_n or FAST.peak_n)
    return isinstance(solve(bench_model, motion_profile, resolution), Motion)


def _two_breaths(settings: WorldSettings, step_s: float) -> FloatArray:
    """(m,) instants of the approach and of two breaths, from 0."""
    span = APPROACH_S + 2.0 / settings.motion.respiration_hz
    return np.arange(round(span / step_s), dtype=np.float64) * step_s


_BENCH = ("out_of_plane_per_m", "contact_angle_deg", "tilt_deg", "wall_stiffness_n_per_m", "friction")
"""Parameters that the sessions of one bench share beside the catheter."""
_BENCH_TRIALS = 4
"""Drawn motions, of which one must give a bench its forces."""


def bench_of(settings: WorldSettings, seed: int, session: int) -> dict[str, float]:
    """Returns the parameters that the sessions of a bench share, by name; none where each has a bench of its own.

    Raises:
        InputError: no draw of the bench reaches the forces.
    """
    if settings.sessions_per_bench == 1:
        return {}
    return _shared_bench(settings.model_dump_json(), seed, session // settings.sessions_per_bench)


@lru_cache(maxsize=64)
def _shared_bench(settings_json: str, seed: int, number: int) -> dict[str, float]:
    settings = WorldSettings.model_validate_json(settings_json)
    device = catheter_of(settings, seed, number * settings.sessions_per_bench).device
    for redraw in range(_REDRAWS):
        rng = np.random.default_rng([seed, number, 13, redraw])
        drawn = sample_parameters(settings, device, rng)
        bench = {name: getattr(drawn, name) for name in _BENCH}
        if any(
            _solvable(settings, replace(sample_parameters(settings, device, rng), **bench), rng)
            for _ in range(_BENCH_TRIALS)
        ):
            return bench
    raise InputError(
        f"bench {number} of seed {seed}: none of {_REDRAWS} draws of it reaches the forces asked for; widen "
        "motion.peak_force_n or motion.amplitude_m, or change the ranges of the wall"
    )


_DRAWS = 400
_SAME_ANGLE = 4
"""Draws in a row that share their contact angle: steep ones fail more often and would be rare with an angle a draw."""
_BEATING_S = 1.0
"""Largest force and time without contact are solved for on what follows the approach: at least so much."""
UNFIT_CATHETER = "no motion brings the catheter to the forces"


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What is true of one session. ``redraws``: by reason, how often its values were drawn again.

    Of the catheter's own draws `UNFIT_CATHETER` counts. ``trajectory``: what happens where nobody commands a drive.
    """

    bench_model: BenchModel
    motion_profile: MotionProfile
    motion: Motion
    trajectory: Trajectory
    redraws: dict[str, int]

    def begin(self) -> TrajectoryIntegrator:
        """The same session before its first instant, to be made to happen again, commanded."""
        return TrajectoryIntegrator(self.bench_model, self.motion_profile, self.motion)


def run_session(settings: WorldSettings, seed: int, number: int, resolution: Resolution = FINE) -> Session:
    """Simulates session ``number`` of ``seed``: the same arguments give the same values.

    Raises:
        InputError: where every draw is rejected, or the session is too short (see `require_long_enough`).
    """
    require_long_enough(settings)
    if settings.motion.peak_within_n:
        resolution = replace(FAST, every=resolution.every, peak_n=settings.motion.peak_within_n)
    catheter = catheter_of(settings, seed, number)
    redraws = {UNFIT_CATHETER: catheter.redraws} if catheter.redraws else {}
    angle_deg, peak_n, bench = 0.0, 0.0, bench_of(settings, seed, number)
    kind = sample_kind(settings, np.random.default_rng([seed, number, 10]))
    instants = round((settings.seconds + LEAD_S + TRAIL_S) / STEP_S)
    whole = np.arange(instants, dtype=np.float64) * STEP_S - LEAD_S
    for attempt in range(_DRAWS):
        rng = np.random.default_rng([seed, number, 1, attempt])
        parameters = sample_parameters(settings, catheter.device, rng)
        if attempt % _SAME_ANGLE == 0:
            angle_deg = parameters.contact_angle_deg
        if attempt % settings.motion.same_peak == 0:
            peak_n = parameters.peak_force_n
        shared = {"contact_angle_deg": angle_deg, "peak_force_n": peak_n} | kind | bench
        parameters = replace(parameters, **shared)
        bench_model = build_bench_model(settings, parameters)
        motion_profile = compose_motion(bench_model, whole, rng)
        found = solve(
            build_bench_model(settings, parameters, resolution.trial_segment_m)
            if resolution.trial_segment_m
            else bench_model,
            motion_profile,
            resolution,
        )
        why = found if isinstance(found, str) else ""
        if isinstance(found, Motion):
            trajectory = integrate_trajectory(bench_model, motion_profile, found, resolution.every)
            why = rejection_reason(bench_model, trajectory)
            if not why:
                return Session(bench_model, motion_profile, found, trajectory, redraws)
        redraws[why] = redraws.get(why, 0) + 1
    redraws.pop(UNFIT_CATHETER, None)
    worst = max(redraws, key=lambda reason: redraws[reason])
    raise InputError(
        f"session {number} of seed {seed}: none of {_DRAWS} draws could be had, most often: {worst}; widen "
        "motion.peak_force_n, motion.free_share or motion.amplitude_m"
    )


def require_long_enough(settings: WorldSettings) -> None:
    """Raises InputError for a session that is over before the wall has beaten for a second: nothing can be solved."""
    least = settings.tare_s + APPROACH_S + _BEATING_S
    if settings.seconds < least:
        raise InputError(
            f"world.seconds={settings.seconds:g}: a session needs {settings.tare_s:g} s of tare (world.tare_s), "
            f"{APPROACH_S:g} s of approach and {_BEATING_S:g} s of beats; state at least {least:g} s"
        )
