"""The control loop: takes estimates, keeps the state of the run, and moves the drives through the safety layer."""

import math
import threading
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ..types import Actuators, Clock, ForceEstimate
from ..units import newtons_to_grams
from ._controllers import Controller, PeriodicRejection, make_controller
from ._observer import Sample, WallObserver
from ._path import Path
from ._safety import Applied, SafetyAction, SafetyLayer
from ._settings import ControlSettings

_HISTORY_S = 2.0
"""Time for which the positions of the drives are kept: older images are not used."""
_INTERVAL_SIGMAS = 2 * 1.6449
"""Width of a 90 % interval, in standard deviations."""
_DITHER_RATE_RATIO = 1.5
"""Ratio of the rate of the test motion to the heart rate: between the harmonics."""
_AVERAGED_BREATHS = 1.0
"""Number of breaths over which the force is averaged with controller ``none``."""
_MIN_FOLLOWED_SHARE = 0.85
"""The hold may begin when this share of the wall's motion is followed."""
_EXCESS_S = 2.0
"""Time over which the excess of the force lowers the wanted force."""
_UPPER_RESERVE = 1.2
"""The upper end of the interval, times this factor, must fit below the limit at the wanted force."""
_FALL_RATIO = 5.0
"""Ratio of the rate at which the wanted force falls to that at which it rises."""
_MAX_CALM_ERROR_SHARE = 0.4
"""Share of the target: with smaller errors the heart rate counts as found."""
_LOST_SHARE, _KEPT_SHARE = 0.3, 0.8
"""Shares of the last seconds in contact: below the first the least force is wanted, above the second the target."""
_MIN_TARGET_SHARE = 0.25
"""Smallest share of the target that is wanted in hold."""
_AHEAD_S = np.arange(0.0, 0.301, 0.05)
"""Times for which the wall is predicted, half a beat, so that the tip can avoid it."""
_WALL_SIGMAS = 1.0
"""Number of standard deviations of wall and gain that are added to each prediction. 0.5 and 1 were compared, with rates
within 10, 20 and 40 in log-likelihood, on 18 analytic benches: docs/log.md."""
_MAX_RATE_RANGE_HZ = 0.21
"""The heart rate is resolved where the plausible rates differ by less."""
_SMALL_ERROR_N, _LARGE_ERROR_N = 0.1, 0.2
"""Largest errors of the predicted force within the last second: below the first the tip goes toward the wall at the
full speed of the drives, above the second at `_CAREFUL_MM_PER_S`."""
_CAREFUL_MM_PER_S = 5.0
"""Speed toward the wall where its motion is not known: the full speed of a drive would double the speed at which wall
and tip meet."""
_FREE_S = 0.1
"""After this time without certain contact the tip is free."""
_MAX_WITHOUT_CONTACT_S = 8.0
"""After this time without contact the tip approaches the wall again, lightly."""
_BEAT_MARGIN = 1.2
"""Factor on the longest period of the heart: a whole beat is then among the forces, although images come late."""
_DRAW_BACK_RATIO = 5.0
"""Ratio of the largest speeds away from and toward the wall in contact."""
_HELD_S = 2.0
_MAX_HELD_ERROR_SHARE = 0.25
"""The force is held where its root mean square distance from the target over the last `_HELD_S` is at most this share
of the target."""
_START_TOLERANCE_MM = 0.05
"""The catheter is at the start if it is nearer than this."""


def _force_text(force_n: float) -> str:
    return f"{force_n:.2f} N ({newtons_to_grams(force_n):.0f} g)"


class ControlState(StrEnum):
    """State of a run."""

    IDLE = "idle"
    APPROACH = "approach"
    CONTACT = "contact"
    """The tip touches, lightly; the wall's motion is learnt."""
    HOLD = "hold"
    RETRACT = "retract"


@dataclass(frozen=True, slots=True)
class ControlTick:
    """The loop at one command.

    Args:
        time_s: time on the loop's clock.
        state: state of the run.
        target_n: the force that is wanted at this time; 0 outside of hold.
        force_n: magnitude of the last estimate; NaN before the first.
        low_n: lower end of its interval.
        high_n: upper end of its interval.
        upper_n: upper end of the interval, also of an estimate that abstains because its interval is too wide; NaN
            where none is known.
        valid: whether the last estimate is valid.
        position_mm: measured position on the path.
        applied: command that was sent.
        gain_n_per_mm: estimated force for each mm of the path.
        heart_hz: estimated heart rate.
    """

    time_s: float
    state: ControlState
    target_n: float
    force_n: float
    low_n: float
    high_n: float
    upper_n: float
    valid: bool
    position_mm: float
    applied: Applied
    gain_n_per_mm: float
    heart_hz: float


class _Reach(NamedTuple):
    """Force of one estimate in hold, upper end of its interval, and excess over the force wanted at that time, N."""

    time_s: float
    force_n: float
    high_n: float
    excess_n: float


class ControlLoop:
    """Holds a force with drives along a path, by the estimates that it is given.

    `update` takes each estimate; `tick` is called every ``settings.period_s`` and commands the drives. The operator's
    `start`, `retract`, `stop` and `release` may be called from any thread. The loop reaches the drives only through
    the safety layer.

    Args:
        actuators: the drives.
        clock: clock of the drives.
        path: path from the marked start to the marked goal.
        settings: target, controller, limits.
        frame_period_s: time between images of the source.
    """

    def __init__(
        self, actuators: Actuators, clock: Clock, path: Path, settings: ControlSettings, frame_period_s: float
    ) -> None:
        self.settings, self.path, self._clock = settings, path, clock
        self.safety = SafetyLayer(actuators, clock, path, settings.safety, frame_period_s)
        self.state, self.reason = ControlState.IDLE, ""
        self.restarts = 0
        self._lock = threading.RLock()
        self._history: deque[tuple[float, float]] = deque()
        self._estimate: ForceEstimate | None = None
        self._valid_since_s: float | None = None
        self._again = self._approach_next = self._left = False
        self._last_s: float | None = None
        self._begin_run()

    def _begin_run(self) -> None:
        """Sets all that a run learns and remembers to its first values: the wall's model, the controller, histories."""
        # The tip meets the wall at an unknown position on the path: at half its length, with a deviation of that half.
        half_mm = 0.5 * self.path.length_mm
        self._observer = WallObserver(self.settings.observer, -half_mm, half_mm)
        self._controller: Controller = make_controller(
            self.settings.controller, self.settings, self._observer, self.safety.max_acceleration_mm_per_s2
        )
        self._target_n = 0.0
        self._wanted_mm = 0.0
        self._contact_s, self._hold_s = math.inf, math.inf
        self._touched_s = -math.inf
        """Time of the last certain contact."""
        self._light_mm: deque[tuple[float, float]] = deque()
        """Certain contacts of the last beat: time, and position at which they would have been light, mm; where there
        was none, the deepest position of the beat before the hold."""
        self._touch_mm = self._follow = 0.0
        self._slack_mm = 0.0
        """Distance that the tip may go beyond the limit by the plausible walls; it grows while there is no contact."""
        self._recent: deque[_Reach] = deque()
        self._forces: deque[tuple[float, float]] = deque()
        self._distances: deque[tuple[float, float]] = deque()
        """Time in s and distance of the force from the target in N; `held` uses them."""

    def start(self) -> None:
        """Starts a run: the catheter goes to the marked start, then toward the goal.

        Nothing happens during a run, or between `stop` and `release`: a release moves nothing.
        """
        with self._lock:
            if self.state is not ControlState.IDLE or self.safety.stopped:
                return
            self._left = False
            self._begin_run()
            self._wanted_mm = self.safety.measured_mm()
            self._approach_next = abs(self._wanted_mm) > _START_TOLERANCE_MM
            if self._approach_next:
                self._go(ControlState.RETRACT, "to the marked start")
            else:
                self._go(ControlState.APPROACH, "started")

    @property
    def resumes(self) -> bool:
        """Whether a run that was drawn back will begin its approach again by itself."""
        return self._again

    def retract(self, reason: str = "the operator ended the run") -> None:
        """Ends the run: the catheter goes back to the marked start. Without a run it goes back only after a `stop`."""
        with self._lock:
            self._again = self._approach_next = False
            if not self.safety.stopped and (self.state is not ControlState.IDLE or self._left):
                self._left = False
                self._go(ControlState.RETRACT, reason)

    def stop(self) -> None:
        """Stops the drives: they brake and stay until `release`, in every state of the run."""
        self.safety.stop()
        with self._lock:
            self._again = self._approach_next = False
            self._left = True
            self._go(ControlState.IDLE, "the stop key was pressed")

    def release(self) -> None:
        """Ends a `stop`: the run may be started again, or retracted."""
        with self._lock:
            if self.safety.stopped and self.state is ControlState.IDLE:
                self.reason = "released"
            self.safety.release()

    def update(self, estimate: ForceEstimate, captured_ns: int | None = None) -> None:
        """Takes an estimate: passes it to the safety layer, and during a run, if it has a force, to the control.

        Args:
            estimate: the estimate, valid or not.
            captured_ns: mid-exposure of its image on the loop's clock; None: the stamp of the estimate.
        """
        with self._lock:
            captured = estimate.stamp_ns if captured_ns is None else captured_ns
            self.safety.observe(estimate, captured)
            self._estimate = estimate
            captured_s = captured * 1e-9
            if not estimate.valid:
                self._valid_since_s = None
            elif self._valid_since_s is None:
                self._valid_since_s = self._clock.now_ns() * 1e-9
            low, high = estimate.magnitude_interval_n if estimate.valid else estimate.abstained_interval_n
            force_n = estimate.magnitude_n if estimate.valid else 0.5 * (low + high)
            if math.isfinite(force_n):
                sigma_n = float(high - low) / _INTERVAL_SIGMAS if math.isfinite(high - low) else 0.0
                sample = Sample(captured_s, float(force_n), sigma_n, self._position_at(captured_s))
                self._take(sample, float(low), float(high), estimate.valid)

    def _take(self, sample: Sample, low_n: float, high_n: float, valid: bool) -> None:
        """Takes a sample: updates the wall's model and the histories, then acts as the state of the run requires.

        Approach ends at the first contact. In contact the loop waits until the wall is known. In hold the controller
        gets the sample, unless contact was lost.

        Args:
            sample: force, its standard deviation, and the position of the catheter at the same time.
            low_n: lower end of the force's interval, N: where it is 0 there may be no contact.
            high_n: its upper end, N.
            valid: False: the sample is the middle of an abstained interval, with its width. Without such samples the
                model of the wall would know small forces only, since large ones are often uncertain.
        """
        if self.state not in (ControlState.APPROACH, ControlState.CONTACT, ControlState.HOLD):
            return
        self._observer.add(sample)
        averaged_s = _AVERAGED_BREATHS / self.settings.observer.respiration_hz
        self._forces.append((sample.time_s, sample.force_n))
        while self._forces[0][0] < sample.time_s - averaged_s:
            self._forces.popleft()
        # of an abstained interval the end that is farther from the target counts: its middle is not an estimate
        half_width_n = 0.0 if valid else 0.5 * _INTERVAL_SIGMAS * sample.sigma_n
        self._distances.append((sample.time_s, abs(sample.force_n - self.settings.target_n) + half_width_n))
        while len(self._distances) > 1 and self._distances[1][0] <= sample.time_s - _HELD_S:
            self._distances.popleft()
        touches = low_n > 0.0 and sample.force_n > self.settings.contact_n
        if touches:
            self._touched_s = sample.time_s
            wanted_n = max(self._target_n, self.settings.touch_n)
            too_deep_mm = max(0.0, sample.force_n - wanted_n) / self._observer.gain_n_per_mm
            self._light_mm.append((sample.time_s, sample.position_mm - too_deep_mm))
            while self._light_mm[0][0] < sample.time_s - self._longest_beat_s:
                self._light_mm.popleft()
        if self.state is ControlState.APPROACH:
            if touches:
                recoil_mm = 0.0 if self.settings.controller == "none" else self.settings.recoil_mm
                self._touch_mm = max(0.0, self._wanted_mm - recoil_mm)
                self._contact_s = sample.time_s
                self._go(ControlState.CONTACT, "the tip touches")
        elif self.state is ControlState.CONTACT:
            self._touch(sample)
        else:
            self._recent.append(_Reach(sample.time_s, sample.force_n, high_n, sample.force_n - self._target_n))
            while self._recent[0].time_s < sample.time_s - _EXCESS_S:
                self._recent.popleft()
            if not self._observer.locked and self._calm(sample.time_s):
                self._observer.lock()
            if valid:
                self._controller.add(sample, self._target_n, self._observer.gain_n_per_mm)
            if self._out_of_touch(sample.time_s):
                self._touch_mm, self._contact_s = self._wanted_mm, sample.time_s
                self._go(ControlState.CONTACT, "contact was lost")

    def _out_of_touch(self, now_s: float) -> bool:
        """Returns whether contact is missing for `_MAX_WITHOUT_CONTACT_S` although a force is wanted."""
        free_s = now_s - max(self._touched_s, self._hold_s)
        return self.settings.controller == "periodic" and free_s > _MAX_WITHOUT_CONTACT_S

    def _touch(self, sample: Sample) -> None:
        """Waits in contact until the model of the wall is good enough for the controller; then the hold begins.

        Controller "periodic" waits until the heart rate or the wall is known, "none" until the mean force is at the
        target, and the others do not wait: they follow the force, not the wall's model.
        """
        settings, in_contact_s = self.settings, sample.time_s - self._contact_s
        if settings.controller == "none":
            ready = in_contact_s >= settings.settle_s
        elif settings.controller == "periodic":
            if in_contact_s >= settings.learn_s:
                # The share that is followed rises as the error of the next beat falls below the depth of a light touch.
                relative_error = self._observer.spread_mm() * self._observer.gain_n_per_mm / settings.touch_n
                self._follow = 1.0 / (1.0 + relative_error * relative_error)
            resolved = in_contact_s >= settings.learn_s and self._observer.rate_range_hz <= _MAX_RATE_RANGE_HZ
            ready = resolved or self._follow >= _MIN_FOLLOWED_SHARE or in_contact_s >= settings.learn_at_most_s
        else:
            ready = True
        if ready:
            self._controller.begin(self._wanted_mm)
            self._hold_s, self._slack_mm = sample.time_s, 0.0
            if not self._light_mm or sample.time_s - self._touched_s > self._longest_beat_s:
                begun_s = sample.time_s - self._longest_beat_s
                deepest_mm = max((mm for time_s, mm in self._history if time_s >= begun_s), default=self._wanted_mm)
                self._light_mm = deque([(sample.time_s, deepest_mm)])
            # begins with half of a light touch; `_raise_target` raises it from there
            self._target_n = min(0.5 * settings.touch_n, settings.target_n)
            self._go(ControlState.HOLD, "the wall's motion is known well enough")

    def _calm(self, now_s: float) -> bool:
        """Returns whether the force was near the wanted one for `_EXCESS_S`: model and rate are then right."""
        enough = now_s - self._recent[0].time_s >= 0.9 * _EXCESS_S and self._target_n >= self.settings.target_n
        return enough and max(abs(each.excess_n) for each in self._recent) < _MAX_CALM_ERROR_SHARE * self._target_n

    @property
    def held(self) -> bool:
        """Whether the estimated force was near the target in the last `_HELD_S` seconds, by the RMS of its distance."""
        with self._lock:
            if self.state is not ControlState.HOLD or self._estimate is None or not self._estimate.valid:
                return False
            if self._distances[-1][0] - self._distances[0][0] < _HELD_S:
                return False
            mean_square_n2 = sum(distance * distance for _, distance in self._distances) / len(self._distances)
            return math.sqrt(mean_square_n2) <= _MAX_HELD_ERROR_SHARE * self.settings.target_n

    @property
    def progress(self) -> str:
        """One line for people: the reason of the state; in hold, whether the force is held, or the reason if not."""
        with self._lock:
            if self.state is not ControlState.HOLD:
                return self.reason
            target = _force_text(self.settings.target_n)
            if self.held:
                return f"the force is held at {target}"
            action, why = self.safety.check()
            if action is not SafetyAction.PASS:
                return f"not held at {target}: {why}"
            return f"not held yet: brought to {target}, {_force_text(self._target_n)} is wanted now"

    def tick(self) -> ControlTick:
        """Commands the drives once, every ``settings.period_s``, and returns the state of the loop.

        A retraction of the safety layer during a run ends it; `start` may repeat it, ``settings.restarts`` times.
        """
        with self._lock:
            now_s = self._clock.now_ns() * 1e-9
            position = self.safety.measured_mm()
            self._history.append((now_s, position))
            while self._history[0][0] < now_s - _HISTORY_S:
                self._history.popleft()
            dt_s = 0.0 if self._last_s is None else now_s - self._last_s
            self._last_s = now_s
            action, reason = self.safety.check()
            running = self.state in (ControlState.APPROACH, ControlState.CONTACT, ControlState.HOLD)
            if running and action is SafetyAction.RETRACT and self.safety.age_ns() is not None:
                self._again = self.restarts < self.settings.restarts
                self._go(ControlState.RETRACT, reason)
            applied = self._drive(now_s, dt_s, position)
            estimate = self._estimate
            low, high = (math.nan, math.nan) if estimate is None else estimate.magnitude_interval_n.tolist()
            return ControlTick(
                time_s=now_s,
                state=self.state,
                target_n=self._target_n if self.state is ControlState.HOLD else 0.0,
                force_n=math.nan if estimate is None else estimate.magnitude_n,
                low_n=low,
                high_n=high,
                upper_n=math.nan if estimate is None else estimate.upper_n,
                valid=estimate is not None and estimate.valid,
                position_mm=position,
                applied=applied,
                gain_n_per_mm=self._observer.gain_n_per_mm,
                heart_hz=self._observer.heart_hz,
            )

    def _drive(self, now_s: float, dt_s: float, position: float) -> Applied:
        """Moves the wanted position as the state of the run requires, and sends it through the safety layer.

        Args:
            now_s: time of this tick.
            dt_s: time since the last tick.
            position: measured position on the path, mm.

        Returns:
            The command that was sent: limits may have changed the wanted position.
        """
        settings = self.settings
        match self.state:
            case ControlState.IDLE:
                valid_s = 0.0 if self._valid_since_s is None else now_s - self._valid_since_s
                if self._again and valid_s >= settings.restart_valid_s:
                    self._again, self.restarts = False, self.restarts + 1
                    self.start()
                return Applied(position, self.safety.check()[0], self.reason)
            case ControlState.APPROACH:
                speed = settings.approach_mm_per_s
                self._wanted_mm += speed * dt_s
                if self._wanted_mm >= self.path.length_mm:
                    self._again = False
                    self._go(ControlState.RETRACT, "the goal was reached without contact")
            case ControlState.CONTACT:
                # a light touch, with the share of the wall's motion that is known already
                self._touch_mm += self._touch_speed() * dt_s
                self._wanted_mm = self._touch_mm + self._follow * self._swing_mm(now_s)
                speed = None
            case ControlState.HOLD:
                self._raise_target(dt_s)
                farthest_mm = min(self._wanted_mm + self._nearing_mm_per_s() * dt_s, self._reach_mm(now_s))
                self._wanted_mm = self._controller.position_mm(now_s, self._target_n) + self._dither_mm(now_s)
                self._wanted_mm = min(self._wanted_mm, farthest_mm)
                speed = None
            case ControlState.RETRACT:
                self._wanted_mm, speed = 0.0, settings.retract_mm_per_s
                if abs(position) < _START_TOLERANCE_MM:
                    self._arrive()
        if self.state is ControlState.HOLD and settings.controller == "periodic":
            # keeps away from each plausible wall; while forces are small the slack lets the tip come nearer
            self._slack_mm = max(0.0, self._slack_mm + self._touch_speed() * dt_s)
            self._wanted_mm -= max(0.0, self._excess_mm(now_s) - self._slack_mm)
        applied = self.safety.command(self._wanted_mm, speed)
        # controller and touch continue from the position that the limits allowed
        if self.state is ControlState.HOLD:
            self._controller.applied(applied.position_mm - self._dither_mm(now_s))
        elif self.state is ControlState.CONTACT and applied.action is not SafetyAction.PASS:
            self._touch_mm = applied.position_mm - self._follow * self._swing_mm(now_s)
        self._wanted_mm = applied.position_mm
        return applied

    def _arrive(self) -> None:
        if self._approach_next:
            self._approach_next = False
            self._go(ControlState.APPROACH, "started")
        else:
            self._go(ControlState.IDLE, self.reason)

    def _touch_speed(self) -> float:
        """Returns the speed toward the wall, in mm/s, that brings the force of the last beat to its wanted value.

        With controller "none" the mean force over a breath is brought to the target; with the others the largest force
        of the last beat is brought to a light touch. Negative: away from the wall.
        """
        settings = self.settings
        if settings.controller == "none":
            mean_n = sum(force for _, force in self._forces) / len(self._forces)
            error = (settings.target_n - mean_n) / settings.target_n
            return settings.touch_mm_per_s * max(-1.0, min(1.0, 2.0 * error))  # full speed from an error of 50 %
        newest_s = self._forces[-1][0]
        largest_n = max(force for time_s, force in self._forces if time_s >= newest_s - self._longest_beat_s)
        error = (settings.touch_n - largest_n) / settings.touch_n
        return settings.touch_mm_per_s * max(-_DRAW_BACK_RATIO, min(1.0, error))

    @property
    def _longest_beat_s(self) -> float:
        return _BEAT_MARGIN / self.settings.observer.heart_hz[0]

    def _swing_mm(self, now_s: float) -> float:
        return self._controller.swing_mm(now_s) if isinstance(self._controller, PeriodicRejection) else 0.0

    def _nearing_mm_per_s(self) -> float:
        """Returns the largest speed toward the goal while the force is held.

        It falls with the largest error in the last second of the force that the model of the moving wall predicts: full
        speed up to `_SMALL_ERROR_N`, then linearly to 0 at `_LARGE_ERROR_N`, but never below `_CAREFUL_MM_PER_S`. It is
        that speed, too, as long as the rate of the model is uncertain.
        """
        fastest = self.safety.max_speed_mm_per_s
        if self.settings.controller != "periodic":  # the others follow the force, not the wall's model
            return fastest
        if self._observer.rate_range_hz > _MAX_RATE_RANGE_HZ:
            return min(_CAREFUL_MM_PER_S, fastest)
        speed_share = (_LARGE_ERROR_N - self._observer.max_residual_n) / (_LARGE_ERROR_N - _SMALL_ERROR_N)
        return max(min(_CAREFUL_MM_PER_S, fastest), fastest * min(1.0, speed_share))

    def _reach_mm(self, now_s: float) -> float:
        """Returns the farthest position of a tip that is free while the force is held; infinite in contact.

        It begins where the certain contacts of the last beat would have been light, and grows at the speed of a light
        touch: a tip that follows a wall out of reach would meet it deep in the next beat. Where the heart rate is known
        the tip is free after a beat without certain contact.
        """
        settings = self.settings
        free_s = self._forces[-1][0] - self._touched_s
        known = self._observer.rate_range_hz <= _MAX_RATE_RANGE_HZ
        if settings.controller != "periodic" or free_s <= (self._longest_beat_s if known else _FREE_S):
            return math.inf
        nearest_mm = min(position for _, position in self._light_mm)
        return nearest_mm + settings.touch_mm_per_s * (now_s - self._light_mm[-1][0])

    def _excess_mm(self, now_s: float) -> float:
        """Returns by how much the wanted position is too deep for a plausible wall, now or soon, in mm.

        The wall is predicted for the next 0.3 s (half a beat): the drives need time to move away from a wall that
        comes nearer. 0 where even the full speed back keeps every predicted force below the limit over the reserve.
        """
        settings = self.settings
        # position now, and later if the drives moved back at full speed from now on
        positions_mm = self._wanted_mm - self.safety.max_speed_mm_per_s * _AHEAD_S
        times_s = now_s + settings.drive_delay_s + _AHEAD_S
        return self._observer.excess_mm(times_s, positions_mm, self.safety.limit_n / settings.reserve, _WALL_SIGMAS)

    def _raise_target(self, dt_s: float) -> None:
        """Moves the wanted force toward the target, as far as excess and upper end of the force fit below the limit.

        Three bounds of the wanted force come from the samples of the last `_EXCESS_S` seconds: the largest excess times
        the reserve, and the highest upper end, must fit below the limit; and contact must not be lost repeatedly. The
        wanted force rises by at most ``settings.ramp_n_per_s * dt_s`` and falls five times as fast.
        """
        settings = self.settings
        largest_n = max((reach.excess_n for reach in self._recent), default=0.0)
        bound_n = self.safety.limit_n - settings.reserve * max(largest_n, 0.0)
        if self._recent:
            # an upper end above the limit would draw the catheter back, and contact would be lost
            highest = max(self._recent, key=lambda reach: reach.high_n)
            force_n = self.safety.limit_n * highest.force_n / (_UPPER_RESERVE * max(highest.high_n, 1e-9))
            bound_n = min(bound_n, force_n - highest.excess_n)
            # repeated loss of contact shows that the motion of the wall is not known yet
            touching = sum(reach.excess_n > settings.contact_n - self._target_n for reach in self._recent)
            share = (touching / len(self._recent) - _LOST_SHARE) / (_KEPT_SHARE - _LOST_SHARE)
            bound_n = min(bound_n, settings.target_n * share)
        goal_n = min(settings.target_n, self.safety.limit_n, max(bound_n, _MIN_TARGET_SHARE * settings.target_n))
        rise_n = settings.ramp_n_per_s * dt_s
        self._target_n += min(max(goal_n - self._target_n, -_FALL_RATIO * rise_n), rise_n)

    def _dither_mm(self, now_s: float) -> float:
        """Returns the small sine motion from which the observer learns the gain, in mm; 0 for other controllers.

        Its rate is between the harmonics of the heart, so that heart and test motion do not mix.
        """
        if not isinstance(self._controller, PeriodicRejection):
            return 0.0
        amplitude_mm = self.settings.dither_n / self._observer.gain_n_per_mm
        return amplitude_mm * math.sin(2.0 * math.pi * _DITHER_RATE_RATIO * self._observer.heart_hz * now_s)

    def _position_at(self, time_s: float) -> float:
        """Returns the position of the catheter at ``time_s``, interpolated between the readings of the drives."""
        if not self._history:
            return self.safety.measured_mm()
        row = bisect_left(self._history, (time_s, -math.inf))
        if row == 0:
            return self._history[0][1]
        if row == len(self._history):
            return self._history[-1][1]
        (before_s, before), (after_s, after) = self._history[row - 1], self._history[row]
        return before + (after - before) * (time_s - before_s) / (after_s - before_s)

    def _go(self, state: ControlState, reason: str) -> None:
        self.state, self.reason = state, reason
