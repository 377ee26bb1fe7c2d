"""Which frames are proposed: those that differ, and of these the ones in which the detection is least certain."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tipforce.annotation import Candidate, choose_frames
from tipforce.annotation._choice import farthest_points


def candidates(levels: list[float]) -> list[Candidate]:
    return [Candidate(str(k), 0, np.array([level, 0.0])) for k, level in enumerate(levels)]


def test_of_frames_that_are_the_same_only_one_is_chosen() -> None:
    levels = [0.0] * 30 + [0.5] + [1.0] * 30
    chosen = choose_frames(candidates(levels), 3, lambda pool: [0.0] * len(pool))
    assert sorted(levels[int(name)] for name in chosen) == [0.0, 0.5, 1.0]


def test_the_frame_with_an_uncertain_detection_is_preferred_to_its_equal_neighbours() -> None:
    levels = np.linspace(0.0, 1.0, 9).tolist()
    chosen = choose_frames(candidates(levels), 3, lambda pool: [float(each.name == "5") for each in pool])
    assert "5" in chosen


def test_all_frames_are_chosen_where_there_are_no_more() -> None:
    assert choose_frames(candidates([0.2, 0.1, 0.9]), 12, lambda pool: [0.5] * len(pool)) == ["0", "1", "2"]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.data())
def test_farthest_points_are_different_indices(levels: list[float], data: st.DataObject) -> None:
    count = data.draw(st.integers(1, len(levels)))
    found = farthest_points(np.array(levels)[:, None], count, np.ones(len(levels)))
    assert len(set(found.tolist())) == count
