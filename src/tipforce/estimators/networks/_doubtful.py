"""Answers whose intervals follow the network's doubt, and refusals with their reason."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...types import BoolArray, FloatArray, ForceEstimate, Status
from .._answers import Interval
from .._conformal import interval_of
from ._arrays import Outputs
from ._domain import refused_as_strange
from ._doubt import Doubt
from ._lead import Lead, Trail

__all__ = ["Doubtful", "Limits", "limits_from", "magnitude_sigma", "relative_interval", "seen_of", "sigma_of", "wider"]

_FAINT = 0.3
"""Of the least usual sight of a catheter: fainter is none."""
_RARE = 0.002
"""Share of usual pictures that may look as if their catheter were moved."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What is answered: at least ``seen`` of the catheter, standard deviations of the magnitude up to ``sigma_n``.

    ``seen``: expected pixels of its map; 0 where the map was never taught. ``familiar``: the least logit of lying as in
    training; -inf where that was never taught.
    """

    seen: float
    sigma_n: float
    familiar: float

    def widened(self, other: "Limits") -> "Limits":
        """All that one of both answers; what only one of them was taught to refuse is refused."""
        return Limits(
            seen=min(filter(None, (self.seen, other.seen)), default=0.0),
            sigma_n=max(self.sigma_n, other.sigma_n),
            familiar=min(filter(math.isfinite, (self.familiar, other.familiar)), default=-math.inf),
        )


@dataclass(frozen=True, eq=False)
class Doubtful:
    """Makes estimates of what `CompactTask`'s network returned; ``unit_n`` is that network's."""

    known: BoolArray
    unit_n: float
    doubt: Doubt
    limits: Limits
    interval: Interval
    """In standard deviations, not newtons: an answer's own deviation widens it."""
    lead: Lead
    trail: Trail
    """Of one session."""

    def __call__(self, stamp_ns: int, outputs: Outputs) -> ForceEstimate:
        """One estimate, of outputs (1, ...)."""
        seen = seen_of(outputs)[0]
        if seen < self.limits.seen:
            return ForceEstimate.invalid(
                stamp_ns, Status.NO_CATHETER, f"there is hardly a catheter in the window ({seen:.1f} pixels of its map)"
            )
        if outputs["familiar"][0] < self.limits.familiar:
            return ForceEstimate.invalid(
                stamp_ns,
                Status.OUT_OF_DOMAIN,
                "the catheter lies as in no picture that it learnt from: shifted, turned, or of another scale",
            )
        strange = refused_as_strange(stamp_ns, self.doubt.domains, outputs["grid"])
        if strange is not None:
            return strange
        force, sigma = outputs["force_n"][0].astype(np.float64), sigma_of(outputs, self.doubt, self.unit_n)[0]
        doubt = magnitude_sigma(force, sigma)
        if not doubt <= self.limits.sigma_n:
            return ForceEstimate.invalid(
                stamp_ns, Status.UNOBSERVABLE, f"this picture tells the force to {doubt * 1e3:.0f} mN only"
            )
        rate = self.trail.rate(stamp_ns, force)
        if rate is None:
            sigma = sigma * self.lead.alone
        else:
            force = force + rate @ self.lead.seconds
        size, doubt = float(np.linalg.norm(force)), magnitude_sigma(force, sigma)
        full, interval = np.full(3, math.nan), np.full((3, 2), math.nan)
        covariance = np.full((3, 3), math.nan)
        axes = np.flatnonzero(self.known)
        full[axes] = force
        reach = self.interval.half_n[axes] * sigma
        interval[axes, 0], interval[axes, 1] = force - reach, force + reach
        covariance[np.ix_(axes, axes)] = np.diag(sigma**2)
        wide = self.interval.magnitude_half_n * doubt
        return ForceEstimate(
            stamp_ns=stamp_ns,
            force_n=full,
            known=self.known,
            covariance_n2=covariance,
            interval_n=interval,
            magnitude_n=size,
            magnitude_interval_n=np.array([max(0.0, size - wide), size + wide]),
            contact=1.0 / (1.0 + math.exp(-float(outputs["contact"][0]))),
        )


def relative_interval(
    known: BoolArray,
    found: FloatArray,
    sigma: FloatArray,
    truth: FloatArray,
    session: npt.NDArray[np.str_],
    drawn: str,
) -> Interval:
    """As `interval_from`, in deviations: from errors ``found`` - ``truth`` (n, t) over their ``sigma`` (n, t)."""
    spread = np.array([magnitude_sigma(f, s) for f, s in zip(found, sigma, strict=True)])
    off = (np.linalg.norm(found, axis=1) - np.linalg.norm(truth, axis=1)) / spread
    return interval_of(known, (found - truth) / sigma, off, session, held_out=not drawn, drawn=drawn)


def sigma_of(outputs: Outputs, doubt: Doubt, unit_n: float) -> FloatArray:
    """(n, t): standard deviations of the components: the label's own, and what the last layer was not taught."""
    log = outputs["log_variance"].astype(np.float64)
    untaught = 1.0 + doubt.variance(outputs["features"].astype(np.float64))
    return unit_n * np.exp(0.5 * log) * np.sqrt(untaught)[:, None]


def magnitude_sigma(force: FloatArray, sigma: FloatArray) -> float:
    """Of the length of ``force`` (t,) with deviations ``sigma`` (t,); of a force near zero, of any direction."""
    square = float(force @ force) + float(sigma @ sigma) / len(sigma)
    along = float((force * force) @ (sigma * sigma)) + float(sigma @ sigma) ** 2 / len(sigma) ** 2
    return math.sqrt(along / square)


def seen_of(outputs: Outputs) -> FloatArray:
    """(n,): pixels of the map that the catheter is expected to cover."""
    heat = outputs["heat"].astype(np.float64)
    return (1.0 / (1.0 + np.exp(-heat))).sum(axis=(1, 2))


def limits_from(kept: Outputs, sigma_n: FloatArray, refused: float, *, map_taught: bool, moved_taught: bool) -> Limits:
    """From outputs of what was ``kept`` from training, and deviations of the magnitude (n,): a share is ``refused``.

    ``map_taught``, ``moved_taught``: whether it was shown where the catheter is, and pictures moved too far.
    """
    familiar = min(0.0, float(np.quantile(kept["familiar"], _RARE)))
    return Limits(
        seen=_FAINT * float(np.quantile(seen_of(kept), 0.01)) if map_taught else 0.0,
        sigma_n=float(np.quantile(sigma_n, 1.0 - refused)),
        familiar=familiar if moved_taught else -math.inf,
    )


def wider(ours: Interval, other: Interval) -> Interval:
    """Half-widths of whichever is wider, of what ours knows; the basis says so where the ``other`` one's are."""
    halves = np.where(np.isnan(ours.half_n), np.nan, np.fmax(ours.half_n, other.half_n))
    magnitude = max(ours.magnitude_half_n, other.magnitude_half_n)
    if magnitude == ours.magnitude_half_n and np.array_equal(halves, ours.half_n, equal_nan=True):
        return ours
    basis = f"{ours.basis}; or, where wider, that of the model it began with ({other.basis})"
    return replace(ours, half_n=halves, magnitude_half_n=magnitude, basis=basis)
