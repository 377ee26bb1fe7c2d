"""How far a session's stage must move for the largest force that was drawn, found by trial."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.optimize import brentq

from ...mechanics import SpatialContactSolver
from ...types import FloatArray
from ._course import Course, CourseRun, run_course, thinned
from ._rig import Rig
from ._tune import APPROACH_S, STEP_S, Motion, Tune

__all__ = ["FINE", "SWIFT", "Pace", "objection", "solve"]

_COARSE_S = 4e-3
_TRIALS = 15
_CHUNK = 1000
"""Instants of a trial between two looks at its force."""
_ENOUGH = 1.5
"""A trial that comes to so many times the wanted force says no more by going on."""
_LEAST_N = 1e-3
_RAMP_M = 0.3e-3
"""Steps in which the tip is first pressed on the wall at rest."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How finely a session is run. The stage always moves at every instant.

    ``every``: the rod follows at every so many. ``trial_every``: in the trials that solve the motion; 0: stage and rod
    every 4 ms. ``trial_segment_m``: length of the rod's segments in them; 0: the session's own. ``peak_n``: how near
    the largest force then comes to the drawn one; 0: the amplitude to 10 um.
    """

    every: int = 1
    trial_every: int = 0
    trial_segment_m: float = 0.0
    peak_n: float = 0.0


FINE = Pace()
"""What recordings are made with."""
SWIFT = Pace(every=5, trial_every=20, trial_segment_m=2e-3, peak_n=5e-3)
"""For single pictures: on the same motion the force is mostly within 0.2 mN rms of that of `FINE`, in less time."""

_LITTLE = "too little force at the largest amplitude"
_MUCH = "too much force at the smallest amplitude"


def solve(rig: Rig, tune: Tune, pace: Pace) -> Motion | str:
    """The amplitude that gives the peak force, with the stand-off that frees the tip long enough; or why not."""
    settings = rig.settings
    # Two breaths show all that happens while the knob stands still.
    span = APPROACH_S + 2.0 / settings.motion.respiration_hz
    end = settings.tare_s + span if settings.actuation.knob_deg_per_s == 0.0 else settings.seconds
    coarse = tune.thinned(1 if pace.trial_every else round(_COARSE_S / STEP_S), settings.tare_s, end)
    return _near(rig, tune, coarse, pace) if pace.trial_every else _exact(rig, tune, coarse)


def _peak_n(course: Course) -> float:
    return float(np.linalg.norm(course.contact.force_n, axis=1).max())


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where ``function`` crosses zero, to 10 um."""
    return float(cast("float", brentq(function, low, high, xtol=1e-5)))


def _exact(rig: Rig, tune: Tune, coarse: Tune) -> Motion | str:
    """The amplitude to 10 um."""

    def motion(amplitude: float) -> Motion:
        return Motion(amplitude, tune.standoff_m(rig, amplitude))

    wanted, peaks = rig.draw.peak_force_n, dict[float, float]()

    def excess(amplitude: float) -> float:
        if amplitude not in peaks:
            peaks[amplitude] = _peak_n(run_course(rig, coarse, motion(amplitude)))
        return peaks[amplitude] - wanted

    low, high = rig.settings.motion.amplitude_m
    if excess(high) < 0.0:
        return _LITTLE
    peaks[low] = _peak_n(_trial(rig, coarse, motion(low), 1, wanted)[0])
    if excess(low) > 0.0:
        return _MUCH
    found = motion(_root(excess, low, high))
    return _lies_down(rig, run_course(rig, coarse, found)) or found


def _near(rig: Rig, tune: Tune, coarse: Tune, pace: Pace) -> Motion | str:
    """An amplitude whose largest force is within ``pace.peak_n``; what is wrong with the session, seen in that trial.

    The wall at rest tells which depth gives which force; each trial then tells how far off that is.
    """
    wanted = rig.draw.peak_force_n
    low, high = rig.settings.motion.amplitude_m
    amplitudes, forces = _pressed(rig, coarse)
    below, above, ratio = 0.0, math.inf, 1.0
    for _ in range(_TRIALS):
        at = min(max(float(np.interp(wanted / ratio, forces, amplitudes)), low), high)
        if math.isfinite(above) and below > 0.0:
            share = 0.1 * (above - below)
            at = min(max(at, below + share), above - share)
        motion = Motion(at, tune.standoff_m(rig, at))
        course, whole = _trial(rig, coarse, motion, pace.trial_every, wanted if at <= low else _ENOUGH * wanted)
        peak = _peak_n(course)
        if whole and abs(peak - wanted) <= pace.peak_n:
            return objection(rig, course) or motion
        if peak > wanted:
            if at <= low:
                return _MUCH
            above = at
        else:
            if at >= high:
                return _LITTLE
            below = at
        ratio = max(peak, _LEAST_N) / max(float(np.interp(at, amplitudes, forces)), _LEAST_N)
    return "no amplitude gives the force"


def _pressed(rig: Rig, coarse: Tune) -> tuple[FloatArray, FloatArray]:
    """(k,) amplitudes, and (k,) the force that the wall at rest gives where the stage then comes farthest."""
    amplitudes = np.linspace(*rig.settings.motion.amplitude_m, 16)
    deepest = np.array([float(coarse.push_m(rig, a).max()) - coarse.standoff_m(rig, a) for a in amplitudes])
    depth = np.arange(-_RAMP_M, float(deepest.max()) + _RAMP_M, _RAMP_M)
    press = SpatialContactSolver(rig.rod, rig.wall, 1.0, rig.radius_m)
    turned = np.zeros((depth.size, 3))
    turned[:, 2] = np.median(coarse.curvature_per_m)
    beyond = rig.reach_m(turned[:1, 2]) - depth
    wall = rig.touch_m + rig.directed(np.stack([-beyond, np.zeros(depth.size)], axis=1))
    force = np.linalg.norm(press.run(wall, turned).force_n, axis=1)
    return amplitudes, np.interp(deepest, depth, np.maximum.accumulate(force))


def _trial(rig: Rig, coarse: Tune, motion: Motion, every: int, enough_n: float) -> tuple[Course, bool]:
    """The course until more than ``enough_n`` is reached, and whether that is all of it."""
    run, count = CourseRun(rig, coarse, motion, every), coarse.time_s.size
    while run.done < count:
        first = run.done
        run.advance(first + _CHUNK)
        now = np.linalg.norm(run.course.contact.force_n[first : run.done], axis=1)
        if float(now.max()) > enough_n:
            break
    return thinned(run.course, every), run.done == count


def objection(rig: Rig, course: Course) -> str:
    """Why a careful person would not have kept this session, or empty."""
    contact, motion = course.contact, rig.settings.motion
    if not contact.converged.all():
        return "no equilibrium found"
    if not 0.95 * motion.peak_force_n[0] <= _peak_n(course) <= 1.05 * motion.peak_force_n[1]:
        return "peak force out of range"
    beating = course.time_s > rig.settings.tare_s + APPROACH_S
    free = 1.0 - float(contact.touching[beating].mean())
    if not motion.free_share[0] <= free <= motion.free_share[1]:
        return "time without contact out of range"
    return _lies_down(rig, course)


def _lies_down(rig: Rig, course: Course) -> str:
    """The objection that the dome does not touch, or empty."""
    if rig.wall.side_stiffness_n_per_m2 > 0.0:
        return ""  # the side touches too
    contact = course.contact
    steepest = float((contact.tip_axes(contact.touching) @ rig.wall.normal).min(initial=1.0))
    return "the electrode's side, not its dome, would touch" if steepest < 0.05 else ""
