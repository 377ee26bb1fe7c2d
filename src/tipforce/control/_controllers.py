"""Controllers: from estimates of the force to a position on the path. They know no drive and no clock."""

import math
from typing import Protocol

from ._observer import Sample, WallObserver
from ._settings import ControllerName, ControlSettings


class Controller(Protocol):
    """Holds a force: takes each estimate, and returns the wanted position every few milliseconds."""

    def begin(self, position_mm: float) -> None:
        """Begins to hold, with the catheter at ``position_mm``."""

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Takes an estimate.

        Args:
            sample: the estimate.
            target_n: wanted force.
            gain_n_per_mm: present estimate of the plant's gain.
        """

    def position_mm(self, time_s: float, target_n: float) -> float:
        """Returns the wanted position on the path.

        Args:
            time_s: time of the command.
            target_n: wanted force.
        """
        ...

    def applied(self, position_mm: float) -> None:
        """Takes the position that was sent: limits may have changed the wanted one."""


class Still:
    """No control: the catheter stays where it was when the hold began."""

    def __init__(self) -> None:
        self._position = 0.0

    def begin(self, position_mm: float) -> None:
        """See `Controller`."""
        self._position = position_mm

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Ignores the estimate; see `Controller.add`."""

    def position_mm(self, time_s: float, target_n: float) -> float:
        """Returns the position at which the hold began; see `Controller.position_mm`."""
        del time_s, target_n
        return self._position

    def applied(self, position_mm: float) -> None:
        """Ignores the position."""


class ProportionalIntegral:
    """PI control of the force error divided by the gain (a position in mm), with anti-windup by back-calculation.

    With the default factors a plant that is a gain with a dead time of ``loop_delay_s`` stays stable, even if its gain
    is wrong by a factor of two.

    Args:
        loop_delay_s: time from the wall's motion to the clamp's response.
        proportional: part of the force error that is corrected immediately.
        integral: part of the force error that is corrected within one ``loop_delay_s``.
    """

    def __init__(self, loop_delay_s: float, proportional: float = 0.2, integral: float = 0.35) -> None:
        self._proportional, self._integral_per_s = proportional, integral / loop_delay_s
        self._integral_mm = self._wanted_mm = 0.0
        self._time_s: float | None = None

    def begin(self, position_mm: float) -> None:
        """See `Controller`."""
        self._integral_mm = self._wanted_mm = position_mm
        self._time_s = None

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Computes the wanted position from the force error of an estimate; see `Controller.add`."""
        error_mm = (target_n - sample.force_n) / gain_n_per_mm  # travel that would correct the whole error
        dt_s = 0.0 if self._time_s is None else max(0.0, sample.time_s - self._time_s)
        self._time_s = sample.time_s
        self._integral_mm += self._integral_per_s * error_mm * dt_s
        self._wanted_mm = self._integral_mm + self._proportional * error_mm

    def position_mm(self, time_s: float, target_n: float) -> float:
        """See `Controller`."""
        del time_s, target_n
        return self._wanted_mm

    def applied(self, position_mm: float) -> None:
        """Moves the integral by the difference of sent and wanted position, so that it does not wind up at a limit."""
        self._integral_mm += position_mm - self._wanted_mm
        self._wanted_mm = position_mm


class Admittance:
    """The catheter gives way to the force like a damped mass: ``m a + b v = target - force``.

    a and v are its acceleration and speed on the path, m its virtual mass, b its damping. The damping and the mass are
    in proportion to the gain (``b = gain * give_way_s``, ``m = b * inertia_s``): so the catheter responds to a stiff
    wall as fast as to a soft one.

    Args:
        loop_delay_s: time from the wall's motion to the clamp's response.
        give_way: ``give_way_s`` in units of ``loop_delay_s``.
        inertia: ``inertia_s`` in units of ``loop_delay_s``.
    """

    def __init__(self, loop_delay_s: float, give_way: float = 3.0, inertia: float = 0.5) -> None:
        self._give_way_s, self._inertia_s = give_way * loop_delay_s, inertia * loop_delay_s
        self._wanted_mm = self._speed_mm_per_s = self._final_speed_mm_per_s = 0.0
        self._time_s: float | None = None

    def begin(self, position_mm: float) -> None:
        """See `Controller`."""
        self._wanted_mm, self._speed_mm_per_s, self._final_speed_mm_per_s = position_mm, 0.0, 0.0
        self._time_s = None

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Computes the speed that the mass approaches under the force error of an estimate; see `Controller.add`."""
        self._final_speed_mm_per_s = (target_n - sample.force_n) / (gain_n_per_mm * self._give_way_s)

    def position_mm(self, time_s: float, target_n: float) -> float:
        """Moves the mass until ``time_s`` and returns its position; see `Controller.position_mm`."""
        del target_n  # `add` has used it
        dt_s = 0.0 if self._time_s is None else max(0.0, time_s - self._time_s)
        self._time_s = time_s
        share = -math.expm1(-dt_s / self._inertia_s)  # 1 - exp(-dt / inertia): a first-order lag toward the final speed
        self._speed_mm_per_s += (self._final_speed_mm_per_s - self._speed_mm_per_s) * share
        self._wanted_mm += self._speed_mm_per_s * dt_s
        return self._wanted_mm

    def applied(self, position_mm: float) -> None:
        """Sets the speed of the mass to zero where limits stopped it."""
        if abs(position_mm - self._wanted_mm) > 1e-9:
            self._speed_mm_per_s = 0.0
        self._wanted_mm = position_mm


_DELAY_RANGE_S = (0.0, 0.15)
"""Range of the delay of the drives."""
_DELAY_TIME_S = 3.0
"""Time constant with which the delay of the drives is learnt."""
_DIFFERENCE_STEP_S = 5e-3
"""Step of the central difference for the speed of the prediction."""
_MIN_SPEED_MM_PER_S = 1.0
"""A slower motion does not show the delay of the drives."""


class PeriodicRejection:
    """Integral action, and rejection of heart and breath: the tip follows the predicted wall with the target force.

    The observer's constant is the integral part. Its oscillators are the internal model of the disturbance, at the
    measured rate. Each is predicted to the time at which the command takes effect, which is the phase lead of each
    harmonic. The delay of the drives is learnt from their readings, beginning with ``drive_delay_s``. Besides, an axis
    that can stop at its target is behind a moving target by speed^2 / (2 acceleration); the target is sent ahead by it.

    Args:
        observer: model of the wall.
        drive_delay_s: delay of the drives as known beforehand.
        max_acceleration_mm_per_s2: largest acceleration of the drives along the path.
    """

    def __init__(self, observer: WallObserver, drive_delay_s: float, max_acceleration_mm_per_s2: float) -> None:
        self._observer, self.drive_delay_s = observer, drive_delay_s
        self._acceleration = max_acceleration_mm_per_s2
        self._mean_square_speed = _MIN_SPEED_MM_PER_S**2
        self._time_s: float | None = None

    def begin(self, position_mm: float) -> None:
        """Does nothing: the observer knows the position."""

    def _wanted_mm(self, time_s: float, target_n: float) -> float:
        return target_n / self._observer.gain_n_per_mm - self._observer.wall_mm(time_s)

    def _speed_mm_per_s(self, time_s: float) -> float:
        later_mm, earlier_mm = (self._observer.wall_mm(time_s + side * _DIFFERENCE_STEP_S) for side in (1.0, -1.0))
        return (earlier_mm - later_mm) / (2.0 * _DIFFERENCE_STEP_S)

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Learns the delay of the drives from the measured position; see `Controller.add`. The observer has the force.

        Drives that are too late by ``d`` are behind the wanted position by ``d * speed``. The delay changes by the
        running regression of that distance on the speed, with time constant `_DELAY_TIME_S`.
        """
        del gain_n_per_mm  # the observer's own gain is used
        dt_s = 0.0 if self._time_s is None else max(0.0, sample.time_s - self._time_s)
        self._time_s = sample.time_s
        speed = self._speed_mm_per_s(sample.time_s)
        behind_mm = self._wanted_mm(sample.time_s, target_n) - sample.position_mm
        share = -math.expm1(-dt_s / _DELAY_TIME_S)  # weight of this sample in an exponential mean
        # a slow wall does not show the delay: the least speed keeps the quotient small there
        self._mean_square_speed += share * (max(speed * speed, _MIN_SPEED_MM_PER_S**2) - self._mean_square_speed)
        delay = self.drive_delay_s + share * behind_mm * speed / self._mean_square_speed
        self.drive_delay_s = min(max(delay, _DELAY_RANGE_S[0]), _DELAY_RANGE_S[1])

    def position_mm(self, time_s: float, target_n: float) -> float:
        """See `Controller`."""
        return target_n / self._observer.gain_n_per_mm - self._observer.mean_mm + self.swing_mm(time_s)

    def swing_mm(self, time_s: float) -> float:
        """Returns the motion about its mean, in mm, with which the catheter follows heart and breath.

        Args:
            time_s: time at which the command is sent; it takes effect after the delay of the drives.
        """
        effect_s = time_s + self.drive_delay_s
        speed = self._speed_mm_per_s(effect_s)
        # an axis that can stop at its target is behind a moving one by its braking distance
        braking_mm = speed * abs(speed) / (2.0 * self._acceleration)
        return self._observer.mean_mm - self._observer.wall_mm(effect_s) + braking_mm

    def applied(self, position_mm: float) -> None:
        """Does nothing: the observer measures the position, so that nothing winds up."""


def make_controller(
    name: ControllerName, settings: ControlSettings, observer: WallObserver, max_acceleration_mm_per_s2: float
) -> Controller:
    """Returns a new controller.

    Args:
        name: "none", "pi", "admittance" or "periodic".
        settings: delays of the loop and of the drives.
        observer: model of the wall.
        max_acceleration_mm_per_s2: largest acceleration of the drives along the path.
    """
    match name:
        case "none":
            return Still()
        case "pi":
            return ProportionalIntegral(settings.loop_delay_s)
        case "admittance":
            return Admittance(settings.loop_delay_s)
        case "periodic":
            return PeriodicRejection(observer, settings.drive_delay_s, max_acceleration_mm_per_s2)
