import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics import Rod, Wall, solve_contact, solve_static

ROD = Rod(0.04, 4.3e-4, 0.008, 5.33, 40.0)
RADIUS = 0.00116


def touching_position(wall, rod=ROD):
    """Where the undented surface just meets the unloaded tip."""
    shape = solve_static(rod, np.zeros(2))
    axis = np.array([math.cos(shape.tip_angle_rad), math.sin(shape.tip_angle_rad)])
    ball = shape.tip_m - RADIUS * axis
    return ball @ [math.cos(wall.angle_rad), math.sin(wall.angle_rad)] + RADIUS


def pushed(wall, push, along=None, dt=1e-3):
    push = np.asarray(push, dtype=float)
    return solve_contact(
        ROD, wall, touching_position(wall) - push, np.zeros(push.size) if along is None else along, dt, RADIUS
    )


def test_before_the_wall_is_met_there_is_no_force_and_the_shape_is_the_unloaded_one():
    contact = pushed(Wall(0.5, 120.0, friction=0.2), np.linspace(-0.01, -1e-6, 20))
    assert not contact.touching.any()
    assert not contact.force_n.any()
    np.testing.assert_allclose(contact.angles_rad, np.tile(ROD.unloaded_angles_rad, (20, 1)), atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.2, 1.5), st.floats(0.0, 0.3), st.floats(-1, 1))
def test_the_wall_gives_back_what_the_tip_puts_on_it(angle, friction, sideways):
    wall = Wall(angle, 120.0, friction=friction)
    push = np.linspace(-1e-3, 6e-3, 60)
    contact = pushed(wall, push, sideways * push)
    assert contact.converged.all()
    for row in (20, 40, 59):
        force = contact.force_n[row]
        arm = contact.touch_m[row] - ROD.nodes_m(contact.angles_rad[row])[-1]
        # The same rod under the wall's force as a dead load, moved from the place of touch to the tip's end.
        alone = solve_static(ROD, force, arm[0] * force[1] - arm[1] * force[0], start=contact.angles_rad[row])
        np.testing.assert_allclose(alone.angles_rad, contact.angles_rad[row], atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.2, 1.5), st.floats(0.0, 0.3))
def test_force_obeys_the_walls_laws(angle, friction):
    wall = Wall(angle, 120.0, friction=friction)
    t = np.linspace(0, 2 * np.pi, 400)
    contact = pushed(wall, 4e-3 * (1 - np.cos(2 * t)) - 1e-3, 2e-3 * np.sin(t))
    d = np.array([math.cos(angle), math.sin(angle)])
    normal, drag = -contact.force_n @ d, contact.force_n @ [-d[1], d[0]]
    np.testing.assert_allclose(normal, 120.0 * contact.indentation_m * contact.touching, atol=1e-8)
    assert (normal >= 0).all()
    assert (np.abs(drag) <= friction * normal + 1e-9).all()
    np.testing.assert_allclose(np.abs(drag[contact.slipping]), friction * normal[contact.slipping], atol=1e-8)


def test_without_friction_the_force_is_normal_to_the_wall():
    contact = pushed(Wall(0.7, 120.0), np.linspace(-1e-3, 6e-3, 80))
    np.testing.assert_allclose(contact.force_n @ [-math.sin(0.7), math.cos(0.7)], 0, atol=1e-12)


def test_a_sliding_wall_drags_the_tip_along_and_a_rough_one_takes_it_with_it():
    push = np.full(200, 2e-3)
    push[:20] = np.linspace(-1e-3, 2e-3, 20)
    along = np.concatenate([np.zeros(50), np.linspace(0, 2e-3, 150)])
    tangent = np.array([-math.sin(0.25), math.cos(0.25)])
    walls = (Wall(0.25, 500.0, friction=0.02), Wall(0.25, 500.0, friction=20.0))
    smooth, rough = (pushed(wall, push, along) for wall in walls)
    assert (smooth.force_n @ tangent)[-1] > 0  # the wall moves along +t
    assert smooth.slipping[-1]
    assert not rough.slipping[50:].any()
    ways = [(contact.touch_m[-1] - contact.touch_m[49]) @ tangent for contact in (smooth, rough)]
    assert ways[1] == pytest.approx(2e-3, rel=0.15)  # less what the tissue yields
    assert ways[0] < 0.5 * ways[1]


def test_the_walls_force_leads_its_dent_by_the_loss_angle():
    hertz, loss = 1.2, 0.175
    wall = Wall(0.9, 120.0, damping_ns_per_m=120.0 * loss / (2 * math.pi * hertz))
    t = np.arange(3000) * 1e-3
    contact = pushed(wall, 5e-3 * np.minimum(1, t / 0.2) + 0.2e-3 * np.sin(2 * np.pi * hertz * t), dt=1e-3)
    late = slice(3000 - 2500, 3000)  # three whole beats
    wave = np.exp(-2j * np.pi * hertz * t[late])
    normal = np.linalg.norm(contact.force_n, axis=1)
    lead = np.angle((normal[late] - normal[late].mean()) @ wave) - np.angle(
        (contact.indentation_m[late] - contact.indentation_m[late].mean()) @ wave
    )
    assert math.tan(lead) == pytest.approx(loss, rel=0.02)


def test_a_released_dent_goes_back_with_its_time_constant():
    wall = Wall(0.9, 120.0, damping_ns_per_m=12.0)
    push = np.concatenate([np.linspace(-1e-3, 5e-3, 300), np.full(300, -5e-3)])
    contact = pushed(wall, push)
    assert not contact.touching[300:].any()
    indentation = contact.indentation_m
    assert indentation[299] > 1e-4
    assert indentation[399] / indentation[299] == pytest.approx(math.exp(-1), rel=0.01)


def test_steps_four_times_shorter_give_the_same_force():
    wall = Wall(0.6, 120.0, damping_ns_per_m=2.8, friction=0.2)

    def force(points):
        t = np.linspace(0, 1.6, points)
        contact = pushed(wall, 4e-3 - 5e-3 * np.cos(2 * np.pi * 1.2 * t), 3e-3 * np.sin(7 * t), dt=1.6 / (points - 1))
        return contact.force_n

    # At touch and release the dashpot makes the force jump: there an instant's shift shows, elsewhere nothing may.
    misses = np.abs(force(1601) - force(6401)[::4]).max(axis=1)
    assert np.quantile(misses, 0.99) < 1e-3
    assert misses.max() < 5e-3


def test_unequal_rows_and_impossible_walls_are_refused():
    with pytest.raises(ValueError, match="equally long"):
        solve_contact(ROD, Wall(0.5, 120.0), np.zeros(3), np.zeros(4), 1e-3, RADIUS)
    with pytest.raises(ValueError, match="positive stiffness"):
        Wall(0.5, 0.0)
    with pytest.raises(ValueError, match="tip_radius_m"):
        solve_contact(ROD, Wall(0.5, 120.0), np.zeros(3), np.zeros(3), 1e-3, 0.01)
