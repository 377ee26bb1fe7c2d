"""Out-of-distribution detection and epistemic uncertainty, and what a fine-tuned network keeps of them."""

import numpy as np
import pytest

from tipforce.estimators.networks._compact_estimates import AbstentionLimits, fit_abstention_limits
from tipforce.estimators.uncertainty import (
    FeatureDistribution,
    Interval,
    LastLayerLaplace,
    OodDetector,
    fit_feature_distribution,
    fit_laplace,
    fit_ood_detector,
    wider_interval,
)

RNG = np.random.default_rng(0)
MIXING = RNG.normal(size=(6, 40))


def grids(count: int, centre: float = 0.0, spread: float = 1.0) -> np.ndarray:
    """Features near a plane of six directions."""
    grid = RNG.normal(centre, spread, (count, 6)) @ MIXING + RNG.normal(0.0, 0.05, (count, 40))
    return grid.astype(np.float32)


def detector(centre: float, spread: float, initial: OodDetector | None = None) -> OodDetector:
    held_out = grids(200, centre, spread)
    return fit_ood_detector(grids(800, centre, spread), held_out, held_out, initial)


def test_features_like_the_training_s_are_in_distribution_and_others_are_not():
    ood = detector(0.0, 1.0)
    assert np.mean(ood.score(grids(500)) <= 1.0) > 0.98
    beside = RNG.normal(size=(100, 40))  # no combination of the six directions
    assert (ood.score(beside) > 1.0).all()
    assert (ood.score(grids(100, centre=8.0)) > 1.0).all()


def test_differences_along_ignored_directions_are_in_distribution():
    training, held_out = grids(800), grids(200)
    whole, beside = fit_feature_distribution(training, held_out), fit_feature_distribution(training, held_out, 6)
    further = grids(100, centre=8.0)
    assert (whole.score(further) > 1.0).all()
    assert np.mean(beside.score(further) <= 1.0) > 0.9
    other = grids(100) + 0.5 * RNG.normal(size=(100, 40))
    assert (beside.score(other) > 1.0).all()
    again = FeatureDistribution.of(beside.arrays())
    assert np.allclose(again.score(other), beside.score(other), rtol=1e-3)


def test_a_fine_tuned_network_keeps_the_initial_distribution():
    before = detector(0.0, 1.0)
    narrow = detector(0.5, 0.1)
    both = detector(0.5, 0.1, before)
    usual = grids(500)
    assert np.mean(narrow.score(usual) <= 1.0) < 0.1
    assert np.mean(both.score(usual) <= 1.0) > 0.98
    assert len(both.distributions) == 2


def test_an_initial_distribution_without_the_new_images_is_dropped():
    assert len(detector(8.0, 1.0, detector(0.0, 1.0)).distributions) == 1


def test_samples_of_the_initial_network_reduce_the_epistemic_variance():
    features = RNG.normal(size=(800, 8)).astype(np.float32)
    alone = fit_laplace(features)
    both = fit_laplace(features, fit_laplace(RNG.normal(size=(800, 8)).astype(np.float32)))
    new = RNG.normal(size=(50, 8))
    assert (both.variance(new) < alone.variance(new)).all()
    assert alone.variance(new).mean() == pytest.approx(8 / 800, rel=0.3)


def test_uncertainty_comes_back_from_its_arrays():
    ood, laplace = detector(0.5, 0.1, detector(0.0, 1.0)), fit_laplace(RNG.normal(size=(100, 8)))
    arrays = {**ood.arrays(), **laplace.arrays()}
    new, features = grids(20), RNG.normal(size=(5, 8))
    assert np.allclose(OodDetector.of(arrays).score(new), ood.score(new), rtol=1e-3)
    assert np.allclose(LastLayerLaplace.of(arrays).variance(features), laplace.variance(features), rtol=1e-3)
    for kind in (OodDetector, LastLayerLaplace):
        with pytest.raises(KeyError):
            kind.of({})


def test_limits_are_not_narrowed_by_fine_tuning():
    sigma = np.linspace(0.01, 0.02, 100)
    held_out = {
        "heatmap_logit": np.linspace(-3.0, -2.0, 100)[:, None, None] * np.ones((1, 20, 20)),
        "in_distribution_logit": sigma * 100,
    }
    own = fit_abstention_limits(held_out, sigma, 0.03, heatmap_trained=True, ood_trained=True)
    assert own.min_in_distribution_logit == 0.0  # all of it lies above: no more is required than what is likelier
    assert own.widened(AbstentionLimits(1.0, 0.05, -2.0)) == AbstentionLimits(1.0, 0.05, -2.0)
    assert own.widened(AbstentionLimits(99.0, 0.01, 3.0)) == own
    untrained = fit_abstention_limits(held_out, sigma, 0.03, heatmap_trained=False, ood_trained=False)
    assert untrained.min_heatmap_px == 0.0
    assert untrained.min_in_distribution_logit == -np.inf
    assert untrained.widened(own) == own.widened(untrained) == own  # a limit that only one of them has
    unsure = {**held_out, "in_distribution_logit": np.linspace(-4.0, 9.0, 1000)}
    limits = fit_abstention_limits(unsure, sigma, 0.03, heatmap_trained=True, ood_trained=True)
    assert -4.0 < limits.min_in_distribution_logit < -3.9


def test_the_wider_interval_is_kept_and_named():
    nan = np.full((3, 3), np.nan)
    ours = Interval(np.array([1.0, 2.0, np.nan]), 1.5, nan, False, "frames", 1, 30)
    other = Interval(np.array([1.5, 1.0, 3.0]), 1.2, nan, True, "whole sessions", 40, 900)
    both = wider_interval(ours, other)
    assert both.half_n.tolist()[:2] == [1.5, 2.0]
    assert np.isnan(both.half_n[2])
    assert both.magnitude_half_n == 1.5
    assert "whole sessions" in both.basis
    assert wider_interval(other, other) is other
