"""Intervals of the rod estimators: those of the posterior, times what held on sessions apart."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ...datasets import Dataset
from ...errors import InputError
from ...types import BoolArray, DetectedShape, FloatArray, ForceEstimate, Status
from .._builder import MAX_FORCE_N, implausible
from ..uncertainty import ForceStrata, conformal_half_width, fit_strata, interval_basis

__all__ = ["Widths", "calibrated_widths"]

_GAUSS_90 = 1.6448536269514722
_KNOWN = np.array([True, True, False])
_KNOWN.setflags(write=False)
_LEAST_STD_N = 1e-3
"""Standard deviations below this are taken for it: no model of a rod is better."""


@dataclass(frozen=True, slots=True)
class Widths:
    """Factors on the half-widths of a Gaussian's 90 % intervals, of fx, fy and the magnitude; what they rest on.

    ``strata``: ends of the magnitude's interval by stratum of the force in standard deviations; None: ``magnitude``
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

    def estimate(
        self, stamp_ns: int, force: FloatArray, covariance: FloatArray, contact: float, shape: DetectedShape | None
    ) -> ForceEstimate:
        """The valid estimate of ``force`` (2,) with ``covariance`` (2, 2); invalid where it is implausible."""
        size = float(math.hypot(force[0], force[1]))
        if not size <= MAX_FORCE_N:
            return implausible(stamp_ns, size, shape)
        std = _stds(force, covariance)
        half = _GAUSS_90 * std * (self.fx, self.fy, self.magnitude)
        force_n, whole, interval = np.full(3, np.nan), np.full((3, 3), np.nan), np.full((3, 2), np.nan)
        force_n[:2], whole[:2, :2] = force, covariance
        interval[:2, 0], interval[:2, 1] = force - half[:2], force + half[:2]
        return ForceEstimate(
            stamp_ns=stamp_ns,
            force_n=force_n,
            known=_KNOWN,
            covariance_n2=whole,
            interval_n=interval,
            magnitude_n=size,
            magnitude_interval_n=np.array(
                (max(0.0, size - half[2]), size + half[2])
                if self.strata is None
                else self.strata.interval(size, float(std[2]))
            ),
            status=Status.VALID,
            contact=contact,
            shape=shape,
        )


def _stds(force: FloatArray, covariance: FloatArray) -> FloatArray:
    """(3,): of fx, fy and the magnitude, to first order; where there is no force, of the larger axis."""
    size = math.hypot(force[0], force[1])
    xx, xy, yy = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    half, apart = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    along = half + apart
    if size * size > along:
        along = (force[0] ** 2 * xx + 2.0 * force[0] * force[1] * xy + force[1] ** 2 * yy) / size**2
    return np.sqrt(np.maximum(np.array([xx, yy, along]), _LEAST_STD_N**2))


def calibrated_widths(found: Sequence[ForceEstimate], dataset: Dataset) -> Widths:
    """The factors that hold 90 % of the errors of ``found``, the estimates of all samples of ``dataset``.

    Raises InputError where no sample has an estimate.
    """
    valid: BoolArray = np.array([each.valid for each in found], np.bool_)
    if not valid.any():
        raise InputError(f"{dataset.title}: no sample has an estimate, so there are no intervals to calibrate")
    estimates = [each for each in found if each.valid]
    force = np.array([each.force_n[:2] for each in estimates])
    std = np.array([_stds(each.force_n[:2], each.covariance_n2[:2, :2]) for each in estimates])
    truth, session = dataset.force_n[valid], dataset.session[valid]
    known = dataset.known
    basis = interval_basis(len(set(session.tolist())), held_out=True)
    factors, strata = [1.0, 1.0, 1.0], None
    for axis in range(2):
        if known[axis]:
            share = (force[:, axis] - truth[:, axis]) / (_GAUSS_90 * std[:, axis])
            factors[axis] = conformal_half_width(share, session, basis)
    if known[:2].any():
        size = np.linalg.norm(np.where(known, truth, 0.0), axis=1)
        estimate = np.linalg.norm(force, axis=1)
        factors[2] = conformal_half_width((estimate - size) / (_GAUSS_90 * std[:, 2]), session, basis)
        strata = fit_strata(estimate, size, session, std[:, 2])
    finite = [each if math.isfinite(each) else 1.0 for each in factors]
    return Widths(finite[0], finite[1], finite[2], basis.text, strata)
