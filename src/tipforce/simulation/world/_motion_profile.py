"""The motion profile of a session, before its amplitude is solved: knob, drift and waves."""

import math
from dataclasses import dataclass, fields
from itertools import accumulate

import numpy as np

from ...mechanics import HeartMotion, Play
from ...types import FloatArray
from ._bench_model import BenchModel
from ._hand_motion import hand_wave
from ._parameters import BY_HAND, SessionParameters


def knob_trajectory(parameters: SessionParameters, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Makes the motion of the knob: at rest, or back and forth with pauses of up to two seconds.

    Args:
        parameters: the drawn parameters.
        time_s: (m,) times.
        rng: random numbers.

    Returns:
        (m,) angles in degrees.
    """
    low, high, speed = parameters.knob_low_deg, parameters.knob_high_deg, parameters.knob_speed_deg_per_s
    if speed == 0.0 or high == low:
        return np.full(time_s.size, parameters.knob_low_deg)
    times, angles = [float(time_s[0])], [float(rng.uniform(low, high))]
    while times[-1] < time_s[-1]:
        # Move to a random angle at constant speed, then pause.
        target = float(rng.uniform(low, high))
        times.append(times[-1] + abs(target - angles[-1]) / speed + 1e-3)
        angles.append(target)
        times.append(times[-1] + float(rng.uniform(0.0, 2.0)))
        angles.append(target)
    return np.interp(time_s, times, angles)


def slow_drift(rms: float, correlation_s: float, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Makes a stationary Gauss-Markov process (Ornstein-Uhlenbeck), exact 200 times in its correlation time.

    Args:
        rms: standard deviation.
        correlation_s: correlation time.
        time_s: (m,) times.
        rng: random numbers.

    Returns:
        (m,) values.
    """
    knots = np.arange(time_s[0], time_s[-1] + correlation_s / 100, correlation_s / 200)
    # x[k + 1] = keep x[k] + sqrt(1 - keep^2) noise, whose variance stays 1.
    keep = math.exp(-1 / 200)
    kicks = rng.standard_normal(knots.size)
    kicks[1:] *= math.sqrt(1 - keep * keep)
    process = np.fromiter(accumulate(kicks.tolist(), lambda before, kick: kick + keep * before), np.float64, knots.size)
    return rms * np.interp(time_s, knots, process)


STEP_S = 1e-3
"""Time between two instants of a session."""
LEAD_S, TRAIL_S = 0.5, 0.3
"""Times simulated before the first frame and after the last; the offset of the force log's clock is smaller."""
APPROACH_S = 1.5
CLEARANCE_M = 3e-3
"""Smallest distance between tip and wall while the sensor is tared."""


def instants_until(time_s: float) -> int:
    """Returns the number of instants of a session that are not after ``time_s`` on the camera's clock."""
    return math.floor((time_s + LEAD_S) / STEP_S + 1e-6) + 1


@dataclass(frozen=True, slots=True)
class Motion:
    """The solved motion: amplitude along the normal, and standoff, by which the whole motion is set back."""

    amplitude_m: float
    standoff_m: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionProfile:
    """The motion of a session before its amplitude is known: (m,) each.

    Attributes:
        time_s: time on the camera's clock.
        knob_deg: angle of the knob.
        transmitted_deg: angle that reaches the catheter, behind the play of the knob.
        drift: relative drift of the curvature that follows from it.
        curvature_per_m: curvature of the catheter without load.
        wave: position of the wall along its normal, relative to the amplitude of the beat.
        lateral: position of the wall to the side, relative to the same amplitude.
        breath_m: position of the wall along its normal due to breath.
    """

    time_s: FloatArray
    knob_deg: FloatArray
    transmitted_deg: FloatArray
    drift: FloatArray
    curvature_per_m: FloatArray
    wave: FloatArray
    lateral: FloatArray
    breath_m: FloatArray

    def thinned(self, step: int, start_s: float, end_s: float) -> "MotionProfile":
        """Returns a part of the profile with fewer instants.

        Args:
            step: every ``step``-th instant is kept.
            start_s: start of the part.
            end_s: end of the part, inclusive.

        Returns:
            The thinned profile.
        """
        rows = np.flatnonzero((self.time_s >= start_s) & (self.time_s <= end_s))[::step]
        return MotionProfile(*(getattr(self, field.name)[rows] for field in fields(self)))

    def push_m(self, bench_model: BenchModel, amplitude_m: float) -> FloatArray:
        """Returns the distance of the wall beyond first contact if the standoff were 0.

        Args:
            bench_model: the bench.
            amplitude_m: amplitude of the beat.

        Returns:
            (m,) distances along the wall's normal in metres.
        """
        return amplitude_m * self.wave + self.breath_m + bench_model.reach_m(self.curvature_per_m)

    def standoff_m(self, bench_model: BenchModel, amplitude_m: float) -> float:
        """Returns the standoff that leaves the tip free for the wanted share of the beats.

        Args:
            bench_model: the bench.
            amplitude_m: amplitude of the beat.

        Returns:
            The standoff in metres.
        """
        beating = self.time_s > bench_model.settings.tare_s + APPROACH_S
        return float(np.quantile(self.push_m(bench_model, amplitude_m)[beating], bench_model.parameters.free_share))

    def programme_m(self, bench_model: BenchModel, motion: Motion) -> FloatArray:
        """Returns the commands of the stage; during the tare it is out of the tip's reach.

        Args:
            bench_model: the bench.
            motion: amplitude of the beat, and standoff.

        Returns:
            (m, 2) positions in metres, along the wall's normal and across.
        """
        push_m = self.push_m(bench_model, motion.amplitude_m)
        approach = np.clip((self.time_s - bench_model.settings.tare_s) / APPROACH_S, 0.0, 1.0)
        # A smooth step: the stage comes from a position in which the deepest motion would stay clear of the tip.
        farthest_m = push_m.max() - motion.standoff_m + CLEARANCE_M
        retreat_m = (1.0 - approach * approach * (3.0 - 2.0 * approach)) * farthest_m
        forward_m = motion.amplitude_m * self.wave + self.breath_m - motion.standoff_m - retreat_m
        return np.stack([forward_m, motion.amplitude_m * self.lateral], axis=1)


def compose_motion(bench_model: BenchModel, time_s: FloatArray, rng: np.random.Generator) -> MotionProfile:
    """Draws the motion of one session: the knob, the catheter behind it, heart beat and breath.

    Args:
        bench_model: parameters and settings of the session.
        time_s: (m,) evenly spaced times.
        rng: random numbers.

    Returns:
        The motion at these times; the beat is relative to an amplitude in m that is not known yet.
    """
    parameters, settings = bench_model.parameters, bench_model.settings
    knob = knob_trajectory(parameters, time_s, rng)
    actuation = settings.actuation
    transmitted = Play(actuation.play_deg, output=float(knob[0]) + parameters.play_start_deg).run(knob)
    drift = slow_drift(actuation.drift_rms, actuation.drift_s, time_s, rng)
    if parameters.wave == BY_HAND:
        wave, lateral = hand_wave(time_s, rng), parameters.lateral_share * hand_wave(time_s, rng)
        breath = np.zeros(time_s.size)
    else:
        heart = _heart(parameters, settings.motion.respiration_hz)
        wave, lateral, breath = heart.forward(time_s), heart.lateral(time_s), heart.respiration(time_s)
    return MotionProfile(
        time_s=time_s,
        knob_deg=knob,
        transmitted_deg=transmitted,
        drift=drift,
        curvature_per_m=bench_model.curvature_per_m(transmitted, drift),
        wave=wave,
        lateral=lateral,
        breath_m=breath,
    )


def _heart(parameters: SessionParameters, respiration_hz: float) -> HeartMotion:
    """Returns heart beat and breath with a beat of amplitude 1: the true amplitude in m is solved later."""
    return HeartMotion(
        amplitude_m=1.0,  # to be solved for
        beat_hz=parameters.beat_hz,
        wave=parameters.wave,
        lateral_share=parameters.lateral_share,
        lateral_phase_rad=parameters.lateral_phase,
        respiration_m=parameters.respiration_m,
        respiration_hz=respiration_hz,
        respiration_phase_rad=parameters.respiration_phase,
    )
