"""The planar oracle against the exact elastica, in Jacobi's functions, with all its solutions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk, ellipkinc
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import PlanarRod

LENGTH, STIFFNESS = 0.065, 4.3e-4


def angle_off_the_force(tip, way):
    """Pendulum: angle at ``way`` = sqrt(P / EI) (L - s) before the tip, where it is at rest at ``tip``."""
    k = np.sin(tip / 2)
    _, cn, dn, _ = ellipj(way, k * k)
    return 2 * np.arcsin(k * cn / dn)


def exact_tips(alpha, direction):
    """(solutions, 3): place over L and angle of the tip, of every equilibrium under ``alpha`` = P L^2 / EI.

    The angle off the reversed force obeys the pendulum's equation along the shaft, and the clamp holds it at its base.
    """
    clamp = (-direction - math.pi + math.pi) % (2 * math.pi) - math.pi
    way = math.sqrt(alpha)
    amplitudes = np.linspace(-math.pi + 1e-9, math.pi - 1e-9, 4001)
    miss = angle_off_the_force(amplitudes, way) - clamp
    roots = [
        brentq(lambda a: angle_off_the_force(a, way) - clamp, amplitudes[i], amplitudes[i + 1], xtol=1e-14)
        for i in np.flatnonzero(miss[:-1] * miss[1:] <= 0)
    ]
    nodes, weights = np.polynomial.legendre.leggauss(60)
    tips = []
    for root in roots:
        angles = angle_off_the_force(root, way * (1 - (nodes + 1) / 2)) + direction + math.pi
        tips.append([weights @ np.cos(angles) / 2, weights @ np.sin(angles) / 2, root - clamp])
    return np.array(tips)


def extrapolated_tip(alpha, direction, segments=50):
    """Place over L and angle of the tip: error of second order taken out with half as many segments."""
    force = alpha * STIFFNESS / LENGTH**2 * np.array([math.cos(direction), math.sin(direction)])
    fine, coarse = (solve_static(PlanarRod(LENGTH, STIFFNESS, segments=n), force) for n in (segments, segments // 2))
    assert fine.converged
    a, b = (np.append(shape.tip_m / LENGTH, shape.tip_angle_rad) for shape in (fine, coarse))
    return (4 * a - b) / 3


@settings(max_examples=40, deadline=None)
@given(st.floats(0.01, 12.0), st.floats(-3.1, 3.1))
def test_shape_under_a_tip_load_is_an_exact_elastica(alpha, direction):
    misses = np.abs(exact_tips(alpha, direction) - extrapolated_tip(alpha, direction)).max(axis=1)
    assert misses.min() < 1e-4


def test_below_the_buckling_load_the_exact_solution_is_alone_and_above_it_there_are_three():
    assert len(exact_tips(0.95 * math.pi**2 / 4, 3.0)) == 1
    assert len(exact_tips(2.0 * math.pi**2 / 4, 3.1)) == 3


@pytest.mark.parametrize("alpha", [0.5, 1, 2, 5, 10])
def test_elliptic_integrals_give_the_cantilevers_load_back(alpha):
    # Bisshopp and Drucker: alpha = (K(k) - F(phi_0, k))^2, with k from the angle of the tip
    angle = extrapolated_tip(alpha, math.pi / 2)[2]
    m = (1 + math.sin(angle)) / 2
    assert (ellipk(m) - ellipkinc(math.asin(1 / math.sqrt(2 * m)), m)) ** 2 == pytest.approx(alpha, rel=2e-4)


def test_the_tip_under_any_load_is_that_of_a_boundary_value_solver_with_second_order():
    force, moment = np.array([-0.1, 0.08]), 3e-3

    def slopes(s, y):
        along = np.stack([np.cos(y[0]), np.sin(y[0])])
        bent = y[1] / (STIFFNESS * (1.0 + 0.4 * np.cos(40 * s))) + 8.0 + 6.0 * np.sin(50 * s)
        return np.stack([bent, along[1] * force[0] - along[0] * force[1], *along])

    def ends(a, b):
        lever = 0.008 * np.array([math.cos(b[0]), math.sin(b[0])])
        return np.array([a[0], a[2], a[3], b[1] - moment - lever[0] * force[1] + lever[1] * force[0]])

    mesh = np.linspace(0, LENGTH, 200)
    found = solve_bvp(slopes, ends, mesh, np.stack([8.0 * mesh, 0 * mesh, mesh, 0 * mesh]), tol=1e-9)
    angle, _, x, y = found.y[:, -1]
    exact = np.array([x, y]) + 0.008 * np.array([math.cos(angle), math.sin(angle)])
    errors = []
    for segments in (25, 50, 100):
        s = np.linspace(0, LENGTH, segments + 1)
        curved, stiff = 8.0 + 6.0 * np.sin(50 * s), 1.0 + 0.4 * np.cos(40 * s)
        rod = PlanarRod(LENGTH, STIFFNESS, 0.008, curved, stiffness_profile=stiff, segments=segments)
        errors.append(np.linalg.norm(solve_static(rod, force, moment).tip_m - exact))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


def test_the_moment_follows_the_stiffening():
    rod = PlanarRod(0.04, 4.3e-4, precurvature_per_m=5.0, stiffening_curvature_per_m=40.0)
    curvature = solve_static(rod, np.zeros(2), 0.012).tip_angle_rad / 0.04
    assert 4.3e-4 * (1 + (curvature / 40) ** 2) * (curvature - 5.0) == pytest.approx(0.012, rel=1e-8)


@pytest.mark.parametrize(
    "wrong", [{"flexible_length_m": 0.0}, {"bending_stiffness_nm2": -1.0}, {"segments": 3}, {"rigid_length_m": -0.1}]
)
def test_impossible_rods_are_refused(wrong):
    with pytest.raises(ValueError, match="a rod needs"):
        PlanarRod(**{"flexible_length_m": 0.04, "bending_stiffness_nm2": 4e-4, **wrong})


def test_precurvature_beyond_the_stiffening_law_is_refused():
    with pytest.raises(ValueError, match="precurvature_per_m"):
        PlanarRod(0.04, 4e-4, precurvature_per_m=70.0, stiffening_curvature_per_m=40.0)


@pytest.mark.parametrize("name", ["precurvature_per_m", "stiffness_profile"])
def test_rows_of_the_wrong_length_are_refused(name):
    with pytest.raises(ValueError, match=name):
        PlanarRod(0.04, 4e-4, **{name: np.ones(50)}, segments=50)


def test_a_profile_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="stiffness_profile"):
        PlanarRod(0.04, 4e-4, stiffness_profile=np.linspace(1, 0, 51))
