"""Builds valid estimates fast: the checks of `ForceEstimate` are left out where their outcome is known."""

import math
from dataclasses import MISSING, fields

import numpy as np

from ..types import BoolArray, DetectedShape, FloatArray, ForceEstimate, Status
from .uncertainty import Interval

AXES = ("fx", "fy", "fz")
"""Names of the force components."""

MAX_FORCE_N = 10.0
"""Larger estimates are not valid: tissue tears, and shafts buckle, at a fraction of this force."""

_set = object.__setattr__
_DEFAULTS = tuple((field.name, field.default) for field in fields(ForceEstimate) if field.default is not MISSING)


def implausible(stamp_ns: int, magnitude_n: float, shape: DetectedShape | None = None) -> ForceEstimate:
    """Returns an invalid estimate in place of a force that is not finite, or larger than `MAX_FORCE_N`.

    Args:
        stamp_ns: stamp of the frame.
        magnitude_n: the magnitude.
        shape: the detected shape.
    """
    found = f"{magnitude_n:.3g} N, more than {MAX_FORCE_N:g} N" if math.isfinite(magnitude_n) else "no finite number"
    detail = f"the model answers with {found}: the image or the actuation is unlike the training data, or the model is"
    return ForceEstimate.invalid(stamp_ns, Status.OUT_OF_DISTRIBUTION, f"{detail} damaged", shape)


def within_error(estimate: ForceEstimate, max_error_n: float | None) -> ForceEstimate:
    """Returns ``estimate``, or an abstention where the 90 % interval of its magnitude is too wide.

    Args:
        estimate: the estimate.
        max_error_n: largest distance in N of the interval's ends from the estimate; None: no limit.
    """
    if max_error_n is None or not estimate.valid:
        return estimate
    low, high = (float(end) for end in estimate.magnitude_interval_n)
    reach = max(estimate.magnitude_n - low, high - estimate.magnitude_n)
    if reach <= max_error_n:
        return estimate
    return ForceEstimate.invalid(
        estimate.stamp_ns,
        Status.UNOBSERVABLE,
        f"the 90 % interval of the force is {low:.2f} to {high:.2f} N; its ends may be at most max_error_n = "
        f"{max_error_n:g} N from the estimate",
        estimate.shape,
        (low, high),
    )


class EstimateBuilder:
    """Builds estimates from forces. The parts that all estimates share are made once and are read-only.

    Args:
        known: (3,) the estimated components.
        interval: intervals of the method.
    """

    def __init__(self, known: BoolArray, interval: Interval) -> None:
        self._axes = np.flatnonzero(known).tolist()
        self._half = [float(interval.half_n[axis]) for axis in self._axes]
        self._interval = interval
        self._known, self._covariance = known.copy(), interval.covariance_n2.copy()
        self._unknown, self._no_interval = np.full(3, math.nan), np.full((3, 2), math.nan)
        for array in (self._known, self._covariance, self._unknown, self._no_interval):
            array.setflags(write=False)

    def valid(self, stamp_ns: int, newtons: FloatArray, shape: DetectedShape | None = None) -> ForceEstimate:
        """Returns the estimate of a force; it is not valid if the force is not finite, or larger than `MAX_FORCE_N`.

        Args:
            stamp_ns: stamp of the frame.
            newtons: (t,) the known components in order, or the magnitude alone where none is known.
            shape: the detected shape.
        """
        if self._axes:
            force, interval, square = self._unknown.copy(), self._no_interval.copy(), 0.0
            for place, (axis, half) in enumerate(zip(self._axes, self._half, strict=True)):
                value = float(newtons[place])
                force[axis] = value
                interval[axis, 0] = value - half
                interval[axis, 1] = value + half
                square += value * value
            magnitude_n = math.sqrt(square)
            force.setflags(write=False)
            interval.setflags(write=False)
        else:  # a magnitude cannot be negative, but the regression's may be; NaN stays NaN
            estimate_n = float(newtons[0])
            magnitude_n = estimate_n if math.isnan(estimate_n) else max(0.0, estimate_n)
            force, interval = self._unknown, self._no_interval
        if not magnitude_n <= MAX_FORCE_N:  # also true for NaN
            return implausible(stamp_ns, magnitude_n, shape)
        magnitude_interval = np.array(self._interval.magnitude_interval(magnitude_n))
        magnitude_interval.setflags(write=False)
        # ForceEstimate's own __init__ copies and checks five arrays: 8 us of the 100 us that a frame may take
        estimate = ForceEstimate.__new__(ForceEstimate)
        for name, value in _DEFAULTS:
            _set(estimate, name, value)
        _set(estimate, "stamp_ns", stamp_ns)
        _set(estimate, "force_n", force)
        _set(estimate, "known", self._known)
        _set(estimate, "covariance_n2", self._covariance)
        _set(estimate, "interval_n", interval)
        _set(estimate, "magnitude_n", magnitude_n)
        _set(estimate, "magnitude_interval_n", magnitude_interval)
        _set(estimate, "shape", shape)
        return estimate
