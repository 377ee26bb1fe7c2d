import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import (
    PlanarRod,
    SpatialContactSolver,
    SpatialRod,
    SpatialWall,
    damping_of_loss_factor,
    solve_static_spatial,
)
from tipforce.mechanics.spatial._energy import exponential_spring

ROD = SpatialRod(0.04, 4.3e-4, 0.008, None, np.array([0.0, 1.2, 5.33]), 40.0, segments=40)
RADIUS = 0.00116
GRAVITY = np.array([0.0, 0.0, -0.3])


def solve_contact(rod, wall, wall_m, dt_s, tip_radius_m, *, change=None, advance_m=None, **more):
    """The rod while the wall moves, from hanging free."""
    return SpatialContactSolver(rod, wall, dt_s, tip_radius_m, **more).run(wall_m, change, advance_m)


def meeting_point(normal, rod=ROD, load=None):
    """A point of the undented surface that just meets the unloaded tip."""
    shape = solve_static_spatial(rod, np.zeros(3), distributed_n_per_m=load)
    return shape.tip_m - RADIUS * shape.frames[-1, :, 0] + RADIUS * normal


def pushed(wall, push, along=0.0, dt=1e-3, rod=ROD, load=None, **more):
    """``push`` (m,): how far the surface has come toward the rod; ``along`` (m, 2): in its own plane."""
    along = np.zeros((len(push), 2)) + along
    way = -np.asarray(push)[:, None] * wall.normal + along @ wall.axes[1:]
    meet = meeting_point(wall.normal, rod, load)
    return solve_contact(rod, wall, meet + way, dt, RADIUS, distributed_n_per_m=load, **more)


def beating(seconds=1.7, dt=1e-3, hz=1.2, lateral=2e-3):
    t = np.arange(round(seconds / dt)) * dt
    along = lateral * np.stack([np.sin(2 * np.pi * hz * t + 1), np.cos(2 * np.pi * hz * t)], axis=1)
    return 2.5e-3 - 4e-3 * np.cos(2 * np.pi * hz * t), along


def tangential(contact):
    """(m,) normal force and (m, 2) force along the wall."""
    parts = contact.force_n @ contact.wall.axes.T
    return -parts[:, 0], parts[:, 1:]


normals = st.tuples(st.floats(0.2, 1.3), st.floats(-0.4, 0.4)).map(
    lambda a: np.array([math.cos(a[0]) * math.cos(a[1]), math.sin(a[0]) * math.cos(a[1]), math.sin(a[1])])
)
NORMAL = np.array([0.6, 0.8, 0.1])


def test_before_the_wall_is_met_there_is_no_force_and_the_shape_is_the_unloaded_one():
    contact = pushed(SpatialWall(NORMAL, 120.0, friction=0.2), np.linspace(-0.01, -1e-6, 20))
    assert not contact.touching.any()
    assert not contact.force_n.any()
    np.testing.assert_allclose(contact.quaternions, np.tile(ROD.unloaded_quaternions, (20, 1, 1)), atol=1e-12)


@pytest.mark.parametrize("angle", [0.5, 0.9, 1.3])
def test_in_the_plane_the_rod_stands_under_the_walls_force_as_the_planar_oracle_does(angle):
    rod = SpatialRod(0.04, 4.3e-4, 0.008, None, np.array([0, 0, 5.33]), 40.0, segments=40)
    wall = SpatialWall(np.array([math.cos(angle), math.sin(angle), 0]), 120.0)
    contact = pushed(wall, beating(0.4)[0], rod=rod)
    np.testing.assert_allclose(contact.force_n, -120.0 * contact.indentation_m[:, None] * wall.normal, atol=1e-9)
    flat = PlanarRod(0.04, 4.3e-4, 0.008 - RADIUS, 5.33, 40.0, segments=40)  # pushed in the middle of its dome
    for row in np.flatnonzero(contact.touching)[::40]:
        middle = solve_static(flat, contact.force_n[row, :2]).tip_m
        np.testing.assert_allclose(contact.touch_m[row, :2], middle + RADIUS * wall.normal[:2], atol=1e-9)


@settings(max_examples=25)
@given(normals, st.floats(0.0, 0.3), st.sampled_from([None, 2e-3]))
def test_the_clamp_takes_what_wall_and_weight_put_on_the_rod(normal, friction, hertz):
    wall = SpatialWall(normal, 120.0, 2.8, friction, hertz_depth_m=hertz)
    push, along = beating(0.9)
    contact = pushed(wall, push, along, load=GRAVITY)
    assert contact.converged.all()
    force = contact.reaction_force_n + contact.force_n + GRAVITY * ROD.length_m
    np.testing.assert_allclose(force, 0, atol=1e-12)
    # The moment at the clamp comes from the strain there: it must be that of all loads. Friction acts on the point of
    # the dome that was expected to touch, which may lie micrometres beside the one that does.
    nodes = contact.nodes_m()
    weights = np.linalg.norm(np.diff(nodes, axis=1), axis=2)[..., None] * GRAVITY
    moment = np.cross(contact.touch_m, contact.force_n)
    moment += np.cross((nodes[:, 1:] + nodes[:, :-1]) / 2, weights).sum(axis=1)
    np.testing.assert_allclose(contact.reaction_moment_nm, -moment, atol=1e-10 if friction == 0.0 else 5e-7)
    assert np.quantile(np.abs(contact.reaction_moment_nm + moment), 0.95) < 1e-9


@settings(max_examples=15)
@given(normals, st.floats(0.02, 0.3))
def test_the_rod_under_the_walls_force_alone_has_the_same_shape(normal, friction):
    push, along = beating(0.5)
    contact = pushed(SpatialWall(normal, 120.0, friction=friction), push, along)
    for row in (250, 499):
        if not contact.stable[row]:
            continue
        arm = contact.touch_m[row] - contact.nodes_m()[row, -1]
        start = solve_static_spatial(ROD, np.zeros(3))
        near = type(start)(
            **{**{n: getattr(start, n) for n in start.__slots__}, "quaternions": contact.quaternions[row]}
        )
        alone = solve_static_spatial(ROD, contact.force_n[row], np.cross(arm, contact.force_n[row]), start=near)
        np.testing.assert_allclose(alone.tip_m, contact.nodes_m()[row, -1], atol=3e-6)


@settings(max_examples=25)
@given(normals, st.floats(0.0, 0.3), st.sampled_from([None, 2e-3]))
def test_force_obeys_the_walls_laws(normal, friction, hertz):
    wall = SpatialWall(normal, 120.0, friction=friction, hertz_depth_m=hertz)
    push, along = beating(0.9)
    contact = pushed(wall, push, along)
    normal_n, drag = tangential(contact)
    depth = contact.indentation_m * contact.touching
    np.testing.assert_allclose(normal_n, 120.0 * depth * (1 if hertz is None else np.sqrt(depth / hertz)), atol=1e-9)
    assert (normal_n >= 0).all()
    pull = np.linalg.norm(drag, axis=1)
    assert (pull <= friction * normal_n + 1e-9).all()
    np.testing.assert_allclose(pull[contact.slipping], friction * normal_n[contact.slipping], atol=1e-9)


@pytest.mark.parametrize("depth", [0.1e-3, 2e-3, 11.9e-3, 12.1e-3, 0.3])
def test_an_exponential_spring_is_the_slope_of_its_energy_and_never_overflows(depth):
    stiffness, reach, off = 120.0, 2e-3, 1e-8
    force, slope, _ = exponential_spring(stiffness, 1 / reach, depth)
    below, above = (exponential_spring(stiffness, 1 / reach, depth + way) for way in (-off, off))
    assert (above[2] - below[2]) / (2 * off) == pytest.approx(force, rel=1e-6)
    assert (above[0] - below[0]) / (2 * off) == pytest.approx(slope, rel=1e-6)
    if depth <= 12e-3:
        assert force == pytest.approx(stiffness * reach * math.expm1(depth / reach) / (math.e - 1))


@pytest.mark.parametrize("damping", [0.0, 2.8])
def test_tissue_that_stiffens_exponentially_presses_as_its_law_says(damping):
    wall = SpatialWall(NORMAL, 120.0, damping, 0.1, exponential_depth_m=2e-3)
    push, along = beating(0.9)
    contact = pushed(wall, push, along)
    assert contact.converged.all()
    pressed, _ = tangential(contact)
    depth = contact.indentation_m
    spring = 120.0 * 2e-3 * np.expm1(depth / 2e-3) / (math.e - 1)
    rate = np.diff(depth, prepend=0.0) / 1e-3
    np.testing.assert_allclose(pressed, (spring + damping * rate) * contact.touching, atol=1e-8)


@pytest.mark.parametrize("radius", [15e-3, -15e-3])
def test_on_a_round_face_the_dome_sinks_into_a_sphere(radius):
    wall = SpatialWall(NORMAL, 300.0, 1.0, 0.1, face_radius_m=radius)
    push, along = beating(0.9, lateral=4e-3)
    contact = pushed(wall, push, along)
    touching = contact.touching
    assert contact.converged.all()
    assert 0.3 < touching.mean() < 0.9
    # the wall's point at each instant is the sphere's apex
    apex = meeting_point(wall.normal) - push[:, None] * wall.normal + along @ wall.axes[1:]
    dome = contact.nodes_m()[:, -1] - RADIUS * contact.tip_axes(np.arange(len(push)))
    away = np.linalg.norm(dome - apex - radius * wall.normal, axis=1)
    depth = radius + RADIUS - away if radius > 0 else away - abs(radius) + RADIUS
    np.testing.assert_allclose(contact.indentation_m[touching], depth[touching], atol=2e-6)
    normal = wall.normals_at(dome - apex)
    lean = np.degrees(np.arccos(normal[touching] @ wall.normal))
    assert lean.max() > 5
    across = contact.force_n + (normal * contact.force_n).sum(axis=1)[:, None] * -normal
    pressed = -(normal * contact.force_n).sum(axis=1)
    assert (np.linalg.norm(across, axis=1) <= 0.1 * pressed + 1e-3).all()


def test_a_face_of_large_radius_is_flat():
    push, along = beating(0.5)
    flat, round_ = (
        pushed(SpatialWall(NORMAL, 120.0, 2.0, 0.1, face_radius_m=radius), push, along) for radius in (None, 1e4)
    )
    np.testing.assert_allclose(round_.force_n, flat.force_n, atol=1e-7)


def test_a_wall_has_one_law_and_a_face_larger_than_the_tip():
    with pytest.raises(ValueError, match="one law"):
        SpatialWall(NORMAL, 120.0, hertz_depth_m=1e-3, exponential_depth_m=1e-3)
    with pytest.raises(ValueError, match="radius must exceed"):
        SpatialContactSolver(ROD, SpatialWall(NORMAL, 120.0, face_radius_m=-1e-3), 1e-3, RADIUS)


def test_slip_goes_against_the_force_it_meets():
    wall = SpatialWall(NORMAL, 120.0, friction=0.1)
    push, along = beating()
    contact = pushed(wall, push, along)
    way = contact.touch_m @ wall.axes[1:].T - along
    # The dome rolls a little too; where it slips far that is small beside the way it slips.
    fast = contact.slipping[1:] & (np.linalg.norm(np.diff(way, axis=0), axis=1) > 5e-6)
    assert fast.sum() > 200
    steps, drag = np.diff(way, axis=0)[fast], tangential(contact)[1][1:][fast]
    cosine = np.sum(steps * drag, axis=1) / np.linalg.norm(steps, axis=1) / np.linalg.norm(drag, axis=1)
    assert np.median(cosine) < -0.99
    assert np.quantile(cosine, 0.95) < -0.8


@pytest.mark.parametrize("hertz", [None, 2e-3])
@pytest.mark.parametrize(("friction", "damping"), [(0.0, 0.0), (0.0, 2.8), (0.15, 0.0), (0.3, 2.8), (50.0, 0.0)])
def test_over_a_closed_cycle_a_passive_wall_gives_no_energy(hertz, friction, damping):
    wall = SpatialWall(NORMAL, 120.0, damping, friction, hertz_depth_m=hertz)
    push, along = beating(1 / 1.2 * 2, dt=1 / 2400)
    contact = pushed(wall, push, along, dt=1 / 2400)
    wall_way = -push[:, None] * wall.normal + along @ wall.axes[1:]
    # The work that the stage puts in by moving the wall; the rod only stores, so what is left over was dissipated.
    middle = 0.5 * (contact.force_n[1:] + contact.force_n[:-1])
    work = np.cumsum(np.sum(middle * np.diff(wall_way, axis=0), axis=1))
    start, end = 2000 - 1, 4000 - 1  # one whole beat, the second: from free to free
    assert not contact.touching[[start + 1, -1]].any()
    lost, moved = work[end - 1] - work[start], np.ptp(work)
    if friction == damping == 0.0:
        assert abs(lost) < 1e-4 * moved
    elif friction == 50.0:
        assert lost > -1e-3 * moved
    else:
        assert lost > 0.01 * moved


def test_the_walls_force_leads_its_dent_by_the_loss_angle():
    hertz, loss = 1.2, 0.175
    wall = SpatialWall(NORMAL, 120.0, damping_of_loss_factor(120.0, loss, hertz))
    t = np.arange(3000) * 1e-3
    contact = pushed(wall, 5e-3 * np.minimum(1, t / 0.2) + 0.2e-3 * np.sin(2 * np.pi * hertz * t))
    late = slice(500, 3000)  # three whole beats
    wave = np.exp(-2j * np.pi * hertz * t[late])
    force, indentation = (part[late] - part[late].mean() for part in (tangential(contact)[0], contact.indentation_m))
    assert math.tan(np.angle(force @ wave) - np.angle(indentation @ wave)) == pytest.approx(loss, rel=0.02)


@pytest.mark.parametrize("hertz", [None, 2e-3])
def test_a_released_dent_goes_back_as_its_spring_and_dashpot_say(hertz):
    wall = SpatialWall(NORMAL, 120.0, 12.0, hertz_depth_m=hertz)
    contact = pushed(wall, np.concatenate([np.linspace(-1e-3, 5e-3, 300), np.full(300, -9e-3)]))
    assert not contact.touching[300:].any()
    indentation = contact.indentation_m[299:]
    rate = 10.0 if hertz is None else 10.0 / math.sqrt(hertz)
    t = np.arange(301) * 1e-3
    exact = indentation[0] * np.exp(-rate * t) if hertz is None else (indentation[0] ** -0.5 + rate * t / 2) ** -2
    assert indentation[0] > 1e-4
    np.testing.assert_allclose(indentation, exact, rtol=0.02)


def test_a_sticking_tip_rolls_on_its_dome():
    # A rough wall holds the touching point; as the electrode tilts, that point moves by radius x tilt.
    wall = SpatialWall(NORMAL, 2e4, friction=1e4)
    push = np.concatenate([np.linspace(-1e-4, 1e-4, 50), np.full(300, 1e-4)])
    along = np.zeros((350, 2))
    along[50:, 1] = np.linspace(0, 4e-3, 300)
    contact = pushed(wall, push, along)
    assert not contact.slipping[60:].any()
    way = (contact.touch_m @ wall.axes[1:].T)[-1] - (contact.touch_m @ wall.axes[1:].T)[60]
    frames = contact.frames()[60:, -1]
    spins = Rotation.from_matrix(frames[1:] @ np.swapaxes(frames[:-1], 1, 2)).as_rotvec().sum(axis=0)
    carried = along[-1] - along[60]  # less what the tie yields
    rolled = RADIUS * np.cross(spins, wall.normal) @ wall.axes[1:].T
    drag = tangential(contact)[1]
    tie = (drag[60] - drag[-1]) / wall.tangential_n_per_m
    np.testing.assert_allclose(way, carried - rolled + tie, atol=2e-7)
    assert np.linalg.norm(rolled) > 5e-5


def test_turning_everything_about_the_base_tangent_turns_the_force():
    turn = Rotation.from_rotvec([0.7, 0, 0]).as_matrix()
    push, along = beating(0.9)
    wall = SpatialWall(NORMAL, 120.0, 2.8, 0.2)
    here = pushed(wall, push, along)
    turned = SpatialRod(0.04, 4.3e-4, 0.008, None, turn @ ROD.precurvature_per_m[0], 40.0, segments=40)
    other = SpatialWall(turn @ NORMAL, 120.0, 2.8, 0.2)
    way = (-push[:, None] * wall.normal + along @ wall.axes[1:]) @ turn.T
    there = solve_contact(turned, other, turn @ meeting_point(wall.normal) + way, 1e-3, RADIUS)
    np.testing.assert_allclose(there.force_n, here.force_n @ turn.T, atol=1e-7)


def test_step_by_step_is_the_whole_march():
    push, along = beating(0.6)
    wall = SpatialWall(NORMAL, 120.0, 2.8, 0.2)
    way = meeting_point(wall.normal, load=GRAVITY) - push[:, None] * wall.normal + along @ wall.axes[1:]
    change = np.column_stack([0 * push, 0.3 * np.sin(7 * push / 1e-3), push / 1e-3])
    advance = 0.5 * push
    options = {"distributed_n_per_m": GRAVITY, "creep": 0.03, "creep_time_s": 0.1}
    whole = solve_contact(ROD, wall, way, 1e-3, RADIUS, change=change, advance_m=advance, **options)
    live = SpatialContactSolver(ROD, wall, 1e-3, RADIUS, **options)
    for row in range(600):
        now = live.step(way[row], change[row], advance[row])
        np.testing.assert_array_equal(now.force_n[0], whole.force_n[row])
    assert whole.touching.any()


def test_a_step_may_change_on_the_way():
    wall = SpatialWall(NORMAL, 120.0, damping_ns_per_m=2.8, friction=0.2)
    options = {"creep": 0.03, "creep_time_s": 0.2}
    meet, ends = meeting_point(wall.normal), []
    depth = np.linspace(-1e-3, 3e-3, 101)
    for finer in (1, 4):  # from then on the wall stands still, and all that is left is the dashpots' time
        live = SpatialContactSolver(ROD, wall, 1e-3, RADIUS, **options)
        live.run(meet - depth[:, None] * wall.normal)
        live.change_step(4e-3 / finer)
        ends.append(live.run(np.tile(meet - depth[-1] * wall.normal, (25 * finer, 1))))
    coarse, fine = ends
    np.testing.assert_allclose(coarse.force_n[-1], fine.force_n[-1], rtol=2e-3)
    again = SpatialContactSolver(ROD, wall, 1e-3, RADIUS, **options)
    again.run(meet - depth[:, None] * wall.normal)
    same = again.run(np.tile(meet - depth[-1] * wall.normal, (25, 1)))  # a quarter of the time: not yet there
    gap = np.linalg.norm(same.force_n[-1] - fine.force_n[-1])
    assert gap > 5 * np.linalg.norm(coarse.force_n[-1] - fine.force_n[-1])
    with pytest.raises(ValueError, match="dt_s"):
        again.change_step(0.0)


def test_a_step_changed_to_itself_changes_nothing():
    wall = SpatialWall(NORMAL, 120.0, damping_ns_per_m=2.8, friction=0.2)
    push, along = beating(0.5)
    way = meeting_point(wall.normal) - push[:, None] * wall.normal + along @ wall.axes[1:]
    one, two = (SpatialContactSolver(ROD, wall, 1e-3, RADIUS, creep=0.03) for _ in range(2))
    two.change_step(7e-3)
    two.change_step(1e-3)
    np.testing.assert_array_equal(one.run(way).quaternions, two.run(way).quaternions)


def test_advancing_the_clamp_is_the_wall_coming_closer():
    wall = SpatialWall(NORMAL, 120.0, 2.8, 0.2)
    ahead = np.linspace(-2e-3, 5e-3, 400)
    meet = meeting_point(wall.normal)
    moved = solve_contact(ROD, wall, np.tile(meet, (400, 1)), 1e-3, RADIUS, advance_m=ahead)
    still = solve_contact(ROD, wall, meet - ahead[:, None] * [1.0, 0, 0], 1e-3, RADIUS)
    assert moved.touching.any()
    np.testing.assert_allclose(moved.force_n, still.force_n, atol=1e-9)
    np.testing.assert_allclose(moved.touch_m - ahead[:, None] * [1.0, 0, 0], still.touch_m, atol=1e-9)
    np.testing.assert_allclose(moved.nodes_m()[:, 0], ahead[:, None] * [1.0, 0, 0])


def test_without_a_wall_in_reach_the_knob_bends_the_shaft_freely():
    change = np.column_stack([np.zeros(50), np.linspace(0, 3, 50), np.linspace(0, 15, 50)])
    far = np.tile([1.0, 0, 0], (50, 1))
    moved = solve_contact(ROD, SpatialWall(np.array([1.0, 0, 0]), 120.0), far, 1e-3, RADIUS, change=change, creep=0.03)
    bent = SpatialRod(0.04, 4.3e-4, 0.008, None, np.array([0, 4.2, 20.33]), 40.0, segments=40)
    np.testing.assert_allclose(moved.nodes_m()[-1], bent.nodes_m(bent.unloaded_quaternions), atol=1e-12)


def test_a_held_strain_loses_moment_and_a_held_load_gains_strain_by_the_creep():
    rod = SpatialRod(0.04, 4.3e-4, 0.008, segments=40)
    wall = SpatialWall(np.array([0.0, 1.0, 0.0]), 1e6)  # hard: the tip is held where it is
    push = np.concatenate([np.linspace(-1e-5, 3e-3, 20), np.full(3000, 3e-3)])
    force = tangential(pushed(wall, push, rod=rod, creep=0.03, creep_time_s=0.5, dt=1e-3))[0]
    assert force[-1] / force[19] == pytest.approx(1 / 1.03, rel=2e-3)
    fallen = (force[19] - force) / (force[19] - force[-1])
    assert fallen[19 + 500] == pytest.approx(1 - math.exp(-1), abs=0.01)
    slow = tangential(pushed(wall, push, rod=rod))[0]
    assert force[-1] == pytest.approx(slow[-1], rel=1e-3)


def test_creep_loses_energy_over_a_cycle_and_never_gives_any():
    wall = SpatialWall(np.array([0.5, 0.8, 0.2]), 120.0)
    push, _ = beating(1 / 1.2 * 4, dt=1 / 2400)
    contact = pushed(wall, push, dt=1 / 2400, creep=0.1, creep_time_s=0.15)
    work = np.cumsum(-0.5 * np.diff(push) * ((contact.force_n[1:] + contact.force_n[:-1]) @ wall.normal))
    # Seen from the wall the cycle closes at the same indentation, so that what is lost has gone into the shaft.
    loss = [work[(k + 1) * 2000 - 1] - work[k * 2000] for k in (1, 2)]
    assert min(loss) > 0.002 * np.ptp(work)
    assert loss[1] == pytest.approx(loss[0], rel=0.05)


def test_a_shaft_that_lies_on_the_wall_is_held_by_its_side():
    rod = SpatialRod(0.04, 4.3e-4, 0.008, None, np.array([0, 0, 12.0]), segments=40)
    normal = np.array([0.0, -1.0, 0.0])
    push = np.linspace(-1e-3, 11e-3, 300)
    meet = np.array([0.0, -RADIUS - 8e-3, 0.0])
    bare, sided = (
        solve_contact(
            rod, SpatialWall(normal, 120.0, side_stiffness_n_per_m2=side), meet - push[:, None] * normal, 1e-3, RADIUS
        )
        for side in (0.0, 2e4)
    )
    assert not bare.side_force_n.any()
    assert sided.converged.all()
    heights = sided.nodes_m()[:, 1:-1] @ normal + RADIUS - (meet - push[:, None] * normal)[:, None] @ normal
    normal_n = 2e4 * 0.001 * np.maximum(0, heights)
    np.testing.assert_allclose(sided.side_force_n, -normal_n.sum(axis=1)[:, None] * normal, atol=1e-9)
    assert (normal_n[-1] > 0).sum() >= 1
    # The clamp's moment is that of the dome's force and of every node's.
    moment = np.cross(sided.touch_m, sided.force_n)
    moment += np.cross(sided.nodes_m()[:, 1:-1], -normal_n[..., None] * normal).sum(axis=1)
    np.testing.assert_allclose(sided.reaction_moment_nm, -moment, atol=1e-10)


def test_steps_four_times_shorter_give_the_same_force():
    wall = SpatialWall(np.array([0.8, 0.55, 0.1]), 120.0, 2.8, 0.2)

    def force(points):
        t = np.linspace(0, 1.6, points)
        along = 3e-3 * np.stack([np.sin(7 * t), np.sin(5 * t + 1)], axis=1)
        return pushed(wall, 4e-3 - 5e-3 * np.cos(2 * np.pi * 1.2 * t), along, dt=1.6 / (points - 1)).force_n

    # At touch and release the dashpot makes the force jump: there an instant's shift shows, elsewhere nothing may.
    misses = np.abs(force(1601) - force(6401)[::4]).max(axis=1)
    assert np.quantile(misses, 0.99) < 1e-3
    assert misses.max() < 5e-3


def test_impossible_walls_and_unequal_rows_are_refused():
    wall = SpatialWall(NORMAL, 120.0)
    with pytest.raises(ValueError, match=r"wall_m \(m, 3\)"):
        solve_contact(ROD, wall, np.zeros((3, 3)), 1e-3, RADIUS, advance_m=np.zeros(4))
    with pytest.raises(ValueError, match="positive stiffness"):
        SpatialWall(NORMAL, 0.0)
    with pytest.raises(ValueError, match="direction"):
        SpatialWall(np.zeros(3), 120.0)
    with pytest.raises(ValueError, match="tip_radius_m"):
        solve_contact(ROD, wall, np.zeros((3, 3)), 1e-3, 0.01)
    with pytest.raises(ValueError, match="dt_s"):
        solve_contact(ROD, wall, np.zeros((3, 3)), 0.0, RADIUS)
    with pytest.raises(ValueError, match="must stay below"):
        solve_contact(ROD, wall, np.zeros((1, 3)), 1e-3, RADIUS, change=np.array([[0, 0, 90.0]]))
    with pytest.raises(ValueError, match="loss_factor"):
        damping_of_loss_factor(120.0, -1.0, 1.2)
