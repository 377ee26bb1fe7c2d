import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.evaluation import error_metrics, interval_metrics, percent_of_true, score
from tipforce.evaluation._metrics import json_ready
from tipforce.evaluation._predictions import collect, with_reference
from tipforce.types import ForceEstimate, Status


def test_errors_match_a_calculation_by_hand():
    reference = np.array([0.10, 0.20, 0.30, 0.40])
    estimate = np.array([0.11, 0.18, 0.33, 0.40])
    figures = error_metrics(reference, estimate)
    assert figures["n"] == 4
    assert figures["mae_n"] == pytest.approx(0.015)
    assert figures["mse_n2"] == pytest.approx((0.01**2 + 0.02**2 + 0.03**2) / 4)
    assert figures["rmse_n"] == pytest.approx(math.sqrt(0.00035))
    assert figures["max_n"] == pytest.approx(0.03)
    assert figures["min_n"] == pytest.approx(0.0, abs=1e-15)
    assert figures["bias_n"] == pytest.approx(0.005)
    assert figures["r2"] == pytest.approx(1 - 0.00035 / 0.0125)
    assert figures["mae_percent_of_range"] == pytest.approx(5.0)
    assert figures["mean_percent_of_true"] == pytest.approx((10 + 10 + 10 + 0) / 4)
    assert figures["max_percent_of_true"] == pytest.approx(10.0)


def test_grams_are_newtons_over_standard_gravity():
    figures = error_metrics(np.array([0.0]), np.array([0.0980665]))
    assert figures["mae_g"] == pytest.approx(10.0)
    assert figures["bias_g"] == pytest.approx(10.0)


def test_a_refused_sample_does_not_count():
    with_gap = error_metrics(np.array([0.1, 0.2, 0.3]), np.array([0.11, np.nan, 0.3]))
    assert with_gap == error_metrics(np.array([0.1, 0.3]), np.array([0.11, 0.3]))


def test_no_answer_at_all_gives_no_numbers():
    figures = error_metrics(np.array([0.1, 0.2]), np.array([np.nan, np.nan]))
    assert figures.pop("n") == 0
    assert all(math.isnan(value) for value in figures.values())


def test_r2_has_no_meaning_for_a_constant_reference():
    assert math.isnan(error_metrics(np.array([0.2, 0.2]), np.array([0.1, 0.3]))["r2"])


def test_the_mean_of_the_test_part_has_an_r2_of_zero():
    reference = np.array([0.1, 0.2, 0.6])
    assert error_metrics(reference, np.full(3, 0.3))["r2"] == pytest.approx(0.0)


def test_percent_is_positive_for_over_estimation_whatever_the_sign():
    percent = percent_of_true(np.array([0.2, -0.2, 0.2]), np.array([0.22, -0.22, 0.18]))
    assert percent == pytest.approx([10, 10, -10])


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=30),
)
def test_figures_keep_their_order(pairs):
    reference, estimate = np.array(pairs).T
    figures = error_metrics(reference, estimate)
    slack = 1e-12
    assert figures["min_n"] <= figures["mae_n"] + slack
    assert figures["mae_n"] <= figures["rmse_n"] + slack
    assert figures["rmse_n"] <= figures["max_n"] + slack
    assert abs(figures["bias_n"]) <= figures["mae_n"] + slack


def test_coverage_counts_what_lies_inside():
    interval = np.array([[0.0, 0.2], [0.0, 0.2], [0.3, 0.5], [np.nan, np.nan]])
    figures = interval_metrics(np.array([0.1, 0.3, 0.3, 0.1]), interval)
    assert figures["coverage"] == pytest.approx(2 / 3)
    assert figures["width_n"] == pytest.approx(0.2)
    assert figures["unbounded_share"] == 0.0


def test_an_unbounded_interval_covers_everything_and_is_counted_apart():
    interval = np.array([[-np.inf, np.inf], [0.0, 0.2]])
    figures = interval_metrics(np.array([5.0, 0.1]), interval)
    assert figures["coverage"] == 1.0
    assert figures["width_n"] == pytest.approx(0.2)
    assert figures["unbounded_share"] == 0.5


def outcome_of(dataset, magnitudes, statuses=None, contact=None):
    """An outcome whose estimates point along x."""
    nan = np.nan
    estimates = []
    for place, size in enumerate(magnitudes):
        if statuses is not None and statuses[place] is not Status.VALID:
            estimates.append(ForceEstimate.invalid(0, statuses[place], "because"))
            continue
        estimates.append(
            ForceEstimate(
                stamp_ns=0,
                force_n=np.array([size, 0.0, nan]),
                known=np.array([True, True, False]),
                covariance_n2=np.full((3, 3), nan),
                interval_n=np.array([[size - 0.1, size + 0.1], [-0.1, 0.1], [nan, nan]]),
                magnitude_n=size,
                magnitude_interval_n=np.array([size - 0.1, size + 0.1]),
            )
        )
    if contact is None:
        contact = dataset.magnitude_n > 0.01
    return collect("m", "random", "random", dataset, np.arange(len(dataset)), estimates, contact)


def test_refusals_are_counted_by_reason(make_bench):
    data = make_bench(sessions=1, frames=4)
    statuses = [Status.VALID, Status.NO_CATHETER, Status.OUT_OF_DISTRIBUTION, Status.NO_CATHETER]
    figures = score(outcome_of(data, data.magnitude_n, statuses))
    assert figures["abstained_share"] == 0.75
    assert figures["abstained"] == {"no_catheter": 2, "out_of_distribution": 1}
    assert figures["valid"] == 1


def test_refusing_hard_frames_cannot_lower_the_filled_error(make_bench):
    data = make_bench(sessions=1, frames=4)
    statuses = [Status.VALID, Status.VALID, Status.VALID, Status.OUT_OF_DISTRIBUTION]
    fallback = np.full(4, data.magnitude_n[3] + 0.4)
    figures = score(outcome_of(data, data.magnitude_n, statuses), fallback)
    assert figures["quantities"]["magnitude"]["mae_n"] == pytest.approx(0.0)
    assert figures["mae_filled_n"] == pytest.approx(0.1)


def test_frames_with_and_without_contact_are_scored_apart(make_bench):
    data = make_bench(sessions=1, frames=4)
    data.force_n[1] = [0.001, 0.0, np.nan]
    estimates = data.magnitude_n + np.array([0.01, 0.05, 0.01, 0.01])
    apart = score(outcome_of(data, estimates))["by_contact"]
    assert apart["contact"]["quantities"]["magnitude"]["mae_n"] == pytest.approx(0.01)
    assert apart["no_contact"]["quantities"]["magnitude"]["mae_n"] == pytest.approx(0.05)
    assert apart["no_contact"]["samples"] == 1


def test_without_a_free_frame_there_is_no_such_part(make_bench):
    data = make_bench(sessions=1, frames=4)
    assert "by_contact" not in score(outcome_of(data, data.magnitude_n))


def test_force_bins_hold_every_sample_once(make_bench):
    data = make_bench()
    bins = score(outcome_of(data, data.magnitude_n))["by_force"]
    assert sum(part["samples"] for part in bins) == len(data)
    for part in bins:
        assert part["quantities"]["magnitude"]["mae_n"] == pytest.approx(0.0)


def test_scoring_against_the_truth_uses_the_truth(make_bench):
    data = make_bench()
    truth = np.nan_to_num(data.force_n) * 0.5
    against_truth = score(with_reference(outcome_of(data, data.magnitude_n * 0.5), truth))
    assert against_truth["quantities"]["magnitude"]["mae_n"] == pytest.approx(0.0)
    assert score(outcome_of(data, data.magnitude_n * 0.5))["quantities"]["magnitude"]["mae_n"] > 0.05


def test_figures_become_json_without_nan(make_bench):
    data = make_bench(sessions=1, frames=4)
    figures = score(outcome_of(data, data.magnitude_n, [Status.NO_CATHETER] * 4))
    text = json.dumps(json_ready(figures), allow_nan=False)
    assert json.loads(text)["quantities"]["magnitude"]["mae_n"] is None
