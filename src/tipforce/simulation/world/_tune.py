"""What a session's motion is made of before it happens: knob, drift and waves, and how they are composed."""

import math
from dataclasses import dataclass, fields

import numpy as np

from ...mechanics import HeartMotion, Play
from ...types import FloatArray
from ._draw import knob_course, slow_drift
from ._rig import Rig

__all__ = ["APPROACH_S", "LEAD_S", "STEP_S", "TRAIL_S", "Motion", "Tune", "compose", "instants_until"]

STEP_S = 1e-3
"""Between instants of a session."""
LEAD_S, TRAIL_S = 0.5, 0.3
"""Simulated before the first frame and after the last: the force log's clock lies off by less."""
APPROACH_S = 1.5
CLEARANCE_M = 3e-3
"""Between tip and wall where they are closest while the sensor is tared."""


def instants_until(time_s: float) -> int:
    """How many instants of a session lie at or before ``time_s`` on the camera's clock."""
    return math.floor((time_s + LEAD_S) / STEP_S + 1e-6) + 1


@dataclass(frozen=True, slots=True)
class Motion:
    """What is solved for: amplitude along the normal, and how far the stage stands off."""

    amplitude_m: float
    standoff_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Tune:
    """What a session's motion is made of before its amplitude is known: (m,) each.

    ``transmitted_deg``: the knob behind its play; ``drift``: relative, of the curvature that follows from it.
    """

    time_s: FloatArray
    knob_deg: FloatArray
    transmitted_deg: FloatArray
    drift: FloatArray
    curvature_per_m: FloatArray
    wave: FloatArray
    lateral: FloatArray
    breath_m: FloatArray

    def thinned(self, step: int, start_s: float, end_s: float) -> "Tune":
        """Every ``step``-th instant from ``start_s`` to ``end_s``."""
        rows = np.flatnonzero((self.time_s >= start_s) & (self.time_s <= end_s))[::step]
        return Tune(*(getattr(self, field.name)[rows] for field in fields(self)))

    def push_m(self, rig: Rig, amplitude_m: float) -> FloatArray:
        """How far the wall would stand beyond first touch without standing off."""
        return amplitude_m * self.wave + self.breath_m + rig.reach_m(self.curvature_per_m)

    def standoff_m(self, rig: Rig, amplitude_m: float) -> float:
        """What frees the tip for the wanted share of the beats."""
        beating = self.time_s > rig.settings.tare_s + APPROACH_S
        return float(np.quantile(self.push_m(rig, amplitude_m)[beating], rig.draw.free_share))

    def programme_m(self, rig: Rig, motion: Motion) -> FloatArray:
        """(m, 2): what the stage's axes are told, forward and across; at first out of the tip's reach, for the tare."""
        push = self.push_m(rig, motion.amplitude_m)
        near = np.clip((self.time_s - rig.settings.tare_s) / APPROACH_S, 0.0, 1.0)
        away = (1.0 - near * near * (3.0 - 2.0 * near)) * (push.max() - motion.standoff_m + CLEARANCE_M)
        forward = motion.amplitude_m * self.wave + self.breath_m - motion.standoff_m - away
        return np.stack([forward, motion.amplitude_m * self.lateral], axis=1)


def compose(rig: Rig, time_s: FloatArray, rng: np.random.Generator) -> Tune:
    """Knob, drift and waves over ``time_s``, evenly spaced."""
    draw, settings = rig.draw, rig.settings
    knob = knob_course(draw, time_s, rng)
    actuation = settings.actuation
    transmitted = Play(actuation.play_deg, output=float(knob[0]) + draw.play_start_deg).run(knob)
    drift = slow_drift(actuation.drift_rms, actuation.drift_s, time_s, rng)
    heart = HeartMotion(
        amplitude_m=1.0,  # to be solved for
        beat_hz=draw.beat_hz,
        wave=draw.wave,
        lateral_share=draw.lateral_share,
        lateral_phase_rad=draw.lateral_phase,
        respiration_m=draw.respiration_m,
        respiration_hz=settings.motion.respiration_hz,
        respiration_phase_rad=draw.respiration_phase,
    )
    return Tune(
        time_s=time_s,
        knob_deg=knob,
        transmitted_deg=transmitted,
        drift=drift,
        curvature_per_m=rig.curvature_per_m(transmitted, drift),
        wave=heart.forward(time_s),
        lateral=heart.lateral(time_s),
        breath_m=heart.respiration(time_s),
    )
