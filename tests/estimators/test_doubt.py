"""What a network knows, and what it keeps knowing when it goes on from another one's weights."""

import numpy as np
import pytest

from tipforce.estimators._answers import Interval
from tipforce.estimators.networks._domain import Domain, learn_domain
from tipforce.estimators.networks._doubt import Doubt, learn_doubt
from tipforce.estimators.networks._doubtful import Limits, limits_from, wider

DRAW = np.random.default_rng(0)
MIXING = DRAW.normal(size=(6, 40))


def outputs(count: int, centre: float = 0.0, spread: float = 1.0) -> dict[str, np.ndarray]:
    """Grids near a plane of six directions, and features."""
    grid = DRAW.normal(centre, spread, (count, 6)) @ MIXING + DRAW.normal(0.0, 0.05, (count, 40))
    return {"grid": grid.astype(np.float32), "features": DRAW.normal(size=(count, 8)).astype(np.float32)}


def learnt(centre: float, spread: float, start: Doubt | None = None) -> Doubt:
    kept = outputs(200, centre, spread)
    return learn_doubt(outputs(800, centre, spread), kept, kept["grid"], start)


def test_what_is_like_the_training_is_known_and_what_is_not_is_far():
    doubt = learnt(0.0, 1.0)
    assert np.mean(doubt.domains.distance(outputs(500)["grid"]) <= 1.0) > 0.98
    beside = DRAW.normal(size=(100, 40))  # no combination of the six directions
    assert (doubt.domains.distance(beside) > 1.0).all()
    assert (doubt.domains.distance(outputs(100, centre=8.0)["grid"]) > 1.0).all()


def test_what_differs_along_the_directions_of_the_force_alone_is_known():
    taught, kept = (outputs(count)["grid"] for count in (800, 200))
    whole, beside = learn_domain(taught, kept), learn_domain(taught, kept, 6)
    further = outputs(100, centre=8.0)["grid"]
    assert (whole.distance(further) > 1.0).all()
    assert np.mean(beside.distance(further) <= 1.0) > 0.9
    other = outputs(100)["grid"] + 0.5 * DRAW.normal(size=(100, 40))
    assert (beside.distance(other) > 1.0).all()
    again = Domain.of(beside.arrays())
    assert np.allclose(again.distance(other), beside.distance(other), rtol=1e-3)


def test_one_that_went_on_from_another_still_knows_what_that_one_knew():
    before = learnt(0.0, 1.0)
    narrow = learnt(0.5, 0.1)
    both = learnt(0.5, 0.1, before)
    usual = outputs(500)["grid"]
    assert np.mean(narrow.domains.distance(usual) <= 1.0) < 0.1
    assert np.mean(both.domains.distance(usual) <= 1.0) > 0.98
    assert len(both.domains.each) == 2
    features = outputs(50)["features"].astype(np.float64)
    assert (both.variance(features) < narrow.variance(features)).all()


def test_what_a_network_knew_is_gone_where_it_sees_otherwise():
    assert len(learnt(8.0, 1.0, learnt(0.0, 1.0)).domains.each) == 1


def test_a_doubt_comes_back_from_its_arrays():
    doubt = learnt(0.5, 0.1, learnt(0.0, 1.0))
    again = Doubt.of(doubt.arrays())
    grids = outputs(20)["grid"]
    assert np.allclose(again.domains.distance(grids), doubt.domains.distance(grids), rtol=1e-3)
    with pytest.raises(KeyError):
        Doubt.of({})


def test_limits_are_not_narrowed_by_what_is_learnt_later():
    sigma = np.linspace(0.01, 0.02, 100)
    kept = {"heat": np.linspace(-3.0, -2.0, 100)[:, None, None] * np.ones((1, 20, 20)), "familiar": sigma * 100}
    own = limits_from(kept, sigma, 0.03, map_taught=True, moved_taught=True)
    assert own.familiar == 0.0  # all of it lies above: no more is asked for than what is likelier than not
    assert own.widened(Limits(1.0, 0.05, -2.0)) == Limits(1.0, 0.05, -2.0)
    assert own.widened(Limits(99.0, 0.01, 3.0)) == own
    untaught = limits_from(kept, sigma, 0.03, map_taught=False, moved_taught=False)
    assert untaught.seen == 0.0
    assert untaught.familiar == -np.inf
    assert untaught.widened(own) == own.widened(untaught) == own  # what one was never taught, the other was
    unsure = limits_from(
        {**kept, "familiar": np.linspace(-4.0, 9.0, 1000)}, sigma, 0.03, map_taught=True, moved_taught=True
    )
    assert -4.0 < unsure.familiar < -3.9


def test_the_wider_interval_is_kept_and_says_whose_it_is():
    nan = np.full((3, 3), np.nan)
    ours = Interval(np.array([1.0, 2.0, np.nan]), 1.5, nan, False, "frames", 1, 30)
    other = Interval(np.array([1.5, 1.0, 3.0]), 1.2, nan, True, "whole sessions", 40, 900)
    both = wider(ours, other)
    assert both.half_n.tolist()[:2] == [1.5, 2.0]
    assert np.isnan(both.half_n[2])
    assert both.magnitude_half_n == 1.5
    assert "whole sessions" in both.basis
    assert wider(other, other) is other
