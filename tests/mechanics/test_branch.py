import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics import Branch, Rod, solve_static

ROD = Rod(0.057, 4.3e-4, 0.008)
# A push along the axis and a moment against the sideways force: the moment wins at first, then the force does.
PUSH, MOMENT = np.array([-0.22165, 0.14796]), -0.006339


def walked(rod, force, moment, steps):
    """The shape at the end of many small steps, each from the one before, and the largest change of an angle in one."""
    shape, largest = solve_static(rod, np.zeros(2)), 0.0
    for share in np.arange(1, steps + 1) / steps:
        following = solve_static(rod, share * force, share * moment, start=shape)
        largest = max(largest, float(np.abs(following.angles_rad - shape.angles_rad).max()))
        shape = following
    return shape, largest


@settings(max_examples=15, deadline=None)
@given(st.floats(0, 2 * math.pi), st.floats(0, 12.0), st.floats(-2, 2), st.floats(-48, 48))
def test_a_cold_start_ends_where_many_small_steps_end(direction, alpha, moment, curvature):
    rod = Rod(0.057, 4.3e-4, 0.008, curvature)
    force = alpha * 4.3e-4 / 0.065**2 * np.array([math.cos(direction), math.sin(direction)])
    shape = solve_static(rod, force, moment * 4.3e-4 / 0.065)
    assert shape.converged
    assert shape.residual <= 1e-11
    end, largest = walked(rod, force, moment * 4.3e-4 / 0.065, 150)
    if shape.branch is Branch.UNLOADED and largest < 0.3:
        np.testing.assert_allclose(end.angles_rad, shape.angles_rad, atol=1e-6)
    if shape.branch is Branch.FALLEN:
        assert largest > 0.05


def test_where_the_branch_ends_at_a_fold_the_rod_falls_and_says_so():
    before, after = solve_static(ROD, 0.99 * PUSH, 0.99 * MOMENT), solve_static(ROD, 1.02 * PUSH, 1.02 * MOMENT)
    assert before.branch is Branch.UNLOADED
    assert after.branch is Branch.FALLEN
    assert not after.on_unloaded_branch()
    assert before.stable
    assert after.stable
    assert np.abs(after.angles_rad - before.angles_rad).max() > 0.5
    assert walked(ROD, 1.02 * PUSH, 1.02 * MOMENT, 200)[1] > 0.3


def test_unloading_after_the_fall_goes_back_on_another_branch():
    cold = solve_static(ROD, 0.99 * PUSH, 0.99 * MOMENT)
    back = solve_static(ROD, 0.99 * PUSH, 0.99 * MOMENT, start=solve_static(ROD, 1.02 * PUSH, 1.02 * MOMENT))
    assert back.converged
    assert back.stable
    assert back.branch is Branch.GIVEN
    assert not back.on_unloaded_branch()
    assert np.abs(back.angles_rad - cold.angles_rad).max() > 0.5
    # the fallen shape is the lower one: the rod would not fall upwards
    assert back.energy_j < cold.energy_j


def test_a_start_on_the_unloaded_branch_is_known_again():
    cold = solve_static(ROD, np.array([-0.1, 0.05]))
    warm = solve_static(ROD, np.array([-0.1, 0.05]), start=solve_static(ROD, np.array([-0.09, 0.06])).angles_rad)
    assert cold.on_unloaded_branch()
    assert warm.branch is Branch.GIVEN
    assert warm.on_unloaded_branch()
    assert warm.residual == pytest.approx(0.0, abs=1e-11)
