"""Estimates from the outputs of `compact`: intervals that follow the predicted uncertainty, and abstentions."""

import math
from dataclasses import dataclass

import numpy as np

from ...types import BoolArray, FloatArray, ForceEstimate, Status
from .._builder import MAX_FORCE_N, implausible
from ..uncertainty import Interval, LastLayerLaplace, OodDetector, magnitude_sigma
from ._calibration import Outputs
from ._rate_compensation import History, RateCompensation
from ._tissue import TissueBelief

MIN_HEATMAP_SHARE = 0.3
"""A heatmap with less than this share of the smallest usual number of pixels shows no catheter."""
MAX_WRONG_SHARE = 0.05
"""Share of the estimates that may be wrong by more than the setting ``max_error_n``."""
_USUAL_QUANTILE = 0.01
"""Share of held-out images with fewer pixels than usual."""
_OOD_QUANTILE = 0.002
"""Share of in-distribution images that may be taken for images of a displaced catheter."""


@dataclass(frozen=True, slots=True)
class AbstentionLimits:
    """Limits beyond which there is no estimate.

    Attributes:
        min_heatmap_px: least expected number of heatmap pixels of the catheter; 0 where no heatmap was trained.
        max_sigma_n: largest standard deviation of the magnitude, in newtons.
        min_in_distribution_logit: least logit of an in-distribution position; -inf where that was not trained.
    """

    min_heatmap_px: float
    max_sigma_n: float
    min_in_distribution_logit: float

    def widened(self, other: "AbstentionLimits") -> "AbstentionLimits":
        """Returns the wider of both limits, or the only one of a limit that just one of them has."""
        heatmap = (self.min_heatmap_px, other.min_heatmap_px)
        logits = (self.min_in_distribution_logit, other.min_in_distribution_logit)
        return AbstentionLimits(
            min_heatmap_px=min(filter(None, heatmap), default=0.0),
            max_sigma_n=max(self.max_sigma_n, other.max_sigma_n),
            min_in_distribution_logit=min(filter(math.isfinite, logits), default=-math.inf),
        )


def fit_abstention_limits(
    held_out: Outputs, sigma_n: FloatArray, abstained: float, *, heatmap_trained: bool, ood_trained: bool
) -> AbstentionLimits:
    """Sets the limits beyond which the network abstains.

    Args:
        held_out: outputs for n held-out samples.
        sigma_n: (n,) standard deviations of their magnitudes in newtons.
        abstained: share of them whose standard deviation is to be too large.
        heatmap_trained: whether training had heatmaps.
        ood_trained: whether training had out-of-distribution images.

    Returns:
        The limits; those that were not trained never cause an abstention.
    """
    logit = min(0.0, float(np.quantile(held_out["in_distribution_logit"], _OOD_QUANTILE)))
    usual_px = float(np.quantile(heatmap_pixels(held_out), _USUAL_QUANTILE)) if heatmap_trained else 0.0
    return AbstentionLimits(
        min_heatmap_px=MIN_HEATMAP_SHARE * usual_px,
        max_sigma_n=float(np.quantile(sigma_n, 1.0 - abstained)),
        min_in_distribution_logit=logit if ood_trained else -math.inf,
    )


def largest_trusted_sigma(sigma_n: FloatArray, error_n: FloatArray, max_error_n: float | None) -> float:
    """Returns the largest standard deviation so that at most `MAX_WRONG_SHARE` of the estimates up to it are wrong.

    Args:
        sigma_n: (n,) standard deviations of held-out magnitudes.
        error_n: (n,) their errors.
        max_error_n: a larger error is wrong; None: no error is.

    >>> largest_trusted_sigma(np.array([0.01, 0.02, 0.03]), np.array([0.0, 0.01, 0.2]), 0.05)
    0.02
    """
    if max_error_n is None:
        return math.inf
    order = np.argsort(sigma_n, kind="stable")
    wrong = np.cumsum(np.abs(error_n[order]) > max_error_n) / np.arange(1, len(order) + 1)
    trusted = np.flatnonzero(wrong <= MAX_WRONG_SHARE)
    return float(sigma_n[order[trusted[-1]]]) if len(trusted) else 0.0


@dataclass(frozen=True, eq=False)
class CompactEstimateBuilder:
    """Makes the estimates of one session from the outputs of `CompactTask`'s network.

    Attributes:
        known: (3,) which components are estimated.
        unit_n: the network's unit of force.
        laplace: epistemic uncertainty.
        ood: out-of-distribution detector on the network's last grid of features.
        limits: limits of the abstention.
        interval: half-widths and ends in standard deviations, not newtons: the predicted deviation scales them.
        compensation: compensation of the viscous force.
        history: earlier estimates of the session.
        tissue: shares of the tissue classes in the session; None for a network without classes of tissue.
    """

    known: BoolArray
    unit_n: float
    laplace: LastLayerLaplace
    ood: OodDetector
    limits: AbstentionLimits
    interval: Interval
    compensation: RateCompensation
    history: History
    tissue: TissueBelief | None = None

    def __call__(self, stamp_ns: int, outputs: Outputs) -> ForceEstimate:
        """Returns the estimate of one frame; invalid where a limit of the abstention is exceeded.

        Args:
            stamp_ns: stamp of the frame.
            outputs: outputs of the network, (1, ...) each.
        """
        if self.limits.min_heatmap_px > 0.0 and (pixels := heatmap_pixels(outputs)[0]) < self.limits.min_heatmap_px:
            detail = f"the heatmap shows no catheter in the window ({pixels:.1f} pixels)"
            return ForceEstimate.invalid(stamp_ns, Status.NO_CATHETER, detail)
        if outputs["in_distribution_logit"][0] < self.limits.min_in_distribution_logit:
            detail = "the catheter is shifted, rotated, or of another scale than in all training images"
            return ForceEstimate.invalid(stamp_ns, Status.OUT_OF_DISTRIBUTION, detail)
        abstention = self.ood.abstention(stamp_ns, outputs["grid"])
        if abstention is not None:
            return abstention
        force, covariance = self._mean_and_covariance(stamp_ns, outputs)
        if not (size_n := math.hypot(*force.tolist())) <= MAX_FORCE_N:
            return implausible(stamp_ns, size_n)
        sigma_n = magnitude_sigma(force, covariance)
        if not sigma_n <= self.limits.max_sigma_n:
            detail = f"the force has a standard deviation of {sigma_n * 1e3:.0f} mN in this image, more than the limit"
            ends = self.interval.magnitude_interval(size_n, sigma_n)
            return ForceEstimate.invalid(stamp_ns, Status.UNOBSERVABLE, detail, abstained_interval_n=ends)
        rate = self.history.rate(stamp_ns, force)
        if rate is None:  # no earlier frame: the viscous part stays unknown, and widens the interval
            covariance = covariance * self.compensation.sigma_factor_without_history**2
        else:
            force = force + rate @ self.compensation.seconds
        magnitude_n, sigma_n = float(np.linalg.norm(force)), magnitude_sigma(force, covariance)
        if not magnitude_n <= MAX_FORCE_N or not math.isfinite(sigma_n):
            return implausible(stamp_ns, magnitude_n if magnitude_n > MAX_FORCE_N else math.nan)
        # x, y and z, NaN where the network does not estimate a component
        force_n, interval_n, covariance_n2 = (np.full(shape, math.nan) for shape in ((3,), (3, 2), (3, 3)))
        axes = np.flatnonzero(self.known)
        force_n[axes] = force
        half_n = self.interval.half_n[axes] * np.sqrt(np.diag(covariance))
        interval_n[axes, 0], interval_n[axes, 1] = force - half_n, force + half_n
        covariance_n2[np.ix_(axes, axes)] = covariance
        magnitude_interval_n = np.array(self.interval.magnitude_interval(magnitude_n, sigma_n))
        contact = 1.0 / (1.0 + math.exp(-float(outputs["contact_logit"][0])))
        return ForceEstimate(
            stamp_ns, force_n, self.known, covariance_n2, interval_n, magnitude_n, magnitude_interval_n, contact=contact
        )

    def _mean_and_covariance(self, stamp_ns: int, outputs: Outputs) -> tuple[FloatArray, FloatArray]:
        """Returns force (t,), N, and covariance (t, t), N^2, aleatoric and epistemic together.

        A network with classes of tissue has a force for each class: the moments are those of the mixture, with the
        shares of the classes in this session.
        """
        epistemic = 1.0 + float(self.laplace.variance(outputs["features"].astype(np.float64))[0])
        if self.tissue is None:
            variance = np.exp(outputs["log_variance"][0].astype(np.float64)) * self.unit_n**2
            return outputs["force_n"][0].astype(np.float64), np.diag(variance * epistemic)
        forces = outputs["tissue_force_n"][0].astype(np.float64)
        variances = np.exp(outputs["tissue_log_variance"][0].astype(np.float64)) * self.unit_n**2 * epistemic
        share = self.tissue.shares(stamp_ns, outputs["tissue_logits"][0])
        force = share @ forces
        from_mean = forces - force
        return force, np.diag(share @ variances) + (share[:, None] * from_mean).T @ from_mean


def component_sigma(outputs: Outputs, laplace: LastLayerLaplace, unit_n: float) -> FloatArray:
    """Returns standard deviations (n, t) of the components, N, aleatoric and epistemic together.

    Args:
        outputs: outputs of the network for n samples.
        laplace: epistemic uncertainty.
        unit_n: the network's unit of force in newtons.
    """
    log_variance = outputs["log_variance"].astype(np.float64)
    epistemic = 1.0 + laplace.variance(outputs["features"].astype(np.float64))
    return unit_n * np.exp(0.5 * log_variance) * np.sqrt(epistemic)[:, None]


def heatmap_pixels(outputs: Outputs) -> FloatArray:
    """Returns (n,) expected numbers of heatmap pixels that the catheter covers."""
    logits = outputs["heatmap_logit"].astype(np.float64)
    return (1.0 / (1.0 + np.exp(-logits))).sum(axis=(1, 2))
