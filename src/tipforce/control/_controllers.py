"""Controllers: from estimates of the force to a place on the path. Small and pure: they know no drive and no clock."""

import math
from typing import Protocol

from ._observer import Sample, WallObserver
from ._settings import ControllerName, ControlSettings


class Controller(Protocol):
    """Holds a force: told each estimate, asked every few milliseconds where to go."""

    def begin(self, position_mm: float) -> None:
        """Holding begins with the catheter at ``position_mm``."""
        ...

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Take an estimate. ``gain_n_per_mm``: the plant's, as it is known now."""
        ...

    def position_mm(self, time_s: float, target_n: float) -> float:
        """Where the catheter shall be sent at ``time_s``."""
        ...

    def applied(self, position_mm: float) -> None:
        """Where it was really sent: limits may have had another opinion."""
        ...


class Still:
    """No control: the catheter stays where it was when the hold began."""

    def __init__(self) -> None:
        self._position = 0.0

    def begin(self, position_mm: float) -> None:
        """See `Controller`."""
        self._position = position_mm

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """Nothing is taken."""

    def position_mm(self, time_s: float, target_n: float) -> float:
        """Where it began."""
        del time_s, target_n
        return self._position

    def applied(self, position_mm: float) -> None:
        """Nothing follows from it."""


class ProportionalIntegral:
    """PI on the force over the gain, with anti-windup by back-calculation.

    A plant that is a gain with a dead time ``loop_delay_s``: ``integral = 0.35 / delay`` and ``proportional = 0.2``
    leave it stable also where the gain is known to a factor of two only.

    Args:
        loop_delay_s: from the wall's motion to the answer to it.
    """

    def __init__(self, loop_delay_s: float, proportional: float = 0.2, integral: float = 0.35) -> None:
        self._proportional, self._integral_per_s = proportional, integral / loop_delay_s
        self._sum = self._wanted = 0.0
        self._time_s: float | None = None

    def begin(self, position_mm: float) -> None:
        """See `Controller`."""
        self._sum = self._wanted = position_mm
        self._time_s = None

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """See `Controller`."""
        error_mm = (target_n - sample.force_n) / gain_n_per_mm
        dt_s = 0.0 if self._time_s is None else max(0.0, sample.time_s - self._time_s)
        self._time_s = sample.time_s
        self._sum += self._integral_per_s * error_mm * dt_s
        self._wanted = self._sum + self._proportional * error_mm

    def position_mm(self, time_s: float, target_n: float) -> float:
        """See `Controller`."""
        del time_s, target_n
        return self._wanted

    def applied(self, position_mm: float) -> None:
        """What was not allowed is taken back from the sum."""
        lost = position_mm - self._wanted
        self._sum += lost
        self._wanted = position_mm


class Admittance:
    """The catheter gives way to the force like a damped mass: ``m a + b v = target - force``.

    ``b = gain * give_way_s`` and ``m = b * inertia_s``, so that it answers a stiff wall as fast as a soft one.
    """

    def __init__(self, loop_delay_s: float, give_way: float = 3.0, inertia: float = 0.5) -> None:
        self._give_way_s, self._inertia_s = give_way * loop_delay_s, inertia * loop_delay_s
        self._wanted = self._speed = self._push = 0.0
        self._time_s: float | None = None

    def begin(self, position_mm: float) -> None:
        """See `Controller`."""
        self._wanted, self._speed, self._push, self._time_s = position_mm, 0.0, 0.0, None

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """See `Controller`."""
        self._push = (target_n - sample.force_n) / (gain_n_per_mm * self._give_way_s)

    def position_mm(self, time_s: float, target_n: float) -> float:
        """See `Controller`: the mass moves on as time does."""
        del target_n
        dt_s = 0.0 if self._time_s is None else max(0.0, time_s - self._time_s)
        self._time_s = time_s
        self._speed += (self._push - self._speed) * -math.expm1(-dt_s / self._inertia_s)
        self._wanted += self._speed * dt_s
        return self._wanted

    def applied(self, position_mm: float) -> None:
        """A mass that was stopped has no speed."""
        if abs(position_mm - self._wanted) > 1e-9:
            self._speed = 0.0
        self._wanted = position_mm


_LEAD_RANGE_S = (0.0, 0.15)
_LEAD_TIME_S = 3.0
"""Time constant with which the drives' lateness is learnt."""
_STEP_S = 5e-3
"""For the speed of the prediction."""
_SLOW_MM_PER_S = 1.0
"""Slower motion says nothing of a lateness."""


class PeriodicRejection:
    """Integral action and rejection of heart and breath: the tip goes where the predicted wall will have the target.

    The observer's constant is the integral part, its oscillators are the internal model of the disturbance, at the
    measured rate. Each is predicted to when the command takes effect, which is the phase lead of each harmonic. How
    late the drives are is learnt from what they read back, beginning with ``drive_delay_s``. Besides, an axis that can
    stop at its target trails a moving one by speed^2 / (2 acceleration): so far ahead the target is sent.
    """

    def __init__(self, observer: WallObserver, drive_delay_s: float, max_acceleration_mm_per_s2: float) -> None:
        self._observer, self.lead_s = observer, drive_delay_s
        self._acceleration = max_acceleration_mm_per_s2
        self._power = _SLOW_MM_PER_S**2
        self._time_s: float | None = None

    def begin(self, position_mm: float) -> None:
        """The observer knows all."""

    def _wanted_mm(self, time_s: float, target_n: float) -> float:
        return target_n / self._observer.gain_n_per_mm - self._observer.wall_mm(time_s)

    def _speed_mm_per_s(self, time_s: float) -> float:
        ahead, behind = (self._observer.wall_mm(time_s + side * _STEP_S) for side in (1.0, -1.0))
        return (behind - ahead) / (2.0 * _STEP_S)

    def add(self, sample: Sample, target_n: float, gain_n_per_mm: float) -> None:
        """The observer has the force already; where the catheter was tells how late the drives are."""
        del gain_n_per_mm
        dt_s = 0.0 if self._time_s is None else sample.time_s - self._time_s
        self._time_s = sample.time_s
        speed = self._speed_mm_per_s(sample.time_s)
        behind = self._wanted_mm(sample.time_s, target_n) - sample.position_mm
        share = -math.expm1(-dt_s / _LEAD_TIME_S)
        self._power += share * (max(speed * speed, _SLOW_MM_PER_S**2) - self._power)
        lead = self.lead_s + share * behind * speed / self._power
        self.lead_s = min(max(lead, _LEAD_RANGE_S[0]), _LEAD_RANGE_S[1])

    def position_mm(self, time_s: float, target_n: float) -> float:
        """See `Controller`."""
        return target_n / self._observer.gain_n_per_mm - self._observer.mean_mm + self.swing_mm(time_s)

    def swing_mm(self, time_s: float) -> float:
        """The motion about its middle with which the catheter follows heart and breath, as sent at ``time_s``."""
        at_s = time_s + self.lead_s
        speed = self._speed_mm_per_s(at_s)
        trail = speed * abs(speed) / (2.0 * self._acceleration)
        return self._observer.mean_mm - self._observer.wall_mm(at_s) + trail

    def applied(self, position_mm: float) -> None:
        """The observer measures where the catheter is: nothing winds up."""


def make_controller(
    name: ControllerName, settings: ControlSettings, observer: WallObserver, max_acceleration_mm_per_s2: float
) -> Controller:
    """The controller of this name; the drives' acceleration is that along the path."""
    match name:
        case "none":
            return Still()
        case "pi":
            return ProportionalIntegral(settings.loop_delay_s)
        case "admittance":
            return Admittance(settings.loop_delay_s)
        case "periodic":
            return PeriodicRejection(observer, settings.drive_delay_s, max_acceleration_mm_per_s2)
