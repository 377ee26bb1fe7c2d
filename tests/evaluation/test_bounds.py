"""Errors over their bounds."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.evaluation import Outcome, bound_at, bound_figures


def outcome(force, estimate, index=None):
    n = len(force)
    size = np.linalg.norm(force, axis=1)
    texts = np.full(n, "a")
    return Outcome(
        method="m", protocol="session", index=np.arange(n) if index is None else index, fold=texts, session=texts,
        names=texts, stamp_ns=np.arange(n), reference_n=force, reference_magnitude_n=size, contact=size > 0.01,
        force_n=estimate, magnitude_n=np.linalg.norm(estimate, axis=1), interval_n=np.zeros((n, 3, 2)),
        magnitude_interval_n=np.zeros((n, 2)), status=texts, detail=texts,
    )  # fmt: skip


def made(count=4000, seed=0):
    rng = np.random.default_rng(seed)
    force = np.column_stack([rng.uniform(-0.3, -0.02, (count, 2)), np.zeros(count)])
    bound = np.column_stack([rng.uniform(5e-3, 5e-2, (count, 2)), np.full(count, np.nan)])
    way = force / np.linalg.norm(force, axis=1, keepdims=True)
    bound[:, 2] = np.sqrt(np.sum((way[:, :2] * bound[:, :2]) ** 2, axis=1))
    noise = np.column_stack([bound[:, :2], np.zeros(count)]) * rng.standard_normal((count, 3))
    return force, noise, bound, rng.uniform(0, 90, count)


def test_errors_as_large_as_their_bound_have_the_ratio_one_in_every_bin():
    force, noise, bound, angle = made()
    found = bound_figures(outcome(force, force + noise), bound, angle)
    for quantity in ("x", "y"):
        assert found[quantity]["all"]["n"] == 4000
        assert found[quantity]["all"]["ratio"] == pytest.approx(1.0, abs=0.05)
        assert [row["ratio"] for row in found[quantity]["by_contact_angle"]] == pytest.approx([1.0] * 6, abs=0.15)
    assert found["magnitude"]["all"]["ratio"] == pytest.approx(1.0, abs=0.08)
    assert sum(row["n"] for row in found["x"]["by_contact_angle"]) == 4000
    twice = bound_figures(outcome(force, force + 2 * noise), bound, angle)
    assert twice["x"]["all"]["ratio"] == pytest.approx(2 * found["x"]["all"]["ratio"])


def test_only_answered_samples_in_contact_with_a_bound_count():
    force, noise, bound, _ = made(100)
    estimate = force + noise
    force[:10], estimate[10:30], bound[30:60] = 0.0, np.nan, np.nan
    found = bound_figures(outcome(force, estimate), bound)
    assert found["y"]["all"]["n"] == 40
    assert "by_contact_angle" not in found["y"]
    nothing = bound_figures(outcome(force, estimate), np.full_like(bound, np.nan))
    assert nothing["magnitude"]["all"]["n"] == 0
    assert np.isnan(nothing["magnitude"]["all"]["ratio"])


def test_bounds_are_those_of_the_outcomes_own_samples():
    force, noise, bound, _ = made(100)
    some = np.arange(20, 50)
    part = bound_figures(outcome(force[some], (force + noise)[some], some), bound)
    assert part["x"]["all"]["median_bound_n"] == pytest.approx(np.median(bound[some, 0]))


def test_bounds_find_their_samples_by_session_and_stamp(make_bench):
    planar = make_bench()
    rows = np.flatnonzero(planar.session == planar.sessions[0])
    stamps = np.sort(planar.stamp_ns[rows])
    values = np.arange(3.0 * len(stamps)).reshape(-1, 3) + 1.0
    found = bound_at(planar, {planar.sessions[0]: (stamps + 1_000_000, values)})
    np.testing.assert_array_equal(found[rows[np.argsort(planar.stamp_ns[rows])]], values)
    assert np.isnan(np.delete(found, rows, axis=0)).all()
    with pytest.raises(InputError, match="has a bound"):
        bound_at(planar, {"elsewhere": (stamps, values)})
