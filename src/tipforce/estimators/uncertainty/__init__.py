"""Uncertainty of an estimate: conformal intervals, last-layer Laplace approximation, out-of-distribution detection."""

from ._conformal import (
    COVERAGE,
    Interval,
    IntervalBasis,
    StoredInterval,
    conformal_half_width,
    conformal_interval,
    interval_basis,
    interval_from_errors,
    sessions_for_guarantee,
    wider_interval,
)
from ._laplace import LastLayerLaplace, fit_laplace
from ._normalised import GAUSS_90, gaussian_interval, magnitude_sigma, normalised_interval
from ._ood import FeatureDistribution, OodDetector, fit_feature_distribution, fit_ood_detector
from ._strata import ForceStrata, fit_strata

__all__ = [
    "COVERAGE",
    "GAUSS_90",
    "FeatureDistribution",
    "ForceStrata",
    "Interval",
    "IntervalBasis",
    "LastLayerLaplace",
    "OodDetector",
    "StoredInterval",
    "conformal_half_width",
    "conformal_interval",
    "fit_feature_distribution",
    "fit_laplace",
    "fit_ood_detector",
    "fit_strata",
    "gaussian_interval",
    "interval_basis",
    "interval_from_errors",
    "magnitude_sigma",
    "normalised_interval",
    "sessions_for_guarantee",
    "wider_interval",
]
