"""Conformal prediction intervals, from the errors of a method on sessions that it was not trained on.

The residuals of every session come from a model trained without that session (cross-conformal prediction, Vovk 2015).
Sessions are exchangeable, the frames of one session are not: each of J sessions has the mass 1 / (J + 1), spread over
its frames, and the new session has the remaining mass at infinity (conformal prediction for exchangeable groups, Lee,
Barber and Willett 2023). A 90 % quantile is finite from 9 sessions on. With fewer sessions the frames are pooled, which
guarantees nothing for a new session, and the basis says so.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import BoolArray, FloatArray

__all__ = [
    "COVERAGE",
    "Interval",
    "IntervalBasis",
    "conformal_half_width",
    "conformal_interval",
    "interval_basis",
    "interval_from_errors",
    "sessions_for_guarantee",
    "wider_interval",
]

COVERAGE = 0.9


@dataclass(frozen=True)
class Interval:
    """Half-widths of the 90 % intervals and what they rest on.

    Attributes:
        half_n: (3,) half-widths of the components, NaN where unknown.
        magnitude_half_n: half-width of the magnitude.
        covariance_n2: (3, 3) covariance of the errors, NaN where unknown.
        by_session: True where the interval holds for a new session.
        basis: what the interval rests on, in words.
        sessions: number of sessions of the residuals.
        samples: number of residuals.
    """

    half_n: FloatArray
    magnitude_half_n: float
    covariance_n2: FloatArray
    by_session: bool
    basis: str
    sessions: int
    samples: int

    def values(self) -> dict[str, Any]:
        """Returns JSON values: None for NaN, "inf" for an infinite half-width."""
        return {
            "coverage": COVERAGE,
            "half_width_n": [_to_json(value) for value in self.half_n.tolist()],
            "magnitude_half_width_n": _to_json(self.magnitude_half_n),
            "covariance_n2": [[_to_json(value) for value in row] for row in self.covariance_n2.tolist()],
            "by_session": self.by_session,
            "basis": self.basis,
            "sessions": self.sessions,
            "samples": self.samples,
        }

    @classmethod
    def of(cls, values: Mapping[str, Any], known: BoolArray) -> "Interval":
        """The inverse of `values`, for a method that estimates the ``known`` (3,) components.

        Raises KeyError, TypeError or ValueError where they are no such intervals.
        """
        half = np.array([_from_json(value) for value in values["half_width_n"]], np.float64)
        covariance = np.array([[_from_json(value) for value in row] for row in values["covariance_n2"]], np.float64)
        magnitude = _from_json(values["magnitude_half_width_n"])
        if values["coverage"] != COVERAGE:
            raise ValueError(f"the intervals hold {values['coverage']} of the errors, expected {COVERAGE}")
        if half.shape != (3,) or not (np.append(half[known], magnitude) >= 0).all():
            raise ValueError(f"half-widths of intervals must not be negative, got {[*half.tolist(), magnitude]}")
        used = covariance[np.ix_(known, known)] if covariance.shape == (3, 3) else np.array([[-1.0]])
        if not (np.isfinite(used).all() and (np.diag(used) >= 0).all()):
            raise ValueError(f"the errors have no covariance, got {covariance.tolist()}")
        return cls(
            half_n=half,
            magnitude_half_n=magnitude,
            covariance_n2=covariance,
            by_session=bool(values["by_session"]),
            basis=str(values["basis"]),
            sessions=int(values["sessions"]),
            samples=int(values["samples"]),
        )


def _to_json(value: float) -> float | str | None:
    return None if math.isnan(value) else ("inf" if math.isinf(value) else value)


def _from_json(value: float | str | None) -> float:
    return math.nan if value is None else float(value)


@dataclass(frozen=True, slots=True)
class IntervalBasis:
    """What an interval rests on: ``by_session`` True where it holds for a new session; ``text`` in words."""

    by_session: bool
    text: str


def sessions_for_guarantee(coverage: float = COVERAGE) -> int:
    """Returns the number of sessions from which on the quantile is finite.

    >>> sessions_for_guarantee()
    9
    """
    return math.ceil(coverage / (1 - coverage) - 1e-9)


def interval_basis(sessions: int, held_out: bool, sampling: str = "random folds") -> IntervalBasis:
    """Returns what an interval rests on.

    Args:
        sessions: number of sessions of the residuals.
        held_out: True where whole sessions were held out.
        sampling: how the samples were drawn, where they were not whole sessions.

    >>> interval_basis(4, True).text
    'frames of held-out sessions (4 sessions: too few for a guarantee on a new one)'
    """
    if not held_out:
        return IntervalBasis(False, f"{sampling} of {'one session' if sessions == 1 else f'{sessions} sessions'}")
    if sessions >= sessions_for_guarantee():
        return IntervalBasis(True, "whole sessions")
    return IntervalBasis(
        False, f"frames of held-out sessions ({sessions} sessions: too few for a guarantee on a new one)"
    )


def conformal_half_width(
    residuals: FloatArray, session: npt.NDArray[np.str_], basis: IntervalBasis, coverage: float = COVERAGE
) -> float:
    """Returns half the width of the interval that holds ``coverage``.

    Args:
        residuals: (n,) signed errors.
        session: (n,) their sessions.
        basis: whether sessions or frames are exchangeable.
        coverage: share of new samples in the interval.

    >>> frames = np.repeat([f"s{k}" for k in range(9)], 2)
    >>> float(conformal_half_width(np.arange(18.0), frames, interval_basis(9, True)))
    17.0
    """
    size, order = np.abs(residuals), np.argsort(np.abs(residuals))
    if basis.by_session:
        _, index, counts = np.unique(session, return_inverse=True, return_counts=True)
        mass = 1.0 / ((len(counts) + 1) * counts[index])
    else:
        mass = np.full(len(size), 1.0 / (len(size) + 1))
    reached = np.flatnonzero(np.cumsum(mass[order]) >= coverage - 1e-9)
    return float(size[order[reached[0]]]) if len(reached) else math.inf


def conformal_interval(
    known: BoolArray,
    predicted: FloatArray,
    error: FloatArray,
    truth: FloatArray,
    session: npt.NDArray[np.str_],
    held_out: bool,
    sampling: str = "random folds",
) -> Interval:
    """Returns the intervals of a method from samples that it was not trained on.

    Args:
        known: (3,) which components it estimates; none: the magnitude alone.
        predicted: (n, t) estimated forces in newtons.
        error: (n, t) their errors.
        truth: (n, t) measured forces.
        session: (n,) sessions.
        held_out: True where whole sessions were held out.
        sampling: how the samples were drawn else.
    """
    if known.any():
        magnitude_error = np.linalg.norm(predicted, axis=1) - np.linalg.norm(truth, axis=1)
    else:
        magnitude_error = np.maximum(predicted[:, 0], 0.0) - truth[:, 0]
    return interval_from_errors(known, error, magnitude_error, session, held_out, sampling)


def interval_from_errors(
    known: BoolArray,
    error: FloatArray,
    magnitude_error: FloatArray,
    session: npt.NDArray[np.str_],
    held_out: bool,
    sampling: str,
) -> Interval:
    """As `conformal_interval`, from errors of the components (n, t) and of the magnitude (n,), in any unit."""
    sessions = len(set(session.tolist()))
    basis = interval_basis(sessions, held_out, sampling)
    half, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    if known.any():
        axes = np.flatnonzero(known)
        half[axes] = [conformal_half_width(error[:, t], session, basis) for t in range(len(axes))]
        covariance[np.ix_(axes, axes)] = error.T @ error / len(error)
    return Interval(
        half_n=half,
        magnitude_half_n=conformal_half_width(magnitude_error, session, basis),
        covariance_n2=covariance,
        by_session=basis.by_session,
        basis=basis.text,
        sessions=sessions,
        samples=len(error),
    )


def wider_interval(own: Interval, initial: Interval) -> Interval:
    """Returns the larger half-widths of a fine-tuned model's interval and of the initial model's.

    Only components that ``own`` has are kept. The basis names the initial model where any of its half-widths is used.
    """
    half = np.where(np.isnan(own.half_n), np.nan, np.fmax(own.half_n, initial.half_n))
    magnitude = max(own.magnitude_half_n, initial.magnitude_half_n)
    if magnitude == own.magnitude_half_n and np.array_equal(half, own.half_n, equal_nan=True):
        return own
    basis = f"{own.basis}; or, where wider, that of the model it was fine-tuned from ({initial.basis})"
    return replace(own, half_n=half, magnitude_half_n=magnitude, basis=basis)
