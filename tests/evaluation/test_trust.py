"""How far answers can be trusted: wrong ones, strata, error over abstention."""

import math

import numpy as np
import pytest

from tipforce.evaluation import FEW_SAMPLES, axis_angle_deg, retention, trust_metrics

from .test_statistics import predictions


def test_wrong_answers_are_shares_of_the_answers_alone():
    reference = np.full(8, 0.2)
    estimate = np.array([0.2, 0.24, 0.26, 0.1, np.nan, np.nan, np.nan, np.nan])
    found = trust_metrics(predictions(reference, estimate - 0.01, estimate + 0.01, estimate=estimate))
    assert found["wrong_share"] == 0.5
    assert found["by_force"][0]["wrong_share"] == 0.5
    assert found["by_force"][0]["abstained_share"] == 0.5


def test_strata_are_those_of_the_reference_and_small_ones_are_marked():
    reference = np.concatenate([np.full(FEW_SAMPLES, 0.05), np.full(FEW_SAMPLES - 1, 0.15), np.full(150, 0.5)])
    high = np.where(reference > 0.3, 0.4, 1.0)
    found = trust_metrics(predictions(reference, np.zeros_like(reference), high))
    parts = found["by_force"]
    assert [(part["from_n"], part["samples"], part["few"]) for part in parts] == [
        (0.0, 100, False), (0.1, 99, True), (0.3, 150, False),
    ]  # fmt: skip
    assert [part["coverage"] for part in parts] == [1.0, 1.0, 0.0]
    assert (found["worst_coverage"], found["worst_stratum"]) == (0.0, "0.3 N and more")


def test_the_angle_to_the_shaft_is_zero_for_a_push_straight_back():
    force = np.array([[-1.0, 0, 0], [-1, 1, np.nan], [0, 0, -1], [1, 0, 0], [0, 0, 0], [np.nan, 1, 0]])
    assert axis_angle_deg(force) == pytest.approx([0, 45, 90, 180, np.nan, np.nan], nan_ok=True)


def test_groups_of_sessions_stand_apart():
    reference, session = np.full(4, 0.2), np.array(["a", "b", "b", "c"])
    some = predictions(reference, reference - 0.1, reference + 0.1, session)
    found = trust_metrics(some, {"a": "one", "b": "other", "c": "one"}, base_frame=False)
    assert [(part["group"], part["samples"], part["sessions"]) for part in found["by_group"]] == [
        ("one", 2, 2), ("other", 2, 1),
    ]  # fmt: skip
    assert found["by_axis_angle"] == [], "in another frame nothing is known of the shaft"


def test_an_uncertainty_that_knows_the_error_lets_the_curve_fall_as_fast_as_can_be():
    error = np.random.default_rng(0).exponential(0.02, 1000)
    knows, knows_not = retention(error, error), retention(error, np.ones(1000))
    assert knows["area_n"] == pytest.approx(knows["best_area_n"])
    assert np.diff(knows["mae_n"]).max() < 0
    assert knows_not["mae_n"] == pytest.approx([error.mean()] * 20), "one uncertainty for all tells nothing"
    assert knows_not["area_n"] == pytest.approx(error.mean())
    assert retention(error, -error)["area_n"] > error.mean()


def test_the_curve_begins_where_the_method_abstained_by_itself():
    found = retention(np.full(20, 0.01), np.arange(20.0), answered_share=0.5)
    assert found["abstained_share"][0] == 0.5
    assert found["abstained_share"][-1] == pytest.approx(0.975)
    assert math.isnan(retention(np.zeros(0), np.zeros(0))["area_n"])
