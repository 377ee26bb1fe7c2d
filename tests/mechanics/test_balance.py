"""Force, moment and energy balance of a rod with all its features; an independent integrator agrees."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_bvp

from tipforce.mechanics import Rod, solve_static

SHAFT, TIP, STIFFNESS = 0.057, 0.008, 4.3e-4
loads = st.tuples(
    st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)).map(np.array),
    st.floats(-0.01, 0.01),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2)).map(np.array),
)


def curvature(s):
    return 8.0 + 6.0 * np.sin(50 * s)


def stiffness(s):
    return 1.0 + 0.4 * np.cos(40 * s)


def full(segments=60, stiffening=math.inf):
    """A rod with pre-curvature and stiffness that vary along it."""
    s = np.linspace(0, SHAFT, segments + 1)
    return Rod(SHAFT, STIFFNESS, TIP, curvature(s), stiffening, stiffness(s), segments)


def turn(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@settings(max_examples=40, deadline=None)
@given(loads, st.sampled_from([math.inf, 40.0]))
def test_the_clamp_holds_the_moment_of_all_loads(load, stiffening):
    rod = full(stiffening=stiffening)
    force, moment, spread = load
    shape = solve_static(rod, force, moment, spread)
    assert shape.converged
    middles = (rod.nodes_m(shape.angles_rad)[1:] + rod.nodes_m(shape.angles_rad)[:-1]) / 2
    weights = rod.element_lengths_m[:, None] * spread
    whole = moment + turn(shape.tip_m, force) + turn(middles, weights).sum()
    assert shape.moments_nm[0] == pytest.approx(whole, abs=1e-10)


@settings(max_examples=20, deadline=None)
@given(loads)
def test_the_work_of_the_loads_is_stored_in_the_bend(load):
    rod, (force, moment, spread) = full(stiffening=40.0), load
    nodes, weights = np.polynomial.legendre.leggauss(12)
    work, shape = 0.0, None
    arc = np.linspace(0, rod.length_m, 2001)
    at_rest = solve_static(rod, np.zeros(2))

    def work_of_the_whole_load(shape):
        """What the whole load does on the way from the unloaded shape."""
        moved = shape.centreline_m(arc) - at_rest.centreline_m(arc)
        turned = shape.tip_angle_rad - at_rest.tip_angle_rad
        return force @ moved[-1] + moment * turned + np.trapezoid(moved @ spread, arc)

    # by parts: the integral of share d(way) = whole way - integral of way d(share)
    for node, weight in zip(nodes, weights, strict=True):
        share = (node + 1) / 2
        shape = solve_static(rod, share * force, share * moment, share * spread)
        work -= weight / 2 * work_of_the_whole_load(shape)
    end = solve_static(rod, force, moment, spread)
    if not end.branch == shape.branch == 0 or np.abs(end.angles_rad - at_rest.angles_rad).max() > 1.5:
        return  # a quadrature with twelve nodes does not see a fold or what is nearly one
    work += work_of_the_whole_load(end)
    stored = end.energy_j - at_rest.energy_j
    arms = end.centreline_m(arc)
    stored += force @ end.tip_m + moment * end.tip_angle_rad + np.trapezoid(arms @ spread, arc)
    assert work == pytest.approx(stored, rel=2e-3, abs=1e-8)


@settings(max_examples=30, deadline=None)
@given(loads)
def test_everything_mirrored_gives_the_mirrored_shape(load):
    rod, (force, moment, spread) = full(stiffening=40.0), load
    mirrored = replace(rod, precurvature_per_m=-rod.precurvatures_per_m)
    there = solve_static(mirrored, force * [1, -1], -moment, spread * [1, -1])
    np.testing.assert_allclose(there.angles_rad, -solve_static(rod, force, moment, spread).angles_rad, atol=1e-8)


def integrated(force, moment, spread):
    """Place of the tip by a boundary value solver: angle, moment and place along the shaft."""

    def slopes(s, y):
        along = np.stack([np.cos(y[0]), np.sin(y[0])])
        inner = force[:, None] + spread[:, None] * (SHAFT + TIP - s)
        return np.stack([y[1] / (STIFFNESS * stiffness(s)) + curvature(s), -turn(along.T, inner.T), *along])

    def ends(a, b):
        axis = np.array([math.cos(b[0]), math.sin(b[0])])
        return np.array([a[0], a[2], a[3], b[1] - moment - turn(TIP * axis, force + spread * TIP / 2)])

    mesh = np.linspace(0, SHAFT, 200)
    found = solve_bvp(slopes, ends, mesh, np.stack([8.0 * mesh, 0 * mesh, mesh, 0 * mesh]), tol=1e-9)
    assert found.success
    angle, _, x, y = found.y[:, -1]
    return np.array([x, y]) + TIP * np.array([math.cos(angle), math.sin(angle)])


@pytest.mark.parametrize("force", [(-0.1, 0.08), (0.15, -0.1)])
def test_a_rod_with_all_features_is_that_of_a_boundary_value_solver_with_second_order(force):
    force, moment, spread = np.array(force), 3e-3, np.array([0.4, -0.9])
    exact = integrated(force, moment, spread)
    tips = [solve_static(full(n), force, moment, spread).tip_m for n in (25, 50, 100)]
    errors = [np.linalg.norm(tip - exact) for tip in tips]
    assert errors[1] < 1e-4 * (SHAFT + TIP)
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)
    np.testing.assert_allclose((4 * tips[2] - tips[1]) / 3, exact, atol=1e-6 * (SHAFT + TIP))


def test_a_light_beam_sags_under_its_own_weight_by_the_textbooks_eighth():
    weight = 1e-4
    shape = solve_static(Rod(0.05, STIFFNESS, segments=200), np.zeros(2), distributed_n_per_m=np.array([0.0, -weight]))
    assert shape.tip_m[1] == pytest.approx(-weight * 0.05**4 / (8 * STIFFNESS), rel=1e-4)


def test_weight_on_the_electrode_alone_acts_in_its_middle():
    rod, spread = full(), np.zeros((61, 2))
    spread[-1] = [0.0, -8.0]
    shape = solve_static(rod, np.zeros(2), distributed_n_per_m=spread)
    force = np.array([0.0, -8.0 * TIP])
    back = -TIP / 2 * np.array([math.cos(shape.tip_angle_rad), math.sin(shape.tip_angle_rad)])
    alone = solve_static(rod, force, float(turn(back, force)))
    np.testing.assert_allclose(alone.angles_rad, shape.angles_rad, atol=1e-9)


def test_a_load_row_by_row_is_the_same_as_one_value():
    spread = np.array([0.5, -1.0])
    one, rows = (solve_static(full(), np.zeros(2), distributed_n_per_m=q) for q in (spread, np.tile(spread, (61, 1))))
    np.testing.assert_array_equal(one.angles_rad, rows.angles_rad)
