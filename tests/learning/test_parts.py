"""What is kept from training."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.learning import Recipe, Samples, validation_part


def sessions(count: int, each: int) -> np.ndarray:
    return np.repeat([f"s{k}" for k in range(count)], each)


def test_whole_sessions_where_the_share_comes_to_one() -> None:
    session = sessions(20, 5)
    part = validation_part(session, Recipe())
    assert part.sessions
    assert len(set(session[part.validate])) == 2
    assert not set(session[part.validate]) & set(session[part.train])


def test_samples_where_there_are_few_sessions() -> None:
    part = validation_part(sessions(4, 25), Recipe())
    assert not part.sessions
    assert len(part.validate) == 10
    assert np.array_equal(np.sort(np.concatenate([part.train, part.validate])), np.arange(100))


def test_what_cannot_be_parted_is_refused() -> None:
    with pytest.raises(InputError, match="at least two sessions"):
        validation_part(sessions(1, 30), Recipe(hold_out="session"))
    with pytest.raises(InputError, match="too few to train on"):
        validation_part(sessions(1, 2), Recipe())


def test_samples_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="arrays of one length"):
        Samples(np.zeros((3, 8, 8, 3), np.uint8), np.zeros((2, 2), np.float32), sessions(1, 3))
