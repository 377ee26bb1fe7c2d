import math

import numpy as np
import pytest
from bench.published import CANTILEVER
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics import Rod, solve_static, solve_static_batch

forces = st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25)).map(np.array)
rods = st.builds(
    Rod,
    flexible_length_m=st.floats(0.035, 0.065),
    bending_stiffness_nm2=st.floats(3e-4, 9e-4),
    rigid_length_m=st.sampled_from([0.0, 0.008]),
    precurvature_per_m=st.floats(-20, 20),
    stiffening_curvature_per_m=st.sampled_from([math.inf, 40.0]),
)


def cantilever(alpha, segments):
    shape = solve_static(Rod(1.0, 1.0, segments=segments), np.array([0.0, alpha]))
    x, y = shape.tip_m
    return np.array([y, 1 - x, shape.tip_angle_rad])


@pytest.mark.parametrize("alpha", CANTILEVER)
def test_published_cantilever_is_met_by_extrapolation(alpha):
    coarse, fine = cantilever(alpha, 50), cantilever(alpha, 100)
    np.testing.assert_allclose((4 * fine - coarse) / 3, CANTILEVER[alpha], atol=1e-5)


def test_error_falls_with_the_square_of_the_segment_length():
    exact = (4 * cantilever(5.0, 400) - cantilever(5.0, 200)) / 3
    errors = [np.abs(cantilever(5.0, n) - exact).max() for n in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)


def test_small_load_gives_the_linear_beam():
    rod = Rod(0.048, 4.3e-4, segments=200)
    shape = solve_static(rod, np.array([0.0, 1e-5]))
    assert shape.tip_m[1] == pytest.approx(1e-5 * 0.048**3 / (3 * 4.3e-4), rel=1e-4)


@pytest.mark.parametrize("moment", [-0.02, 0.001, 0.03])
def test_pure_moment_bends_to_a_circle(moment):
    rod = Rod(0.04, 4.3e-4, precurvature_per_m=5.0)
    shape = solve_static(rod, np.zeros(2), moment)
    curvature = 5.0 + moment / 4.3e-4
    assert shape.tip_angle_rad == pytest.approx(curvature * 0.04, rel=1e-9)
    # O(h^2): the polygon around an arc is longer than the arc by (k h)^2 / 24
    np.testing.assert_allclose(
        shape.tip_m,
        np.array([math.sin(curvature * 0.04), 1 - math.cos(curvature * 0.04)]) / curvature,
        rtol=(curvature * 0.0008) ** 2 / 20 + 1e-9,
    )


def test_moment_over_curvature_follows_the_stiffening():
    rod = Rod(0.04, 4.3e-4, precurvature_per_m=5.0, stiffening_curvature_per_m=40.0)
    shape = solve_static(rod, np.zeros(2), 0.012)
    curvature = shape.tip_angle_rad / 0.04
    assert 4.3e-4 * (1 + (curvature / 40) ** 2) * (curvature - 5.0) == pytest.approx(0.012, rel=1e-8)


@settings(max_examples=60, deadline=None)
@given(rods, forces)
def test_moment_at_the_base_balances_the_tip_load(rod, force):
    shape = solve_static(rod, force)
    assert shape.converged
    curvature = shape.angles_rad[0] / (rod.flexible_length_m / rod.segments / 2)
    stiffer = 1 + (curvature / rod.stiffening_curvature_per_m) ** 2
    moment = rod.bending_stiffness_nm2 * stiffer * (curvature - rod.precurvature_per_m)
    x, y = shape.tip_m
    assert moment == pytest.approx(x * force[1] - y * force[0], abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(rods, forces)
def test_energy_falls_with_the_load_by_the_way_of_the_tip(rod, force):
    # Castigliano's theorem for the energy less the load's work: its slope with the force is minus the tip's place.
    shape, small = solve_static(rod, force), 1e-5
    if not shape.stable or np.linalg.norm(force) > 0.15:
        return  # near a fold the shape runs away from any finite difference
    for axis in range(2):
        step = np.eye(2)[axis] * small
        slope = (
            solve_static(rod, force + step, start=shape).energy_j
            - solve_static(rod, force - step, start=shape).energy_j
        ) / (2 * small)
        assert slope == pytest.approx(-shape.tip_m[axis], abs=2e-7)


@settings(max_examples=30, deadline=None)
@given(rods, forces)
def test_mirrored_rod_under_mirrored_load_has_the_mirrored_shape(rod, force):
    mirrored = Rod(
        rod.flexible_length_m,
        rod.bending_stiffness_nm2,
        rod.rigid_length_m,
        -rod.precurvature_per_m,
        rod.stiffening_curvature_per_m,
    )
    there, here = solve_static(mirrored, force * [1, -1]), solve_static(rod, force)
    np.testing.assert_allclose(there.angles_rad, -here.angles_rad, atol=1e-7)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.3, 3.0), forces)
def test_shape_depends_on_the_load_over_the_stiffness_alone(scale, force):
    small = solve_static(Rod(0.04, 4.3e-4, 0.008, 5.0), force)
    large = solve_static(Rod(0.04 * scale, 4.3e-4, 0.008 * scale, 5.0 / scale), force / scale**2)
    np.testing.assert_allclose(large.angles_rad, small.angles_rad, atol=1e-7)


def test_a_rigid_tip_acts_as_a_lever():
    force = np.array([-0.1, -0.15])
    whole = solve_static(Rod(0.04, 4.3e-4, 0.008, 5.0), force)
    lever = 0.008 * np.array([math.cos(whole.tip_angle_rad), math.sin(whole.tip_angle_rad)])
    shaft = solve_static(Rod(0.04, 4.3e-4, 0.0, 5.0), force, lever[0] * force[1] - lever[1] * force[0])
    np.testing.assert_allclose(shaft.angles_rad, whole.angles_rad, atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(rods, st.floats(0, 2 * math.pi))
def test_a_warm_start_ends_where_continuation_ends(rod, direction):
    force = 0.08 * np.array([math.cos(direction), math.sin(direction)])
    cold = solve_static(rod, force)
    warm = solve_static(rod, force, start=solve_static(rod, 0.95 * force))
    np.testing.assert_allclose(warm.angles_rad, cold.angles_rad, atol=1e-7)


def test_centreline_is_uniform_and_ends_at_the_tip():
    rod = Rod(0.0393, 4.3e-4, 0.008, 5.0)
    shape = solve_static(rod, np.array([-0.05, -0.1]))
    line = rod.centreline_m(shape.angles_rad, 97)
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    np.testing.assert_allclose(steps, rod.length_m / 96, rtol=2e-4)
    np.testing.assert_allclose(line[[0, -1]], [[0, 0], shape.tip_m], atol=1e-15)


@pytest.mark.parametrize(
    "wrong", [{"flexible_length_m": 0.0}, {"bending_stiffness_nm2": -1.0}, {"segments": 3}, {"rigid_length_m": -0.1}]
)
def test_impossible_rods_are_refused(wrong):
    with pytest.raises(ValueError, match="a rod needs"):
        Rod(**{"flexible_length_m": 0.04, "bending_stiffness_nm2": 4e-4, **wrong})


def test_precurvature_beyond_the_stiffening_law_is_refused():
    with pytest.raises(ValueError, match="precurvature_per_m"):
        Rod(0.04, 4e-4, precurvature_per_m=70.0, stiffening_curvature_per_m=40.0)


@pytest.mark.parametrize("name", ["precurvature_per_m", "stiffness_profile"])
def test_rows_of_the_wrong_length_are_refused(name):
    with pytest.raises(ValueError, match=name):
        Rod(0.04, 4e-4, **{name: np.ones(50)}, segments=50)


def test_a_profile_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="stiffness_profile"):
        Rod(0.04, 4e-4, stiffness_profile=np.linspace(1, 0, 51))


def test_a_row_of_equal_values_is_the_same_rod_as_one_value():
    force = np.array([-0.1, 0.12])
    rows = Rod(0.04, 4.3e-4, 0.008, np.full(51, 7.0), 40.0, np.full(51, 1.0))
    np.testing.assert_array_equal(
        solve_static(rows, force).angles_rad, solve_static(Rod(0.04, 4.3e-4, 0.008, 7.0, 40.0), force).angles_rad
    )


@pytest.mark.parametrize("softening", [math.inf, 40.0])
@pytest.mark.parametrize("segments", [4, 5, 7, 8, 49])
def test_any_number_of_segments_is_in_balance_alone_and_side_by_side(segments, softening):
    # the rod is solved from both ends at once: the middle lies differently in odd and even ones
    rod = Rod(0.05, 4.3e-4, 0.008, 8.0, stiffening_curvature_per_m=softening, segments=segments)
    force = np.random.default_rng(segments).uniform(-0.2, 0.2, (11, 2))
    shapes = solve_static_batch(rod, force)
    alone = [solve_static(rod, f) for f in force]
    assert np.abs(shapes.angles_rad - [s.angles_rad for s in alone]).max() < 1e-11
    for shape, (fx, fy) in zip(alone, force, strict=True):
        pull = 0.05 / segments * (np.cos(shape.angles_rad) * fy - np.sin(shape.angles_rad) * fx)
        missing = np.diff(shape.moments_nm) + pull[:-1]
        assert np.abs(missing).max() < 1e-10 * 4.3e-4 / 0.05


def test_many_loads_in_one_call_give_the_shapes_of_single_calls():
    rng = np.random.default_rng(3)
    force, moment, curved = rng.uniform(-0.2, 0.2, (30, 2)), rng.uniform(-0.01, 0.01, 30), rng.uniform(-30, 30, 30)
    rod, weight = Rod(0.04, 4.3e-4, 0.008, 5.0, 40.0), np.array([0.1, -0.3])
    shapes = solve_static_batch(rod, force, moment, weight, curved)
    again = solve_static_batch(rod, force, moment, weight, curved, start=shapes)
    for row in range(30):
        alone = solve_static(Rod(0.04, 4.3e-4, 0.008, curved[row], 40.0), force[row], moment[row], weight)
        np.testing.assert_array_equal(alone.angles_rad, shapes.angles_rad[row])
        assert shapes[row].rod.precurvature_per_m == curved[row]
        assert (alone.branch, alone.energy_j, alone.iterations) == (
            shapes[row].branch,
            shapes[row].energy_j,
            shapes[row].iterations,
        )
    assert len(shapes) == 30
    np.testing.assert_allclose(shapes.tip_m[4], shapes[4].tip_m, atol=1e-15)
    np.testing.assert_array_equal(shapes.centreline_m(9)[4], shapes[4].centreline_m(9))
    np.testing.assert_array_equal(again.angles_rad, shapes.angles_rad)
    assert not again.iterations.any()


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"force_n": np.zeros(2)}, "force_n"),
        ({"force_n": np.full((3, 2), math.nan)}, "force_n"),
        ({"moment_nm": np.zeros(4)}, "moment_nm"),
        ({"moment_nm": math.inf}, "moment_nm"),
        ({"distributed_n_per_m": np.zeros(3)}, "distributed_n_per_m"),
        ({"precurvature_per_m": np.zeros(2)}, "precurvature_per_m"),
        ({"precurvature_per_m": np.full(3, 80.0)}, "precurvature_per_m"),
        ({"start": np.zeros((3, 50))}, "start"),
    ],
)
def test_loads_that_do_not_fit_together_are_refused(wrong, match):
    with pytest.raises(ValueError, match=match):
        solve_static_batch(Rod(0.04, 4.3e-4, stiffening_curvature_per_m=40.0), **{"force_n": np.zeros((3, 2)), **wrong})


def test_points_are_found_at_given_arc_lengths():
    shape = solve_static(Rod(0.04, 4.3e-4, 0.008, 5.0), np.array([-0.1, 0.1]))
    whole = shape.centreline_m(49)
    np.testing.assert_allclose(shape.centreline_m(np.array([0.0, 0.012, 0.048])), whole[[0, 12, 48]], atol=1e-15)
    with pytest.raises(ValueError, match="arc lengths"):
        shape.centreline_m(np.array([0.049]))
