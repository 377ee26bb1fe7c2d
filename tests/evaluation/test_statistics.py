"""Statistics by session: bootstrap, Bland-Altman, coverage by stratum."""

import math

import numpy as np
import pytest

from tipforce.evaluation import (
    CONTACT_ANGLE_BINS_DEG,
    COVERAGE_FORCE_BINS_N,
    MIN_SESSIONS,
    Predictions,
    bland_altman,
    bootstrap_mean,
    coverage_by_stratum,
    score,
)


def grouped(sessions, each, between, within, seed=0):
    """Values with a mean of each session and noise of each sample; and the sessions' names."""
    draw = np.random.default_rng(seed)
    means = draw.normal(0, between, sessions)
    values = np.repeat(means, each) + draw.normal(0, within, sessions * each)
    return values, np.repeat([f"s{i:03d}" for i in range(sessions)], each)


def test_the_bootstrap_interval_is_that_of_independent_sessions_not_of_frames():
    values, session = grouped(sessions=40, each=50, between=1.0, within=0.1)
    found = bootstrap_mean(values, session)
    half = 0.5 * (found["high"] - found["low"])
    means = values.reshape(40, 50).mean(axis=1)
    assert half == pytest.approx(1.96 * means.std(ddof=1) / np.sqrt(40), rel=0.1)
    assert half > 4 * 1.96 * values.std() / np.sqrt(len(values)), "frames of a session are not independent"
    assert found["low"] < values.mean() < found["high"]
    assert found["sessions"] == 40


def test_the_bootstrap_interval_holds_the_true_mean_about_as_often_as_it_says():
    held = 0
    for seed in range(200):
        values, session = grouped(sessions=20, each=5, between=1.0, within=0.5, seed=seed)
        found = bootstrap_mean(values, session, resamples=500)
        held += found["low"] <= 0.0 <= found["high"]
    assert 0.87 <= held / 200 <= 0.98


def test_long_sessions_weigh_more_as_in_the_mean_itself():
    values = np.concatenate([np.full(990, 1.0), np.arange(10.0)])
    session = np.concatenate([np.full(990, "long"), [f"s{i}" for i in range(10)]])
    found = bootstrap_mean(values, session)
    assert found["low"] <= values.mean() <= found["high"]
    assert found["low"] >= 0.9


def test_the_same_seed_gives_the_same_interval_and_the_order_of_samples_does_not_matter():
    values, session = grouped(12, 10, 1.0, 1.0)
    order = np.random.default_rng(1).permutation(len(values))
    first = bootstrap_mean(values, session, seed=3)
    assert bootstrap_mean(values, session, seed=3) == first
    again = bootstrap_mean(values[order], session[order], seed=3)
    assert again["low"] == pytest.approx(first["low"])
    assert bootstrap_mean(values, session, seed=4) != first


def test_too_few_sessions_give_no_interval():
    values, session = grouped(MIN_SESSIONS - 1, 100, 1.0, 1.0)
    found = bootstrap_mean(values, session)
    assert math.isnan(found["low"])
    assert math.isnan(found["high"])
    assert found["sessions"] == MIN_SESSIONS - 1
    assert bootstrap_mean(np.full(3, np.nan), np.array(["a", "b", "c"]))["sessions"] == 0


def test_sessions_without_an_estimate_do_not_count():
    values, session = grouped(MIN_SESSIONS + 1, 10, 1.0, 1.0)
    values[session == "s000"] = np.nan
    assert bootstrap_mean(values, session)["sessions"] == MIN_SESSIONS


def test_limits_of_agreement_match_a_calculation_by_hand():
    reference = np.array([0.10, 0.20, 0.30, 0.40])
    estimate = np.array([0.12, 0.20, 0.31, 0.45])
    found = bland_altman(reference, estimate, np.full(4, "s"))
    difference = np.array([0.02, 0.0, 0.01, 0.05])
    assert found["n"] == 4
    assert found["bias_n"] == pytest.approx(0.02)
    assert found["sd_n"] == pytest.approx(difference.std(ddof=1))
    assert found["lower_n"] == pytest.approx(0.02 - 1.96 * difference.std(ddof=1))
    assert found["upper_n"] == pytest.approx(0.02 + 1.96 * difference.std(ddof=1))
    assert found["inside_share"] == 1.0
    assert found["slope"] == pytest.approx(np.polyfit(0.5 * (reference + estimate), difference, 1)[0])
    assert found["between_sd_n"] == 0.0


def test_the_variance_between_sessions_widens_the_limits_of_agreement():
    difference, session = grouped(sessions=300, each=4, between=0.03, within=0.01)
    found = bland_altman(np.full(len(difference), 0.2), 0.2 + difference, session)
    assert found["within_sd_n"] == pytest.approx(0.01, rel=0.05)
    assert found["between_sd_n"] == pytest.approx(0.03, rel=0.1)
    assert found["sd_n"] == pytest.approx(math.hypot(0.01, 0.03), rel=0.1)
    assert found["inside_share"] == pytest.approx(0.95, abs=0.02)


def test_sessions_of_unequal_length_give_the_same_variances():
    draw = np.random.default_rng(0)
    sizes = draw.integers(2, 30, 400)
    session = np.repeat(np.arange(400).astype(str), sizes)
    difference = np.repeat(draw.normal(0, 0.03, 400), sizes) + draw.normal(0, 0.02, sizes.sum())
    found = bland_altman(np.zeros(len(difference)), difference, session)
    assert found["within_sd_n"] == pytest.approx(0.02, rel=0.05)
    assert found["between_sd_n"] == pytest.approx(0.03, rel=0.1)


def test_agreement_of_nothing_has_no_numbers():
    found = bland_altman(np.array([0.1, 0.2]), np.array([np.nan, np.nan]), np.array(["a", "b"]))
    assert found["n"] == 0
    assert math.isnan(found["bias_n"])
    assert math.isnan(found["upper_n"])


def predictions(reference, low, high, session=None, estimate=None):
    """Of magnitudes along x, with these intervals."""
    n = len(reference)
    estimate = 0.5 * (low + high) if estimate is None else estimate
    texts = np.full(n, "a")
    along = np.column_stack([reference, np.zeros((n, 2))])
    return Predictions(
        method="m", protocol="session", index=np.arange(n), fold=texts, session=texts if session is None else session,
        names=texts, stamp_ns=np.arange(n), reference_n=along, reference_magnitude_n=reference,
        contact=reference > 0.01, force_n=np.column_stack([estimate, np.zeros((n, 2))]), magnitude_n=estimate,
        interval_n=np.zeros((n, 3, 2)), magnitude_interval_n=np.column_stack([low, high]), status=texts, detail=texts,
        shape=np.full(n, None),
    )  # fmt: skip


def test_coverage_by_stratum_counts_what_lies_inside_each():
    reference = np.array([0.02, 0.04, 0.1, 0.15, 0.35, 0.35])
    low = np.array([0.0, 0.05, 0.1, 0.0, 0.0, np.nan])
    high = np.array([0.03, 0.06, 0.2, 0.1, np.inf, np.nan])
    found = coverage_by_stratum(
        predictions(reference, low, high, estimate=np.array([0.02, 0.05, 0.12, 0.05, 0.3, np.nan])),
        reference, COVERAGE_FORCE_BINS_N, "n",
    )  # fmt: skip
    assert [(part["from_n"], part["below_n"]) for part in found] == [(0.0, 0.05), (0.1, 0.2), (0.3, 0.4)]
    assert [part["samples"] for part in found] == [2, 2, 2]
    assert [part["intervals"] for part in found] == [2, 2, 1]
    assert [part["coverage"] for part in found] == [0.5, 0.5, 1.0]
    assert [part["abstained_share"] for part in found] == [0.0, 0.0, 0.5]
    assert found[0]["width_n"] == pytest.approx(0.02)
    assert found[2]["width_n"] == math.inf
    assert found[0]["bias_n"] == pytest.approx(0.005)
    assert found[0]["mae_n"] == pytest.approx(0.005)
    assert all(math.isnan(part["coverage_ci95"][0]) for part in found), "one session alone"


def test_coverage_of_a_stratum_has_a_confidence_interval_from_its_own_sessions():
    draw = np.random.default_rng(0)
    reference = np.tile(np.linspace(0.0, 0.39, 40), 10)
    session = np.repeat([f"s{i}" for i in range(10)], 40)
    noise = draw.normal(0, 0.02, 400)
    found = coverage_by_stratum(
        predictions(reference, reference + noise - 0.033, reference + noise + 0.033, session),
        reference, COVERAGE_FORCE_BINS_N, "n",
    )  # fmt: skip
    assert sum(part["samples"] for part in found) == 400
    for part in found:
        low, high = part["coverage_ci95"]
        assert part["sessions"] == 10
        assert low <= part["coverage"] <= high
        assert 0.75 < part["coverage"] <= 1.0


def test_the_last_edge_belongs_to_the_last_stratum():
    angle = np.array([0.0, 15.0, 90.0, np.nan])
    reference = np.full(4, 0.2)
    found = coverage_by_stratum(
        predictions(reference, reference - 0.1, reference + 0.1), angle, CONTACT_ANGLE_BINS_DEG, "deg"
    )
    assert [(part["from_deg"], part["samples"]) for part in found] == [(0.0, 1), (15.0, 1), (75.0, 1)]


def test_a_score_holds_interval_agreement_and_coverage():
    reference = np.tile(np.linspace(0.0, 0.39, 40), 10)
    session = np.repeat([f"s{i}" for i in range(10)], 40)
    some = predictions(reference, reference - 0.1, reference + 0.1, session, reference + 0.01)
    angle = np.linspace(0, 89, 400)
    found = score(some, contact_angle_deg=angle)
    magnitude = found["quantities"]["magnitude"]
    assert magnitude["mae_ci95_n"] == pytest.approx([0.01, 0.01])
    assert magnitude["mae_ci95_sessions"] == 10
    assert magnitude["bland_altman"]["bias_n"] == pytest.approx(0.01)
    assert sum(part["samples"] for part in found["coverage_by_force"]) == 400
    assert sum(part["samples"] for part in found["coverage_by_contact_angle"]) == int(some.contact.sum())
    assert "coverage_by_contact_angle" not in score(some)
