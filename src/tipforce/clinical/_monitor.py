"""Follows the contact over time: state, class, time in the window and above the limit, force-time integral."""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from ..types import ForceEstimate
from ..units import newtons_to_grams
from ._probability import probability_above
from ._settings import ContactSettings
from ._state import ContactClass, ContactState, contact_class, contact_state


@dataclass(frozen=True, slots=True)
class Duration:
    """Time during which a force was in a range.

    Attributes:
        seconds: time by the estimates themselves, s.
        least_s: time during which the whole 90 % interval was in the range, s.
        most_s: time during which any part of the interval was in the range, s. An estimate without a bounded interval
            adds only to this time.
    """

    seconds: float = 0.0
    least_s: float = 0.0
    most_s: float = 0.0

    def plus(self, seconds: float, inside: bool, surely: bool, possibly: bool) -> "Duration":
        """Returns the duration with a further stretch of time.

        Args:
            seconds: length of the stretch, s.
            inside: whether the force was in the range.
            surely: whether the whole interval was in the range.
            possibly: whether any part of the interval was in the range.
        """
        return Duration(
            self.seconds + seconds * inside, self.least_s + seconds * surely, self.most_s + seconds * possibly
        )


@dataclass(frozen=True, slots=True)
class ClinicalState:
    """The contact at one instant, and the totals since the start.

    All times are since the first frame or the last `ContactMonitor.reset`. Time without a valid estimate is only
    counted as ``unknown_s``, in particular not as zero force.

    Attributes:
        stamp_ns: mid-exposure of the frame.
        contact: state by the magnitude itself.
        contact_class: class of the last seconds.
        in_contact: probability of contact; NaN where unknown.
        in_window: probability that the force is in the window; NaN where unknown.
        above_limit: probability that the force is above the limit; NaN where unknown.
        elapsed_s: time from the first frame to this one, s.
        unknown_s: part of it without a valid estimate, s.
        window: time in the window.
        limit: time above the limit.
        integral_n_s: force-time integral over the known time, N s.
        integral_interval_n_s: its ends if the errors of all frames had the same sign. Errors of one session do resemble
            each other; where they average out, the interval is wider than necessary. NaN where an estimate had no
            bounded interval.
    """

    stamp_ns: int
    contact: ContactState
    contact_class: ContactClass
    in_contact: float
    in_window: float
    above_limit: float
    elapsed_s: float
    unknown_s: float
    window: Duration
    limit: Duration
    integral_n_s: float
    integral_interval_n_s: tuple[float, float]

    @property
    def known_s(self) -> float:
        """Time with a valid estimate."""
        return max(0.0, self.elapsed_s - self.unknown_s)

    @property
    def window_share(self) -> float:
        """Share of the known time in the window; NaN without any."""
        return self.window.seconds / self.known_s if self.known_s > 0.0 else math.nan

    @property
    def integral_g_s(self) -> float:
        """Force-time integral in g s."""
        return newtons_to_grams(self.integral_n_s)

    @property
    def integral_interval_g_s(self) -> tuple[float, float]:
        """Ends of the force-time integral in g s."""
        low, high = self.integral_interval_n_s
        return newtons_to_grams(low), newtons_to_grams(high)


class _Instant(NamedTuple):
    """Stamp, magnitude and interval of one frame; NaN where unknown."""

    stamp_ns: int
    magnitude_n: float
    low_n: float
    high_n: float


class ContactMonitor:
    """Follows one stream of estimates.

    A frame represents half the time to the frame before it and half the time to the next one. Therefore half of the
    time between a valid and an invalid frame is unknown, and all of the time between frames more than ``max_gap_s``
    apart. A frame that is not later than the one before it adds no time.

    >>> import numpy as np
    >>> nothing = np.full((3, 3), np.nan)
    >>> none = np.zeros(3, np.bool_)
    >>> def of(second, force):
    ...     ends = np.array([force - 0.02, force + 0.02])
    ...     stamp_ns = second * 1_000_000_000
    ...     return ForceEstimate(stamp_ns, nothing[0], none, nothing, nothing[:, :2], force, ends)
    >>> monitor = ContactMonitor(ContactSettings(max_gap_s=1.0))
    >>> states = [monitor.update(of(second, force)) for second, force in enumerate([0.2, 0.2, 0.5])]
    >>> last = states[-1]
    >>> str(last.contact), last.window.seconds, last.limit.seconds, round(last.integral_n_s, 3)
    ('excessive', 1.5, 0.5, 0.55)
    >>> [round(end, 3) for end in last.integral_interval_n_s], round(last.above_limit, 3)
    ([0.51, 0.59], 1.0)
    """

    def __init__(self, settings: ContactSettings | None = None) -> None:
        self.settings = settings or ContactSettings()
        self._last: _Instant | None = None
        self._recent: deque[tuple[int, float]] = deque()
        self._since_ns: int | None = None
        """Stamp since which there was no gap between frames."""
        self.reset()

    def reset(self) -> None:
        """Resets times and integral, as at the beginning of an ablation; the class continues."""
        self._elapsed_s = self._unknown_s = self._integral = self._low = self._high = 0.0
        self._window = self._limit = Duration()

    def update(self, estimate: ForceEstimate) -> ClinicalState:
        """Adds the next estimate; returns the state after it."""
        settings = self.settings
        low, high = estimate.magnitude_interval_n.tolist()
        bounded = math.isfinite(low) and math.isfinite(high)
        now = _Instant(
            estimate.stamp_ns,
            estimate.magnitude_n,
            low if bounded else math.nan,
            high if bounded else math.nan,
        )
        last = self._last
        if last is None:
            self._last, self._since_ns = now, now.stamp_ns
        elif now.stamp_ns > last.stamp_ns:
            seconds = (now.stamp_ns - last.stamp_ns) * 1e-9
            self._elapsed_s += seconds
            if seconds > settings.max_gap_s:
                self._unknown_s += seconds
                self._since_ns = now.stamp_ns
                self._recent.clear()
            else:
                self._add(last, 0.5 * seconds)
                self._add(now, 0.5 * seconds)
            self._last = now
        in_contact = estimate.contact
        if math.isnan(in_contact):
            in_contact = probability_above(estimate, settings.contact_n)
        return ClinicalState(
            stamp_ns=estimate.stamp_ns,
            contact=contact_state(estimate.magnitude_n, settings),
            contact_class=self._class(now),
            in_contact=in_contact,
            in_window=max(
                0.0,
                probability_above(estimate, settings.window_n[0]) - probability_above(estimate, settings.window_n[1]),
            )
            if estimate.valid
            else math.nan,
            above_limit=probability_above(estimate, settings.limit_n),
            elapsed_s=self._elapsed_s,
            unknown_s=self._unknown_s,
            window=self._window,
            limit=self._limit,
            integral_n_s=self._integral,
            integral_interval_n_s=(self._low, self._high),
        )

    def _add(self, instant: _Instant, seconds: float) -> None:
        """Adds ``seconds`` at the force of ``instant``."""
        force, low, high = instant.magnitude_n, instant.low_n, instant.high_n
        if math.isnan(force):
            self._unknown_s += seconds
            return
        (least, most), limit, bounded = self.settings.window_n, self.settings.limit_n, not math.isnan(low)
        self._window = self._window.plus(
            seconds,
            least <= force <= most,
            bounded and least <= low and high <= most,
            not bounded or (low <= most and high >= least),
        )
        self._limit = self._limit.plus(seconds, force > limit, bounded and low > limit, not bounded or high > limit)
        self._integral += seconds * force
        self._low += seconds * low
        self._high += seconds * high

    def _class(self, now: _Instant) -> ContactClass:
        """Returns the class of the last seconds; unknown until they have passed."""
        reach = round(self.settings.class_s * 1e9)
        self._recent.append((now.stamp_ns, now.magnitude_n))
        while self._recent[0][0] < now.stamp_ns - reach:
            self._recent.popleft()
        assert self._since_ns is not None
        if now.stamp_ns - self._since_ns < reach:
            return ContactClass.UNKNOWN
        return contact_class([force for _, force in self._recent], self.settings)
