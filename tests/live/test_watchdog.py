"""The rule by which an image is stale, exactly, with times that the tests state."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.live import CameraWatch, LiveSettings

MS = 1_000_000


def image(number, shape=(24, 32)):
    """Alike but for one pixel, which is none of those that are looked at first."""
    found = np.full(shape, 100, np.uint8)
    found.flat[1] = number % 256
    return found


def watched(period_ms=20, count=10, delay_ms=5, options=None):
    """A watch after ``count`` images; returns it and the mid-exposure of the last one."""
    watch = CameraWatch("camera", options or LiveSettings())
    for number in range(count):
        at = number * period_ms * MS
        assert watch.see(image(number), at, at, at + delay_ms * MS) == "running"
    return watch, (count - 1) * period_ms * MS


@settings(max_examples=30)
@given(st.integers(2, 1000), st.integers(1, 5))
def test_an_image_is_valid_until_200_ms_or_two_and_a_half_periods_after_its_exposure(period_ms, count):
    watch, last = watched(period_ms, count + 1)
    limit = max(200 * MS, round(2.5 * period_ms * MS))
    assert watch.deadline_ns == last + limit
    assert watch.fault(last + limit) is None
    assert watch.fault(last + limit + 1) is not None


def test_a_camera_that_grows_slower_is_late():
    watch, last = watched(100, 20)  # 250 ms are allowed
    for number in range(20):
        last += 400 * MS
        assert watch.fault(last - 1).camera == "late"
        assert watch.see(image(100 + number), last, last, last) == "running"
    assert watch.limit_ns == 250 * MS


def test_a_new_start_measures_the_rate_anew():
    watch, last = watched(100, 20)
    watch.restart()
    for number in range(3):
        watch.see(image(200 + number), number * 400 * MS, last + number * 400 * MS, last + number * 400 * MS)
    assert watch.limit_ns == 1000 * MS


def test_the_same_image_twice_is_no_fault_but_does_not_make_the_value_younger():
    watch, last = watched()
    frozen = image(9)
    for step in range(1, 10):
        at = last + 20 * step * MS
        assert watch.see(frozen, at, at, at) == "frozen"
        assert watch.fault(at) is None
    assert watch.fault(last + 201 * MS).camera == "frozen"
    assert watch.see(image(10), last + 210 * MS, last + 210 * MS, last + 210 * MS) == "running"
    assert watch.fault(last + 211 * MS) is None


def test_one_pixel_that_differs_is_another_image():
    watch, last = watched()
    assert watch.see(image(9), last + 1, last + 1, last + 1) == "frozen"
    assert watch.see(image(8), last + 2, last + 2, last + 2) == "running"


@pytest.mark.parametrize(
    ("bad", "state"),
    [
        (np.full((24, 32), 16, np.uint8), "black"),
        (image(0, (12, 32)), "wrong_size"),
        (image(0, (24, 32, 3)), "wrong_size"),
    ],
)
def test_black_or_of_another_size_ends_the_value_at_once(bad, state):
    watch, last = watched()
    assert watch.see(bad, last + MS, last + MS, last + MS) == state
    assert watch.fault(last + MS).camera == state
    assert watch.deadline_ns is None
    assert watch.see(image(50), last + 2 * MS, last + 2 * MS, last + 2 * MS) == "running"
    assert watch.fault(last + 2 * MS) is None


def test_hot_pixels_make_a_black_image_no_lighter_and_a_light_catheter_does():
    black = np.full((240, 320), 8, np.uint8)
    black[::80, ::80] = 255
    watch = CameraWatch("camera", LiveSettings())
    assert watch.see(black, 0, 0, 0) == "black"
    catheter = black.copy()
    catheter[100:112] = 90
    assert watch.see(catheter, 1, 1, 1) == "running"


def test_silence_is_late_then_lost():
    watch, last = watched(delay_ms=0)
    assert watch.fault(last + 500 * MS).camera == "late"
    assert "500 ms old" in watch.fault(last + 500 * MS).message
    assert watch.fault(last + 2001 * MS).camera == "lost"


def test_images_that_are_old_when_they_arrive_are_late():
    watch, last = watched(delay_ms=250)
    assert watch.fault(last + 250 * MS).camera == "late"
