"""Intervals: what they promise, and on which basis."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.datasets import Dataset
from tipforce.estimators import create
from tipforce.estimators.uncertainty import conformal_half_width, interval_basis, interval_from_errors
from tipforce.types import ForceEstimate

World = Callable[..., Dataset]
QUICK = {"c": (10.0,), "epsilon": (0.01,), "sigma": (1.0,), "force": "components"}


def test_with_few_sessions_a_guarantee_would_be_infinite() -> None:
    eight = np.repeat([f"s{k}" for k in range(8)], 5)
    by_session = interval_basis(9, True)
    assert conformal_half_width(np.ones(40), eight, by_session) == math.inf
    nine = np.repeat([f"s{k}" for k in range(9)], 5)
    assert conformal_half_width(np.ones(45), nine, by_session) == 1.0


def test_a_long_session_weighs_no_more_than_a_short_one() -> None:
    session = np.array(["long"] * 1000 + [f"s{k}" for k in range(19) for _ in range(3)])
    residuals = np.where(session == "long", 100.0, 1.0)
    assert conformal_half_width(residuals, session, interval_basis(20, True)) == 1.0
    assert conformal_half_width(residuals, session, interval_basis(4, True)) == 100.0


@given(st.lists(st.floats(-10, 10), min_size=10, max_size=60))
def test_pooled_frames_give_the_usual_quantile(values: list[float]) -> None:
    found = conformal_half_width(np.array(values), np.array(["one"] * len(values)), interval_basis(1, False))
    assert found == np.sort(np.abs(values))[math.ceil(0.9 * (len(values) + 1) - 1e-9) - 1]


def test_sessions_that_differ_are_covered_on_new_ones() -> None:
    draw = np.random.default_rng(0)
    hits = []
    for _ in range(400):
        centres = draw.normal(size=13)
        frames = centres[:, None] + 0.3 * draw.normal(size=(13, 30))
        width = conformal_half_width(
            frames[:12].ravel(), np.repeat([f"s{k}" for k in range(12)], 30), interval_basis(12, True)
        )
        hits.append(np.mean(np.abs(frames[12]) <= width))
    assert 0.88 < np.mean(hits) < 0.96


@pytest.mark.parametrize("sessions", [2, 3, 4])
def test_the_components_of_a_new_session_are_covered_although_there_were_only_few(sessions: int) -> None:
    draw = np.random.default_rng(0)
    names = np.repeat([f"s{k}" for k in range(sessions)], 30)
    hits = []
    for _ in range(100):
        frames = 0.02 * (draw.normal(size=(sessions + 1, 1, 3)) + 0.3 * draw.normal(size=(sessions + 1, 30, 3)))
        old = frames[:-1].reshape(-1, 3)
        size = np.linalg.norm(old, axis=1)
        for held_out, sampling in ((True, ""), (False, "random samples")):
            found = interval_from_errors(
                np.ones(3, np.bool_), old, np.zeros(len(old)), size, np.ones(len(old)), names, held_out, sampling
            )
            assert not found.by_session
            hits.append(np.mean(np.abs(frames[-1]) <= found.half_n))
    assert np.mean(hits) > 0.9  # 0.75 to 0.85 from the errors of all frames as they are


@pytest.mark.parametrize(
    ("sessions", "text"),
    [
        (1, "random folds of one session"),
        (2, "random folds of 2 sessions"),
        (4, "frames of held-out sessions (4 sessions: too few for a guarantee on a new one)"),
        (10, "whole sessions"),
    ],
)
def test_the_basis_is_said(world: World, sessions: int, text: str) -> None:
    svr = create("svr", QUICK).fit(world(sessions=sessions, frames=25))
    assert svr.describe().interval_basis == text
    assert np.isfinite(svr.describe().magnitude_interval_half_width_n)


def test_nine_tenths_of_the_frames_of_new_sessions_lie_within(world: World) -> None:
    data = world(sessions=30, frames=20, spread_n=0.02)
    old = np.isin(data.session, [f"s{k}" for k in range(15)])
    answers = create("svr", QUICK).fit(data.subset(old)).predict(data.subset(~old))
    truth = data.subset(~old).force_n
    inside = [
        answer.interval_n[axis, 0] <= truth[place, axis] <= answer.interval_n[axis, 1]
        for place, answer in enumerate(answers)
        for axis in range(2)
    ]
    assert 0.8 < np.mean(inside) <= 1.0
    width = answers[0].interval_n[0, 1] - answers[0].interval_n[0, 0]
    assert 0.04 < width < 0.16
    spread = np.sqrt(np.diag(answers[0].covariance_n2)[:2])
    assert np.all((spread > 0.01) & (spread < 0.04))


def test_calibrating_on_sessions_apart_gives_their_own_width_and_the_same_answers(world: World) -> None:
    calm, rough = world(sessions=3, frames=25), world(sessions=30, frames=20, spread_n=0.05, seed=1)
    part = np.isin(rough.session, [f"s{k}" for k in range(15)])
    svr = create("svr", QUICK).fit(calm)
    test = rough.subset(~part)
    before = svr.predict(test)
    after = svr.calibrate(rough.subset(part)).predict(test)
    assert [a.magnitude_n for a in after] == [b.magnitude_n for b in before]

    def inside(answers: list[ForceEstimate]) -> float:
        bounds = np.array([answer.interval_n[:2] for answer in answers])
        return float(np.mean((bounds[:, :, 0] <= test.force_n[:, :2]) & (test.force_n[:, :2] <= bounds[:, :, 1])))

    assert inside(before) < 0.6
    assert 0.8 < inside(after) <= 1.0
    assert svr.describe().interval_basis == "whole sessions"
