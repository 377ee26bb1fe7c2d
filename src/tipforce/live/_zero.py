"""The operator's zero button: what is read now is 0 from now on, and what that hides is told."""

import math
from collections import deque
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..types import FloatArray, ForceEstimate
from ..units import newtons_to_grams
from ._settings import LiveSettings
from ._update import Zero

__all__ = ["ZeroButton"]

_MOST, _FEWEST = 512, 3
"""Estimates that are remembered, and those that a zero needs at least."""
_NO_CONTACT = 0.05
"""A method that states a lower probability of contact reads its own error, and nothing else."""
_DRIFT_S = 1.0
"""Time over which such readings are averaged, for their noise is no drift."""


class ZeroButton:
    """Subtracts from estimates what was read when it was pressed.

    The intervals move along and keep their widths: the errors of one session resemble each other, so a zero takes
    away a part of them, but how much nobody knows.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._settings = settings
        self._recent: deque[tuple[int, ForceEstimate]] = deque(maxlen=_MOST)
        self._zero: Zero | None = None
        self._drift: FloatArray | None = None

    @property
    def zero(self) -> Zero | None:
        """What is subtracted; None before the button is pressed."""
        return self._zero

    def clear(self) -> None:
        """Subtract nothing any more, as after the method began anew."""
        self._recent.clear()
        self._zero = self._drift = None

    def press(self, now_ns: int) -> Zero:
        """Takes the mean of the last ``zero_s`` as zero.

        Raises InputError where too few estimates were valid, or they are too large to be an error of the zero.
        """
        since_ns = now_ns - round(self._settings.zero_s * 1e9)
        taken = [estimate for at_ns, estimate in self._recent if at_ns >= since_ns]
        if len(taken) < _FEWEST:
            raise InputError(
                f"no zero: {len(taken)} valid estimates in the last {self._settings.zero_s:g} s; expected {_FEWEST}"
            )
        values = np.mean([_vector(estimate) for estimate in taken], axis=0)
        magnitude_n = float(np.linalg.norm(values))
        most_n = self._settings.zero_max_n
        if magnitude_n > most_n:
            raise InputError(
                f"no zero: {newtons_to_grams(magnitude_n):.0f} g are read, and an error of the zero is at most "
                f"{newtons_to_grams(most_n):.0f} g; take the tip off the tissue first"
            )
        known = taken[-1].known
        offset = np.full(3, math.nan)
        offset[known] = values[: int(known.sum())] if known.any() else math.nan
        contact = float(np.mean([estimate.contact for estimate in taken]))
        self._zero, self._drift = Zero(offset, magnitude_n, now_ns, contact), None
        return self._zero

    def apply(self, estimate: ForceEstimate, now_ns: int) -> ForceEstimate:
        """Remembers an estimate as the method gave it; returns it with the zero subtracted."""
        if not estimate.valid:
            return estimate
        self._recent.append((now_ns, estimate))
        if self._zero is None:
            return estimate
        left = _vector(estimate) - self._subtracted(estimate)
        self._follow_drift(estimate, left, now_ns)
        offset = np.where(estimate.known, self._zero.offset_n, 0.0)
        magnitude = float(np.linalg.norm(left)) if estimate.known.any() else max(0.0, float(left[0]))
        ends = np.maximum(0.0, estimate.magnitude_interval_n + (magnitude - estimate.magnitude_n))
        return replace(
            estimate,
            force_n=estimate.force_n - offset,
            interval_n=estimate.interval_n - offset[:, None],
            magnitude_n=magnitude,
            magnitude_interval_n=ends,
        )

    def _subtracted(self, estimate: ForceEstimate) -> FloatArray:
        assert self._zero is not None
        known = estimate.known
        return self._zero.offset_n[known] if known.any() else np.array([self._zero.magnitude_n])

    def _follow_drift(self, estimate: ForceEstimate, left: FloatArray, now_ns: int) -> None:
        zero = self._zero
        assert zero is not None
        if not estimate.contact < _NO_CONTACT:
            return
        if self._drift is None or zero.drift_ns is None:
            self._drift = left
        else:
            weight = min(1.0, (now_ns - zero.drift_ns) * 1e-9 / _DRIFT_S)
            self._drift = self._drift + weight * (left - self._drift)
        self._zero = replace(zero, drift_n=float(np.linalg.norm(self._drift)), drift_ns=now_ns)


def _vector(estimate: ForceEstimate) -> FloatArray:
    """(k,) known components, or (1,) the magnitude where the method yields no components."""
    return estimate.force_n[estimate.known] if estimate.known.any() else np.array([estimate.magnitude_n])
