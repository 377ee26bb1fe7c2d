"""Derivatives and information in space: against finite differences, and against the plane."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tipforce.mechanics import (
    CentrelineNoise,
    Priors,
    Rod,
    SpatialRod,
    cramer_rao,
    derivatives,
    fisher_information,
    solve_static,
    solve_static_spatial,
)

POINTS, N = 9, 24


@st.composite
def bent(draw):
    """A stable shape, not near a fold, of a rod with all features."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rod = SpatialRod(
        0.057,
        4.3e-4,
        draw(st.sampled_from([0.0, 0.008])),
        draw(st.floats(2e-4, 6e-4)),
        rng.uniform(-10, 10, (N + 1, 3)),
        draw(st.sampled_from([math.inf, 40.0])),
        rng.uniform(0.8, 1.2, N + 1),
        N,
    )
    force = rng.normal(size=3)
    force *= draw(st.floats(0, 5)) * 4.3e-4 / 0.065**2 / np.linalg.norm(force)
    shape = solve_static_spatial(rod, force, rng.uniform(-2e-3, 2e-3, 3), rng.uniform(-1, 1, 3))
    assume(shape.converged)
    assume(shape.stable)
    softness = np.abs(derivatives(shape, 5).force).max() / (rod.length_m**3 / (3 * rod.bending_stiffness_nm2))
    assume(softness < 4)
    return shape


def again(shape, **changed):
    rod = replace(shape.rod, **{k: v for k, v in changed.items() if hasattr(shape.rod, k)})
    loads = [changed.get(k, getattr(shape, k)) for k in ("force_n", "moment_nm", "distributed_n_per_m")]
    return solve_static_spatial(rod, *loads, start=shape).centreline_m(POINTS)


def assert_slope(derived, line, step):
    measured = (line(step) - line(-step)) / (2 * step)
    np.testing.assert_allclose(derived, measured, atol=3e-6 * np.abs(measured).max() + 1e-11, rtol=0)


@settings(max_examples=10, deadline=None)
@given(bent(), st.integers(0, 2))
def test_derivatives_in_space_are_what_finite_differences_measure(shape, axis):
    rod, found, unit = shape.rod, derivatives(shape, POINTS), np.eye(3)[axis]
    ei, gj, length = rod.bending_stiffness_nm2, rod.gj_nm2, rod.length_m
    force, moment, rest = shape.force_n, shape.moment_nm, rod.precurvature_per_m
    np.testing.assert_allclose(found.centreline_m, shape.centreline_m(POINTS), atol=1e-15)
    assert_slope(found.force[:, :, axis], lambda e: again(shape, force_n=force + e * unit), 1e-5 * ei / length**2)
    assert_slope(found.moment[:, :, axis], lambda e: again(shape, moment_nm=moment + e * unit), 1e-5 * ei / length)
    assert_slope(found.precurvature[:, :, axis], lambda e: again(shape, precurvature_per_m=rest + e * unit), 1e-3)

    def under_a_turned_clamp(angle):
        """A turned clamp is a turned rod under loads that are turned back."""
        r = Rotation.from_rotvec(angle * unit).as_matrix()
        loads = {k: getattr(shape, k) @ r for k in ("force_n", "moment_nm", "distributed_n_per_m")}
        return again(shape, **loads) @ r.T

    assert_slope(found.base[:, :, 3 + axis], under_a_turned_clamp, 1e-5)
    np.testing.assert_array_equal(found.base[:, :, :3], np.tile(np.eye(3), (POINTS, 1, 1)))
    # GJ is told apart, so that it stays while EI changes
    assert_slope(
        found.stiffness[:, :, 0],
        lambda e: again(shape, bending_stiffness_nm2=ei + e, torsional_stiffness_nm2=gj),
        1e-5 * ei,
    )
    assert_slope(found.stiffness[:, :, 1], lambda e: again(shape, torsional_stiffness_nm2=gj + e), 1e-5 * gj)


def test_in_the_plane_both_rods_have_the_same_derivatives():
    force = np.array([-0.08, 0.1])
    plane = derivatives(solve_static(Rod(0.057, 4.3e-4, 0.008, 7.0, 40.0), force, 1e-3), POINTS)
    rod = SpatialRod(0.057, 4.3e-4, 0.008, None, np.array([0.0, 0.0, 7.0]), 40.0)
    space = derivatives(solve_static_spatial(rod, np.append(force, 0.0), np.array([0.0, 0.0, 1e-3])), POINTS)
    for flat, full in (
        (plane.force, space.force[:, :2, :2]),
        (plane.moment, space.moment[:, :2, 2:]),
        (plane.precurvature, space.precurvature[:, :2, 2:]),
        (plane.stiffness, space.stiffness[:, :2, :1]),
        (plane.base, space.base[:, :2, [0, 1, 5]]),
    ):
        np.testing.assert_allclose(full, flat, atol=1e-7 * np.abs(flat).max())


def test_a_planar_shape_tells_of_its_own_plane_what_it_tells_without_the_third_axis():
    force, noise = np.array([-0.06, 0.08]), CentrelineNoise(2e-4)
    priors = Priors(precurvature_per_m=2.0, base_position_m=2e-4, base_angle_rad=0.02)
    flat = derivatives(solve_static(Rod(0.065, 4.3e-4, 0.0, 15.0), force), 20)
    rod = SpatialRod(0.065, 4.3e-4, precurvature_per_m=np.array([0.0, 0.0, 15.0]))
    full = derivatives(solve_static_spatial(rod, np.append(force, 0.0)), 20)
    plane, space = (cramer_rao(fisher_information(seen, noise, priors)) for seen in (flat, full))
    np.testing.assert_allclose(space.covariance_n2[:2, :2], plane.covariance_n2, rtol=1e-5)
    np.testing.assert_allclose(space.axial_std_n, plane.axial_std_n, rtol=1e-5)
    # the force out of the plane is seen too, and the larger of the two lateral ones is stated
    assert space.lateral_std_n >= plane.lateral_std_n * (1 - 1e-6)
    np.testing.assert_allclose(space.covariance_n2[2, :2], 0.0, atol=1e-6 * space.covariance_n2[2, 2])
