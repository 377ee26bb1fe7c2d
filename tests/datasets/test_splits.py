"""Splits: what is held out, and that nothing leaks where it must not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tipforce.datasets import (
    Dataset,
    blocked_folds,
    blocked_split,
    open_dataset,
    random_folds,
    random_split,
    random_subset,
    session_folds,
    splits,
)
from tipforce.errors import InputError

Make = Callable[..., Path]


@pytest.fixture
def data(make_folder: Make) -> Dataset:
    return open_dataset(make_folder(sessions=4, frames=20))


def test_the_random_split_is_the_thesis_s_share(data: Dataset) -> None:
    split = random_split(data, 0.25, seed=3)
    assert len(split.test) == 20
    assert np.array_equal(np.sort(np.concatenate([split.train, split.test])), np.arange(80))
    again, other = random_split(data, 0.25, seed=3), random_split(data, 0.25, seed=4)
    assert np.array_equal(split.test, again.test)
    assert not np.array_equal(split.test, other.test)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20)
@given(k=st.integers(2, 12), seed=st.integers(0, 99))
def test_random_folds_test_every_sample_once(data: Dataset, k: int, seed: int) -> None:
    folds = random_folds(data, k, seed)
    assert np.array_equal(np.sort(np.concatenate([fold.test for fold in folds])), np.arange(80))
    assert all(not set(fold.train) & set(fold.test) for fold in folds)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20)
@given(k=st.integers(2, 5), gap_s=st.floats(0, 1.4))
def test_blocks_are_contiguous_and_keep_their_gap(data: Dataset, k: int, gap_s: float) -> None:
    folds = blocked_folds(data, k, gap_s)
    assert np.array_equal(np.sort(np.concatenate([fold.test for fold in folds])), np.arange(80))
    for fold in folds:
        for name in data.sessions:
            test = fold.test[data.session[fold.test] == name]
            assert np.array_equal(test, np.arange(test[0], test[-1] + 1))
            train = fold.train[data.session[fold.train] == name]
            apart = np.abs(data.stamp_ns[train][:, None] - data.stamp_ns[test][None])
            assert np.min(apart) > gap_s * 1e9


def test_a_single_block_is_drawn_in_every_session(data: Dataset) -> None:
    split = blocked_split(data, 0.25, gap_s=1.0, seed=1)
    assert [int(np.sum(data.session[split.test] == name)) for name in data.sessions] == [5, 5, 5, 5]
    assert len(split.train) + len(split.test) < 80


def test_sessions_are_held_out_whole(data: Dataset) -> None:
    for split in session_folds(data):
        assert not set(data.session[split.train]) & set(data.session[split.test])
        assert len(split.train) + len(split.test) == 80
    assert [fold.name for fold in session_folds(data)] == [f"without s{k}" for k in range(4)]


def test_many_sessions_are_held_out_in_ten_groups(make_folder: Make) -> None:
    many = open_dataset(make_folder(sessions=23, frames=2))
    folds = session_folds(many)
    assert len(folds) == 10
    assert np.array_equal(np.sort(np.concatenate([fold.test for fold in folds])), np.arange(46))
    assert len(session_folds(many, 4)) == 4


def test_the_protocols_by_name(data: Dataset) -> None:
    assert [len(splits(name, data)) for name in ("random", "blocked", "session")] == [1, 1, 4]  # type: ignore[arg-type]
    assert [len(splits(name, data, folds=2)) for name in ("random", "blocked", "session")] == [2, 2, 2]  # type: ignore[arg-type]


def test_splits_that_cannot_be_made_say_why(make_folder: Make) -> None:
    small = open_dataset(make_folder(sessions=1, frames=3))
    with pytest.raises(InputError, match="at least two sessions, got 1"):
        session_folds(small)
    with pytest.raises(InputError, match="too few for 4 folds"):
        random_folds(small, 4)
    with pytest.raises(InputError, match="session s0 has 3 samples, too few for 4 blocks"):
        blocked_folds(small, 4)
    with pytest.raises(InputError, match=r"leave none to train on once blocks are held out with a gap of 9 s"):
        blocked_folds(small, 3, gap_s=9)
    with pytest.raises(InputError, match="between 0 and 1, got 1"):
        random_split(small, 1.0)


def test_drawing_keeps_order_and_depends_on_the_seed_alone(data: Dataset) -> None:
    some = random_subset(data, 30, seed=5)
    assert len(some) == 30
    assert np.all(np.diff(some.rows) > 0)
    same, other = random_subset(data, 30, seed=5), random_subset(data, 30, seed=6)
    assert some.fingerprint() == same.fingerprint() != other.fingerprint()
    assert random_subset(data, 500) is data
    with pytest.raises(InputError, match="at least 1, got 0"):
        random_subset(data, 0)
