"""One session: drawn, its motion solved, run; drawn again where it cannot be had."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import cast

import numpy as np
from scipy.optimize import brentq

from ...errors import InputError
from ._course import Course, CourseRun, run_course
from ._device import catheter_of
from ._draw import draw_session
from ._rig import Rig, build_rig
from ._tune import APPROACH_S, LEAD_S, STEP_S, TRAIL_S, Motion, Tune, compose
from .settings import WorldSettings

__all__ = ["FINE", "SWIFT", "Pace", "Session", "run_session"]

_COARSE_S = 4e-3
_DRAWS = 400
_SAME_ANGLE = 4
"""Draws in a row that share their contact angle: steep ones fail more often and would be rare with an angle a draw."""
_TRIALS = 40


@dataclass(frozen=True, slots=True)
class Pace:
    """How finely a session is run. The stage always moves at every instant.

    ``every``: the rod follows at every so many. ``trial_every``: in the trials that solve the motion; 0: stage and rod
    every 4 ms. ``peak_n``: how near the largest force then comes to the drawn one; 0: the amplitude to 10 um.
    """

    every: int = 1
    trial_every: int = 0
    peak_n: float = 0.0


FINE = Pace()
"""What recordings are made with."""
SWIFT = Pace(every=5, trial_every=10, peak_n=2e-3)
"""For single pictures: on the same motion the force is mostly within 0.2 mN rms of that of `FINE`, in less time."""
UNFIT_CATHETER = "no motion brings the catheter to the forces"


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What is true of one session. ``redraws``: by reason, how often its values were drawn again.

    Of the catheter's own draws `UNFIT_CATHETER` counts. ``course``: what happens where nobody commands a drive.
    """

    rig: Rig
    tune: Tune
    motion: Motion
    course: Course
    redraws: dict[str, int]

    def begin(self) -> CourseRun:
        """The same session before its first instant, to be made to happen again, commanded."""
        return CourseRun(self.rig, self.tune, self.motion)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where ``function`` crosses zero, to 10 um."""
    return float(cast("float", brentq(function, low, high, xtol=1e-5)))


_LITTLE = "too little force at the largest amplitude"
_MUCH = "too much force at the smallest amplitude"


def _approach(excess: Callable[[float], float], low: float, high: float, wanted_n: float, near_n: float) -> float | str:
    """Where ``excess`` is at most ``near_n``; or that it lies below ``low`` or above ``high``.

    From where the force would be in proportion to the amplitude, then by the line through the nearest on either side.
    """
    at, below, above = math.sqrt(low * high), (low, math.nan), (high, math.nan)
    for _ in range(_TRIALS):
        now = excess(at)
        if abs(now) <= near_n:
            return at
        if now < 0.0:
            if at >= high:
                return _LITTLE
            below = at, now
        else:
            if at <= low:
                return _MUCH
            above = at, now
        if math.isnan(below[1]) or math.isnan(above[1]):
            at = min(max(at * wanted_n / max(wanted_n + now, 0.1 * wanted_n), low), high)
        else:
            share = below[1] / (below[1] - above[1])
            # kept off the ends, where the line of a bent curve would stay for long
            at = below[0] + min(max(share, 0.1), 0.9) * (above[0] - below[0])
    return at


def _solve(rig: Rig, tune: Tune, pace: Pace) -> Motion | str:
    """The amplitude that gives the peak force, with the stand-off that frees the tip long enough; or why not."""
    settings = rig.settings
    # Two breaths show all that happens while the knob stands still.
    span = APPROACH_S + 2.0 / settings.motion.respiration_hz
    end = settings.tare_s + span if settings.actuation.knob_deg_per_s == 0.0 else settings.seconds
    coarse = tune.thinned(1 if pace.trial_every else round(_COARSE_S / STEP_S), settings.tare_s, end)

    def motion(amplitude: float) -> Motion:
        return Motion(amplitude, tune.standoff_m(rig, amplitude))

    @cache  # the search begins at the two ends, which are looked at before it
    def excess(amplitude: float) -> float:
        force = run_course(rig, coarse, motion(amplitude), max(pace.trial_every, 1)).contact.force_n
        return float(np.linalg.norm(force, axis=1).max()) - rig.draw.peak_force_n

    low, high = settings.motion.amplitude_m
    if pace.peak_n > 0.0:
        near = _approach(excess, low, high, rig.draw.peak_force_n, pace.peak_n)
        return near if isinstance(near, str) else motion(near)
    if excess(low) > 0.0:
        return _MUCH
    if excess(high) < 0.0:
        return _LITTLE
    found = motion(_root(excess, low, high))
    return _lies_down(rig, run_course(rig, coarse, found)) or found


def _objection(rig: Rig, course: Course) -> str:
    """Why a careful person would not have kept this session, or empty."""
    contact, motion = course.contact, rig.settings.motion
    if not contact.converged.all():
        return "no equilibrium found"
    peak = float(np.linalg.norm(contact.force_n, axis=1).max())
    if not 0.95 * motion.peak_force_n[0] <= peak <= 1.05 * motion.peak_force_n[1]:
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
    axis = contact.frames()[:, -1, :, 0]
    steepest = float((axis @ rig.wall.normal)[contact.touching].min(initial=1.0))
    return "the electrode's side, not its dome, would touch" if steepest < 0.05 else ""


def run_session(settings: WorldSettings, seed: int, number: int, pace: Pace = FINE) -> Session:
    """The session ``number`` of ``seed``: the same arguments give the same values.

    Raises InputError where the settings leave no session that can be had.
    """
    catheter = catheter_of(settings, seed, number)
    redraws = {UNFIT_CATHETER: catheter.redraws} if catheter.redraws else {}
    angle_deg = 0.0
    instants = round((settings.seconds + LEAD_S + TRAIL_S) / STEP_S)
    whole = np.arange(instants, dtype=np.float64) * STEP_S - LEAD_S
    for attempt in range(_DRAWS):
        rng = np.random.default_rng([seed, number, 1, attempt])
        draw = draw_session(settings, catheter.device, rng)
        if attempt % _SAME_ANGLE == 0:
            angle_deg = draw.contact_angle_deg
        rig = build_rig(settings, replace(draw, contact_angle_deg=angle_deg))
        tune = compose(rig, whole, rng)
        found = _solve(rig, tune, pace)
        why = found if isinstance(found, str) else ""
        if isinstance(found, Motion):
            course = run_course(rig, tune, found, pace.every)
            why = _objection(rig, course)
            if not why:
                return Session(rig, tune, found, course, redraws)
        redraws[why] = redraws.get(why, 0) + 1
    redraws.pop(UNFIT_CATHETER, None)
    worst = max(redraws, key=lambda reason: redraws[reason])
    raise InputError(
        f"session {number} of seed {seed}: none of {_DRAWS} draws could be had, most often: {worst}; widen "
        "motion.peak_force_n, motion.free_share or motion.amplitude_m"
    )
