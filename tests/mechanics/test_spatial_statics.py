import itertools
import math

import numpy as np
import pytest
from bench.published import BEND_45, CANTILEVER
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import Branch, PlanarRod, SpatialRod, solve_static_spatial

vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)
rods = st.builds(
    SpatialRod,
    flexible_length_m=st.floats(0.035, 0.065),
    bending_stiffness_nm2=st.floats(3e-4, 9e-4),
    rigid_length_m=st.sampled_from([0.0, 0.008]),
    torsional_stiffness_nm2=st.floats(2e-4, 9e-4),
    precurvature_per_m=vectors.map(lambda v: v * [3, 15, 15]),
    stiffening_curvature_per_m=st.sampled_from([math.inf, 40.0]),
    stiffness_profile=st.sampled_from([None, np.linspace(1.3, 0.8, 31)]),
    segments=st.just(30),
)
forces = vectors.map(lambda v: 0.25 * v)


def moments_at_joints(shape):
    """(segments + 1, 3): what each joint carries, base frame, from the strain alone, and the joints' places."""
    rod, frames = shape.rod, shape.frames
    before = np.concatenate([np.eye(3)[None], frames[:-1]])
    turns = Rotation.from_matrix(np.swapaxes(before, 1, 2) @ frames).as_rotvec()
    u, rest = turns / rod.joint_spans_m[:, None], rod.precurvature_per_m
    b, b0 = u[:, 1:], rest[:, 1:]
    soft = rod.stiffening_curvature_per_m**-2
    both, now = np.sum(b * b0, 1, keepdims=True), np.sum(b * b, 1, keepdims=True)
    bending = b - b0 + soft * (now * b - (now * b0 + 2 * both * b) / 3)
    moment = np.column_stack([rod.gj_nm2 * (u[:, 0] - rest[:, 0]), rod.bending_stiffness_nm2 * bending])
    moment *= rod.stiffness_profile[:, None]
    # The moment that does work on the rotation vector's rate, turned into the one that does so on the spin's.
    spin = []
    for turn, value in zip(turns, moment, strict=True):
        angle = np.linalg.norm(turn)
        factor = 1 / 12 if angle < 1e-4 else (1 - angle / 2 / math.tan(angle / 2)) / angle**2
        spin.append(value + np.cross(turn, value) / 2 + factor * np.cross(turn, np.cross(turn, value)))
    return np.einsum("kij,kj->ki", before, np.array(spin))


@pytest.mark.parametrize("alpha", CANTILEVER)
def test_published_cantilever_is_met_by_extrapolation(alpha):
    direction = np.array([0.0, math.cos(0.7), math.sin(0.7)])

    def tip(segments):
        x, *across = solve_static_spatial(SpatialRod(1.0, 1.0, segments=segments), alpha * direction).tip_m
        return np.array([direction[1:] @ across, 1 - x])

    np.testing.assert_allclose((4 * tip(100) - tip(50)) / 3, CANTILEVER[alpha][:2], atol=1e-5)


@pytest.mark.parametrize("torsion", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_a_moment_in_space_winds_the_rod_to_a_helix(torsion, order):
    # M = (3, 0, 4), EI = 2, length 2: exact tips for a tangent along x and, axes renamed, along z.
    exact = {0: (0.47451539, 0.22922810, 1.14411346), 2: (1.14411346, -0.17192108, 1.14191490)}[order[0]]
    tips = []
    for segments in (80, 160, 320, 640):
        rod = SpatialRod(2.0, 2.0, torsional_stiffness_nm2=torsion, segments=segments)
        shape = solve_static_spatial(rod, np.zeros(3), np.array([3.0, 0.0, 4.0])[order])
        assert shape.converged
        tips.append(shape.tip_m)
    for level in range(1, 4):  # Romberg: the error is a series in the square of the segment's length
        tips = [fine + (fine - coarse) / (4**level - 1) for coarse, fine in itertools.pairwise(tips)]
    np.testing.assert_allclose(tips[0], np.array(exact)[order], atol=1e-8)


@pytest.mark.parametrize("load", BEND_45)
def test_the_45_degree_bend_is_met(load):
    rod = SpatialRod(100 * math.pi / 4, 8.333e5, 0.0, 8.333e5, np.array([0, 0, 0.01]), segments=100)
    x, y, z = solve_static_spatial(rod, np.array([0.0, 0.0, load])).tip_m
    np.testing.assert_allclose([y, x, z], BEND_45[load], atol=0.02)


def test_error_falls_with_the_square_of_the_segment_length():
    def tip(segments):
        profile = np.linspace(1.3, 0.8, segments + 1)
        rod = SpatialRod(1.0, 1.0, 0.1, 0.6, np.array([0.5, 1.0, 0.4]), 4.0, profile, segments)
        return solve_static_spatial(
            rod, np.array([-0.5, 1.0, 2.0]), np.array([0.2, 0.1, -0.3]), np.array([0, 1, -0.5])
        ).tip_m

    exact = (4 * tip(400) - tip(200)) / 3
    errors = [np.abs(tip(n) - exact).max() for n in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)


@settings(max_examples=40)
@given(
    st.tuples(*[st.floats(-0.2, 0.2)] * 2), st.floats(-20, 20), st.sampled_from([math.inf, 40.0]), st.floats(0.02, 0.06)
)
def test_in_the_plane_it_is_the_planar_rod(force, curvature, softness, length):
    flat = solve_static(PlanarRod(length, 4.3e-4, 0.008, curvature, softness), np.array(force))
    rod = SpatialRod(length, 4.3e-4, 0.008, None, np.array([0, 0, curvature]), softness)
    shape = solve_static_spatial(rod, np.array([*force, 0.0]))
    assert shape.converged
    if shape.branch is Branch.UNLOADED and flat.converged:
        np.testing.assert_allclose(shape.tip_m, [*flat.tip_m, 0.0], atol=1e-9)


@settings(max_examples=60)
@given(rods, forces, vectors.map(lambda v: 2e-3 * v), vectors)
def test_every_joint_carries_the_moment_of_the_loads_beyond_it(rod, force, moment, line):
    shape = solve_static_spatial(rod, force, moment, line)
    assert shape.converged
    assert shape.residual < 1e-9
    nodes = rod.nodes_m(shape.quaternions)
    middles = (nodes[1:] + nodes[:-1]) / 2
    lengths = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    carried = moments_at_joints(shape)
    for joint in (0, 7, 30):
        arms = middles[joint:] - nodes[joint]
        wanted = (
            moment + np.cross(nodes[-1] - nodes[joint], force) + np.cross(arms, line * lengths[joint:, None]).sum(0)
        )
        np.testing.assert_allclose(carried[joint], wanted, atol=1e-11)


@settings(max_examples=40)
@given(rods, forces, vectors.map(lambda v: 2e-3 * v), st.floats(-math.pi, math.pi))
def test_turning_the_bench_about_the_base_tangent_turns_the_shape(rod, force, moment, angle):
    turn = Rotation.from_rotvec([angle, 0, 0]).as_matrix()
    turned = SpatialRod(
        rod.flexible_length_m,
        rod.bending_stiffness_nm2,
        rod.rigid_length_m,
        rod.torsional_stiffness_nm2,
        rod.precurvature_per_m @ turn.T,
        rod.stiffening_curvature_per_m,
        rod.stiffness_profile,
        rod.segments,
    )
    here, there = solve_static_spatial(rod, force, moment), solve_static_spatial(turned, turn @ force, turn @ moment)
    if here.branch is there.branch is Branch.UNLOADED:
        np.testing.assert_allclose(there.tip_m, turn @ here.tip_m, atol=1e-8)
        np.testing.assert_allclose(there.frames, turn @ here.frames @ turn.T, atol=1e-6)


@settings(max_examples=30)
@given(rods, forces)
def test_the_loads_path_does_the_work_that_the_rod_stores(rod, force):
    # The force raised in small steps does the elastic energy's work; the energy comes from the joints' strains.
    shares, shape, work, tip = np.linspace(0, 1, 201), None, 0.0, None
    for share in shares:
        shape = solve_static_spatial(rod, 0.3 * share * force, start=shape)
        if tip is not None:
            work += 0.3 * (share - 0.5 * shares[1]) * force @ (shape.tip_m - tip)
        tip = shape.tip_m
    frames = np.concatenate([np.eye(3)[None], shape.frames])
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).as_rotvec()
    u, rest = turns / rod.joint_spans_m[:, None], rod.precurvature_per_m
    b, b0, soft = u[:, 1:], rest[:, 1:], rod.stiffening_curvature_per_m**-2
    density = np.sum((b - b0) ** 2, 1) / 2
    now, then, both = np.sum(b * b, 1), np.sum(b0 * b0, 1), np.sum(b * b0, 1)
    density += soft * (now**2 / 4 - both * now / 3 + then**2 / 12)
    density = rod.bending_stiffness_nm2 * density + rod.gj_nm2 * (u[:, 0] - rest[:, 0]) ** 2 / 2
    stored = np.sum(density * rod.stiffness_profile * rod.joint_spans_m)
    assert work == pytest.approx(stored, rel=1e-3, abs=1e-12)


@settings(max_examples=30)
@given(rods, vectors)
def test_a_warm_start_ends_where_continuation_ends(rod, direction):
    force = 0.06 * direction
    cold = solve_static_spatial(rod, force)
    warm = solve_static_spatial(rod, force, start=solve_static_spatial(rod, 0.95 * force))
    assert warm.branch is Branch.GIVEN
    assert warm.on_unloaded_branch()
    np.testing.assert_allclose(warm.tip_m, cold.tip_m, atol=1e-9)


@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.02, False)])
def test_euler_column_loses_its_stability_at_the_buckling_load(share, stable):
    critical = math.pi**2 * 4.3e-4 / (4 * 0.065**2)
    shape = solve_static_spatial(SpatialRod(0.065, 4.3e-4), np.array([-share * critical, 0.0, 0.0]))
    assert shape.converged
    assert shape.stable is stable


@pytest.mark.parametrize("beyond", [1.1, 1.5, 3.0])
def test_a_slightly_bent_column_buckles_out_of_its_plane_of_least_resistance(beyond):
    # Bent about y: with gravity sideways the shape leaves both planes; the load path stays on one branch.
    critical = math.pi**2 * 4.3e-4 / (4 * 0.065**2)
    rod = SpatialRod(0.065, 4.3e-4, precurvature_per_m=np.array([0, -0.5, 0.0]))
    shape = solve_static_spatial(rod, np.array([-beyond * critical, 0, 0]), distributed_n_per_m=np.array([0, 0.02, 0]))
    assert shape.converged
    assert shape.stable
    assert shape.branch is Branch.UNLOADED
    assert shape.tip_m[2] > 0.005
    assert shape.tip_m[1] > 1e-4


def test_its_own_weight_bends_it_as_the_linear_beam_says():
    rod = SpatialRod(0.05, 4.3e-4, segments=200)
    shape = solve_static_spatial(rod, np.zeros(3), distributed_n_per_m=np.array([0, 0, -1e-3]))
    assert shape.tip_m[2] == pytest.approx(-1e-3 * 0.05**4 / (8 * 4.3e-4), rel=1e-4)


def test_moment_over_curvature_follows_the_stiffening_in_any_plane():
    turn = Rotation.from_rotvec([1.1, 0, 0]).as_matrix()
    rod = SpatialRod(0.04, 4.3e-4, precurvature_per_m=turn @ [0, 0, 5.0], stiffening_curvature_per_m=40.0)
    shape = solve_static_spatial(rod, np.zeros(3), turn @ [0, 0, 0.012])
    curvature = np.arccos(shape.frames[-1, 0, 0]) / 0.04
    assert 4.3e-4 * (1 + (curvature / 40) ** 2) * (curvature - 5.0) == pytest.approx(0.012, rel=1e-8)


def test_a_rigid_tip_acts_as_a_lever():
    force = np.array([-0.1, -0.1, 0.08])
    whole = solve_static_spatial(SpatialRod(0.04, 4.3e-4, 0.008, None, np.array([0, 2.0, 5.0])), force)
    lever = 0.008 * whole.frames[-1, :, 0]
    shaft = solve_static_spatial(
        SpatialRod(0.04, 4.3e-4, 0.0, None, np.array([0, 2.0, 5.0])), force, np.cross(lever, force)
    )
    np.testing.assert_allclose(shaft.frames, whole.frames, atol=1e-8)


def test_centreline_is_uniform_and_ends_at_the_tip():
    rod = SpatialRod(0.0393, 4.3e-4, 0.008, None, np.array([0, 3.0, 5.0]))
    shape = solve_static_spatial(rod, np.array([-0.05, -0.1, 0.1]))
    line = shape.centreline_m(97)
    np.testing.assert_allclose(np.linalg.norm(np.diff(line, axis=0), axis=1), rod.length_m / 96, rtol=2e-4)
    np.testing.assert_allclose(line[[0, -1]], [[0, 0, 0], shape.tip_m], atol=1e-15)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"flexible_length_m": 0.0}, "a rod needs positive"),
        ({"bending_stiffness_nm2": -1.0}, "a rod needs positive"),
        ({"torsional_stiffness_nm2": 0.0}, "a rod needs positive"),
        ({"segments": 3}, "at least 4 segments"),
        ({"stiffness_profile": np.ones(50)}, "stiffness_profile: expected shape"),
        ({"stiffness_profile": -np.ones(51)}, "positive stiffness_profile"),
        ({"precurvature_per_m": np.zeros((50, 3))}, "precurvature_per_m: expected shape"),
        ({"precurvature_per_m": np.array([0, 50.0, 50.0]), "stiffening_curvature_per_m": 40.0}, "must stay below"),
    ],
)
def test_impossible_rods_are_refused(wrong, says):
    with pytest.raises(ValueError, match=says):
        SpatialRod(**{"flexible_length_m": 0.04, "bending_stiffness_nm2": 4e-4, **wrong})


def test_a_force_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match="force_n"):
        solve_static_spatial(SpatialRod(0.04, 4e-4), np.zeros(2))
