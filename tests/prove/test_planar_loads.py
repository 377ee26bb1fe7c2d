"""The planar rod under 100,000 random loads from a cold start: none is lost, and each says on which branch it lies."""

import pytest
from bench.planar_loads import RODS, measure


@pytest.mark.slow
@pytest.mark.parametrize("name", RODS)
def test_no_load_is_lost_and_each_shape_knows_its_branch(name: str) -> None:
    rod, seed = RODS[name]
    figures = measure(rod, seed)
    count = figures["count"]
    assert count == 100_000
    assert figures["unconverged"] == 0
    assert figures["worst_residual"] < 1e-9
    assert figures["worst_residual_by_numpy"] < 1e-9
    assert figures["stable"] == count
    assert figures["unloaded_branch"] + figures["fallen"] == count
    assert 100 < figures["fallen"] < 0.02 * count
    assert figures["fallen_without_a_jump_in_the_walk"] == 0
    assert figures["walked_to_another_shape"] == 0
    assert figures["walked_with_a_jump"] < 0.003 * figures["walked"]
