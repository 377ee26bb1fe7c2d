"""A driven axis: commands go in, positions come out, within the limits of the drive."""

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...types import FloatArray


@dataclass(frozen=True, slots=True)
class AxisModel:
    """A stepper or servo axis, in its own unit (m or degrees).

    Attributes:
        step: resolution.
        max_speed: largest speed, per s.
        max_acceleration: largest acceleration, per s^2.
        delay_s: time from a command to the start of its effect.
        lag_s: time constant with which the load follows the motor.
        low: lower end of the travel.
        high: upper end of the travel.
    """

    step: float
    max_speed: float
    max_acceleration: float
    delay_s: float = 0.0
    lag_s: float = 0.0
    low: float = -math.inf
    high: float = math.inf


@njit(cache=True, error_model="numpy")
def _safe_speed(room: float, acceleration: float, dt_s: float) -> float:
    """Returns the largest speed from which an axis, commanded every ``dt_s``, still stops within ``room``."""
    step = acceleration * dt_s
    return -0.5 * step + math.sqrt(0.25 * step * step + 2.0 * acceleration * max(room - 0.125 * step * dt_s, 0.0))


@njit(cache=True, error_model="numpy")
def _follow(
    commands: FloatArray,
    dt_s: float,
    max_speed: float,
    max_acceleration: float,
    low: float,
    high: float,
    position: float,
    speed: float,
    out: FloatArray,
) -> tuple[float, float]:
    """Follows the commands as fast as the axis can while it is able to stop there.

    Args:
        commands: (m,) target positions in the unit of the axis; NaN: to brake to rest.
        dt_s: time between commands.
        max_speed: see `AxisModel`.
        max_acceleration: see `AxisModel`.
        low: see `AxisModel`.
        high: see `AxisModel`.
        position: position before the first command.
        speed: speed before the first command, per s.
        out: (m,) array that receives the position after each command.

    Returns:
        Position and speed after the last command.
    """
    for row in range(commands.size):
        distance = min(max(commands[row], low), high) - position
        if math.isnan(commands[row]):
            target_speed = 0.0
        else:
            # Fastest speed from which the axis still comes to rest within the gap, and that does not jump over it.
            brake = math.sqrt(2.0 * max_acceleration * abs(distance))
            target_speed = math.copysign(min(brake, max_speed, abs(distance) / dt_s), distance)
        # It must also be able to stop before either end of the travel.
        target_speed = min(target_speed, max(_safe_speed(high - position, max_acceleration, dt_s), 0.0))
        target_speed = max(target_speed, -max(_safe_speed(position - low, max_acceleration, dt_s), 0.0))
        change = min(max(target_speed - speed, -max_acceleration * dt_s), max_acceleration * dt_s)
        speed += change
        position += speed * dt_s
        out[row] = position
    return position, speed


@njit(cache=True, error_model="numpy")
def _lag(positions: FloatArray, share: float, load: float) -> float:
    """Applies a first-order lag.

    Args:
        positions: (m,) positions of the motor; they are replaced by those of the load.
        share: share of the distance to the motor that the load covers in one step.
        load: position of the load before the first step.

    Returns:
        Position of the load after the last step.
    """
    for row in range(positions.size):
        load += share * (positions[row] - load)
        positions[row] = load
    return load


class Axis:
    """Follows commands that are given at a fixed rate; each call continues from the state after the last one.

    Args:
        model: limits and dynamics of the axis.
        dt_s: time between commands.
        start: position at the start, in the unit of the axis.
        speed: speed at the start, in that unit per s.

    >>> axis = Axis(AxisModel(step=1e-5, max_speed=0.1, max_acceleration=1.0), dt_s=1e-3)
    >>> bool(axis.follow(np.array([0.05]))[0] < 1e-4)  # it has mass
    True
    """

    def __init__(self, model: AxisModel, dt_s: float, start: float = 0.0, speed: float = 0.0) -> None:
        self.model, self.dt_s = model, dt_s
        self._motor, self._motor_speed = start, speed
        self._load = start
        """Position of the load, which lags behind the motor where the model has a lag."""

    def follow(self, commands: FloatArray) -> FloatArray:
        """Moves the axis by one step of ``dt_s`` for each command, from where the last call left it.

        The motor keeps to the limits of speed, acceleration and travel; the load follows it with the model's lag.

        Args:
            commands: (m,) target positions in the unit of the axis; NaN: to brake to rest.

        Returns:
            (m,) positions of the load after each step, in the unit of the axis. They are exact; `resolved` rounds
            them to whole steps of the motor.
        """
        positions = np.empty(len(commands))
        model = self.model
        self._motor, self._motor_speed = _follow(
            np.ascontiguousarray(commands), self.dt_s, model.max_speed, model.max_acceleration, model.low, model.high,
            self._motor, self._motor_speed, positions,
        )  # fmt: skip
        if model.lag_s > 0.0:
            share = -math.expm1(-self.dt_s / model.lag_s)  # exact solution of a first-order lag over one step
            self._load = _lag(positions, share, self._load)  # changes the positions
        return positions

    def resolved(self, positions: FloatArray) -> FloatArray:
        """Returns ``positions`` in whole steps: the positions that the axis reaches and reads back."""
        steps = np.round(positions / self.model.step) * self.model.step
        return np.minimum(np.maximum(steps, self.model.low), self.model.high)


class Drive:
    """An axis over a session: it follows its programme until it is commanded.

    Args:
        model: limits and dynamics of the axis.
        dt_s: time between instants.
        programme: (m,) programme in the unit of the axis.
        by_hand: the programme is the true position of the axis, which a hand moves or nothing moves, and the motor
            takes over from there; otherwise the programme is the commands of the motor.
    """

    def __init__(self, model: AxisModel, dt_s: float, programme: FloatArray, *, by_hand: bool) -> None:
        self.model, self.dt_s, self.programme, self.by_hand = model, dt_s, programme, by_hand
        self.late = round(model.delay_s / dt_s)
        """Number of instants from a command to its effect."""
        self._axis = None if by_hand else Axis(model, dt_s, start=float(programme[0]))
        self._rows: list[int] = []
        self._targets: list[float] = []

    def command(self, row: int, target: float) -> None:
        """Commands the axis to go to a position.

        Args:
            row: instant from which the command holds; not before that of the last command.
            target: position in the unit of the axis; NaN: to brake.
        """
        self._rows.append(row)
        self._targets.append(target)

    @property
    def taken_over(self) -> int | None:
        """The instant from which commands have an effect, if there are any."""
        return self._rows[0] + self.late if self._rows else None

    def commands(self, first: int, end: int) -> FloatArray:
        """Returns the commands at a range of instants; before instant 0, the first command.

        Args:
            first: first instant; it may be negative.
            end: end of the instants, exclusive.

        Returns:
            (end - first,) positions in the unit of the axis; NaN: to brake.
        """
        commanded = self.programme[np.clip(np.arange(first, end), 0, None)]
        for index in range(max(0, bisect_right(self._rows, first) - 1), len(self._rows)):
            commanded[max(0, self._rows[index] - first) :] = self._targets[index]
        return commanded

    def run(self, first: int, end: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Moves the axis over the next instants.

        Args:
            first: first instant: the end of the last run.
            end: end of the instants, exclusive.

        Returns:
            Commands, positions, and positions in whole steps, (end - first,) each, in the unit of the axis.
        """
        commanded, smooth = self.commands(first, end), self.programme[first:end].copy()
        whole_steps = smooth
        taken_over = self.taken_over
        # First instant at which the motor drives the axis; an axis moved by hand is driven after its first command.
        start = first if self._axis is not None else end if taken_over is None else min(max(taken_over, first), end)
        if start < end:
            if self._axis is None:
                # The motor takes over position and speed of the hand.
                here, before = (float(self.programme[max(0, start - back)]) for back in (1, 2))
                self._axis = Axis(self.model, self.dt_s, here, (here - before) / self.dt_s)
            driven = self._axis.follow(self.commands(start - self.late, end - self.late))
            smooth[start - first :] = driven
            whole_steps = smooth.copy()
            whole_steps[start - first :] = self._axis.resolved(driven)
        resting = np.isnan(commanded)
        commanded[resting] = whole_steps[resting]
        return commanded, smooth, whole_steps
