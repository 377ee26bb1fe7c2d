"""What a centreline tells of the force, against figures that were computed for this project by other means."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics import CentrelineNoise, Priors, Rod, cramer_rao, derivatives, fisher_information, solve_static

LENGTH, STIFFNESS, POINTS = 0.065, 4.3e-4, 20
NOISE = CentrelineNoise(0.2e-3)
KNOWN_REST = Priors()
FREE = Priors(precurvature_per_m=math.inf, base_position_m=0.2e-3, base_angle_rad=math.radians(1))


def pushed(curvature, contact_deg, force_n=0.1):
    """A rod under a force of 0.1 N, from a push along the unloaded tip's axis (0 degrees) to one across it (90)."""
    angle = curvature * LENGTH + math.pi - math.radians(contact_deg)
    rod = Rod(LENGTH, STIFFNESS, precurvature_per_m=curvature)
    return solve_static(rod, force_n * np.array([math.cos(angle), math.sin(angle)]))


def bound_mn(shape, priors=KNOWN_REST, noise=NOISE):
    bound = cramer_rao(fisher_information(derivatives(shape, POINTS), noise, priors))
    return 1e3 * bound.axial_std_n, 1e3 * bound.lateral_std_n


# Standard deviations in mN, 20 points at 0.2 mm: pre-curvature in 1/m, degrees off the tip's axis, axial, lateral.
KNOWN = [(0, 90, 65, 6), (0, 0.6, 3300, 6), (10, 0, 48, 11), (10, 90, 22, 8), (25, 0, 15, 9), (25, 90, 8, 7)]
UNKNOWN = [(0, 90, 375, 60), (10, 0, 375, 121), (10, 90, 141, 81), (25, 0, 105, 107), (25, 90, 46, 78)]


@pytest.mark.parametrize(
    ("curvature", "degrees", "axial", "lateral", "priors"),
    [(*row, Priors()) for row in KNOWN] + [(*row, FREE) for row in UNKNOWN],
)
def test_the_bounds_of_the_reference_are_met(curvature, degrees, axial, lateral, priors):
    found = bound_mn(pushed(curvature, degrees), priors)
    # they are written with two digits, and their points and directions are known to a few percent
    assert found[0] == pytest.approx(axial, rel=0.04, abs=0.5)
    assert found[1] == pytest.approx(lateral, rel=0.03, abs=0.5)


def test_between_a_push_along_and_one_across_the_bound_falls_between():
    for curvature, priors in ((10, Priors()), (25, Priors()), (25, FREE)):
        axial = [bound_mn(pushed(curvature, degrees), priors)[0] for degrees in (0, 30, 60, 90)]
        assert axial[0] == max(axial)
        assert min(axial) > 0.9 * axial[-1]


def test_a_fit_reaches_the_bound():
    rng = np.random.default_rng(5)
    shape = pushed(25.0, 45.0)
    std = 0.02e-3  # small enough for the rod to be linear within it
    found = derivatives(shape, POINTS)
    bound = cramer_rao(fisher_information(found, CentrelineNoise(std)))
    errors = []
    for _ in range(300):
        seen = shape.centreline_m(POINTS) + rng.normal(0, std, (POINTS, 2))
        force, fitted = shape.force_n * 0.9, shape
        for _ in range(4):
            fitted = solve_static(shape.rod, force, start=fitted)
            slopes = derivatives(fitted, POINTS).force.reshape(-1, 2)
            force = force + np.linalg.lstsq(slopes, (seen - fitted.centreline_m(POINTS)).ravel())[0]
        errors.append(force - shape.force_n)
    covariance = np.cov(np.array(errors).T)
    # whitened by the bound it is the identity, within what 300 draws let one say
    root = np.linalg.inv(np.linalg.cholesky(bound.covariance_n2))
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(2), atol=0.25)


@settings(max_examples=30, deadline=None)
@given(st.floats(0, 30), st.floats(1, 179), st.floats(1e-5, 3.0), st.floats(1e-7, 1e-4), st.floats(1e-5, 1e-2))
def test_the_less_is_known_beforehand_the_less_is_known_of_the_force(curvature, degrees, curved, stiff, place):
    shape = pushed(curvature, degrees)
    stages = [
        Priors(),
        Priors(precurvature_per_m=curved),
        Priors(precurvature_per_m=curved, stiffness_nm2=stiff),
        Priors(precurvature_per_m=curved, stiffness_nm2=stiff, base_position_m=place, base_angle_rad=0.02),
        Priors(
            moment_nm=1e-4, precurvature_per_m=math.inf, stiffness_nm2=stiff, base_position_m=place, base_angle_rad=0.02
        ),
    ]
    axial, lateral = np.array([bound_mn(shape, priors) for priors in stages]).T
    assert (np.diff(axial) >= -1e-5 * axial[1:]).all()
    assert (np.diff(lateral) >= -1e-5 * lateral[1:]).all()


def test_a_narrow_prior_is_knowledge_and_a_wide_one_is_none():
    shape = pushed(10.0, 40.0)
    np.testing.assert_allclose(bound_mn(shape, Priors(precurvature_per_m=1e-6)), bound_mn(shape), rtol=1e-6)
    np.testing.assert_allclose(
        bound_mn(shape, Priors(precurvature_per_m=1e6)), bound_mn(shape, Priors(precurvature_per_m=math.inf)), rtol=1e-6
    )


def test_what_a_straight_rod_cannot_tell_is_infinite_unless_it_was_known():
    straight = solve_static(Rod(LENGTH, STIFFNESS), np.zeros(2))
    axial, lateral = bound_mn(straight)
    assert axial == math.inf
    assert lateral < 10
    covariance = cramer_rao(fisher_information(derivatives(straight, POINTS), NOISE)).covariance_n2
    np.testing.assert_array_equal(np.isinf(covariance), [[True, False], [False, False]])
    assert bound_mn(straight, Priors(force_n=0.2))[0] == pytest.approx(200.0)
    assert bound_mn(straight, Priors(force_n=0.2))[1] < lateral


def test_noise_of_all_coordinates_may_be_given_as_one_covariance():
    shape, noise = pushed(10.0, 40.0), CentrelineNoise(0.2e-3, 0.01)
    arc = derivatives(shape, POINTS).arc_m
    whole = np.kron(noise.covariance_m2(arc), np.eye(2))
    np.testing.assert_allclose(bound_mn(shape, noise=whole), bound_mn(shape, noise=noise), rtol=1e-9)
    assert whole[0, 2] == pytest.approx(0.04e-6 * math.exp(-LENGTH / 19 / 0.01))


def test_with_correlated_noise_more_points_do_not_help_without_end():
    shape = pushed(25.0, 45.0)

    def axial(points, noise):
        return cramer_rao(fisher_information(derivatives(shape, points), noise)).axial_std_n

    correlated = CentrelineNoise(0.2e-3, 0.01)
    assert axial(160, NOISE) == pytest.approx(axial(40, NOISE) / 2, rel=0.02)
    assert axial(160, correlated) > 0.95 * axial(40, correlated)
    assert axial(20, CentrelineNoise(0.2e-3, 1e-5)) == pytest.approx(axial(20, NOISE), rel=1e-6)


def test_noise_in_pixels_is_that_in_metres():
    assert CentrelineNoise.from_px(0.5, 2e-4, 10.0) == CentrelineNoise(1e-4, 2e-3)


def test_impossible_noise_and_priors_are_refused():
    found = derivatives(pushed(10.0, 40.0), 5)
    with pytest.raises(ValueError, match="positive std_m"):
        CentrelineNoise(0.0)
    with pytest.raises(ValueError, match="standard deviations"):
        Priors(moment_nm=-1.0)
    with pytest.raises(ValueError, match="not positive definite"):
        fisher_information(found, np.ones((10, 10)))
    with pytest.raises(ValueError, match="expected shape"):
        fisher_information(found, np.eye(5))
