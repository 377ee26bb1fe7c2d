"""Answers at the rate of frames: a `ForceEstimate` without paying for checks whose outcome is known."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..types import BoolArray, FloatArray, ForceEstimate, Status

__all__ = ["AXES", "Answers", "Interval"]

AXES = ("fx", "fy", "fz")
"""What the components of a force are called."""

_set = object.__setattr__


@dataclass(frozen=True)
class Interval:
    """Half-widths of the 90 % intervals and what they rest on.

    ``half_n`` (3,): of the components, NaN where unknown; ``magnitude_half_n``; ``covariance_n2`` (3, 3).
    """

    half_n: FloatArray
    magnitude_half_n: float
    covariance_n2: FloatArray
    by_session: bool
    basis: str
    sessions: int
    samples: int

    def values(self) -> dict[str, Any]:
        """As JSON values (None for NaN and infinity; an infinite half-width is "inf")."""
        return {
            "coverage": 0.9,
            "half_width_n": [_plain(value) for value in self.half_n.tolist()],
            "magnitude_half_width_n": _plain(self.magnitude_half_n),
            "covariance_n2": [[_plain(value) for value in row] for row in self.covariance_n2.tolist()],
            "by_session": self.by_session,
            "basis": self.basis,
            "sessions": self.sessions,
            "samples": self.samples,
        }

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Interval":
        """The inverse of `values`."""
        return cls(
            half_n=np.array([_number(value) for value in values["half_width_n"]]),
            magnitude_half_n=_number(values["magnitude_half_width_n"]),
            covariance_n2=np.array([[_number(value) for value in row] for row in values["covariance_n2"]]),
            by_session=values["by_session"],
            basis=values["basis"],
            sessions=values["sessions"],
            samples=values["samples"],
        )


def _plain(value: float) -> float | str | None:
    return None if math.isnan(value) else ("inf" if math.isinf(value) else value)


def _number(value: float | str | None) -> float:
    return math.nan if value is None else float(value)


class Answers:
    """Makes estimates from forces; all that is the same in each is made once and shared, read-only."""

    def __init__(self, known: BoolArray, interval: Interval) -> None:
        self._axes = np.flatnonzero(known).tolist()
        self._half = [float(interval.half_n[axis]) for axis in self._axes]
        self._magnitude_half = interval.magnitude_half_n
        self._known, self._covariance = known.copy(), interval.covariance_n2.copy()
        self._unknown, self._no_interval = np.full(3, math.nan), np.full((3, 2), math.nan)
        for array in (self._known, self._covariance, self._unknown, self._no_interval):
            array.setflags(write=False)

    def valid(self, stamp_ns: int, newtons: FloatArray) -> ForceEstimate:
        """``newtons`` (t,): the known components in order, or the magnitude alone where none is known."""
        if self._axes:
            force, interval, square = self._unknown.copy(), self._no_interval.copy(), 0.0
            for place, (axis, half) in enumerate(zip(self._axes, self._half, strict=True)):
                value = float(newtons[place])
                force[axis] = value
                interval[axis, 0] = value - half
                interval[axis, 1] = value + half
                square += value * value
            magnitude = math.sqrt(square)
            force.setflags(write=False)
            interval.setflags(write=False)
        else:
            # a magnitude cannot be negative; the regression does not know that
            magnitude, force, interval = max(0.0, float(newtons[0])), self._unknown, self._no_interval
        both = np.array((max(0.0, magnitude - self._magnitude_half), magnitude + self._magnitude_half))
        both.setflags(write=False)
        # ForceEstimate's own __init__ copies and checks five arrays: 8 us of the 100 us that a frame may take
        estimate = ForceEstimate.__new__(ForceEstimate)
        _set(estimate, "stamp_ns", stamp_ns)
        _set(estimate, "force_n", force)
        _set(estimate, "known", self._known)
        _set(estimate, "covariance_n2", self._covariance)
        _set(estimate, "interval_n", interval)
        _set(estimate, "magnitude_n", magnitude)
        _set(estimate, "magnitude_interval_n", both)
        _set(estimate, "status", Status.VALID)
        _set(estimate, "detail", "")
        _set(estimate, "contact", math.nan)
        return estimate
