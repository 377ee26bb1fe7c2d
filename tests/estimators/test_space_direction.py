"""`rod-3d`: the direction of the force, which the instants of one contact share, and friction beside it."""

import math

import numpy as np
import pytest
from tests.estimators.test_rod_3d import FORCE_N, INFO, KNOB_DEG, nodes_m, seen, session

from tipforce.estimators.space import SpaceSettings
from tipforce.estimators.space._direction import SpaceDirection
from tipforce.estimators.space._filter import SpaceFilter, SpaceResult
from tipforce.types import FloatArray

AXIS = np.array([1.0, 0.0, 0.0])
BOTH = ("a", "b")
FROM_SIDE_RAD = math.radians(-4.0)
"""Direction of a force that pulls at the bent tip, to the side of the unloaded one."""


def unit(degrees: float, turn_deg: float = 0.0) -> FloatArray:
    """Returns the unit vector of a push at ``degrees`` from `AXIS`, turned about it."""
    angle, turn = math.radians(degrees), math.radians(turn_deg)
    return np.array([-math.cos(angle), math.sin(angle) * math.cos(turn), math.sin(angle) * math.sin(turn)])


def taught(*pushes: FloatArray, elapsed: float = 0.01) -> SpaceDirection:
    direction = SpaceDirection()
    for push in pushes:
        direction.learn(0.2 * push[None], np.ones(1), elapsed)
    return direction


def densities(direction: SpaceDirection, *pushes: FloatArray) -> FloatArray:
    return direction.density(0.1 * np.array(pushes), AXIS)


def test_a_remembered_direction_is_the_likeliest_and_none_is_excluded() -> None:
    same, near, far = densities(taught(*[unit(50.0)] * 20), unit(50.0), unit(60.0), unit(50.0, 180.0))
    assert same > 2.0
    assert same > near > far
    assert far >= 0.1


def test_a_new_direction_takes_the_place_of_the_old_one() -> None:
    old, new = densities(
        taught(*[unit(50.0)] * 20, *[unit(50.0, 180.0)] * 20, elapsed=0.1), unit(50.0), unit(50.0, 180.0)
    )
    assert new > 2.0 * old


def test_nothing_is_known_before_the_first_contact() -> None:
    assert densities(SpaceDirection(), unit(0.0), unit(50.0)).tolist() == [1.0, 1.0]
    assert densities(taught_nothing(), unit(0.0), unit(50.0)).tolist() == [1.0, 1.0]


def taught_nothing() -> SpaceDirection:
    direction = SpaceDirection()
    direction.learn(np.zeros((1, 3)), np.zeros(1), 0.0)
    return direction


def test_the_directions_of_a_push_share_the_probability() -> None:
    """Even in the angle to the axis, and about it: a sample of this prior has a mean density of 1."""
    rng, count = np.random.default_rng(1), 20_000
    pushes = [
        unit(angle, turn) for angle, turn in zip(rng.uniform(0, 106, count), rng.uniform(0, 360, count), strict=True)
    ]
    assert densities(taught(unit(40.0)), *pushes).mean() == pytest.approx(1.0, abs=0.1)


def test_strong_pushes_show_the_direction_of_a_weak_one() -> None:
    """Of a force near nothing the lines show little: with the memory its error across the remembered one is smaller."""
    weak = 0.1 * FORCE_N
    forces = [np.zeros(3)] * 3 + [FORCE_N] * 6 + [weak]
    remembered = session(BOTH, forces, [BOTH] * 10)[-1].force
    rng, model = np.random.default_rng(3), SpaceFilter(SpaceSettings(views=BOTH, direction_s=0.0), 0.5, INFO)
    for k, force in enumerate(forces):
        without = model.step(seen(force, rng), KNOB_DEG, 0.07 if k else 0.0, 0.0).force
    assert remembered.contact > without.contact
    assert np.linalg.norm(remembered.force_n - weak) < np.linalg.norm(without.force_n - weak)


def tip_axis(force_n: FloatArray) -> FloatArray:
    nodes = nodes_m(force_n)
    axis: FloatArray = nodes[-1] - nodes[-2]
    return axis / np.linalg.norm(axis)


def test_friction_may_pull_a_little_along_the_tip() -> None:
    axis = tip_axis(np.zeros(3))
    side = np.cross(axis, [0.0, 0.0, 1.0])
    truth = 0.12 * (math.cos(FROM_SIDE_RAD) * side + math.sin(FROM_SIDE_RAD) * axis)
    pull = float(truth @ tip_axis(truth))
    assert 0.1 * 0.12 < pull < 0.29 * 0.12, "the force does not pull at the bent tip as friction does"
    found: SpaceResult = session(BOTH, [np.zeros(3)] * 4 + [truth], [BOTH] * 5)[-1]
    assert found.explained
    for k, value in enumerate((*truth.tolist(), 0.12)):
        assert found.force.low_n[k] - 2e-3 < value < found.force.high_n[k] + 2e-3
