"""Intervals of the rod estimators: those of the posterior, times factors from separate sessions."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import numpy as np

from ...datasets import Dataset
from ...errors import InputError
from ...types import BoolArray, DetectedShape, FloatArray, ForceEstimate, Status
from .._builder import MAX_FORCE_N, implausible
from ..uncertainty import GAUSS_90, ForceStrata, conformal_half_width, fit_strata, interval_basis
from ._mixture import Mixed

_KNOWN = np.array([True, True, False])
_KNOWN.setflags(write=False)
_Width = TypeVar("_Width", float, FloatArray)
LEAST_STD_N = 1e-3
"""Standard deviations below this are taken for it: no model of a rod is better."""


@dataclass(frozen=True, slots=True)
class Widths:
    """Factors on how far the 90 % intervals of fx, fy and the magnitude reach to either side, and their basis.

    ``strata``: ends of the magnitude's interval by stratum of the force, in units of `_unit_n`; None: ``magnitude``
    holds at every force.
    """

    fx: float = 1.0
    fy: float = 1.0
    magnitude: float = 1.0
    basis: str = "the posterior of the rod alone"
    strata: ForceStrata | None = None

    def values(self) -> dict[str, Any]:
        """Returns them as JSON values; the inverse of `of`."""
        strata = None if self.strata is None else self.strata.values()
        return {"fx": self.fx, "fy": self.fy, "magnitude": self.magnitude, "basis": self.basis, "strata": strata}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Makes the factors from the JSON values of a stored model.

        Raises:
            KeyError: a factor is missing.
            ValueError: a factor is not positive and finite.
        """
        factors = [float(values[name]) for name in ("fx", "fy", "magnitude")]
        if not all(math.isfinite(factor) and factor > 0 for factor in factors):
            raise ValueError(f"factors of intervals must be positive, got {factors}")
        strata = None if values.get("strata") is None else ForceStrata.of(values["strata"])
        return cls(factors[0], factors[1], factors[2], str(values["basis"]), strata)

    def estimate(self, stamp_ns: int, mixed: Mixed, shape: DetectedShape | None) -> ForceEstimate:
        """Returns the valid estimate of a planar force; an invalid one where the force is implausibly large.

        The ends of the posterior's 90 % intervals move away from the force by the factors; the covariance grows with
        them. z is not known.

        Args:
            stamp_ns: stamp of the frame.
            mixed: the posterior of the force.
            shape: the detected shape.
        """
        force = mixed.force_n
        size_n = float(math.hypot(force[0], force[1]))
        if not size_n <= MAX_FORCE_N:
            return implausible(stamp_ns, size_n, shape)
        factors = np.array([self.fx, self.fy])
        force_n, covariance_n2, interval_n = np.full(3, np.nan), np.full((3, 3), np.nan), np.full((3, 2), np.nan)
        force_n[:2] = force
        covariance_n2[:2, :2] = (mixed.covariance_n2 + LEAST_STD_N**2 * np.eye(2)) * np.outer(factors, factors)
        least_n = GAUSS_90 * LEAST_STD_N
        interval_n[:2, 0] = force - factors * np.maximum(force - mixed.low_n[:2], least_n)
        interval_n[:2, 1] = force + factors * np.maximum(mixed.high_n[:2] - force, least_n)
        below, above = max(size_n - float(mixed.low_n[2]), least_n), max(float(mixed.high_n[2]) - size_n, least_n)
        ends = max(0.0, size_n - self.magnitude * below), size_n + self.magnitude * above
        if self.strata is not None:
            ends = self.strata.interval(size_n, _unit_n(below + above))
        return ForceEstimate(
            stamp_ns, force_n, _KNOWN, covariance_n2=covariance_n2, interval_n=interval_n, magnitude_n=size_n,
            magnitude_interval_n=np.array(ends), status=Status.VALID, contact=mixed.contact, shape=shape,
        )  # fmt: skip


def _unit_n(width_n: _Width) -> _Width:
    """Standard deviation of a Gaussian whose 90 % interval is so wide."""
    return width_n / (2.0 * GAUSS_90)


def errors_over_reach(value: FloatArray, interval: FloatArray, truth: FloatArray) -> FloatArray:
    """Returns errors (n,) over the distance of the interval's end on the side of the truth.

    Args:
        value: (n,) estimates.
        interval: (n, 2) their 90 % intervals.
        truth: (n,) true values.
    """
    reach = np.where(truth > value, interval[:, 1] - value, value - interval[:, 0])
    return (value - truth) / np.maximum(reach, GAUSS_90 * LEAST_STD_N)


def without_widths(method: Any, dataset: Dataset, progress: Callable[[float], None]) -> list[ForceEstimate]:
    """Returns the estimates of a fitted rod method with its posterior's own intervals and no limit of the error.

    Args:
        method: the method; ``fitted_`` has its ``widths``.
        dataset: the samples.
        progress: called with the finished share.
    """
    unlimited = method.with_settings(method.settings.model_copy(update={"max_error_n": None}))
    unlimited.fitted_ = replace(method.fitted_, widths=type(method.fitted_.widths)())
    return unlimited.predict(dataset, progress)


def calibrated_widths(found: Sequence[ForceEstimate], dataset: Dataset) -> Widths:
    """Returns the factors with which the intervals contain 90 % of the true forces (conformal prediction).

    Args:
        found: the estimates of all samples, with factors 1.
        dataset: the samples, of sessions that trained nothing.

    Raises:
        InputError: no sample has an estimate.
    """
    valid: BoolArray = np.array([each.valid for each in found], np.bool_)
    if not valid.any():
        raise InputError(f"{dataset.title}: no sample has an estimate, so there are no intervals to calibrate")
    estimates = [each for each in found if each.valid]
    truth, session = dataset.force_n[valid], dataset.session[valid]
    known = dataset.known
    basis = interval_basis(len(set(session.tolist())), held_out=True)
    factors, strata = [1.0, 1.0, 1.0], None
    for axis in range(2):
        if known[axis]:
            force = np.array([each.force_n[axis] for each in estimates])
            interval = np.array([each.interval_n[axis] for each in estimates])
            factors[axis] = conformal_half_width(errors_over_reach(force, interval, truth[:, axis]), session, basis)
    if known[:2].any():
        magnitude = np.array([each.magnitude_n for each in estimates])
        interval = np.array([each.magnitude_interval_n for each in estimates])
        true_magnitude = np.linalg.norm(np.where(known, truth, 0.0), axis=1)
        factors[2] = conformal_half_width(errors_over_reach(magnitude, interval, true_magnitude), session, basis)
        strata = fit_strata(magnitude, true_magnitude, session, _unit_n(interval[:, 1] - interval[:, 0]))
    # infinite: too few samples for 90 %; the posterior's own intervals stay
    finite = [factor if math.isfinite(factor) else 1.0 for factor in factors]
    return Widths(finite[0], finite[1], finite[2], basis.text, strata)
