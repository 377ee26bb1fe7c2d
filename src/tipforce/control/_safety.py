"""The layer between a controller and the drives: every command to the drives passes through it."""

import math
import threading
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from ..types import MAX_AGE_S, Actuators, Clock, ForceEstimate
from ._path import Path
from ._settings import SafetySettings


class SafetyAction(StrEnum):
    """Response of the layer to a command of the controller."""

    PASS = "pass"
    COAST = "coast"
    """No valid estimate at this time, but the force is below the limit: an abstained interval shows it, or the force
    cannot have reached the limit since the last interval. The controller's command still passes."""
    OVER_LIMIT = "over_limit"
    """The upper end of the force is above the limit, or will be before the drives respond: the catheter is drawn back
    at full speed until the upper end is below the limit again."""
    RETRACT = "retract"
    """No valid estimate for too long, or above the limit for too long: the catheter goes back to the start."""
    STOPPED = "stopped"
    """The stop key was pressed: the drives rest until the run is released."""


@dataclass(frozen=True, slots=True)
class Applied:
    """Command that was sent to the drives.

    Args:
        position_mm: position on the path.
        action: response of the safety layer.
        reason: reason of the action, or of an idle loop; "" if the command passed.
    """

    position_mm: float
    action: SafetyAction
    reason: str = ""


class SafetyLayer:
    """Force limit on the interval's upper end, speed limits, retraction, watchdog and stop key.

    Args:
        actuators: the drives.
        clock: clock of the drives.
        path: the line along which the drives may go; they never go beyond its ends.
        settings: the limits.
        frame_period_s: frame period of the source; the watchdog learns the usual delay by itself.
    """

    def __init__(
        self, actuators: Actuators, clock: Clock, path: Path, settings: SafetySettings, frame_period_s: float
    ) -> None:
        path.check(actuators)
        self.settings, self.path = settings, path
        self.max_speed_mm_per_s = path.max_speed_mm_per_s(actuators.limits, settings)
        self.max_acceleration_mm_per_s2 = path.max_acceleration_mm_per_s2(actuators.limits)
        self._actuators, self._clock = actuators, clock
        self._stale_ns = round(1e9 * max(settings.least_stale_s, settings.stale_frames * frame_period_s))
        self._valid_ns: int | None = None
        self._known_ns = 0
        """Mid-exposure of the last estimate with an interval, valid or not."""
        self._usual_ns = 0
        self._limit_n = settings.limit_n
        self._bound = _Bound(settings)
        self._over_since_ns: int | None = None
        self._why = ""
        self._sent_mm: float | None = None
        self._sent_ns = 0
        self._stopped = False
        self._judging = threading.Lock()
        """Held while an estimate changes the bound, or the bound is compared: they come from different threads."""
        self._sending = threading.Lock()
        """Held during each call of the drives: no command follows a stop that came during the command."""

    @property
    def upper_n(self) -> float:
        """Upper end of the last interval, of an estimate that was valid or abstained; 0 before the first."""
        return self._bound.upper_n

    @property
    def limit_n(self) -> float:
        """Limit of the settings, or the operator's if that is smaller; above it the catheter is drawn back."""
        return self._limit_n

    def set_limit(self, limit_n: float) -> None:
        """Sets the operator's limit, on the thread of `check`; it never raises the limit of the settings."""
        self._limit_n = min(limit_n, self.settings.limit_n)

    @property
    def stopped(self) -> bool:
        """Whether the stop key holds the drives."""
        return self._stopped

    def measured_mm(self) -> float:
        """Returns the measured position of the drives on the path, in mm."""
        return self.path.position_mm(self._actuators.read().values)

    def observe(self, estimate: ForceEstimate, captured_ns: int) -> None:
        """Takes an estimate, valid or not: updates the bound of the force, the watchdog's times and the usual delay.

        Args:
            estimate: the estimate.
            captured_ns: mid-exposure of its image on the clock.
        """
        with self._judging:
            self._bound.add(estimate, captured_ns)
        if not math.isnan(estimate.upper_n):
            self._known_ns = max(self._known_ns, captured_ns)
        if not estimate.valid:
            self._why = f"{estimate.status.value}: {estimate.detail}" if estimate.detail else estimate.status.value
            return
        now = self._clock.now_ns()
        delay = now - captured_ns
        if self._valid_ns is None or delay < self._usual_ns:
            self._usual_ns = delay  # the smallest delay is the time that the computation needs
        if self._valid_ns is not None and captured_ns <= self._valid_ns:
            return
        self._valid_ns, self._why = captured_ns, ""

    def _compare(self, now_ns: int) -> float:
        """Returns the bound of the force, in newtons, and remembers since when it is above the limit.

        Once above, it must fall below ``release_share`` of the limit, so that the action does not switch to and fro.
        """
        with self._judging:
            bound_n = self._bound.at_n(now_ns)
            if bound_n > self._limit_n:
                self._over_since_ns = now_ns if self._over_since_ns is None else self._over_since_ns
            elif bound_n < self.settings.release_share * self._limit_n:
                self._over_since_ns = None
            return bound_n

    def age_ns(self) -> int | None:
        """Returns the age of the last interval, beyond the usual delay; None before the first valid estimate."""
        return None if self._valid_ns is None else self._clock.now_ns() - self._known_ns - self._usual_ns

    def check(self) -> tuple[SafetyAction, str]:
        """Returns the action for this time, and its reason; the first of these conditions that holds decides.

        Stopped; retract without a valid estimate, or when the last one is too old; over the limit (retract after
        ``max_above_s``); coast while estimates are not valid; else pass.
        """
        now, age, settings = self._clock.now_ns(), self.age_ns(), self.settings
        bound_n = self._compare(now)
        if self._stopped:
            return SafetyAction.STOPPED, "the stop key was pressed"
        if age is None or self._valid_ns is None:
            return SafetyAction.RETRACT, self._why or "no valid estimate so far"
        abstained_ns = now - self._valid_ns - self._usual_ns
        # with its usual delay an estimate is never used after more than MAX_AGE_S
        stale_ns = min(self._stale_ns, round(1e9 * MAX_AGE_S) - self._usual_ns)
        too_long = age > settings.coast_s * 1e9 or abstained_ns > settings.abstained_s * 1e9
        if age > stale_ns or (self._why and too_long):
            return SafetyAction.RETRACT, self._why or f"stale: no estimate for {age * 1e-9:.2f} s"
        if self._over_since_ns is not None:
            if now - self._over_since_ns > settings.max_above_s * 1e9:
                return SafetyAction.RETRACT, f"above {self._limit_n:g} N for {settings.max_above_s:g} s"
            with self._judging:
                return SafetyAction.OVER_LIMIT, self._bound.reason(bound_n, self._limit_n)
        if self._why:
            return SafetyAction.COAST, self._why
        return SafetyAction.PASS, ""

    def command(self, wanted_mm: float, max_speed_mm_per_s: float | None = None) -> Applied:
        """Sends the drives toward ``wanted_mm``, or back where the limits require it.

        Args:
            wanted_mm: wanted position on the path.
            max_speed_mm_per_s: largest speed on the path; None: the largest that drives and settings allow.

        Returns:
            The command that was sent.
        """
        with self._sending:
            return self._command(wanted_mm, max_speed_mm_per_s)

    def _command(self, wanted_mm: float, max_speed_mm_per_s: float | None) -> Applied:
        """Does the work of `command`, with the drives locked for other threads."""
        now = self._clock.now_ns()
        action, reason = self.check()
        last_mm = self.measured_mm() if self._sent_mm is None else self._sent_mm
        if action is SafetyAction.STOPPED:
            return Applied(last_mm, action, reason)
        speed = min(self.max_speed_mm_per_s, max_speed_mm_per_s or self.max_speed_mm_per_s)
        if action in (SafetyAction.OVER_LIMIT, SafetyAction.RETRACT):
            wanted_mm, speed = 0.0, self.max_speed_mm_per_s  # toward the start, as fast as the drives may go
        # the speed limits the step from the last command; the first command sends the measured position
        step_mm = speed * (now - self._sent_ns) * 1e-9 if self._sent_mm is not None else 0.0
        sent_mm = min(max(wanted_mm, last_mm - step_mm), last_mm + step_mm)
        # within the path; a catheter that is still before its start is not moved faster than the step
        sent_mm = min(max(sent_mm, min(0.0, last_mm)), self.path.length_mm)
        self._actuators.command(self.path.targets(sent_mm))
        self._sent_mm, self._sent_ns = sent_mm, now
        return Applied(sent_mm, action, reason)

    def stop(self) -> None:
        """Stops the drives immediately; no command passes until `release`."""
        self._stopped = True
        with self._sending:
            self._actuators.stop(*self.path.start)

    def rest(self) -> None:
        """Lets the next command begin at the measured position: the drives rest, or another program moved them."""
        self._sent_mm = None

    def release(self) -> None:
        """Ends a stop: commands pass again, from the measured position of the drives."""
        self._stopped, self._sent_mm, self._over_since_ns = False, None, None


class _Bound:
    """Largest force that the tip can have, from the last interval and from the rate at which the force rises."""

    def __init__(self, settings: SafetySettings) -> None:
        self._settings = settings
        self.upper_n = 0.0
        self._middle_n = self._rise_n_per_s = 0.0
        self._captured_ns: int | None = None
        self._missed = False
        """Whether an estimate without an interval came after the last interval."""
        self._rises: deque[tuple[int, float]] = deque()

    def add(self, estimate: ForceEstimate, captured_ns: int) -> None:
        """Takes an estimate, valid or not: stores the upper end of its interval and the rate at which the force rises.

        After an estimate without an interval the bound rises until the next interval. One that is not newer than the
        last is ignored.

        Args:
            estimate: the estimate.
            captured_ns: mid-exposure of its image on the clock, ns.
        """
        if self._captured_ns is not None and captured_ns <= self._captured_ns:
            return
        if math.isnan(estimate.upper_n):
            self._missed = True
            return
        middle_n = estimate.magnitude_n if estimate.valid else 0.5 * sum(estimate.abstained_interval_n)
        if self._captured_ns is not None:
            seconds = (captured_ns - self._captured_ns) * 1e-9
            # An estimate that lags behind shows a new contact first in its interval, which becomes wider.
            rise_n = max(middle_n - self._middle_n, estimate.upper_n - self.upper_n) - self._settings.noise_n
            self._rise_n_per_s = max(0.0, rise_n) / seconds
        self._rises.append((captured_ns, self._rise_n_per_s))
        while self._rises[0][0] < captured_ns - 1e9 * self._settings.rise_memory_s:
            self._rises.popleft()
        self.upper_n, self._middle_n, self._captured_ns, self._missed = estimate.upper_n, middle_n, captured_ns, False

    def rise_n_per_s(self) -> float:
        """Returns the present rate of rise: that between the last two intervals, or a larger one while none comes."""
        if not self._missed:
            return self._rise_n_per_s
        return max(self._settings.least_rise_n_per_s, max(rise for _, rise in self._rises))

    def at_n(self, now_ns: int) -> float:
        """Returns the upper end of the force when a command of ``now_ns`` takes effect."""
        if self._captured_ns is None:
            return 0.0
        return self.upper_n + self.rise_n_per_s() * ((now_ns - self._captured_ns) * 1e-9 + self._settings.reaction_s)

    def reason(self, bound_n: float, limit_n: float) -> str:
        """Returns the reason why the catheter is drawn back, in one line."""
        if self.upper_n > limit_n:
            return f"upper end {self.upper_n:.2f} N above {limit_n:g} N"
        return (
            f"upper end {self.upper_n:.2f} N, rising by {self.rise_n_per_s():.1f} N/s: {bound_n:.2f} N before the "
            f"drives answer, limit {limit_n:g} N"
        )
