"""The catheter that consecutive sessions share: drawn again where no motion brings it to the forces that are asked for.

The choice hangs on the catheter's own random numbers alone, never on a session's, so all of its sessions find the same
one, in whatever order and process they are made.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...errors import InputError
from ._course import run_course
from ._draw import Device, draw_device, draw_session
from ._rig import build_rig
from ._tune import APPROACH_S, Motion, compose
from .settings import WorldSettings

__all__ = ["Catheter", "catheter_of"]

_TRIALS = 100
_REDRAWS = 50
_STEP_S = 8e-3


@dataclass(frozen=True, slots=True)
class Catheter:
    """``redraws``: how many catheters were drawn before this one and could not be used."""

    device: Device
    redraws: int = 0


def catheter_of(settings: WorldSettings, seed: int, session: int) -> Catheter:
    """The catheter of a session.

    One that serves a single session is taken as drawn: that session finds out for itself. Raises InputError where no
    catheter reaches the forces.
    """
    if settings.shaft.sessions_per_catheter == 1:
        return Catheter(draw_device(settings, seed, session))
    return _shared(settings.model_dump_json(), seed, session // settings.shaft.sessions_per_catheter)


@lru_cache(maxsize=64)
def _shared(settings_json: str, seed: int, number: int) -> Catheter:
    settings = WorldSettings.model_validate_json(settings_json)
    first = number * settings.shaft.sessions_per_catheter
    for redraws in range(_REDRAWS):
        device = draw_device(settings, seed, first, redraws)
        if any(_reaches(settings, device, (seed, number, 6, redraws, trial)) for trial in range(_TRIALS)):
            return Catheter(device, redraws)
    raise InputError(
        f"catheter {number} of seed {seed}: none of {_REDRAWS} draws of it reaches the forces asked for; widen "
        "motion.peak_force_n or motion.amplitude_m, or change the ranges of the shaft"
    )


def _reaches(settings: WorldSettings, device: Device, key: tuple[int, ...]) -> bool:
    """Whether one drawn session comes to the least of the wanted peak forces, over two breaths of largest amplitude."""
    rng = np.random.default_rng(key)
    brief = settings.model_copy(update={"tare_s": 0.0})
    rig = build_rig(brief, draw_session(brief, device, rng))
    span = APPROACH_S + 2.0 / settings.motion.respiration_hz
    tune = compose(rig, np.arange(round(span / _STEP_S), dtype=np.float64) * _STEP_S, rng)
    largest = settings.motion.amplitude_m[1]
    contact = run_course(rig, tune, Motion(largest, tune.standoff_m(rig, largest))).contact
    peak = float(np.linalg.norm(contact.force_n, axis=1).max())
    return bool(contact.converged.all()) and peak >= settings.motion.peak_force_n[0]
