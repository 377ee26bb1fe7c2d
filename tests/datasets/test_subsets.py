"""Drawing samples and keeping sessions back."""

import numpy as np
import pytest

from tipforce.datasets import Dataset, random_subset, without_sessions
from tipforce.errors import InputError


@pytest.fixture
def three_sessions() -> Dataset:
    session = np.repeat(["a", "b", "c"], 10)
    return Dataset(
        store=None,  # type: ignore[arg-type]
        session=session,
        stamp_ns=np.arange(30, dtype=np.int64),
        actuation={"knob_deg": np.full(30, 10.0)},
        force_n=np.random.default_rng(0).normal(size=(30, 3)),
        known=np.ones(3, bool),
        names=session,
        session_info={},
        rows=np.arange(30, dtype=np.int64),
    )


def test_sessions_left_out_are_gone_and_the_rest_stays(three_sessions: Dataset) -> None:
    left = without_sessions(three_sessions, ["b"])
    assert left.sessions == ("a", "c")
    np.testing.assert_array_equal(left.rows, [*range(10), *range(20, 30)])
    assert without_sessions(three_sessions, []) is three_sessions


@pytest.mark.parametrize(("names", "said"), [(["d"], "there are a, b, c"), (["a", "b", "c"], "nothing remains")])
def test_leaving_out_the_unknown_or_everything_is_explained(
    three_sessions: Dataset, names: list[str], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        without_sessions(three_sessions, names)


def test_drawing_is_repeatable_and_keeps_the_order(three_sessions: Dataset) -> None:
    rows = random_subset(three_sessions, 7, seed=3).rows
    assert len(set(rows.tolist())) == 7
    assert (np.diff(rows) > 0).all()
    np.testing.assert_array_equal(rows, random_subset(three_sessions, 7, seed=3).rows)
    assert rows.tolist() != random_subset(three_sessions, 7, seed=4).rows.tolist()
