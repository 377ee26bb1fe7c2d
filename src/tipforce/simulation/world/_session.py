"""One session: its parameters are drawn, its motion is solved, it is simulated; it is drawn again if it is rejected.

Consecutive sessions share a catheter. It is drawn again if no motion brings it to the requested forces. That choice
depends on the catheter's own random numbers alone, never on a session's, so all of its sessions find the same one, in
any order and in any process. The last constants in a key of random numbers (1, 6, 10, 13) keep their streams apart.
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
"""Largest number of trial sessions of a catheter, of which one must reach the forces."""
_REDRAWS = 50
"""Largest number of draws of a catheter or of a bench."""
_TRIAL_STEP_S = 8e-3


@dataclass(frozen=True, slots=True)
class SampledDevice:
    """A catheter, and the number ``redraws`` of catheters that were drawn before it and rejected."""

    device: DeviceProperties
    redraws: int = 0


def catheter_of(settings: WorldSettings, seed: int, session: int) -> SampledDevice:
    """Returns the catheter of a session.

    A catheter of several sessions is drawn again until one trial session with it reaches the wanted forces. A catheter
    of a single session is drawn without this test: it is rejected with the session.

    Args:
        settings: settings of the world.
        seed: seed of all random numbers.
        session: number of the session.

    Returns:
        The catheter, with the number of draws that were rejected.

    Raises:
        InputError: no draw of a catheter of several sessions reaches the wanted forces.
    """
    if settings.shaft.sessions_per_catheter == 1:
        return SampledDevice(sample_device(settings, seed, session))
    return _shared(settings.model_dump_json(), seed, session // settings.shaft.sessions_per_catheter)


@lru_cache(maxsize=64)
def _shared(settings_json: str, seed: int, number: int) -> SampledDevice:
    """Returns catheter ``number`` of ``seed``, see `catheter_of`; settings are JSON, which the cache can compare."""
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
    """Returns whether a trial session with ``device`` and the random numbers of ``key`` reaches the wanted forces.

    Over two breaths, the largest amplitude must reach the lower end of the range of peak forces. If a smallest force is
    wanted, too, the motion is solved.
    """
    rng = np.random.default_rng(key)
    if settings.motion.least_force_n:
        return _solvable(settings, sample_parameters(settings, device, rng), rng)
    without_tare = settings.model_copy(update={"tare_s": 0.0})
    bench_model = build_bench_model(without_tare, sample_parameters(without_tare, device, rng))
    motion_profile = compose_motion(bench_model, _two_breaths(settings, _TRIAL_STEP_S), rng)
    largest = settings.motion.amplitude_m[1]
    contact = integrate_trajectory(
        bench_model, motion_profile, Motion(largest, motion_profile.standoff_m(bench_model, largest))
    ).contact
    peak = float(np.linalg.norm(contact.force_n, axis=1).max())
    return bool(contact.converged.all()) and peak >= settings.motion.peak_force_n[0]


def _solvable(settings: WorldSettings, parameters: SessionParameters, rng: np.random.Generator) -> bool:
    """Returns whether some motion gives the session its smallest and its largest force over two breaths."""
    without_tare = settings.model_copy(update={"tare_s": 0.0})
    bench_model = build_bench_model(without_tare, parameters, FAST.trial_segment_m)
    motion_profile = compose_motion(bench_model, _two_breaths(settings, STEP_S), rng)
    resolution = replace(FAST, peak_n=settings.motion.peak_within_n or FAST.peak_n)
    return isinstance(solve(bench_model, motion_profile, resolution), Motion)


def _two_breaths(settings: WorldSettings, step_s: float) -> FloatArray:
    """Returns (m,) instants of the approach and of two breaths, from 0."""
    span = APPROACH_S + 2.0 / settings.motion.respiration_hz
    return np.arange(round(span / step_s), dtype=np.float64) * step_s


_BENCH_PARAMETERS = ("out_of_plane_per_m", "contact_angle_deg", "tilt_deg", "wall_stiffness_n_per_m", "friction")
"""Parameters that the sessions of one bench share, in addition to the catheter."""
_BENCH_TRIALS = 4
"""Number of drawn motions, of which one must reach the forces on a bench."""


def bench_of(settings: WorldSettings, seed: int, session: int) -> dict[str, float]:
    """Returns the parameters that the sessions of a bench share, by name; none if each session has its own bench.

    Args:
        settings: settings of the world.
        seed: seed of all random numbers.
        session: number of the session.

    Raises:
        InputError: no draw of the bench reaches the forces.
    """
    if settings.sessions_per_bench == 1:
        return {}
    return _shared_bench(settings.model_dump_json(), seed, session // settings.sessions_per_bench)


@lru_cache(maxsize=64)
def _shared_bench(settings_json: str, seed: int, number: int) -> dict[str, float]:
    """Returns the parameters of bench ``number`` of ``seed``, see `bench_of`; settings are JSON as in `_shared`."""
    settings = WorldSettings.model_validate_json(settings_json)
    device = catheter_of(settings, seed, number * settings.sessions_per_bench).device
    for redraw in range(_REDRAWS):
        rng = np.random.default_rng([seed, number, 13, redraw])
        drawn = sample_parameters(settings, device, rng)
        bench = {name: getattr(drawn, name) for name in _BENCH_PARAMETERS}
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
_DRAWS_PER_ANGLE = 4
"""Draws in a row with the same contact angle: steep angles fail more often and would be rare with an angle per draw."""
_MIN_BEATING_S = 1.0
"""Shortest time after the approach: in it the largest force and the time without contact are solved."""
UNFIT_CATHETER = "no motion brings the catheter to the forces"


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """The true values of one session.

    Attributes:
        bench_model: the bench.
        motion_profile: the motion before its amplitude is known.
        motion: the solved motion.
        trajectory: the session if no drive is commanded.
        redraws: number of rejected draws, by reason; `UNFIT_CATHETER` counts the rejected catheters.
    """

    bench_model: BenchModel
    motion_profile: MotionProfile
    motion: Motion
    trajectory: Trajectory
    redraws: dict[str, int]

    def begin(self) -> TrajectoryIntegrator:
        """Returns the same session before its first instant, to be simulated again with commands."""
        return TrajectoryIntegrator(self.bench_model, self.motion_profile, self.motion)


def run_session(settings: WorldSettings, seed: int, number: int, resolution: Resolution = FINE) -> Session:
    """Simulates session ``number`` of ``seed``: the same arguments give the same values.

    Args:
        settings: settings of the world.
        seed: seed of all random numbers.
        number: number of the session, from 0.
        resolution: step sizes.

    Returns:
        The session.

    Raises:
        InputError: every draw is rejected, or the session is too short (see `require_long_enough`).
    """
    require_long_enough(settings)
    if settings.motion.peak_within_n:
        resolution = replace(FAST, every=resolution.every, peak_n=settings.motion.peak_within_n)
    catheter = catheter_of(settings, seed, number)
    redraws = {UNFIT_CATHETER: catheter.redraws} if catheter.redraws else {}
    angle_deg, peak_n, bench = 0.0, 0.0, bench_of(settings, seed, number)
    kind = sample_kind(settings, np.random.default_rng([seed, number, 10]))
    instants = round((settings.seconds + LEAD_S + TRAIL_S) / STEP_S)
    time_s = np.arange(instants, dtype=np.float64) * STEP_S - LEAD_S
    for attempt in range(_DRAWS):
        # Some parameters stay the same for several draws: otherwise values that fail often would be rarer than drawn.
        rng = np.random.default_rng([seed, number, 1, attempt])
        parameters = sample_parameters(settings, catheter.device, rng)
        if attempt % _DRAWS_PER_ANGLE == 0:
            angle_deg = parameters.contact_angle_deg
        if attempt % settings.motion.same_peak == 0:
            peak_n = parameters.peak_force_n
        shared = {"contact_angle_deg": angle_deg, "peak_force_n": peak_n} | kind | bench
        parameters = replace(parameters, **shared)
        bench_model = build_bench_model(settings, parameters)
        motion_profile = compose_motion(bench_model, time_s, rng)
        trial_model = bench_model
        if resolution.trial_segment_m:
            trial_model = build_bench_model(settings, parameters, resolution.trial_segment_m)
        solved = solve(trial_model, motion_profile, resolution)
        rejection = solved if isinstance(solved, str) else ""
        if isinstance(solved, Motion):
            trajectory = integrate_trajectory(bench_model, motion_profile, solved, resolution.every)
            rejection = rejection_reason(bench_model, trajectory)
            if not rejection:
                return Session(bench_model, motion_profile, solved, trajectory, redraws)
        redraws[rejection] = redraws.get(rejection, 0) + 1
    redraws.pop(UNFIT_CATHETER, None)
    worst = max(redraws, key=lambda reason: redraws[reason])
    raise InputError(
        f"session {number} of seed {seed}: none of {_DRAWS} draws could be had, most often: {worst}; widen "
        "motion.peak_force_n, motion.free_share or motion.amplitude_m"
    )


def require_long_enough(settings: WorldSettings) -> None:
    """Checks that a session has a second of beats or more, which its motion needs to be solved.

    Raises:
        InputError: the session is shorter.
    """
    least = settings.tare_s + APPROACH_S + _MIN_BEATING_S
    if settings.seconds < least:
        raise InputError(
            f"world.seconds={settings.seconds:g}: a session needs {settings.tare_s:g} s of tare (world.tare_s), "
            f"{APPROACH_S:g} s of approach and {_MIN_BEATING_S:g} s of beats; state at least {least:g} s"
        )
