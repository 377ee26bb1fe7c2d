"""Observations of several views: which images belong together, and how long a frame waits."""

import numpy as np
import pytest

from tipforce.alignment import PAIR_S, ObservationQueue
from tipforce.types import Actuation, Frame

MS = 1_000_000
PERIOD = 66 * MS
IMAGE = np.zeros((4, 4), np.uint8)


def events(apart_ms: float, frames: int = 5):
    """Frames of the views a and b, b later, and a reading of the knob every 5 ms, in order of their stamps."""
    apart = round(apart_ms * MS)
    found = [Frame(k * PERIOD + place * apart, IMAGE, view) for k in range(frames) for place, view in enumerate("ab")]
    readings = [Actuation(k * 5 * MS, {"knob_deg": 1.0}) for k in range(frames * PERIOD // (5 * MS))]
    return sorted([*found, *readings], key=lambda event: event.stamp_ns)


@pytest.mark.parametrize("apart_ms", [0, 5, 19, 21, 33, 60])
def test_images_are_paired_up_to_the_stated_difference_and_no_frame_waits_longer(apart_ms):
    queue = ObservationQueue(("a", "b"))
    for event in events(apart_ms):
        for observation in queue.add(event):
            assert event.stamp_ns - observation.stamp_ns <= PAIR_S * 1e9 + 5 * MS  # and a reading in between
            near = min(apart_ms, 66 - apart_ms) if observation.stamp_ns else apart_ms
            assert set(observation.views) == ({"a", "b"} if near <= 1e3 * PAIR_S else {"a"})


@pytest.mark.parametrize("apart_ms", [0, 5, 33, 60])
@pytest.mark.parametrize("view", ["a", "b"])
def test_a_method_of_one_view_gets_each_of_its_frames_at_once_however_far_apart_the_views_are(view, apart_ms):
    queue = ObservationQueue((view,), wait_s=0.0)
    for event in events(apart_ms):
        found = queue.add(event)
        wanted = isinstance(event, Frame) and event.view == view
        assert [each.stamp_ns for each in found] == ([event.stamp_ns] if wanted else [])
    assert queue.rest() == []


def test_frames_that_still_wait_come_at_the_end():
    queue = ObservationQueue(("a", "b"))
    assert queue.add(Frame(0, IMAGE, "a")) == []
    (rest,) = queue.rest()
    assert set(rest.views) == {"a"}


@pytest.mark.parametrize("apart_ms", [0, 5, 19, 21, 33, 60])
def test_each_image_of_views_exposed_in_turn_is_an_observation_where_a_method_takes_any_view(apart_ms):
    queue = ObservationQueue(("a", "b"), apart=True)
    found = [each for event in events(apart_ms) for each in queue.add(event)] + queue.rest()
    stamps = [each.stamp_ns for each in found]
    assert stamps == sorted(set(stamps))
    shown = [tuple(each.views) for each in found]
    if apart_ms <= 1e3 * PAIR_S:
        assert shown == [("a", "b")] * 5
    elif apart_ms == 60:  # each is near the next of the first view
        assert shown == [("a",), *[("a", "b")] * 4, ("b",)]
    else:
        assert shown == [("a",), ("b",)] * 5


def test_the_other_view_goes_on_where_the_first_one_is_lost():
    frames = [event for event in events(0) if isinstance(event, Frame)]
    frames = [frame for frame in frames if frame.view == "b" or frame.stamp_ns == 0]
    queue = ObservationQueue(("a", "b"), wait_s=0.0, apart=True)
    found = [each for event in frames for each in queue.add(event)] + queue.rest()
    assert [tuple(each.views) for each in found] == [("a", "b"), *[("b",)] * 4]
