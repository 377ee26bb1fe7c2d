"""Large forces that are drawn to the usual ones are stretched back, but not where that enlarges the mean error."""

import numpy as np
import pytest

from tipforce.estimators._stretch import NO_STRETCH, Stretch, fit_stretch


def drawn(slopes: list[float], noise_n: float = 0.01) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates of sessions whose forces are drawn to 50 mN by these slopes, their truth and their sessions."""
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.03, 0.35, (len(slopes), 100))
    estimate = 0.05 + np.array(slopes)[:, None] * (truth - 0.05) + rng.normal(0.0, noise_n, truth.shape)
    names = np.repeat([f"session_{k:02}" for k in range(len(slopes))], 100)
    return estimate.ravel(), truth.ravel(), names


def test_what_all_sessions_lose_alike_comes_back() -> None:
    estimate, truth, session = drawn([0.8] * 12)
    found = fit_stretch(estimate, truth, session)
    assert found.gain == pytest.approx(0.25, abs=0.02)
    assert found.from_n == pytest.approx(0.05, abs=0.01)
    large = truth > 0.3
    after = estimate * found.ratio(estimate)
    assert abs(np.mean((after - truth)[large])) < 0.003 < -np.mean((estimate - truth)[large])


def test_what_a_few_sessions_lose_is_not_laid_upon_the_others() -> None:
    estimate, truth, session = drawn([1.0] * 10 + [0.3, 0.3])
    found = fit_stretch(estimate, truth, session)
    assert found.gain < 0.05
    after = estimate * found.ratio(estimate)
    assert np.abs(after - truth).mean() <= np.abs(estimate - truth).mean() + 1e-6


@pytest.mark.parametrize("slopes", [[0.8] * 9, [1.0] * 12, [1.2] * 12], ids=["too few", "right", "too large"])
def test_there_may_be_nothing_to_stretch(slopes: list[float]) -> None:
    assert fit_stretch(*drawn(slopes, noise_n=1e-4)).gain < 1e-3


def test_what_is_small_stays() -> None:
    magnitude = np.array([0.0, 0.04, 0.2])
    assert magnitude * Stretch(0.2, 0.05).ratio(magnitude) == pytest.approx([0.0, 0.04, 0.23])
    assert NO_STRETCH.ratio(magnitude).tolist() == [1.0, 1.0, 1.0]
