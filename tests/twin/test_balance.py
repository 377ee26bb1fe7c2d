"""Forces and energy of one beating contact of the twin."""

import numpy as np
import pytest
from bench.balance import measure


@pytest.fixture(scope="module")
def figures():
    return measure(number=0, seconds=9.0, halvings=1)


def test_wall_sensor_and_clamp_carry_the_same_force(figures):
    forces = figures["forces"]
    assert forces["largest_force_n"] > 0.1
    assert 0.05 < forces["slipping"] < forces["touching"] < 0.99
    for name, away in list(forces.items())[4:]:
        assert away < 1e-6, name


def test_what_the_wall_puts_in_is_stored_or_lost_to_the_order_of_the_step(figures):
    coarse, fine = (row["rest, rms of the beats"] for row in figures["energy"])
    assert coarse < 3e-4
    assert np.log2(coarse / fine) > 0.8
    lost = figures["energy"][0]["share of it"]
    assert lost["tissue's damping"] > 0.01
    assert lost["friction"] > 0.01
