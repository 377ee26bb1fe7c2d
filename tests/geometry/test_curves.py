"""The two sets of numbers for a curve: against NumPy, and against curves whose numbers are known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.geometry import angle_matrix, curve_from_angle, fit_polynomial, turning_angles

seeds = st.integers(0, 2**32 - 1)


def fit_angle(points: np.ndarray, degree: int) -> np.ndarray:
    """Legendre coefficients (degree + 1,) of the tangent angle along ``points`` (n, 2)."""
    return angle_matrix(len(points), degree) @ turning_angles(np.ascontiguousarray(points), 1.0, 0.0)


@given(seeds, st.integers(12, 400), st.integers(1, 6), st.floats(20, 1000), st.floats(-50, 50))
def test_the_polynomial_is_the_one_numpy_fits(seed: int, n: int, degree: int, width: float, start: float) -> None:
    rng = np.random.default_rng(seed)
    x = start + width * (np.arange(n) + rng.uniform(0, 0.9, n)) / n
    y = rng.normal(0, 30, n) + 0.001 * x**2
    ours, numpys = np.polyval(fit_polynomial(x, y, degree), x), np.polyval(np.polyfit(x, y, degree), x)
    np.testing.assert_allclose(ours, numpys, rtol=0, atol=1e-6 * np.abs(y).max())


def test_the_thesis_polynomial_agrees_with_numpy_to_nine_digits_in_every_coefficient() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        x = np.linspace(-10, rng.uniform(100, 600), 64)
        y = np.polyval(rng.normal(size=5) / x[-1] ** np.arange(4, -1, -1) * 50, x) + rng.normal(0, 0.1, 64)
        np.testing.assert_allclose(fit_polynomial(x, y, 4), np.polyfit(x, y, 4), rtol=1e-9)


@given(seeds, st.integers(1, 6))
def test_without_a_constant_the_curve_goes_through_the_origin_and_is_the_best_that_does(seed: int, degree: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.linspace(3, 300, 60)
    y = rng.normal(5, 20, 60)
    fitted = fit_polynomial(x, y, degree, False)
    powers = (x / 300)[:, None] ** np.arange(degree, 0, -1)
    best = np.linalg.lstsq(powers, y, rcond=None)[0]
    assert fitted[-1] == 0.0
    np.testing.assert_allclose(fitted[:-1] * 300.0 ** np.arange(degree, 0, -1), best, atol=1e-7 * np.abs(best).max())


@pytest.mark.parametrize("x", [[1.0, 2.0, 3.0], [1.0] * 9, [1.0, 2.0] * 5])
def test_too_few_different_x_are_refused(x: list[float]) -> None:
    with pytest.raises(ValueError, match="too few different x"):
        fit_polynomial(np.array(x), np.zeros(len(x)), 4)


@given(st.lists(st.floats(-0.8, 0.8), min_size=5, max_size=5), st.floats(1, 1000), st.integers(24, 200))
def test_the_angle_series_is_recovered_from_the_curve_it_makes(series: list[float], length: float, points: int) -> None:
    curve = curve_from_angle(np.array(series), length, points)
    off = fit_angle(curve, 4) - series
    off[0] -= 2 * math.pi * round(off[0] / (2 * math.pi))  # a base that points backwards is known to a full turn
    np.testing.assert_allclose(off, 0, atol=2.5e-4 * (24 / points) ** 2)  # 2.1e-4 at worst, with all at the limits


def test_the_angle_series_exists_for_a_shape_that_turns_round_and_on() -> None:
    turns = np.array([2.5 * math.pi, 2.5 * math.pi])
    np.testing.assert_allclose(fit_angle(curve_from_angle(turns, 300.0, 64), 3), [*turns, 0, 0], atol=1e-3)


def test_a_circular_arc_has_a_linear_angle() -> None:
    angle = np.linspace(0, 1.5, 64)
    arc = 100 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    np.testing.assert_allclose(fit_angle(arc, 4), [0.75, 0.75, 0, 0, 0], atol=1e-9)
    straight = curve_from_angle(np.array([0.0]), 50.0, 3)
    np.testing.assert_allclose(straight, [[0, 0], [25, 0], [50, 0]], atol=1e-12)


def test_an_angle_series_from_too_few_points_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 6 points, got 5"):
        angle_matrix(5, 4)
