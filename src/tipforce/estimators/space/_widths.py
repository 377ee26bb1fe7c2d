"""90 % intervals of the force in space: those of the posterior, times factors from separate sessions."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ...datasets import Dataset
from ...errors import InputError
from ...types import DetectedShape, ForceEstimate, Status
from .._builder import AXES, MAX_FORCE_N, implausible
from ..session import LEAST_STD_N, errors_over_reach
from ..uncertainty import GAUSS_90, conformal_half_width, interval_basis
from ._mixture import SpaceForce

_NAMES = (*AXES, "magnitude")
_KNOWN = np.ones(3, np.bool_)
_KNOWN.setflags(write=False)


@dataclass(frozen=True, slots=True)
class SpaceWidths:
    """Factors on the distance of the intervals' ends from the force.

    Attributes:
        factors: of fx, fy, fz and the magnitude.
        basis: the samples that they rest on, in words.
    """

    factors: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    basis: str = "the posterior of the rod in space alone"

    def values(self) -> dict[str, Any]:
        """Returns JSON values; inverse: `of`."""
        return {**dict(zip(_NAMES, self.factors, strict=True)), "basis": self.basis}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Returns the widths of `values`; raises KeyError or ValueError where they are none."""
        factors = tuple(float(values[name]) for name in _NAMES)
        if not all(math.isfinite(each) and each > 0 for each in factors):
            raise ValueError(f"factors of intervals must be positive, got {factors}")
        return cls(factors, str(values["basis"]))

    def estimate(
        self, stamp_ns: int, force: SpaceForce, shape: DetectedShape | None, detail: str = ""
    ) -> ForceEstimate:
        """Returns the estimate of a force; an invalid one where the force is implausibly large.

        The ends of the posterior's 90 % intervals move away from the force by the factors; the covariance grows with
        them.

        Args:
            stamp_ns: stamp of the instant.
            force: its posterior.
            shape: the detected catheter in the first view.
            detail: a remark on the estimate.
        """
        size = float(np.linalg.norm(force.force_n))
        if not size <= MAX_FORCE_N:
            return implausible(stamp_ns, size, shape)
        value = np.append(force.force_n, size)
        least, factor = GAUSS_90 * LEAST_STD_N, np.array(self.factors)
        low = value - factor * np.maximum(value - force.low_n, least)
        high = value + factor * np.maximum(force.high_n - value, least)
        covariance = force.covariance_n2 + LEAST_STD_N**2 * np.eye(3)
        covariance *= np.outer(factor[:3], factor[:3])
        return ForceEstimate(
            stamp_ns, force.force_n, _KNOWN, covariance, np.column_stack([low[:3], high[:3]]), size,
            np.array([max(0.0, low[3]), high[3]]), Status.VALID, detail, contact=force.contact, shape=shape,
        )  # fmt: skip


def calibrated_widths(found: Sequence[ForceEstimate], dataset: Dataset) -> SpaceWidths:
    """Returns the factors with which the intervals contain 90 % of the true forces (conformal prediction).

    Args:
        found: estimates of all samples, with the intervals of the posterior.
        dataset: the samples, of sessions that trained nothing.

    Raises:
        InputError: no sample has an estimate.
    """
    valid = np.array([each.valid for each in found], np.bool_)
    if not valid.any():
        raise InputError(f"{dataset.title}: no sample has an estimate, so there are no intervals to calibrate")
    estimates = [each for each in found if each.valid]
    truth, session = dataset.force_n[valid], dataset.session[valid]
    basis = interval_basis(len(set(session.tolist())), held_out=True)
    # four columns: fx, fy, fz and the magnitude
    true = np.column_stack([truth, np.linalg.norm(np.where(dataset.known, truth, 0.0), axis=1)])
    value = np.array([[*each.force_n, each.magnitude_n] for each in estimates])
    interval = np.array([[*each.interval_n, each.magnitude_interval_n] for each in estimates])
    factors = [1.0, 1.0, 1.0, 1.0]
    for k in range(4):
        if k == 3 or dataset.known[k]:
            width = conformal_half_width(errors_over_reach(value[:, k], interval[:, k], true[:, k]), session, basis)
            factors[k] = width if math.isfinite(width) else 1.0  # infinite: too few samples for 90 %
    return SpaceWidths(tuple(factors), basis.text)
