"""What is kept from training."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.training import Samples, TrainConfig, train_val_split


def sessions(count: int, each: int) -> np.ndarray:
    return np.repeat([f"s{k}" for k in range(count)], each)


def test_whole_sessions_where_the_share_comes_to_one() -> None:
    session = sessions(20, 5)
    part = train_val_split(session, TrainConfig())
    assert part.sessions
    assert len(set(session[part.validate])) == 2
    assert not set(session[part.validate]) & set(session[part.train])


def test_samples_where_there_are_few_sessions() -> None:
    part = train_val_split(sessions(4, 25), TrainConfig())
    assert not part.sessions
    assert len(part.validate) == 10
    assert np.array_equal(np.sort(np.concatenate([part.train, part.validate])), np.arange(100))


def test_what_cannot_be_parted_is_refused() -> None:
    with pytest.raises(InputError, match="at least two sessions"):
        train_val_split(sessions(1, 30), TrainConfig(hold_out="session"))
    with pytest.raises(InputError, match="too few to train on"):
        train_val_split(sessions(1, 2), TrainConfig())


def test_samples_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="arrays of one length"):
        Samples(np.zeros((3, 8, 8, 3), np.uint8), np.zeros((2, 2), np.float32), sessions(1, 3))
