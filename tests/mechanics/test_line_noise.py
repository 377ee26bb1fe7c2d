"""The small model of a seen line's error."""

import numpy as np
import pytest

from tipforce.mechanics import LineNoise

NOISE = LineNoise(0.03, 18.0, 0.6, 0.02, 10.0, 0.15, 25.0, 0.05, 0.2)
ARC = np.linspace(0.0, 230.0, 33)


def test_a_fit_finds_the_noise_again():
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(NOISE.covariance_m2(ARC))
    draws = rng.standard_normal((20_000, 34)) @ root.T
    found = LineNoise.fit(draws.T @ draws / len(draws), ARC)
    np.testing.assert_allclose(found.std_at_m(ARC), NOISE.std_at_m(ARC), rtol=0.05)
    np.testing.assert_allclose(found.correlation(ARC), NOISE.correlation(ARC), atol=0.04)
    assert found.along_std_m == pytest.approx(0.6, rel=0.02)


def test_the_ends_are_worse_than_the_middle_and_the_tip_is_seen_along_the_line_apart():
    std = NOISE.std_at_m(ARC)
    assert std[0] == pytest.approx(np.hypot(0.03, 0.02), rel=1e-3)
    assert std[-1] == pytest.approx(np.hypot(0.03, 0.15), rel=1e-3)
    assert std.min() < 1.1 * 0.03
    covariance = NOISE.covariance_m2(ARC)
    assert covariance.shape == (34, 34)
    assert not covariance[-1, :-1].any()
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_in_another_unit_it_is_the_same_noise():
    there = NOISE.scaled(2e-4).covariance_m2(2e-4 * ARC)
    np.testing.assert_allclose(there, 4e-8 * NOISE.covariance_m2(ARC), rtol=1e-9)


def test_impossible_noise_is_refused():
    with pytest.raises(ValueError, match="expected positive"):
        LineNoise(0.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="shares"):
        LineNoise(1.0, 1.0, 1.0, white_share=0.5, common_share=0.6)
