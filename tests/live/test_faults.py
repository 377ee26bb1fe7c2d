"""Faults injected into a running engine: the output is invalid in time, says why, and recovers."""

import threading
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tipforce.types import Status

from .conftest import FAST, Camera, Method, Notes, wait_until

SLACK_S = 2.0
"""A busy machine wakes a thread late; the rule itself is exact (tests/live/test_watchdog.py)."""


def faulty(start, count, change):
    """A script that changes ``count`` images from number ``start`` on."""
    return lambda number, image: change(image) if start <= number < start + count else image


def silent(image):
    return None


def black(image):
    return np.zeros_like(image) + np.uint8(7)


def halved(image):
    return image[::2, ::2].copy()


class Frozen:
    """The first image that comes, again and again."""

    def __init__(self):
        self.image = None

    def __call__(self, image):
        self.image = image if self.image is None else self.image
        return self.image


def assert_no_value_stands_too_long(updates):
    """Whatever happens: a valid value is followed by another, or taken back, before it is too old."""
    for value, following in pairwise(updates):
        if value.estimate.valid:
            assert value.latency_s <= FAST.stale_s
            assert (following.published_ns - value.captured_ns) * 1e-9 <= FAST.stale_s + SLACK_S


@pytest.mark.parametrize(
    ("change", "state", "words"),
    [
        (silent, "late", "ms old"),
        (Frozen(), "frozen", "same image"),
        (black, "black", "is black"),
        (halved, "wrong_size", "grey images of 24x16; it began with grey images of 48x32"),
    ],
)
def test_a_camera_at_fault_makes_the_output_invalid_in_time_and_recovers(engine, change, state, words):
    notes, camera = Notes(), Camera(90, faulty(20, 50, change))
    report = engine(camera, Method(), notes).run()
    assert report.estimated + report.dropped + report.unusable == report.frames_in
    later = [each for each in notes.updates if each.published_ns >= camera.stamps_ns[20]]
    told = next(each for each in later if each.health.camera == state)
    assert (told.published_ns - camera.stamps_ns[19]) * 1e-9 <= FAST.stale_s + SLACK_S
    assert told.estimate.status is Status.STALE
    assert np.isnan(told.estimate.magnitude_n)
    assert words in told.estimate.detail
    assert told.health.message == told.estimate.detail
    again = notes.valid_since(told.published_ns)
    assert again.captured_ns >= camera.stamps_ns[70]
    assert (again.published_ns - camera.stamps_ns[70]) * 1e-9 < SLACK_S
    assert again.health.camera == "running"
    assert_no_value_stands_too_long(notes.updates)
    # it is said again and again meanwhile, for those that came later
    notices = [each.published_ns for each in notes.updates if told.number <= each.number <= again.number]
    assert np.diff(notices).max() * 1e-9 < FAST.notice_s + SLACK_S


def test_a_camera_that_is_silent_for_long_is_lost(engine):
    notes = Notes()
    live = engine(Camera(200, faulty(10, 10_000, silent)), Method(), notes)
    live.run()
    assert {"late", "lost"} <= {each.health.camera for each in notes.updates}
    assert "nothing for" in next(u.health.message for u in notes.updates if u.health.camera == "lost")


def test_images_that_arrive_late_give_no_force_though_they_come_at_full_rate(engine):
    notes = Notes()
    late_ns = round(1.5 * FAST.stale_s * 1e9)

    class Delayed(Camera):
        def __iter__(self):
            for event in super().__iter__():
                yield replace(event, stamp_ns=event.stamp_ns - late_ns)

    live = engine(Delayed(60), Method(), notes)
    live.run()
    assert not [each for each in notes.updates if each.estimate.valid]
    assert any("ms old" in each.estimate.detail for each in notes.updates)


def test_a_source_that_raises_is_told_at_once_and_opened_again(engine):
    def unplugged(number, image):
        if number in (20, 21, 22):
            raise OSError("the cable is out")
        return image

    notes = Notes()
    camera = Camera(60, unplugged)
    live = engine(camera, Method(), notes)
    report = live.run()
    told = notes.told("the cable is out")
    assert (told.published_ns - camera.stamps_ns[20]) * 1e-9 < SLACK_S
    assert told.health.camera == "lost"
    # 0.04 s: a busy computer has tried once more before the engine looks
    assert any(f"opened again in {wait} s" in told.estimate.detail for wait in ("0.02", "0.04"))
    again = notes.valid_since(told.published_ns)
    assert again.health.reconnects == report.reconnects == 3
    assert camera.opened == 4
    # 20, 40, 40 ms of waiting, as the settings say, from the first failure on
    assert 0.095 <= (again.published_ns - camera.stamps_ns[20]) * 1e-9 < 0.11 + 4 * SLACK_S
    assert report.end == "the source has ended"


def test_a_source_that_fails_for_good_ends_the_run_with_the_reason(engine):
    def broken(number, image):
        raise ValueError("no such device")

    settings = FAST.model_copy(update={"max_reconnects": 2})
    report = engine(Camera(5, broken), Method(), Notes(), settings=settings).run()
    assert report.end == "the source failed: ValueError: no such device"
    assert report.reconnects == 2


def test_a_camera_that_ends_is_opened_again_where_it_must_not_end(engine):
    camera = Camera(10)
    settings = FAST.model_copy(update={"reopen_ended": True})
    live = engine(camera, Method(), settings=settings)
    with live.running():
        wait_until(lambda: camera.opened > 2)
        assert "has ended; it is opened again" in live.latest().estimate.detail


def test_the_watchdog_speaks_while_the_method_hangs_and_its_late_answer_does_not_count(engine, gate):
    def force(number):
        if number >= 20:
            gate.wait(10.0)
        return 0.1

    notes = Notes()
    live = engine(Camera(100_000), Method(force), notes)
    with live.running():
        wait_until(lambda: any("has not answered for" in each.estimate.detail for each in notes.updates))
        told = notes.told("has not answered for")
        last_ns = max(each.captured_ns for each in notes.updates if each.estimate.valid)
        assert FAST.stale_s <= (told.published_ns - last_ns) * 1e-9 <= FAST.stale_s + SLACK_S
        assert told.health.camera == "running"
        time.sleep(FAST.stale_s)
        gate.set()
        wait_until(lambda: notes.updates[-1].estimate.valid)
    late = next(each for each in notes.updates if each.frames and each.number > told.number)
    assert late.latency_s > FAST.stale_s
    assert not late.estimate.valid
    assert_no_value_stands_too_long(notes.updates)
    assert live.report.dropped > 5


def test_a_method_that_raises_is_told_and_started_again(engine):
    failures = iter([ZeroDivisionError("bad")])

    def force(number):
        if number >= 20 and (error := next(failures, None)):
            raise error
        return 0.1

    method, notes = Method(force), Notes()
    engine(Camera(60), method, notes).run()
    told = notes.told("the method failed: ZeroDivisionError: bad")
    assert notes.valid_since(told.published_ns).health.message == ""
    assert method.started == 2


def test_the_last_word_is_that_there_is_no_force(engine):
    notes = Notes()
    live = engine(Camera(100_000), Method(), notes)
    with live.running():
        wait_until(lambda: len(notes.updates) > 5)
    assert notes.updates[-1].estimate.detail == "the run was stopped"
    assert notes.closed == 1


def test_before_the_first_image_it_says_what_it_waits_for(engine):
    class Slow(Camera):
        def before(self):
            time.sleep(0.05)
            yield from ()

    notes, method = Notes(), Method()
    method.wanted_views = ("a",)
    engine(Slow(20), method, notes).run()
    assert notes.updates[0].estimate.detail == "no image of the view a has come yet"
    assert notes.told("the source sends camera")
    assert not any(each.estimate.valid for each in notes.updates)


def test_what_the_source_knows_of_it_is_told(engine):
    class Telling(Camera):
        def trouble(self):
            return "" if self.number < 20 else "cameras.camera is lost: no such device"

    notes = Notes()
    engine(Telling(60, faulty(20, 40, silent)), Method(), notes).run()
    assert notes.told("ms old; cameras.camera is lost: no such device").health.camera == "late"


def test_an_answer_after_the_end_of_the_run_does_not_count(engine, gate):
    hanging = threading.Event()

    def force(number):
        if number >= 20:
            hanging.set()
            gate.wait(10.0)
        return 0.1

    notes = Notes()
    live = engine(Camera(100_000), Method(force), notes)
    with live.running():
        assert hanging.wait(5.0)
    last = live.latest()
    assert last.estimate.detail == "the run was stopped"
    gate.set()
    time.sleep(0.05)
    assert live.latest() is last
    assert notes.updates[-1] is last


def test_a_watchdog_that_fails_ends_the_run(engine, monkeypatch):
    monkeypatch.setattr("tipforce.live._engine.Engine._notice_due", lambda *_: 1 / 0)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    report = engine(Camera(100_000), Method(), Notes()).run()
    assert report.seconds < 60.0


def test_what_a_source_says_of_itself_does_not_stop_the_watchdog(engine):
    class Stammers(Camera):
        def trouble(self):
            raise KeyError("camera")

    notes = Notes()
    engine(Stammers(50, faulty(20, 30, silent)), Method(), notes).run()
    assert notes.told("ms old; the source cannot state the reason: KeyError")
