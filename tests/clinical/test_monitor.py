"""Known answers: time, probability and force-time integral; what is unknown is never zero."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from tipforce.clinical import ContactClass, ContactMonitor, ContactSettings, ContactState, probability_above
from tipforce.types import ForceEstimate, Status
from tipforce.units import GRAM_N

STEP_NS = 40_000_000


def of(number: int, magnitude_n: float, half_n: float = 0.02, low_n: float | None = None) -> ForceEstimate:
    if math.isnan(magnitude_n):
        return ForceEstimate.invalid(number * STEP_NS, Status.NO_CATHETER, "gone")
    nothing = np.full((3, 3), np.nan)
    ends = np.array([magnitude_n - half_n if low_n is None else low_n, magnitude_n + half_n])
    return ForceEstimate(
        number * STEP_NS, nothing[0], np.zeros(3, np.bool_), nothing, nothing[:, :2], magnitude_n, ends
    )


def vector(force_n: tuple[float, float], std_n: tuple[float, float]) -> ForceEstimate:
    covariance = np.full((3, 3), np.nan)
    covariance[:2, :2] = np.diag(np.square(std_n))
    return ForceEstimate(
        0, np.array([*force_n, np.nan]), np.array([True, True, False]), covariance, np.full((3, 2), np.nan),
        math.hypot(*force_n), np.full(2, np.nan),
    )  # fmt: skip


def followed(forces_n: list[float], settings: ContactSettings | None = None, half_n: float = 0.02):
    monitor = ContactMonitor(settings)
    return [monitor.update(of(number, force, half_n)) for number, force in enumerate(forces_n)]


def test_a_constant_force_integrates_to_force_times_time_within_the_ends_of_its_interval() -> None:
    last = followed([0.2] * 101)[-1]
    assert last.elapsed_s == pytest.approx(4.0)
    assert last.integral_n_s == pytest.approx(0.8)
    assert last.integral_g_s == pytest.approx(0.8 / GRAM_N)
    assert last.integral_interval_n_s == pytest.approx((0.72, 0.88))
    assert last.window_share == pytest.approx(1.0)
    assert (last.contact, last.contact_class) == (ContactState.EFFECTIVE, ContactClass.CONSTANT)


def test_a_ramp_integrates_exactly_and_is_shared_between_the_ranges() -> None:
    last = followed(np.linspace(0.0, 0.5, 126).tolist())[-1]
    assert last.integral_n_s == pytest.approx(0.25 * 5.0)
    assert last.window.seconds == pytest.approx(2.0, abs=0.041)
    assert last.window.least_s == pytest.approx(1.6, abs=0.041), "0.12 to 0.28 N"
    assert last.window.most_s == pytest.approx(2.4, abs=0.041), "0.08 to 0.32 N"
    assert last.limit.seconds == pytest.approx(1.0, abs=0.041)
    assert (last.limit.least_s, last.limit.most_s) == pytest.approx((0.8, 1.2), abs=0.041)


def test_invalid_frames_are_unknown_time_and_not_zero_force() -> None:
    nan = math.nan
    states = followed([0.2] * 26 + [nan] * 25 + [0.2] * 25)
    last = states[-1]
    assert last.elapsed_s == pytest.approx(3.0)
    assert last.unknown_s == pytest.approx(1.0)
    assert last.integral_n_s == pytest.approx(0.2 * 2.0)
    assert last.window_share == pytest.approx(1.0), "of the known time"
    assert last.contact_class is ContactClass.UNKNOWN, "a third of the last seconds is unknown"
    lost = states[30]
    assert lost.contact is ContactState.UNKNOWN
    assert all(math.isnan(each) for each in (lost.in_contact, lost.in_window, lost.above_limit))


def test_a_gap_between_frames_is_unknown() -> None:
    monitor = ContactMonitor()
    monitor.update(of(0, 0.2))
    monitor.update(of(1, 0.2))
    last = monitor.update(of(101, 0.2))
    assert (last.elapsed_s, last.unknown_s) == pytest.approx((4.04, 4.0))
    assert last.integral_n_s == pytest.approx(0.2 * 0.04)
    assert last.contact_class is ContactClass.UNKNOWN
    again = monitor.update(of(101, 0.3))
    assert again.elapsed_s == last.elapsed_s, "a frame that is not later adds no time"


def test_the_interval_of_the_integral_is_unknown_where_an_estimate_has_none() -> None:
    last = followed([0.2] * 4, half_n=math.inf)[-1]
    assert all(math.isnan(end) for end in last.integral_interval_n_s)
    assert last.integral_n_s == pytest.approx(0.2 * 0.12)
    assert (last.window.seconds, last.window.least_s, last.window.most_s) == pytest.approx((0.12, 0.0, 0.12))
    assert last.limit.most_s == pytest.approx(0.12), "it may have been above the limit all the time"


def test_reset_begins_the_integral_anew_and_keeps_the_class() -> None:
    monitor = ContactMonitor()
    for number in range(101):
        monitor.update(of(number, 0.2))
    monitor.reset()
    state = monitor.update(of(101, 0.2))
    assert (state.elapsed_s, state.integral_n_s) == pytest.approx((0.04, 0.008))
    assert state.contact_class is ContactClass.CONSTANT


@pytest.mark.parametrize(
    ("magnitude", "half", "above", "expected"),
    [
        (0.4, 0.05, 0.4, 0.5),
        (0.4, 0.05, 0.35, 0.95),
        (0.4, 0.05, 0.45, 0.05),
        (0.4, 0.0, 0.39, 1.0),
        (0.4, 0.0, 0.41, 0.0),
    ],
)
def test_five_percent_lie_beyond_either_end(magnitude: float, half: float, above: float, expected: float) -> None:
    assert probability_above(of(0, magnitude, half), above) == pytest.approx(expected, abs=1e-12)


def test_a_lower_end_cut_at_zero_does_not_make_contact_sure() -> None:
    assert probability_above(of(0, 0.02, 0.1, low_n=0.0), 0.01) < 0.6


def test_without_an_interval_the_covariance_along_the_force_tells() -> None:
    along = probability_above(vector((0.3, 0.0), (0.1, 1e-6)), 0.4)
    assert along == pytest.approx(0.1586552539)
    assert probability_above(vector((0.0, 0.3), (0.1, 1e-6)), 0.4) == pytest.approx(0.0, abs=1e-12)
    assert math.isnan(probability_above(vector((0.3, 0.0), (math.nan, math.nan)), 0.4))


def test_probabilities_agree_with_draws_from_the_stated_distribution() -> None:
    drawn = np.random.default_rng(0).normal(0.36, 0.05 / 1.6448536, 200_000)
    state = followed([0.36], half_n=0.05)[0]
    assert state.above_limit == pytest.approx(np.mean(drawn > 0.4), abs=0.004)
    assert state.in_window == pytest.approx(np.mean((drawn > 0.1) & (drawn < 0.3)), abs=0.004)
    assert state.in_contact == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("forces", "expected"),
    [
        ([0.0] * 100, ContactClass.NONE),
        ([0.2 * (number % 25 > 12) for number in range(100)], ContactClass.INTERMITTENT),
        ([0.25 + 0.15 * math.sin(number / 4) for number in range(100)], ContactClass.VARIABLE),
        ([0.25 + 0.05 * math.sin(number / 4) for number in range(100)], ContactClass.CONSTANT),
        ([0.2] * 50, ContactClass.UNKNOWN),
    ],
)
def test_the_class_is_that_of_the_last_seconds(forces: list[float], expected: ContactClass) -> None:
    assert followed(forces)[-1].contact_class is expected
    if expected is not ContactClass.UNKNOWN:
        assert followed([0.0, 0.5] * 20 + forces)[-1].contact_class is expected, "what is older plays no part"


@pytest.mark.parametrize("values", [{"window_n": (0.4, 0.1)}, {"contact_n": 0.2}, {"limit_n": 0.05}])
def test_thresholds_that_contradict_each_other_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match="expected"):
        ContactSettings.model_validate(values)
