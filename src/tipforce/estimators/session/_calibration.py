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
        """As JSON; inverse: `of`."""
        strata = None if self.strata is None else self.strata.values()
        return {"fx": self.fx, "fy": self.fy, "magnitude": self.magnitude, "basis": self.basis, "strata": strata}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Raises KeyError or ValueError where they are no such factors."""
        factors = [float(values[name]) for name in ("fx", "fy", "magnitude")]
        if not all(math.isfinite(each) and each > 0 for each in factors):
            raise ValueError(f"factors of intervals must be positive, got {factors}")
        strata = None if values.get("strata") is None else ForceStrata.of(values["strata"])
        return cls(factors[0], factors[1], factors[2], str(values["basis"]), strata)

    def estimate(self, stamp_ns: int, mixed: Mixed, shape: DetectedShape | None) -> ForceEstimate:
        """The valid estimate of ``mixed``; invalid where it is implausible.

        The 90 % intervals are the quantiles of the mixture, their distances from the force times the factors; the
        covariance is multiplied with the same factors.
        """
        force = mixed.force_n
        size = float(math.hypot(force[0], force[1]))
        if not size <= MAX_FORCE_N:
            return implausible(stamp_ns, size, shape)
        factors = np.array([self.fx, self.fy])
        force_n, whole, interval = np.full(3, np.nan), np.full((3, 3), np.nan), np.full((3, 2), np.nan)
        force_n[:2] = force
        whole[:2, :2] = (mixed.covariance_n2 + LEAST_STD_N**2 * np.eye(2)) * np.outer(factors, factors)
        least = GAUSS_90 * LEAST_STD_N
        interval[:2, 0] = force - factors * np.maximum(force - mixed.low_n[:2], least)
        interval[:2, 1] = force + factors * np.maximum(mixed.high_n[:2] - force, least)
        below, above = max(size - float(mixed.low_n[2]), least), max(float(mixed.high_n[2]) - size, least)
        ends = max(0.0, size - self.magnitude * below), size + self.magnitude * above
        if self.strata is not None:
            ends = self.strata.interval(size, _unit_n(below + above))
        return ForceEstimate(
            stamp_ns=stamp_ns,
            force_n=force_n,
            known=_KNOWN,
            covariance_n2=whole,
            interval_n=interval,
            magnitude_n=size,
            magnitude_interval_n=np.array(ends),
            status=Status.VALID,
            contact=mixed.contact,
            shape=shape,
        )


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
    every = method.with_settings(method.settings.model_copy(update={"max_error_n": None}))
    every.fitted_ = replace(method.fitted_, widths=type(method.fitted_.widths)())
    return every.predict(dataset, progress)


def calibrated_widths(found: Sequence[ForceEstimate], dataset: Dataset) -> Widths:
    """The factors that hold 90 % of the errors of ``found``, the estimates of all samples of ``dataset``.

    Raises InputError where no sample has an estimate.
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
        force = np.array([each.magnitude_n for each in estimates])
        interval = np.array([each.magnitude_interval_n for each in estimates])
        size = np.linalg.norm(np.where(known, truth, 0.0), axis=1)
        factors[2] = conformal_half_width(errors_over_reach(force, interval, size), session, basis)
        strata = fit_strata(force, size, session, _unit_n(interval[:, 1] - interval[:, 0]))
    finite = [each if math.isfinite(each) else 1.0 for each in factors]
    return Widths(finite[0], finite[1], finite[2], basis.text, strata)
