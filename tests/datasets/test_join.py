"""Several datasets as one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import Dataset, join, open_dataset
from tipforce.errors import InputError
from tipforce.types import Image

Make = Callable[..., Path]


def renamed(data: Dataset, before: str) -> Dataset:
    names = {name: f"{before}{name}" for name in data.sessions}
    infos = {names[name]: replace(info, name=names[name]) for name, info in data.session_info.items()}
    return replace(data, session=np.array([names[name] for name in data.session]), session_info=infos, title=before)


@pytest.fixture
def two(make_folder: Make) -> tuple[Dataset, Dataset]:
    data = open_dataset(make_folder(sessions=2, frames=3))
    return renamed(data, "a"), renamed(data, "b")


def first_pixels(data: Dataset) -> list[int]:
    found: list[int] = []
    for each in data.observations():
        image = each.views["camera"]
        assert isinstance(image, np.ndarray)
        found.append(int(image[0, 0]))
    return found


def test_samples_follow_one_another_and_stay_themselves(two: tuple[Dataset, Dataset]) -> None:
    both = join(two)
    assert both.sessions == ("as0", "as1", "bs0", "bs1")
    assert first_pixels(both) == first_pixels(two[0]) + first_pixels(two[1])
    mixed = both.subset(np.array([7, 0, 8, 11, 1]))
    assert first_pixels(mixed) == [first_pixels(both)[k] for k in (7, 0, 8, 11, 1)]
    assert np.array_equal(mixed.force_n, both.force_n[[7, 0, 8, 11, 1]], equal_nan=True)


def test_actuation_that_one_lacks_is_absent_there(two: tuple[Dataset, Dataset]) -> None:
    both = join((two[0], replace(two[1], actuation={})))
    assert np.isnan(both.actuation["knob_deg"][6:]).all()
    assert np.array_equal(both.actuation["knob_deg"][:6], two[0].actuation["knob_deg"])


def test_masks_are_those_of_the_parts_that_have_them(two: tuple[Dataset, Dataset]) -> None:
    class Drawn:
        def __init__(self, data: Dataset) -> None:
            self.read = data.store.read

        def has_masks(self, rows: np.ndarray, view: str) -> bool:
            return True

        def masks(self, rows: np.ndarray, view: str) -> list[Image | None]:
            return [np.full((2, 2), row, np.uint8) for row in rows.tolist()]

    drawn = replace(two[0], store=Drawn(two[0]))
    both = join((drawn, two[1]))
    assert both.has_masks("camera")
    assert not both.subset(np.arange(6, 12)).has_masks("camera")
    assert both.subset(np.arange(6)).has_masks("camera")
    assert [None if mask is None else int(mask[0, 0]) for mask in both.masks("camera")] == [*range(6), *[None] * 6]


def test_other_sessions_of_the_same_name_get_names_of_their_own(two: tuple[Dataset, Dataset]) -> None:
    first, second = two
    other = replace(first, title="other", force_n=first.force_n + 0.1, _fingerprints=None)
    both = join((first, other, second))
    assert both.sessions == ("as0", "as1", "as0 (2)", "as1 (2)", "bs0", "bs1")
    assert both.session_info["as0 (2)"].name == "as0 (2)"
    assert both.remarks[0] == "as0 of other is called as0 (2), because a has a as0 too"
    assert first_pixels(both)[6:12] == first_pixels(first)


def test_what_one_part_lacks_is_told(two: tuple[Dataset, Dataset]) -> None:
    both = join((two[0], replace(two[1], actuation={})))
    assert both.remarks == ("b: its 6 samples lack the actuation knob_deg, which others of the data have",)
    assert join(two).remarks == ()


def test_one_is_itself_and_what_cannot_be_told_apart_is_refused(two: tuple[Dataset, Dataset]) -> None:
    assert join(two[:1]) is two[0]
    with pytest.raises(InputError, match="has the session 'as0' that a has, with the same stamps and forces"):
        join((two[0], two[0]))
    with pytest.raises(InputError, match="knows other components"):
        join((two[0], replace(two[1], known=np.array([True, True, True]))))
