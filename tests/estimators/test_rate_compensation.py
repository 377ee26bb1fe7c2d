"""Compensation of the viscous force, which follows from the rate of change of the estimate."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.estimators.networks._calibration import CalibrationBatch
from tipforce.estimators.networks._rate_compensation import (
    History,
    RateCompensation,
    earlier_samples,
    fit_rate_compensation,
    rate_compensation_from,
)
from tipforce.training import TrainingSamples

MS = 1_000_000
NOTHING = RateCompensation(np.zeros((2, 2)), 1.0)


def beating(seconds: float = 0.025, hz: float = 24.0, noise_n: float = 0.003) -> tuple[np.ndarray, ...]:
    """Stamps, what images tell of an elastic force and the force that is felt: it leads by so many ``seconds``."""
    stamp_ns = np.rint(np.arange(600) / hz * 1e9).astype(np.int64)
    angle = 2 * np.pi * 1.2 * stamp_ns * 1e-9
    elastic = 0.1 + 0.1 * np.column_stack([np.sin(angle), 0.5 * np.cos(angle)])
    felt = elastic + seconds * 0.1 * 2 * np.pi * 1.2 * np.column_stack([np.cos(angle), -0.5 * np.sin(angle)])
    return stamp_ns, elastic + np.random.default_rng(0).normal(0.0, noise_n, elastic.shape), felt


def run(compensation: RateCompensation, stamp_ns: np.ndarray, estimate: np.ndarray) -> np.ndarray:
    history = History()
    rates = [history.rate(int(stamp), force) for stamp, force in zip(stamp_ns, estimate, strict=True)]
    return np.array([f if r is None else f + r @ compensation.seconds for f, r in zip(estimate, rates, strict=True)])


def rates_of(stamp_ns: np.ndarray, estimate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    before = earlier_samples(stamp_ns, np.full(len(stamp_ns), "s"))
    later = np.flatnonzero(before >= 0)
    elapsed = 1e-9 * (stamp_ns[later] - stamp_ns[before[later]])[:, None]
    return later, (estimate[later] - estimate[before[later]]) / elapsed


@pytest.mark.parametrize("hz", [15.0, 24.0, 60.0, 150.0])
def test_a_force_that_leads_the_indentation_is_found_at_any_frame_rate(hz):
    stamp_ns, estimate, felt = beating(hz=hz)
    later, rate = rates_of(stamp_ns, estimate)
    compensation = fit_rate_compensation(estimate[later], rate, felt[later], NOTHING)
    assert compensation.used
    assert compensation.sigma_factor_without_history > 1.5
    stamp_ns, estimate, felt = beating(hz=hz)
    alone, compensated = (
        np.abs(estimate - felt)[1:].mean(),
        np.abs(run(compensation, stamp_ns, estimate) - felt)[1:].mean(),
    )
    assert compensated < 0.6 * alone


def test_the_initial_compensation_holds_where_there_are_few_samples():
    stamp_ns, estimate, felt = beating()
    later, rate = rates_of(stamp_ns, estimate)
    before = fit_rate_compensation(estimate[later], rate, felt[later], NOTHING)
    few = slice(0, 4)
    assert np.allclose(
        fit_rate_compensation(estimate[few], rate[few], estimate[few], before).seconds, before.seconds, rtol=0.3
    )


@given(st.lists(st.integers(1, 200), min_size=2, max_size=60))
def test_training_compares_the_samples_that_a_session_will(steps_ms):
    stamp_ns = np.cumsum(steps_ms).astype(np.int64) * MS
    estimate = np.arange(len(stamp_ns), dtype=np.float64)[:, None]
    before = earlier_samples(stamp_ns, np.full(len(stamp_ns), "s"))
    history = History()
    for k, stamp in enumerate(stamp_ns.tolist()):
        rate = history.rate(stamp, estimate[k])
        if before[k] < 0:
            assert rate is None
        else:
            elapsed = 1e-9 * (stamp - int(stamp_ns[before[k]]))
            assert rate == pytest.approx((estimate[k] - estimate[before[k]]) / elapsed)


def test_another_session_is_no_earlier_frame():
    before = earlier_samples(np.array([0, 40, 80, 120]) * MS, np.array(["a", "a", "b", "b"]))
    assert before.tolist() == [-1, 0, -1, 2]


def test_after_a_gap_there_is_no_rate():
    history = History()
    assert history.rate(0, np.zeros(2)) is None
    assert history.rate(42 * MS, np.ones(2)) is not None
    assert history.rate(400 * MS, np.ones(2)) is None
    assert history.rate(10 * MS, np.ones(2)) is None  # the clock went back
    assert history.rate(52 * MS, np.ones(2)) is not None


class Shown:
    """A task whose images are the answers."""

    inputs = ("image",)

    def batch(self, samples: TrainingSamples, index: np.ndarray, draws: object) -> dict[str, np.ndarray]:
        return {"image": samples.images[index]}


def test_samples_in_any_order_and_of_several_sessions_are_used():
    stamp_ns, estimate, felt = (np.concatenate([each, each]) for each in beating(noise_n=0.0))
    session = np.repeat(["a", "b"], len(stamp_ns) // 2)
    order = np.random.default_rng(0).permutation(len(stamp_ns))
    samples = TrainingSamples(estimate[order][:, None], felt[order].astype(np.float32), session[order])
    calibration = CalibrationBatch(lambda image: {"force_n": image[:, 0]}, Shown(), samples, None, stamp_ns[order])
    compensation = rate_compensation_from(calibration, None)
    assert (
        (np.diag(compensation.seconds) > 0.015) & (np.diag(compensation.seconds) < 0.03)
    ).all()  # 25 ms, pulled towards none
    assert compensation.sigma_factor_without_history > 3.0
    too_close = replace(calibration, stamp_ns=np.arange(len(order)))
    assert rate_compensation_from(too_close, compensation) is compensation
    still = TrainingSamples(np.zeros_like(estimate)[:, None], felt.astype(np.float32), session)
    assert (
        rate_compensation_from(replace(calibration, samples=still, stamp_ns=stamp_ns), None).seconds.any() == np.False_
    )
    assert rate_compensation_from(
        replace(calibration, stamp_ns=np.arange(len(order))), RateCompensation(np.eye(3), 1.0)
    ).seconds.shape == (2, 2)


def test_a_network_that_hardly_moves_is_not_compensated():
    rate = np.full((40, 2), 1e-4)
    compensation = fit_rate_compensation(np.full((40, 2), 0.1), rate, np.full((40, 2), 0.3), NOTHING)
    assert compensation is NOTHING, "minutes of compensation are no tissue's"
