"""Forces and energy of one beating contact of the simulated bench."""

import numpy as np
import pytest
from bench.studies.balance import measure

pytestmark = pytest.mark.slow  # `python -m bench.studies.balance` measures the same


@pytest.fixture(scope="module")
def figures():
    return measure(number=0, seconds=9.0, halvings=1)


def test_wall_sensor_and_clamp_carry_the_same_force(figures):
    forces = figures["forces"]
    assert forces["largest_force_n"] > 0.1
    assert 0.05 < forces["slipping"] < forces["touching"] < 0.99
    for name, away in list(forces.items())[4:]:
        assert away < 1e-6, name


def test_what_the_wall_puts_in_is_stored_lost_or_the_integrators_to_a_millionth(figures):
    coarse, fine = figures["energy"]
    assert coarse["rest, worst beat"] < 1e-5
    assert fine["rest, rms of the beats"] < 1e-6
    for row in figures["energy, events resolved"]:
        assert row["rest, worst beat"] < 1e-6
    shares = coarse["share of it"]
    assert shares["tissue's damping"] > 0.01
    assert shares["friction"] > 0.01


def test_the_rest_falls_with_the_square_of_the_step_and_what_the_integrator_loses_with_the_step(figures):
    coarse, fine = figures["energy, events resolved"]
    assert np.log2(coarse["rest, rms of the beats"] / fine["rest, rms of the beats"]) > 1.5
    assert 0.5 < np.log2(coarse["implicit Euler, rms"] / fine["implicit Euler, rms"]) < 1.5
    assert coarse["implicit Euler, rms"] > 1e-5  # without it the balance would not close


def test_where_nothing_happens_even_the_simulations_own_step_closes_to_a_millionth(figures):
    coarse, fine = (row["rest in steps without an event, rms"] for row in figures["energy"])
    assert fine < coarse < 1e-6
    assert all(0 < row["events_a_beat"] < 20 for row in figures["energy"])
