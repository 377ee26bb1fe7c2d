"""What the frame before adds to `compact`: the part of the force that follows from how fast the tissue is pressed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.estimators.networks._arrays import Looked
from tipforce.estimators.networks._lead import Lead, Trail, earlier, lead_from, learn_lead
from tipforce.training import Samples

MS = 1_000_000
NOTHING = Lead(np.zeros((2, 2)), 1.0)


def beating(seconds: float = 0.025, hz: float = 24.0, noise_n: float = 0.003) -> tuple[np.ndarray, ...]:
    """Stamps, what pictures tell of an elastic force and the force that is felt: it leads by so many ``seconds``."""
    stamp_ns = np.rint(np.arange(600) / hz * 1e9).astype(np.int64)
    angle = 2 * np.pi * 1.2 * stamp_ns * 1e-9
    elastic = 0.1 + 0.1 * np.column_stack([np.sin(angle), 0.5 * np.cos(angle)])
    felt = elastic + seconds * 0.1 * 2 * np.pi * 1.2 * np.column_stack([np.cos(angle), -0.5 * np.sin(angle)])
    return stamp_ns, elastic + np.random.default_rng(0).normal(0.0, noise_n, elastic.shape), felt


def run(lead: Lead, stamp_ns: np.ndarray, answer: np.ndarray) -> np.ndarray:
    trail = Trail()
    rates = [trail.rate(int(stamp), force) for stamp, force in zip(stamp_ns, answer, strict=True)]
    return np.array([f if r is None else f + r @ lead.seconds for f, r in zip(answer, rates, strict=True)])


def rates_of(stamp_ns: np.ndarray, answer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    before = earlier(stamp_ns, np.full(len(stamp_ns), "s"))
    later = np.flatnonzero(before >= 0)
    elapsed = 1e-9 * (stamp_ns[later] - stamp_ns[before[later]])[:, None]
    return later, (answer[later] - answer[before[later]]) / elapsed


@pytest.mark.parametrize("hz", [15.0, 24.0, 60.0, 150.0])
def test_a_force_that_leads_the_dent_is_found_at_any_frame_rate(hz):
    stamp_ns, answer, felt = beating(hz=hz)
    later, rate = rates_of(stamp_ns, answer)
    lead = learn_lead(answer[later], rate, felt[later], NOTHING)
    assert lead.used
    assert lead.alone > 1.5
    stamp_ns, answer, felt = beating(hz=hz)
    alone, led = np.abs(answer - felt)[1:].mean(), np.abs(run(lead, stamp_ns, answer) - felt)[1:].mean()
    assert led < 0.6 * alone


def test_what_was_learnt_before_holds_where_little_is_new():
    stamp_ns, answer, felt = beating()
    later, rate = rates_of(stamp_ns, answer)
    before = learn_lead(answer[later], rate, felt[later], NOTHING)
    few = slice(0, 4)
    assert np.allclose(learn_lead(answer[few], rate[few], answer[few], before).seconds, before.seconds, rtol=0.3)


@given(st.lists(st.integers(1, 200), min_size=2, max_size=60))
def test_training_compares_the_samples_that_a_session_will(steps_ms):
    stamp_ns = np.cumsum(steps_ms).astype(np.int64) * MS
    answer = np.arange(len(stamp_ns), dtype=np.float64)[:, None]
    before = earlier(stamp_ns, np.full(len(stamp_ns), "s"))
    trail = Trail()
    for k, stamp in enumerate(stamp_ns.tolist()):
        rate = trail.rate(stamp, answer[k])
        if before[k] < 0:
            assert rate is None
        else:
            elapsed = 1e-9 * (stamp - int(stamp_ns[before[k]]))
            assert rate == pytest.approx((answer[k] - answer[before[k]]) / elapsed)


def test_another_session_is_no_earlier_frame():
    before = earlier(np.array([0, 40, 80, 120]) * MS, np.array(["a", "a", "b", "b"]))
    assert before.tolist() == [-1, 0, -1, 2]


def test_after_a_gap_there_is_no_rate():
    trail = Trail()
    assert trail.rate(0, np.zeros(2)) is None
    assert trail.rate(42 * MS, np.ones(2)) is not None
    assert trail.rate(400 * MS, np.ones(2)) is None
    assert trail.rate(10 * MS, np.ones(2)) is None  # the clock went back
    assert trail.rate(52 * MS, np.ones(2)) is not None


class Shown:
    """A task whose pictures are the answers."""

    inputs = ("picture",)

    def batch(self, samples: Samples, index: np.ndarray, draws: object) -> dict[str, np.ndarray]:
        return {"picture": samples.pictures[index]}


def test_samples_in_any_order_and_of_several_sessions_tell_the_lead():
    stamp_ns, answer, felt = (np.concatenate([each, each]) for each in beating(noise_n=0.0))
    session = np.repeat(["a", "b"], len(stamp_ns) // 2)
    order = np.random.default_rng(0).permutation(len(stamp_ns))
    samples = Samples(answer[order][:, None], felt[order].astype(np.float32), session[order])
    looked = Looked(lambda picture: {"force_n": picture[:, 0]}, Shown(), samples, None, stamp_ns[order])
    lead = lead_from(looked, None)
    assert ((np.diag(lead.seconds) > 0.015) & (np.diag(lead.seconds) < 0.03)).all()  # 25 ms, pulled towards none
    assert lead.alone > 3.0
    assert lead_from(replace(looked, stamp_ns=np.arange(len(order))), lead) is lead
    still = Samples(np.zeros_like(answer)[:, None], felt.astype(np.float32), session)
    assert lead_from(replace(looked, samples=still, stamp_ns=stamp_ns), None).seconds.any() == np.False_
    assert lead_from(replace(looked, stamp_ns=np.arange(len(order))), Lead(np.eye(3), 1.0)).seconds.shape == (2, 2)
