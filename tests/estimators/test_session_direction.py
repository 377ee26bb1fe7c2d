"""`rod-track`: the direction of the force, which the frames of one contact share, and friction beside it."""

import math
from functools import cache

import numpy as np
import pytest
from tests.estimators.test_session import FRAME, FRAME_S, SCALE, image_of, see, session

from tipforce.estimators.session import Posterior, SessionFilter
from tipforce.estimators.session._direction import CENTRES_RAD, SessionDirection
from tipforce.estimators.session._walk import DIRECTIONS
from tipforce.types import CentrelinePx, FloatArray

KNOB_DEG = 1.0
"""So the shaft is nearly straight: a push along it bends it little."""


def shares_about(direction_rad: float) -> FloatArray:
    return np.exp(50.0 * (np.cos(CENTRES_RAD - direction_rad) - 1.0))


def most_likely_rad(direction: SessionDirection, tip_rad: float = 0.0) -> float:
    return float(CENTRES_RAD[direction.density(tip_rad).argmax()])


@cache
def image_pushed(size_n: float, angle_rad: float) -> FloatArray:
    return image_of((-size_n * math.cos(angle_rad), size_n * math.sin(angle_rad)), KNOB_DEG)


def pushed(state: SessionFilter, size_n: float, angle_rad: float, elapsed_s: float = FRAME_S) -> Posterior:
    line = FRAME.line(CentrelinePx(image_pushed(size_n, angle_rad)))
    return state.step(line, SCALE, KNOB_DEG, elapsed_s)


def test_a_strong_push_along_the_shaft_shows_the_direction_of_a_weak_one() -> None:
    state = session()
    for _ in range(8):
        pushed(state, 0.35, 0.15)
    after, forgotten = pushed(state, 0.06, 0.15), session()
    for _ in range(8):
        pushed(forgotten, 0.35, 0.15)
    forgotten._direction = SessionDirection()
    without = pushed(forgotten, 0.06, 0.15)
    assert after.force.contact > without.force.contact
    assert abs(np.hypot(*after.force.force_n) - 0.06) < abs(np.hypot(*without.force.force_n) - 0.06)
    assert after.force.low_n[2] <= 0.06 <= after.force.high_n[2]


def test_another_place_of_the_tissue_takes_the_place_of_the_first() -> None:
    state = session()
    for _ in range(10):
        pushed(state, 0.3, 0.2)
    for _ in range(10):
        found = pushed(state, 0.1, -0.8, elapsed_s=0.2)
    assert found.force.low_n[2] < 0.1 < found.force.high_n[2]
    assert found.force.low_n[1] < -0.1 * math.sin(0.8) < found.force.high_n[1]


def test_a_direction_fades_and_none_is_excluded() -> None:
    direction = SessionDirection()
    assert np.all(direction.density(0.0) == 1.0)
    for _ in range(50):
        direction.learn(shares_about(2.5), 1.0 / 600.0)
    assert most_likely_rad(direction) == pytest.approx(2.5, abs=0.05)
    assert direction.density(0.0).min() >= 0.1
    for _ in range(50):
        direction.learn(shares_about(-2.5), 4.0 / 50.0)
    assert most_likely_rad(direction) == pytest.approx(-2.5, abs=0.05)


def test_only_directions_that_push_share_the_probability() -> None:
    direction = SessionDirection()
    direction.learn(shares_about(math.pi), 0.0)
    density = direction.density(0.0)
    assert density[np.abs(CENTRES_RAD) > math.pi / 2.0 - math.atan(0.3)].mean() == pytest.approx(1.0)


def test_a_frame_without_likelihood_teaches_nothing() -> None:
    direction = SessionDirection()
    direction.learn(np.zeros(DIRECTIONS), 0.0)
    assert np.all(direction.density(0.0) == 1.0)


def test_friction_may_pull_a_little_along_the_tip() -> None:
    """The tissue is beside the dome, and friction turns the force away from the shaft."""
    axis_rad, size_n = 0.533 * 10.0 * 0.042 + 0.017, 0.1
    angle = axis_rad - math.radians(90.0)
    truth = np.array([math.cos(angle), math.sin(angle)]) * size_n
    found = see(session(), (float(truth[0]), float(truth[1]))).force
    assert truth @ (math.cos(axis_rad - 0.25), math.sin(axis_rad - 0.25)) > 0.2 * size_n, (
        "it does not pull at the bent tip"
    )
    for k, value in enumerate((*truth.tolist(), size_n)):
        assert found.low_n[k] < value < found.high_n[k]
