"""The split into training and validation."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.training import TrainConfig, TrainingSamples, train_val_split


def sessions(count: int, each: int) -> np.ndarray:
    return np.repeat([f"s{k}" for k in range(count)], each)


def test_whole_sessions_where_the_share_comes_to_one() -> None:
    session = sessions(20, 5)
    split = train_val_split(session, TrainConfig())
    assert split.by_session
    assert len(set(session[split.val])) == 2
    assert not set(session[split.val]) & set(session[split.train])


def test_samples_where_there_are_few_sessions() -> None:
    split = train_val_split(sessions(4, 25), TrainConfig())
    assert not split.by_session
    assert len(split.val) == 10
    assert np.array_equal(np.sort(np.concatenate([split.train, split.val])), np.arange(100))


def test_too_little_data_is_an_error() -> None:
    with pytest.raises(InputError, match="at least two sessions"):
        train_val_split(sessions(1, 30), TrainConfig(hold_out="session"))
    with pytest.raises(InputError, match="too few to train on"):
        train_val_split(sessions(1, 2), TrainConfig())


def test_samples_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="arrays of one length"):
        TrainingSamples(np.zeros((3, 8, 8, 3), np.uint8), np.zeros((2, 2), np.float32), sessions(1, 3))
