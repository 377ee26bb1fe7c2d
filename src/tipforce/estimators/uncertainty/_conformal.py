"""Conformal prediction intervals, from the errors of a method on sessions that it was not trained on.

The residuals of every session come from a model trained without that session (cross-conformal prediction, Vovk 2015).
Sessions are exchangeable, the frames of one session are not: each of J sessions has the mass 1 / (J + 1), spread over
its frames, and the new session has the remaining mass at infinity (conformal prediction for exchangeable groups, Lee,
Barber and Willett 2023). A 90 % quantile is finite from 9 sessions on. With fewer sessions the frames are pooled, which
guarantees nothing for a new session, and the basis says so; Student's factor then widens the components' intervals, as
it does the magnitude's (see `_strata`).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import PlainSerializer, PlainValidator, ValidationInfo

from ...types import BoolArray, FloatArray
from ._strata import MIN_CONFORMAL_SESSIONS, ForceStrata, fit_strata, student_factor

COVERAGE = 0.9

MAX_GENERATIONS = 64
"""A fine-tuned model keeps the strata of its initial model, at most over this number of generations."""


@dataclass(frozen=True)
class Interval:
    """Half-widths of the 90 % intervals and their basis.

    Attributes:
        half_n: (3,) half-widths of the components, NaN where unknown.
        magnitude_half_n: half-width of the magnitude that holds 90 % of all frames together.
        covariance_n2: (3, 3) covariance of the errors, NaN where unknown.
        by_session: True where the interval holds for a new session.
        basis: samples and sessions behind the interval, in words.
        sessions: number of sessions of the residuals.
        samples: number of residuals.
        strata: ends of the magnitude's interval by stratum of the force, the widest of which count; empty in models
            that were saved before there were any: then ``magnitude_half_n`` is its half-width at every force.
    """

    half_n: FloatArray
    magnitude_half_n: float
    covariance_n2: FloatArray
    by_session: bool
    basis: str
    sessions: int
    samples: int
    strata: tuple[ForceStrata, ...] = ()

    def magnitude_interval(self, magnitude_n: float, unit_n: float = 1.0) -> tuple[float, float]:
        """Returns the ends of the magnitude's interval in newtons.

        Args:
            magnitude_n: estimated magnitude.
            unit_n: newtons of the unit of the half-widths.
        """
        if not self.strata:
            half = self.magnitude_half_n * unit_n
            return max(0.0, magnitude_n - half), magnitude_n + half
        ends = [each.interval(magnitude_n, unit_n) for each in self.strata]
        return min(low for low, _ in ends), max(high for _, high in ends)

    def magnitude_examples(self, unit_n: float = 1.0) -> dict[str, list[float]]:
        """Returns the magnitude's interval at an estimate within each of its strata, by the estimate in newtons."""
        edges = self.strata[0].edges_n[:-1].tolist() if self.strata else []
        width = edges[1] if len(edges) > 1 else 0.0
        return {f"{edge + width / 2:.3g}": list(self.magnitude_interval(edge + width / 2, unit_n)) for edge in edges}

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
            "strata": [each.values() for each in self.strata],
        }

    @classmethod
    def of(cls, values: Mapping[str, Any], known: BoolArray) -> "Interval":
        """Makes the intervals from the return value of `values`.

        Args:
            values: the JSON values.
            known: (3,) which components the method estimates.

        Raises:
            KeyError, TypeError, ValueError: the values are no such intervals.
        """
        half = np.array([_from_json(value) for value in values["half_width_n"]], np.float64)
        covariance = np.array([[_from_json(value) for value in row] for row in values["covariance_n2"]], np.float64)
        magnitude = _from_json(values["magnitude_half_width_n"])
        strata = tuple(ForceStrata.of(each) for each in values.get("strata", ()))
        if len(strata) > MAX_GENERATIONS:
            raise ValueError(f"at most {MAX_GENERATIONS} sets of strata are expected, got {len(strata)}")
        if values["coverage"] != COVERAGE:
            raise ValueError(f"the intervals hold {values['coverage']} of the errors, expected {COVERAGE}")
        if half.shape != (3,) or not (np.append(half[known], magnitude) >= 0).all():
            raise ValueError(f"half-widths of intervals must not be negative, got {[*half.tolist(), magnitude]}")
        # another shape has no variances: -1 is refused below
        used = covariance[np.ix_(known, known)] if covariance.shape == (3, 3) else np.array([[-1.0]])
        measured = int(values["samples"]) > 0
        if measured and not (np.isfinite(used).all() and (np.diag(used) >= 0).all()):
            raise ValueError(f"the errors have no covariance, got {covariance.tolist()}")
        return cls(
            half_n=half,
            magnitude_half_n=magnitude,
            covariance_n2=covariance,
            by_session=bool(values["by_session"]),
            basis=str(values["basis"]),
            sessions=int(values["sessions"]),
            samples=int(values["samples"]),
            strata=strata,
        )


def _as_interval(value: Any, info: ValidationInfo) -> Interval:
    return value if isinstance(value, Interval) else Interval.of(value, info.data["known"])


StoredInterval = Annotated[Interval, PlainValidator(_as_interval), PlainSerializer(Interval.values)]
"""The intervals in a stored record; its field ``known`` must come before them."""


def _to_json(value: float) -> float | str | None:
    return None if math.isnan(value) else ("inf" if math.isinf(value) else value)


def _from_json(value: float | str | None) -> float:
    return math.nan if value is None else float(value)


@dataclass(frozen=True, slots=True)
class IntervalBasis:
    """Basis of an interval.

    Attributes:
        by_session: True where it holds for a new session.
        text: the basis in words.
    """

    by_session: bool
    text: str


def sessions_for_guarantee(coverage: float = COVERAGE) -> int:
    """Returns the number of sessions from which on the quantile is finite.

    >>> sessions_for_guarantee()
    9
    """
    return math.ceil(coverage / (1 - coverage) - 1e-9)


def interval_basis(sessions: int, held_out: bool, sampling: str = "random folds") -> IntervalBasis:
    """Returns the basis of an interval.

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
    """Returns half the width of the interval that holds ``coverage``, in the unit of the residuals.

    It is a quantile of their absolute values; infinite where there are too few sessions or frames for it.

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
    if basis.by_session:  # the mass of a session is spread over its frames; the new session has the rest
        _, index, counts = np.unique(session, return_inverse=True, return_counts=True)
        mass = 1.0 / ((len(counts) + 1) * counts[index])
    else:
        mass = np.full(len(size), 1.0 / (len(size) + 1))
    reached = np.flatnonzero(np.cumsum(mass[order]) >= coverage - 1e-9)  # 1e-9: rounding of the sum
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
        sampling: how the samples were drawn otherwise.
    """
    if known.any():
        estimate, force = np.linalg.norm(predicted, axis=1), np.linalg.norm(truth, axis=1)
    else:
        estimate, force = np.maximum(predicted[:, 0], 0.0), truth[:, 0]
    return interval_from_errors(known, error, estimate, force, np.ones(len(error)), session, held_out, sampling)


def interval_from_errors(
    known: BoolArray,
    error: FloatArray,
    magnitude_n: FloatArray,
    truth_n: FloatArray,
    unit_n: FloatArray,
    session: npt.NDArray[np.str_],
    held_out: bool,
    sampling: str,
) -> Interval:
    """Finds intervals as `conformal_interval`, in a unit of each sample, such as its estimate's standard deviation.

    Args:
        known: (3,) which components are estimated.
        error: (n, t) errors of the components, in the unit of each.
        magnitude_n: (n,) estimated magnitudes in newtons.
        truth_n: (n,) measured magnitudes in newtons.
        unit_n: (n,) unit of the magnitude's errors in newtons.
        session: (n,) sessions.
        held_out: True where whole sessions were held out.
        sampling: how the samples were drawn otherwise.

    Returns:
        The intervals, in that unit.
    """
    sessions = len(set(session.tolist()))
    basis = interval_basis(sessions, held_out, sampling)
    half, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    if known.any():
        axes = np.flatnonzero(known)
        guaranteed = basis.by_session or sessions >= MIN_CONFORMAL_SESSIONS
        factor = 1.0 if guaranteed else student_factor(sessions)  # few sessions: see the module
        half[axes] = [factor * conformal_half_width(error[:, t], session, basis) for t in range(len(axes))]
        covariance[np.ix_(axes, axes)] = error.T @ error / len(error)
    return Interval(
        half_n=half,
        magnitude_half_n=conformal_half_width((magnitude_n - truth_n) / unit_n, session, basis),
        covariance_n2=covariance,
        by_session=basis.by_session,
        basis=basis.text,
        sessions=sessions,
        samples=len(error),
        strata=(fit_strata(magnitude_n, truth_n, session, unit_n),),
    )


def wider_interval(own: Interval, initial: Interval) -> Interval:
    """Returns the larger half-widths of a fine-tuned model's interval and of its initial model's.

    Only components that ``own`` has are kept. The basis names the initial model where any of its half-widths is used.
    Strata of both are kept: the widest count.

    Args:
        own: intervals of the fine-tuned model.
        initial: intervals of the initial model.
    """
    half = np.where(np.isnan(own.half_n), np.nan, np.fmax(own.half_n, initial.half_n))
    magnitude = max(own.magnitude_half_n, initial.magnitude_half_n)
    basis = f"{own.basis}; or, where wider, that of the model it was fine-tuned from ({initial.basis})"
    if magnitude == own.magnitude_half_n and np.array_equal(half, own.half_n, equal_nan=True) and not own.strata:
        return own
    inherited = initial.strata
    if not inherited and math.isfinite(initial.magnitude_half_n):
        inherited = (ForceStrata.symmetric(initial.magnitude_half_n),)
    strata = (*own.strata, *inherited) if own.strata else ()
    return replace(own, half_n=half, magnitude_half_n=magnitude, basis=basis, strata=strata)
