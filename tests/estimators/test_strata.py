"""Intervals by stratum of the force: what they promise where an estimator reads large forces too small."""

import math

import numpy as np
import pytest

from tipforce.estimators.uncertainty import (
    ForceStrata,
    Interval,
    conformal_interval,
    fit_strata,
    wider_interval,
)


def shrunk(sessions, frames=40, seed=0):
    """Forces, mostly small, read by an estimator that shrinks to the mean, with an error of each session."""
    draw = np.random.default_rng(seed)
    force = np.abs(draw.normal(0, 0.15, (sessions, frames)))
    estimate = np.abs(0.5 * force + 0.04 + draw.normal(0, 0.02, (sessions, 1)) + draw.normal(0, 0.01, force.shape))
    session = np.repeat([f"s{number:03d}" for number in range(sessions)], frames)
    return estimate.ravel(), force.ravel(), session


def inside(ends, force):
    low, high = np.array(ends).T
    return (low <= force) & (force <= high)


def pooled(estimate, force, session):
    known, along = np.array([True, False, False]), force[:, None]
    return conformal_interval(known, estimate[:, None], estimate[:, None] - along, along, session, held_out=True)


def test_large_forces_are_held_though_the_estimator_shrinks_them():
    interval = pooled(*shrunk(30))
    estimate, force, _ = shrunk(200, seed=1)
    old = inside([(max(0, m - interval.magnitude_half_n), m + interval.magnitude_half_n) for m in estimate], force)
    new = inside([interval.magnitude_interval(m) for m in estimate.tolist()], force)
    for low, high in ((0, 0.1), (0.1, 0.2), (0.2, 0.3), (0.3, 9)):
        stratum = (force >= low) & (force < high)
        assert new[stratum].mean() >= 0.88, (low, high)
    assert old[force > 0.3].mean() < 0.4, "one half-width for all hides what it misses"


def test_the_upper_end_is_farther_where_forces_are_read_too_small():
    low, high = fit_strata(*shrunk(30)).interval(0.2)
    assert high - 0.2 > 1.5 * (0.2 - low)


def test_the_estimate_lies_within_its_interval_whatever_the_unit():
    found = fit_strata(*shrunk(12))
    for magnitude in (0.0, 0.05, 0.1, 0.3, 2.0):
        for unit in (1e-6, 0.1, 1.0, 10.0):
            low, high = found.interval(magnitude, unit)
            assert 0 <= low <= magnitude <= high < math.inf


def test_an_interval_in_units_of_the_estimate_grows_with_them():
    estimate, force, session = shrunk(20)
    found = fit_strata(estimate, force, session, np.full(len(force), 0.02))
    assert found.interval(0.2, 0.02) == pytest.approx(fit_strata(estimate, force, session).interval(0.2))
    assert found.interval(0.2, 0.04)[1] > found.interval(0.2, 0.02)[1]


def test_fewer_sessions_give_wider_intervals():
    def width(sessions):
        found = [fit_strata(*shrunk(sessions, seed=seed)).interval(0.15) for seed in range(12)]
        return np.mean([high - low for low, high in found])

    assert width(2) > 1.3 * width(5) > 1.3 * width(40)


def test_a_stratum_that_few_sessions_reach_is_not_narrower_than_the_one_below():
    estimate, force, session = shrunk(30)
    few = force < 0.3
    exact = np.full(200, 0.35)  # of one session, which happens to be read without any error
    found = fit_strata(
        np.concatenate([estimate[few], exact]), np.concatenate([force[few], exact]),
        np.concatenate([session[few], np.full(200, "s000")]),
    )  # fmt: skip
    below, top = found.by_force[-2:]
    assert top[0] <= below[0]
    assert top[1] >= below[1]


def test_small_forces_have_strata_of_their_own():
    estimate, force, session = shrunk(20)
    assert fit_strata(estimate, force, session).edges_n[:4] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert len(fit_strata(0.1 * estimate, 0.1 * force, session).edges_n) == 5
    assert np.isfinite(fit_strata(np.zeros(9), np.zeros(9), np.arange(9).astype(str)).by_force).all()


def test_stored_strata_come_back_and_nonsense_is_refused():
    found = fit_strata(*shrunk(20))
    again = ForceStrata.of(found.values())
    assert again.interval(0.17, 0.5) == found.interval(0.17, 0.5)
    for name, wrong in (
        ("edges_n", [0.0, 0.2, 0.1]), ("edges_n", [0.1]), ("by_force", [[1.0, 0.0]] * 4), ("by_estimate", [[0.0, 1.0]]),
        ("by_force", [[-1.0, math.nan]] * 4), ("edges_n", list(range(100))),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="strata"):
            ForceStrata.of(found.values() | {name: wrong})


def test_intervals_stored_before_there_were_strata_stay_as_they_were():
    interval, known = pooled(*shrunk(12)), np.array([True, False, False])
    values = interval.values()
    assert Interval.of(values, known).magnitude_interval(0.2) == interval.magnitude_interval(0.2)
    del values["strata"]
    half = interval.magnitude_half_n
    assert Interval.of(values, known).magnitude_interval(0.01, 2.0) == (0.0, 0.01 + 2.0 * half)


def test_a_fine_tuned_model_is_no_surer_than_the_one_that_it_began_with():
    known = np.array([True, False, False])
    _, force, session = shrunk(1)
    own, before = pooled(force + 0.001, force, session), pooled(*shrunk(20))
    stored = before.values()
    del stored["strata"]
    for initial in (before, Interval.of(stored, known)):
        found = wider_interval(own, initial)
        for magnitude in (0.05, 0.25):
            low, high = found.magnitude_interval(magnitude)
            for least, most in (own.magnitude_interval(magnitude), initial.magnitude_interval(magnitude)):
                assert low <= least <= most <= high
        assert "fine-tuned from" in found.basis
