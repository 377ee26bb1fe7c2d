"""The implicit function theorem against finite differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tipforce.mechanics import Rod, derivatives, solve_static

POINTS = 13


@st.composite
def bent(draw):
    """A stable shape, not near a fold, of a rod with all features."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rod = Rod(
        draw(st.floats(0.035, 0.06)),
        draw(st.floats(3e-4, 9e-4)),
        draw(st.sampled_from([0.0, 0.008])),
        rng.uniform(-5, 15, 31),
        draw(st.sampled_from([math.inf, 40.0])),
        rng.uniform(0.8, 1.2, 31),
        30,
    )
    angle, alpha = draw(st.floats(0, 2 * math.pi)), draw(st.floats(0, 6))
    force = alpha * rod.bending_stiffness_nm2 / rod.length_m**2 * np.array([math.cos(angle), math.sin(angle)])
    shape = solve_static(rod, force, draw(st.floats(-3e-3, 3e-3)), rng.uniform(-1, 1, 2))
    assume(shape.stable)
    softness = np.abs(derivatives(shape, 5).force).max() / (rod.length_m**3 / (3 * rod.bending_stiffness_nm2))
    assume(softness < 4)
    return shape


def slope(line, step):
    return (line(step) - line(-step)) / (2 * step)


def assert_close(derived, measured):
    np.testing.assert_allclose(derived, measured, atol=2e-6 * np.abs(measured).max() + 1e-12, rtol=0)


def again(shape, rod=None, force=None, moment=None, spread=None):
    other = solve_static(
        rod or shape.rod,
        shape.force_n if force is None else force,
        shape.moment_nm if moment is None else moment,
        shape.distributed_n_per_m if spread is None else spread,
        start=shape,
    )
    return other.centreline_m(POINTS)


@settings(max_examples=25, deadline=None)
@given(bent())
def test_derivatives_are_what_finite_differences_measure(shape):
    rod, found = shape.rod, derivatives(shape, POINTS)
    ei, length = rod.bending_stiffness_nm2, rod.length_m
    small = 1e-5 * ei / length**2
    np.testing.assert_allclose(found.centreline_m, shape.centreline_m(POINTS), atol=1e-15)
    for axis in range(2):
        step = np.eye(2)[axis]
        assert_close(found.force[:, :, axis], slope(lambda e, d=step: again(shape, force=shape.force_n + e * d), small))
    assert_close(found.moment[:, :, 0], slope(lambda e: again(shape, moment=shape.moment_nm + e), 1e-5 * ei / length))
    assert_close(
        found.precurvature[:, :, 0],
        slope(lambda e: again(shape, replace(rod, precurvature_per_m=rod.precurvatures_per_m + e)), 1e-4),
    )
    assert_close(
        found.stiffness[:, :, 0],
        slope(lambda e: again(shape, replace(rod, bending_stiffness_nm2=ei + e)), 1e-5 * ei),
    )


@settings(max_examples=25, deadline=None)
@given(bent())
def test_a_turned_clamp_is_a_turned_rod_under_loads_turned_back(shape):
    def line(angle):
        back = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        return again(shape, force=back @ shape.force_n, spread=back @ shape.distributed_n_per_m) @ back

    base = derivatives(shape, POINTS).base
    assert_close(base[:, :, 2], slope(line, 1e-5))
    np.testing.assert_array_equal(base[:, :, :2], np.tile(np.eye(2), (POINTS, 1, 1)))


@settings(max_examples=25, deadline=None)
@given(bent())
def test_the_tips_compliance_is_symmetric_and_positive(shape):
    # Maxwell and Betti: a load's way under another load is the other's way under the one
    compliance = derivatives(shape, np.array([shape.rod.length_m])).force[0]
    np.testing.assert_allclose(compliance, compliance.T, atol=1e-9 * np.abs(compliance).max())
    assert np.linalg.eigvalsh(compliance)[0] > -1e-9 * np.abs(compliance).max()


def test_a_straight_cantilever_has_the_textbooks_flexibilities():
    length, ei = 0.05, 4.3e-4
    shape = solve_static(Rod(length, ei, segments=400), np.zeros(2))
    at_tip = derivatives(shape, np.array([length]))
    assert at_tip.force[0, 1, 1] == pytest.approx(length**3 / (3 * ei), rel=1e-4)
    assert at_tip.moment[0, 1, 0] == pytest.approx(length**2 / (2 * ei), rel=1e-4)
    assert at_tip.precurvature[0, 1, 0] == pytest.approx(length**2 / 2, rel=1e-4)
    np.testing.assert_allclose(at_tip.base[0, :, 2], [0.0, length], atol=1e-12)
    np.testing.assert_array_equal(at_tip.tip_axis, [1.0, 0.0])
    assert not at_tip.force[:, 0].any()


def test_a_shape_that_has_not_converged_has_no_derivatives():
    shape = replace(solve_static(Rod(0.05, 4.3e-4), np.zeros(2)), converged=False)
    with pytest.raises(ValueError, match="not converged"):
        derivatives(shape, 5)
