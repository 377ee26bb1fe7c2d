"""The rod against the exact elastica, in Jacobi's functions, with all its solutions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import ellipe, ellipj, ellipk, ellipkinc

from tipforce.mechanics import Branch, Rod, solve_static

LENGTH, STIFFNESS = 0.065, 4.3e-4
CRITICAL = math.pi**2 * STIFFNESS / (4 * LENGTH**2)


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
    fine, coarse = (solve_static(Rod(LENGTH, STIFFNESS, segments=n), force) for n in (segments, segments // 2))
    assert fine.converged
    assert fine.stable
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


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("share", [1.05, 1.5, 2.0, 4.0])
def test_a_buckled_column_is_reached_from_a_bent_start(share, side):
    force = np.array([-share * CRITICAL, 0.0])
    tips = []
    for segments in (50, 100):
        rod = Rod(LENGTH, STIFFNESS, segments=segments)
        shape = solve_static(rod, force, start=solve_static(rod, force + np.array([0.0, side * 0.05 * CRITICAL])))
        assert shape.converged
        assert shape.stable
        assert shape.branch is Branch.GIVEN
        assert not shape.on_unloaded_branch()
        tips.append([*shape.tip_m / LENGTH, shape.tip_angle_rad])
    m = brentq(lambda m: ellipk(m) - math.sqrt(share) * math.pi / 2, 1e-9, 1 - 1e-12)
    exact = [2 * ellipe(m) / ellipk(m) - 1, side * 2 * math.sqrt(m) / ellipk(m), side * 2 * math.asin(math.sqrt(m))]
    np.testing.assert_allclose((4 * np.array(tips[1]) - tips[0]) / 3, exact, atol=2e-5 if share > 1.1 else 2e-4)


@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.02, False), (3.0, False)])
def test_a_straight_column_stays_on_its_branch_and_loses_its_stability_at_the_buckling_load(share, stable):
    shape = solve_static(Rod(LENGTH, STIFFNESS), np.array([-share * CRITICAL, 0.0]))
    assert shape.converged
    assert shape.stable is stable
    assert shape.branch is Branch.UNLOADED
    assert shape.tip_m[0] == pytest.approx(LENGTH)
