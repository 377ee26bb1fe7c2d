"""The zero button: subtracts the force at the time of pressing from all later estimates; every update states it."""

import math
import time
from collections import deque
from dataclasses import replace

import numpy as np

from ..errors import InputError, ZeroInContactError
from ..types import FloatArray, ForceEstimate
from ..units import newtons_to_grams
from ._settings import LiveSettings
from ._update import Zero

MAX_ESTIMATES, MIN_ESTIMATES = 512, 3
"""Largest number of estimates that are kept, and least number that a zero needs."""
MAX_CONTACT_PROBABILITY = 0.05
"""Below this probability of contact the method reads only its own error. `pretrained/compact` on
bench-2021, seed 0, states 0.006 to 0.057 where it reads below 3 mN, and 0.90 or more above 50 mN."""
CONFIRMATION_TOLERANCE_N = 0.01
"""A confirmed zero may differ from the present one by this; a smaller force is not a contact."""
DRIFT_AVERAGE_S = 1.0
"""Time over which estimates without contact are averaged, because their noise is not drift."""


class ZeroButton:
    """Subtracts the force at the time of pressing from all later estimates.

    It is not known which part of that force was an error of the zero and which part was real. So the 90 % intervals
    span both: the interval of the force as it was estimated, and the same interval less the zero. Alarm, limit and
    safety layer act on the upper end, which a zero therefore never lowers.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._settings = settings
        self._recent: deque[tuple[int, ForceEstimate]] = deque(maxlen=MAX_ESTIMATES)
        self._zero: Zero | None = None
        self._drift: FloatArray | None = None

    @property
    def zero(self) -> Zero | None:
        """The subtracted force; None before the button is pressed."""
        return self._zero

    def clear(self) -> None:
        """Removes the zero and forgets the last estimates, for example after the method was started again."""
        self._recent.clear()
        self._zero = self._drift = None

    def press(self, now_ns: int, *, by: str = "", confirmed_n: float | None = None) -> Zero:
        """Takes the mean of the estimates of the last ``zero_s`` seconds as zero.

        Args:
            now_ns: present time, on the engine's clock.
            by: name of the person or page that pressed the button.
            confirmed_n: the magnitude that a person agreed to subtract although the tip may be in contact.

        Returns:
            The new zero: the subtracted force, who pressed the button and when.

        Raises:
            InputError: too few estimates were valid, or they are too large to be an error of the zero.
            ZeroInContactError: the tip may be in contact, and this magnitude was not confirmed.
        """
        since_ns = now_ns - round(self._settings.zero_s * 1e9)
        recent = [estimate for at_ns, estimate in self._recent if at_ns >= since_ns]
        if len(recent) < MIN_ESTIMATES:
            raise InputError(
                f"no zero: {len(recent)} valid estimates in the last {self._settings.zero_s:g} s; "
                f"expected {MIN_ESTIMATES}"
            )
        mean_n = np.mean([_vector(estimate) for estimate in recent], axis=0)
        magnitude_n = float(np.linalg.norm(mean_n))
        most_n = self._settings.zero_max_n
        if magnitude_n > most_n:
            raise InputError(
                f"no zero: {newtons_to_grams(magnitude_n):.0f} g are read, and an error of the zero is at most "
                f"{newtons_to_grams(most_n):.0f} g; take the tip off the tissue first"
            )
        free = self._free(recent, magnitude_n)
        if not free and (confirmed_n is None or abs(magnitude_n - confirmed_n) > CONFIRMATION_TOLERANCE_N):
            raise ZeroInContactError(
                f"the tip may be in contact: {newtons_to_grams(magnitude_n):.1f} g ({1e3 * magnitude_n:.0f} mN) would "
                "be subtracted from every force from now on; take the tip off the tissue first, or confirm it",
                magnitude_n,
            )
        known = recent[-1].known
        offset = np.full(3, math.nan)
        offset[known] = mean_n[: int(known.sum())] if known.any() else math.nan
        contact = float(np.mean([estimate.contact for estimate in recent]))
        self._drift = None
        self._zero = Zero(offset, magnitude_n, now_ns, time.time(), by, confirmed=not free, contact=contact)
        return self._zero

    def _free(self, recent: list[ForceEstimate], magnitude_n: float) -> bool:
        """Returns whether the tip is free, by the stated probability of contact, or else by the force."""
        probabilities = [estimate.contact for estimate in recent]
        if any(math.isnan(contact) for contact in probabilities):
            return magnitude_n <= self._settings.contact.contact_n
        return max(probabilities) < MAX_CONTACT_PROBABILITY

    def apply(self, estimate: ForceEstimate, now_ns: int) -> ForceEstimate:
        """Keeps an estimate of the method for the next zero, and subtracts the present zero from it.

        Args:
            estimate: the estimate of the method.
            now_ns: present time on the engine's clock.

        Returns:
            The estimate less the zero. Each of its intervals spans the force with and without the subtraction.
        """
        if not estimate.valid:
            return self._widened(estimate)
        self._recent.append((now_ns, estimate))
        if self._zero is None:
            return estimate
        remainder_n = _vector(estimate) - self._subtracted(estimate)
        self._follow_drift(estimate, remainder_n, now_ns)
        # a method without components estimates the magnitude alone
        magnitude = float(np.linalg.norm(remainder_n)) if estimate.known.any() else max(0.0, float(remainder_n[0]))
        low, high = np.maximum(0.0, estimate.magnitude_interval_n + (magnitude - estimate.magnitude_n))
        low = min(low, estimate.magnitude_interval_n[0])
        high = max(high, estimate.upper_n) if math.isfinite(high) else max(magnitude, estimate.upper_n)
        offset = np.where(estimate.known, np.nan_to_num(self._zero.offset_n), 0.0)
        shifted = estimate.interval_n - offset[:, None]
        lower_ends = np.minimum(shifted[:, 0], estimate.interval_n[:, 0])
        upper_ends = np.maximum(shifted[:, 1], estimate.interval_n[:, 1])
        return replace(
            estimate,
            force_n=estimate.force_n - offset,
            interval_n=np.stack([lower_ends, upper_ends], axis=1),
            magnitude_n=magnitude,
            magnitude_interval_n=np.array([low, high]),
        )

    def _widened(self, estimate: ForceEstimate) -> ForceEstimate:
        """Widens an abstained interval so that it spans the force with and without the zero in any direction."""
        low, high = estimate.abstained_interval_n
        if self._zero is None or math.isnan(high):
            return estimate
        zero_n = self._zero.magnitude_n
        return replace(estimate, abstained_interval_n=(max(0.0, low - zero_n), high + zero_n))

    def _subtracted(self, estimate: ForceEstimate) -> FloatArray:
        assert self._zero is not None
        known = estimate.known
        return np.nan_to_num(self._zero.offset_n[known]) if known.any() else np.array([self._zero.magnitude_n])

    def _follow_drift(self, estimate: ForceEstimate, remainder_n: FloatArray, now_ns: int) -> None:
        """Averages the remainder after the zero in moments without contact: it is the drift since the zero.

        Args:
            estimate: the estimate; its probability of contact decides. NaN counts as contact.
            remainder_n: its known components, (k,), or its magnitude, (1,), less the zero.
            now_ns: present time on the engine's clock.
        """
        zero = self._zero
        assert zero is not None
        if not estimate.contact < MAX_CONTACT_PROBABILITY:
            return
        if self._drift is None or zero.drift_ns is None:
            self._drift = remainder_n
        else:
            weight = min(1.0, (now_ns - zero.drift_ns) * 1e-9 / DRIFT_AVERAGE_S)
            self._drift = self._drift + weight * (remainder_n - self._drift)
        self._zero = replace(zero, drift_n=float(np.linalg.norm(self._drift)), drift_ns=now_ns)


def _vector(estimate: ForceEstimate) -> FloatArray:
    """Returns the (k,) known components, or the (1,) magnitude if the method estimates no components."""
    return estimate.force_n[estimate.known] if estimate.known.any() else np.array([estimate.magnitude_n])
