"""Solves for the stage motion that gives a session its largest force, by trials."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.optimize import brentq

from ...mechanics import SpatialContactSolver
from ...types import FloatArray
from ._bench_model import BenchModel
from ._motion_profile import APPROACH_S, STEP_S, Motion, MotionProfile
from ._parameters import BY_HAND
from ._trajectory import Trajectory, TrajectoryIntegrator, integrate_trajectory, thinned

_COARSE_STEP_S = 4e-3
_MAX_TRIALS = 15
_CHUNK_INSTANTS = 1000
"""Number of instants of a trial after which its force is checked."""
_MAX_FORCE_RATIO = 1.5
"""A trial ends when its force exceeds this ratio to the wanted one: the rest of it has no further information."""
_MIN_FORCE_N = 1e-3
_MAX_DEPTH_M = 40e-3
"""Range beyond first contact in which the smallest and the largest force are searched."""
_DEPTH_STEP_M = 0.3e-3
"""Step in which the tip is first pressed on the wall at rest."""


@dataclass(frozen=True, slots=True)
class Resolution:
    """Step sizes with which a session is simulated. The stage moves at every instant in any case.

    Attributes:
        every: interval between solutions of the rod, in instants.
        trial_every: the same for the trials that solve the motion; 0: stage and rod every 4 ms.
        trial_segment_m: length of the rod's segments in the trials; 0: that of the session.
        peak_n: largest difference of the largest force from the drawn one; 0: the amplitude is solved to 10 um.
    """

    every: int = 1
    trial_every: int = 0
    trial_segment_m: float = 0.0
    peak_n: float = 0.0


FINE = Resolution()
"""Resolution of recordings."""
FAST = Resolution(every=5, trial_every=20, trial_segment_m=2e-3, peak_n=5e-3)
"""For single images: on the same motion the force is mostly within 0.2 mN rms of that of `FINE`, in less time."""
_TOO_LITTLE = "too little force at the largest amplitude"
_TOO_MUCH = "too much force at the smallest amplitude"


def solve(bench_model: BenchModel, motion_profile: MotionProfile, resolution: Resolution) -> Motion | str:
    """Solves the motion of a session.

    Args:
        bench_model: the bench.
        motion_profile: the motion before its amplitude is known.
        resolution: step sizes of the trials.

    Returns:
        The motion with the wanted largest force and share of time without contact, or the rejection reason.
    """
    settings = bench_model.settings
    # Two breaths show all that happens while the knob stands still and a heart beats.
    span = APPROACH_S + 2.0 / settings.motion.respiration_hz
    repeats = settings.actuation.knob_deg_per_s == 0.0 and bench_model.parameters.wave != BY_HAND
    end = settings.tare_s + span if repeats else settings.seconds
    coarse = motion_profile.thinned(
        1 if resolution.trial_every else round(_COARSE_STEP_S / STEP_S), settings.tare_s, end
    )
    if bench_model.parameters.least_force_n is not None:
        return _solve_range(bench_model, coarse, resolution)
    return (
        _solve_approximately(bench_model, motion_profile, coarse, resolution)
        if resolution.trial_every
        else _solve_exactly(bench_model, motion_profile, coarse)
    )


def _peak_n(trajectory: Trajectory) -> float:
    return float(np.linalg.norm(trajectory.contact.force_n, axis=1).max())


def _least_n(bench_model: BenchModel, trajectory: Trajectory) -> float:
    """Returns the smallest force after the approach."""
    beating = trajectory.time_s > bench_model.settings.tare_s + APPROACH_S
    return float(np.linalg.norm(trajectory.contact.force_n[beating], axis=1).min(initial=np.inf))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Returns the zero of ``function`` to 10 um."""
    return float(cast("float", brentq(function, low, high, xtol=1e-5)))


def _solve_exactly(bench_model: BenchModel, motion_profile: MotionProfile, coarse: MotionProfile) -> Motion | str:
    """Solves the amplitude to 10 um by trials on the profile ``coarse``; returns the motion or the rejection reason."""

    def motion(amplitude: float) -> Motion:
        return Motion(amplitude, motion_profile.standoff_m(bench_model, amplitude))

    wanted_n, peaks_n = bench_model.parameters.peak_force_n, dict[float, float]()

    def excess(amplitude: float) -> float:
        if amplitude not in peaks_n:
            peaks_n[amplitude] = _peak_n(integrate_trajectory(bench_model, coarse, motion(amplitude)))
        return peaks_n[amplitude] - wanted_n

    low, high = bench_model.settings.motion.amplitude_m
    if excess(high) < 0.0:
        return _TOO_LITTLE
    peaks_n[low] = _peak_n(_trial(bench_model, coarse, motion(low), 1, wanted_n)[0])
    if excess(low) > 0.0:
        return _TOO_MUCH
    solved = motion(_root(excess, low, high))
    return _side_contact(bench_model, integrate_trajectory(bench_model, coarse, solved)) or solved


def _solve_approximately(
    bench_model: BenchModel, motion_profile: MotionProfile, coarse: MotionProfile, resolution: Resolution
) -> Motion | str:
    """Returns an amplitude whose largest force is within ``resolution.peak_n``, or why the session is rejected.

    The static solution gives the force at each depth; each trial then shows by which ratio the true force differs.
    """
    wanted = bench_model.parameters.peak_force_n
    low, high = bench_model.settings.motion.amplitude_m
    amplitudes, forces = _static_forces(bench_model, coarse)
    below, above, ratio = 0.0, math.inf, 1.0  # amplitudes known to be too small and too large; true / static force
    for _ in range(_MAX_TRIALS):
        amplitude = min(max(float(np.interp(wanted / ratio, forces, amplitudes)), low), high)
        if math.isfinite(above) and below > 0.0:  # stay 10 % inside the bracket
            inset = 0.1 * (above - below)
            amplitude = min(max(amplitude, below + inset), above - inset)
        motion = Motion(amplitude, motion_profile.standoff_m(bench_model, amplitude))
        enough_n = wanted if amplitude <= low else _MAX_FORCE_RATIO * wanted
        trajectory, complete = _trial(bench_model, coarse, motion, resolution.trial_every, enough_n)
        peak = _peak_n(trajectory)
        if complete and abs(peak - wanted) <= resolution.peak_n:
            return rejection_reason(bench_model, trajectory) or motion
        if peak > wanted:
            if amplitude <= low:
                return _TOO_MUCH
            above = amplitude
        else:
            if amplitude >= high:
                return _TOO_LITTLE
            below = amplitude
        ratio = max(peak, _MIN_FORCE_N) / max(float(np.interp(amplitude, amplitudes, forces)), _MIN_FORCE_N)
    return "no amplitude gives the force"


def _solve_range(bench_model: BenchModel, coarse: MotionProfile, resolution: Resolution) -> Motion | str:
    """Returns the motion with the wanted smallest and largest force, or why the session is rejected.

    The static solution gives the depths of these forces; each trial then shows by which ratio the true forces differ.
    """
    parameters, (low, high) = bench_model.parameters, bench_model.settings.motion.amplitude_m
    wanted_n = np.array([parameters.least_force_n, parameters.peak_force_n])
    beating = coarse.time_s > bench_model.settings.tare_s + APPROACH_S
    depths, forces = _forces_at_rest(bench_model, coarse, _MAX_DEPTH_M)
    aimed_n: FloatArray = wanted_n.copy()
    for _ in range(_MAX_TRIALS):
        if aimed_n[1] >= forces[-1]:
            return _TOO_LITTLE
        shallow, deep = np.interp(aimed_n, forces, depths).tolist()

        def excess_m(amplitude: float, stroke_m: float = deep - shallow) -> float:
            """Returns by how much the stage's stroke is longer than the wanted ``stroke_m``."""
            return float(np.ptp(coarse.push_m(bench_model, amplitude)[beating])) - stroke_m

        if excess_m(low) > 0.0:
            return _TOO_MUCH
        if excess_m(high) < 0.0:
            return _TOO_LITTLE
        amplitude: float = _root(excess_m, low, high)
        motion = Motion(amplitude, float(coarse.push_m(bench_model, amplitude)[beating].max()) - deep)
        trajectory, complete = _trial(
            bench_model, coarse, motion, resolution.trial_every, _MAX_FORCE_RATIO * float(wanted_n[1])
        )
        peak = _peak_n(trajectory)
        if not complete:
            aimed_n = aimed_n * wanted_n[1] / peak
            continue
        reached = np.array([_least_n(bench_model, trajectory), peak])
        if np.abs(reached - wanted_n).max() <= resolution.peak_n:
            return rejection_reason(bench_model, trajectory) or motion
        aimed_n = aimed_n * wanted_n / np.maximum(reached, _MIN_FORCE_N)
    return "no amplitude and stand-off give the forces"


def _forces_at_rest(bench_model: BenchModel, coarse: MotionProfile, deepest_m: float) -> tuple[FloatArray, FloatArray]:
    """Returns (k,) depths of the wall beyond first contact, and (k,) the tip's force at rest there, made monotonic.

    ``deepest_m``: largest depth. The knob has the median angle of the profile.
    """
    depth = np.arange(-_DEPTH_STEP_M, deepest_m + _DEPTH_STEP_M, _DEPTH_STEP_M)
    solver = SpatialContactSolver(bench_model.rod, bench_model.wall, 1.0, bench_model.radius_m)
    curvature = np.zeros((depth.size, 3))
    curvature[:, 2] = np.median(coarse.curvature_per_m)
    stage_gap_m = bench_model.reach_m(curvature[:1, 2]) - depth
    wall = bench_model.touch_m + bench_model.directed(np.stack([-stage_gap_m, np.zeros(depth.size)], axis=1))
    force = np.linalg.norm(solver.run(wall, curvature).force_n, axis=1)
    return depth, np.maximum.accumulate(force)


def _static_forces(bench_model: BenchModel, coarse: MotionProfile) -> tuple[FloatArray, FloatArray]:
    """Returns (k,) amplitudes, and (k,) the force at rest at the largest depth of the stage with each."""
    amplitudes = np.linspace(*bench_model.settings.motion.amplitude_m, 16)
    deepest = np.array(
        [float(coarse.push_m(bench_model, a).max()) - coarse.standoff_m(bench_model, a) for a in amplitudes]
    )
    return amplitudes, np.interp(deepest, *_forces_at_rest(bench_model, coarse, float(deepest.max())))


def _trial(
    bench_model: BenchModel, coarse: MotionProfile, motion: Motion, every: int, enough_n: float
) -> tuple[Trajectory, bool]:
    """Simulates ``motion`` until its force exceeds ``enough_n``; returns the trajectory, and whether it is complete.

    ``every``: interval between solutions of the rod, in instants.
    """
    run, count = TrajectoryIntegrator(bench_model, coarse, motion, every), coarse.time_s.size
    while run.done < count:
        first = run.done
        run.advance(first + _CHUNK_INSTANTS)
        force_n = np.linalg.norm(run.trajectory.contact.force_n[first : run.done], axis=1)
        if float(force_n.max()) > enough_n:
            break
    return thinned(run.trajectory, every), run.done == count


def rejection_reason(bench_model: BenchModel, trajectory: Trajectory) -> str:
    """Returns why the session is rejected, or an empty string.

    Args:
        bench_model: the bench.
        trajectory: the simulated session.
    """
    contact, motion = trajectory.contact, bench_model.settings.motion
    if not contact.converged.all():
        return "no equilibrium found"
    if not 0.95 * motion.peak_force_n[0] <= _peak_n(trajectory) <= 1.05 * motion.peak_force_n[1]:
        return "peak force out of range"
    beating = trajectory.time_s > bench_model.settings.tare_s + APPROACH_S
    if motion.least_force_n is not None:
        if _least_n(bench_model, trajectory) < 0.95 * motion.least_force_n[0]:
            return "least force out of range"
        return _side_contact(bench_model, trajectory)
    free = 1.0 - float(contact.touching[beating].mean())
    if not motion.free_share[0] <= free <= motion.free_share[1]:
        return "time without contact out of range"
    return _side_contact(bench_model, trajectory)


def _side_contact(bench_model: BenchModel, trajectory: Trajectory) -> str:
    """Returns a rejection reason if the side of the electrode would touch, not its dome; else an empty string.

    The dome touches while the tip's axis points into the surface: at more than about 3 degrees to it.
    """
    if bench_model.wall.side_stiffness_n_per_m2 > 0.0:
        return ""  # the side touches too
    contact, wall = trajectory.contact, bench_model.wall
    axes = contact.tip_axes(contact.touching)
    if wall.face_radius_m is None:
        cosines = axes @ wall.normal
    else:
        cosines = (axes * wall.normals_at((contact.touch_m - trajectory.wall_m)[contact.touching])).sum(axis=1)
    smallest = float(cosines.min(initial=1.0))
    return "the electrode's side, not its dome, would touch" if smallest < 0.05 else ""
