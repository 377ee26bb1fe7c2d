"""A driven axis: commands go in, positions come out, within what the drive can do."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...types import FloatArray

__all__ = ["Axis", "AxisLimits"]


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Of a stepper or servo axis, in the axis's own unit (m or degrees): ``step`` is what it can resolve."""

    step: float
    max_speed: float
    max_acceleration: float
    delay_s: float = 0.0
    low: float = -math.inf
    high: float = math.inf


@njit(cache=True, error_model="numpy")
def _follow(
    commands: FloatArray,
    dt_s: float,
    max_speed: float,
    max_acceleration: float,
    low: float,
    high: float,
    place: float,
    speed: float,
    out: FloatArray,
) -> tuple[float, float]:
    """Time after time toward the command: as fast as it can, but able to stop there. Returns place and speed."""
    for row in range(commands.size):
        gap = min(max(commands[row], low), high) - place
        # Fastest speed from which the axis still comes to rest within the gap, and that does not jump over it.
        brake = math.sqrt(2.0 * max_acceleration * abs(gap))
        wanted = math.copysign(min(brake, max_speed, abs(gap) / dt_s), gap)
        change = min(max(wanted - speed, -max_acceleration * dt_s), max_acceleration * dt_s)
        speed += change
        place += speed * dt_s
        out[row] = place
    return place, speed


class Axis:
    """Follows commands given at a fixed rate; `follow` and repeated `move` give the same positions.

    >>> axis = Axis(AxisLimits(step=1e-5, max_speed=0.1, max_acceleration=1.0), dt_s=1e-3)
    >>> axis.move(0.05) < 1e-4  # it has mass
    True
    """

    def __init__(self, limits: AxisLimits, dt_s: float, start: float = 0.0) -> None:
        self.limits, self.dt_s = limits, dt_s
        self._waiting = [start] * round(limits.delay_s / dt_s)
        self._place, self._speed = start, 0.0

    def follow(self, commands: FloatArray) -> FloatArray:
        """(m,) commands, one each ``dt_s`` -> (m,) positions at the same instants, smooth as the drive itself."""
        late = np.concatenate([self._waiting, commands])
        count = len(commands)
        self._waiting = late[count:].tolist()
        positions = np.empty(count)
        limits = self.limits
        self._place, self._speed = _follow(
            late[:count], self.dt_s, limits.max_speed, limits.max_acceleration, limits.low, limits.high,
            self._place, self._speed, positions,
        )  # fmt: skip
        return positions

    def resolved(self, positions: FloatArray) -> FloatArray:
        """``positions`` in whole steps: what the axis comes to and reads back."""
        return np.round(positions / self.limits.step) * self.limits.step

    def move(self, command: float) -> float:
        """One ``dt_s`` on toward ``command``; returns where the axis then is."""
        return float(self.follow(np.array([command]))[0])
