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
    limit = min(max(200 * MS, round(2.5 * period_ms * MS)), 1000 * MS)
    assert watch.deadline_ns == last + limit
    assert watch.fault(last + limit) is None
    assert watch.fault(last + limit + 1) is not None


def test_a_camera_that_grows_slower_is_late_until_its_new_period_is_known():
    watch, last = watched(100, 20)  # 250 ms are allowed
    late = 0
    for number in range(20):
        last += 300 * MS
        late += watch.fault(last - 1) is not None
        assert watch.see(image(100 + number), last, last, last) == "running"
    assert late == 8  # half of the remembered intervals
    assert watch.limit_ns == 750 * MS


@pytest.mark.parametrize("first_ms", [400, 4000, 50_000])
def test_a_slow_start_and_a_pause_do_not_lengthen_the_time_that_a_value_counts(first_ms):
    watch, last = watched(first_ms, 10)
    assert watch.limit_ns <= 1000 * MS
    for number in range(20):
        last += 33 * MS
        watch.see(image(number), last, last, last)
    assert watch.limit_ns == 200 * MS
    watch.see(image(100), last + 8000 * MS, last + 8000 * MS, last + 8000 * MS)
    assert watch.limit_ns == 200 * MS


def test_of_a_camera_with_an_image_every_four_seconds_a_value_counts_for_one_second_and_the_message_says_so():
    watch, last = watched(4000, 5)
    assert watch.fault(last + 1000 * MS) is None
    assert watch.fault(last + 1001 * MS).message == (
        "the last image of the view camera is 1001 ms old; one comes every 4.0 s, and a force counts for 1 s at most"
    )


def test_images_stamped_ahead_of_the_clock_are_no_fresh_images():
    watch, last = watched(delay_ms=0)
    now = last + 20 * MS
    assert watch.see(image(50), now + 1000 * MS, now + 1000 * MS, now) == "late"
    assert "1000 ms ahead of this machine's clock" in watch.fault(now).message
    assert watch.deadline_ns is None
    assert watch.see(image(51), now + 1020 * MS, now + 20 * MS, now + 20 * MS) == "running"
    assert watch.fault(now + 20 * MS) is None


def test_settings_cannot_let_a_value_count_for_longer_than_a_second():
    with pytest.raises(ValueError, match="less than or equal to 1"):
        LiveSettings(stale_s=5.0)


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
