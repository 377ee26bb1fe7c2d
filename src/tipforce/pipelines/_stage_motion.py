"""The motion of a real heart stage: a course for its axes, held against their limits before anything moves."""

import math
import time
from collections.abc import Callable, Mapping

import numpy as np

from ..errors import DeviceError, InputError
from ..hardware import GrblActuators, MotionConfig
from ..mechanics import HeartMotion
from ..types import STAGE_ACROSS, STAGE_FORWARD, AxisLimits

_RAMP_S = 2.0
"""The motion grows from rest within this time."""
_SAMPLES = 2000
"""Points of one beat from which the largest speed and acceleration are found."""
_ARRIVED_MM = 0.02
_POLL_S = 0.02


class StageMotion:
    """`HeartMotion` of ``[hardware.stage.motion]``, from rest away from the tip, as a course of the stage's axes.

    >>> motion = StageMotion(MotionConfig(amplitude_mm=4.0, rate_hz=1.2, respiration_mm=2.0))
    >>> motion.course(0.0), round(motion.needs()["stage_forward_mm"].max_speed, 1)
    ({'stage_forward_mm': -6.0}, 33.3)
    """

    def __init__(self, config: MotionConfig) -> None:
        self.config = config
        self._heart = HeartMotion(
            amplitude_m=1e-3 * config.amplitude_mm,
            beat_hz=config.rate_hz,
            wave=config.wave,
            lateral_share=config.lateral_share,
            lateral_phase_rad=math.radians(config.lateral_phase_deg),
            respiration_m=1e-3 * config.respiration_mm,
            respiration_hz=config.respiration_hz,
            standoff_m=-1e-3 * config.middle_mm,
        )
        away_mm = config.middle_mm - config.amplitude_mm - config.respiration_mm
        self._rest = {STAGE_FORWARD: away_mm, STAGE_ACROSS: 0.0}
        self._axes = (STAGE_FORWARD, STAGE_ACROSS) if config.lateral_share > 0.0 else (STAGE_FORWARD,)

    def course(self, time_s: float) -> dict[str, float]:
        """Returns the position of each axis in mm; the motion grows from rest, away from the tip.

        Args:
            time_s: time since the motion began.
        """
        share = min(1.0, time_s / _RAMP_S)
        share = share * share * (3.0 - 2.0 * share)  # smooth step: no jump of the speed at either end
        heart = self._heart.command(time_s)
        return {axis: self._rest[axis] + share * (heart[axis] - self._rest[axis]) for axis in self._axes}

    def needs(self) -> dict[str, AxisLimits]:
        """Returns the motion's needs for each axis: range in mm, largest speed in mm/s and acceleration in mm/s^2.

        The maxima of heart and breath are added: at some time both coincide. Only the forward axis breathes.
        """
        config = self.config
        time_s = np.linspace(0.0, 1.0 / config.rate_hz, _SAMPLES)  # one beat
        breath_rad_per_s = 2.0 * math.pi * config.respiration_hz
        needs: dict[str, AxisLimits] = {}
        for axis in self._axes:
            forward = axis == STAGE_FORWARD
            heart_mm = config.amplitude_mm * (self._heart.forward(time_s) if forward else self._heart.lateral(time_s))
            speed = np.gradient(heart_mm, time_s)
            breath_mm = config.respiration_mm if forward else 0.0
            middle_mm = config.middle_mm if forward else 0.0
            reach_mm = float(np.abs(heart_mm).max()) + breath_mm
            needs[axis] = AxisLimits(
                middle_mm - reach_mm,
                middle_mm + reach_mm,
                float(np.abs(speed).max()) + breath_mm * breath_rad_per_s,
                float(np.abs(np.gradient(speed, time_s)).max()) + breath_mm * breath_rad_per_s**2,
            )
        return needs

    def check(self, limits: Mapping[str, AxisLimits]) -> None:
        """Checks the motion against the limits of the axes.

        Raises:
            InputError: an axis is missing, or cannot do it; the message names the line of ``bench.toml``.
        """
        for axis, need in self.needs().items():
            limit, table = limits.get(axis), f"hardware.stage.axes.{axis}"
            if limit is None:
                raise InputError(f"hardware.stage.motion moves {axis}; add [{table}] to bench.toml")
            speed, acceleration = limit.max_speed, limit.max_acceleration
            if need.low < limit.low or need.high > limit.high:
                allowed = f"{table}.low = {limit.low:g} and high = {limit.high:g}"
                fault = f"goes from {need.low:g} to {need.high:g} mm, beyond {allowed}"
            elif need.max_speed > speed:
                fault = f"needs {need.max_speed:.1f} mm/s, but {axis} goes at most {speed:.1f} (max_speed, or its $110)"
            elif need.max_acceleration > acceleration:
                fault = (
                    f"needs {need.max_acceleration:.0f} mm/s^2, but {axis} has at most {acceleration:.0f} "
                    "(max_acceleration, or its $120)"
                )
            else:
                continue
            raise InputError(f"hardware.stage.motion {fault}; lower its amplitude_mm or rate_hz, or move its middle_mm")

    def begin(self, stage: GrblActuators, timeout_s: float, stopped: Callable[[], bool] = lambda: False) -> None:
        """Moves the stage to the beginning of the motion, waits for it, and starts the motion after its rest.

        Args:
            stage: the connected stage.
            timeout_s: longest wait in s.
            stopped: called during the wait; True ends it, and nothing is started.

        Raises:
            InputError: see `check`.
            DeviceError: the stage does not get there.
        """
        self.check(stage.limits)
        start = self.course(0.0)
        stage.command(start)
        deadline_s = time.monotonic() + timeout_s
        while any(abs(stage.read().values[axis] - place) > _ARRIVED_MM for axis, place in start.items()):
            if stopped():
                return
            if time.monotonic() > deadline_s:
                raise DeviceError(
                    f"hardware.stage: is not at {start} after {timeout_s:g} s, where hardware.stage.motion begins"
                )
            time.sleep(_POLL_S)
        stage.follow(self.course, self.config.rest_s)
