"""One session: drawn, its motion solved, run; drawn again where it cannot be had."""

from dataclasses import dataclass, replace

import numpy as np

from ...errors import InputError
from ._course import Course, CourseRun, run_course
from ._device import catheter_of
from ._draw import draw_session
from ._rig import Rig, build_rig
from ._solve import FINE, Pace, objection, solve
from ._tune import APPROACH_S, LEAD_S, STEP_S, TRAIL_S, Motion, Tune, compose
from .settings import WorldSettings

__all__ = ["Session", "refuse_short", "run_session"]

_DRAWS = 400
_SAME_ANGLE = 4
"""Draws in a row that share their contact angle: steep ones fail more often and would be rare with an angle a draw."""
_BEATING_S = 1.0
"""Largest force and time without contact are solved for on what follows the approach: at least so much."""
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


def run_session(settings: WorldSettings, seed: int, number: int, pace: Pace = FINE) -> Session:
    """The session ``number`` of ``seed``: the same arguments give the same values.

    Raises InputError where the settings leave no session that can be had, or it is too short, see `refuse_short`.
    """
    refuse_short(settings)
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
        draw = replace(draw, contact_angle_deg=angle_deg)
        rig = build_rig(settings, draw)
        tune = compose(rig, whole, rng)
        found = solve(build_rig(settings, draw, pace.trial_segment_m) if pace.trial_segment_m else rig, tune, pace)
        why = found if isinstance(found, str) else ""
        if isinstance(found, Motion):
            course = run_course(rig, tune, found, pace.every)
            why = objection(rig, course)
            if not why:
                return Session(rig, tune, found, course, redraws)
        redraws[why] = redraws.get(why, 0) + 1
    redraws.pop(UNFIT_CATHETER, None)
    worst = max(redraws, key=lambda reason: redraws[reason])
    raise InputError(
        f"session {number} of seed {seed}: none of {_DRAWS} draws could be had, most often: {worst}; widen "
        "motion.peak_force_n, motion.free_share or motion.amplitude_m"
    )


def refuse_short(settings: WorldSettings) -> None:
    """Raises InputError for a session that is over before the wall has beaten for a second: nothing can be solved."""
    least = settings.tare_s + APPROACH_S + _BEATING_S
    if settings.seconds < least:
        raise InputError(
            f"world.seconds={settings.seconds:g}: a session needs {settings.tare_s:g} s of tare (world.tare_s), "
            f"{APPROACH_S:g} s of approach and {_BEATING_S:g} s of beats; state at least {least:g} s"
        )
