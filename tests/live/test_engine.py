"""The engine at work: newest frame, order, sinks that hang or raise, several views, drives, and what it keeps."""

import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from tipforce.alignment import PAIR_S
from tipforce.clinical import ContactSettings
from tipforce.live import LiveSettings
from tipforce.live._intake import Intake
from tipforce.live._latency import Histogram, RecentDelays
from tipforce.live._runner import SinkRunner
from tipforce.types import Actuation, ActuationInfo, Frame, SessionInfo, Status, SystemClock

from .conftest import FAST, PERIOD_S, Camera, Method, Notes, force_estimate, wait_until

MS = 1_000_000


class Hangs(Notes):
    def __init__(self, gate, keeps_all):
        super().__init__("hangs")
        self.gate, self.keeps_all = gate, keeps_all

    def put(self, update):
        super().put(update)
        self.gate.wait(10.0)


class Raises(Notes):
    keeps_all = False

    def put(self, update):
        super().put(update)
        if len(self.updates) == 1:
            raise ConnectionError("the other side is gone")


def test_every_update_comes_in_order_with_image_age_and_health(engine):
    notes = Notes()
    report = engine(Camera(50), Method(), notes, model="m").run()
    assert [each.number for each in notes.updates] == list(range(len(notes.updates)))
    stamps = [each.estimate.stamp_ns for each in notes.updates if each.frames]
    assert stamps == sorted(set(stamps))
    good = [each for each in notes.updates if each.estimate.valid]
    assert good
    for each in good:
        assert each.captured_ns == each.estimate.stamp_ns
        assert 0 < each.latency_s <= FAST.stale_s
        assert each.frames["camera"].shape == (32, 48)
        assert each.clinical.contact == "effective"
    assert report.frames_in == 50
    assert report.estimated + report.dropped == 50
    assert report.valid == len(good)
    assert report.notices + report.estimated == len(notes.updates) == report.sinks["notes"].taken
    assert 0 < report.latency_p50_s <= report.latency_p99_s
    # a computer that stalls hands over several images at once: the median shows the camera's rate
    assert 0 < np.median([each.health.frames_per_s for each in good]) <= 2 / PERIOD_S


def odd(stamp_ns=0, **numbers):
    """A valid estimate of which some numbers are others; its stamp is off by ``stamp_ns``."""

    class Odd(Method):
        def update(self, observation):
            found = super().update(observation)
            return replace(found, stamp_ns=found.stamp_ns + stamp_ns, **numbers)

    return Odd()


@pytest.mark.parametrize(
    ("method", "words"),
    [
        (odd(magnitude_n=math.inf), "a magnitude of inf N; expected a finite number of at least 0"),
        (odd(magnitude_n=-0.1), "a magnitude of -0.1 N"),
        (odd(force_n=np.array([math.inf, 0.0, math.nan])), "in known components; expected finite numbers"),
        (odd(force_n=np.full(3, math.nan)), "in known components; expected finite numbers"),
        (odd(magnitude_interval_n=np.array([0.3, 0.2])), "an interval of the magnitude from 0.3 to 0.2 N"),
        (odd(covariance_n2=-np.eye(3)), "a negative variance"),
        (odd(contact=7.0), "a probability of contact of 7"),
        (odd(1_000_000_000), "1000 ms after the image"),
    ],
)
def test_an_estimate_that_cannot_be_is_not_valid_and_says_why(engine, method, words):
    notes = Notes()
    report = engine(Camera(20), method, notes).run()
    assert report.estimated > 0
    assert report.valid == 0
    assert words in notes.told(words).estimate.detail
    assert {each.clinical.contact for each in notes.updates} == {"unknown"}


def test_an_estimate_of_an_earlier_image_is_as_old_as_that_image(engine):
    notes = Notes()
    engine(Camera(20), odd(-round(0.5 * FAST.stale_s * 1e9)), notes).run()
    assert min(each.latency_s for each in notes.updates if each.estimate.valid) >= 0.5 * FAST.stale_s
    notes = Notes()
    engine(Camera(20), odd(-round(2 * FAST.stale_s * 1e9)), notes).run()
    assert not [each for each in notes.updates if each.estimate.valid]


def test_images_stamped_ahead_of_the_clock_give_no_force(engine):
    class Ahead(Camera):
        def __iter__(self):
            for event in super().__iter__():
                yield replace(event, stamp_ns=event.stamp_ns + 1_000_000_000)

    notes = Notes()
    assert engine(Ahead(20), Method(), notes).run().valid == 0
    assert notes.told("ms ahead of this machine's clock")


def test_the_bound_that_a_driver_states_counts_as_age(engine):
    class Bounded(Camera):
        max_delay_ns = round(0.5 * FAST.stale_s * 1e9)

        def __iter__(self):
            for event in super().__iter__():
                yield replace(event, max_delay_ns=self.max_delay_ns)

    notes, camera = Notes(), Bounded(20)
    engine(camera, Method(), notes).run()
    assert min(each.latency_s for each in notes.updates if each.estimate.valid) >= 0.5 * FAST.stale_s
    camera = Bounded(20)
    camera.max_delay_ns = round(2 * FAST.stale_s * 1e9)
    assert engine(camera, Method(), Notes()).run().valid == 0


def test_a_value_that_waited_for_its_sink_or_its_reader_expires(engine, gate):
    class Late(Notes):
        keeps_all = False

        def start(self, info, model):
            super().start(info, model)
            gate.wait(10.0)

    notes, late = Notes(), Late()
    engine(Camera(20), Method(), notes).run()
    update = next(each for each in notes.updates if each.estimate.valid)
    assert update.as_of(update.expires_ns) is update
    expired = update.as_of(update.expires_ns + 1)
    assert (expired.estimate.status, expired.clinical) == (Status.STALE, None)
    assert "ms old" in expired.estimate.detail
    runner = SinkRunner(late, SessionInfo(), "m", FAST, SystemClock())
    runner.offer(update)
    runner.start()
    time.sleep(0.01 + update.max_age_s)
    gate.set()
    runner.ask_to_close()
    runner.wait_closed()
    assert [each.estimate.valid for each in late.updates] == [False]


def test_until_the_method_answers_for_the_first_time_the_run_is_starting(engine, gate):
    class Slow(Method):
        def update(self, observation):
            gate.wait(5.0)
            return super().update(observation)

    notes = Notes()
    live = engine(Camera(100_000), Slow(), notes)
    with live.running():
        wait_until(lambda: any("starting the method (0 s so far)" in each.estimate.detail for each in notes.updates))
        assert all(each.health.starting for each in notes.updates)
        gate.set()
        wait_until(lambda: notes.updates[-1].estimate.valid)
        assert not notes.updates[-1].health.starting


def test_a_slow_method_drops_frames_and_says_so(engine):
    method, notes = Method(lambda number: time.sleep(0.02) or 0.1), Notes()
    report = engine(Camera(60), method, notes).run()
    assert report.dropped > 10
    assert report.estimated + report.dropped == 60
    assert notes.updates[-1].health.dropped == report.dropped


@pytest.mark.parametrize("keeps_all", [False, True])
def test_a_sink_that_hangs_stops_nobody_else_and_holds_no_more_than_its_queue(engine, gate, keeps_all):
    hangs, notes = Hangs(gate, keeps_all), Notes()
    settings = FAST.model_copy(update={"queue": 5})
    live = engine(Camera(60), Method(), hangs, notes, settings=settings)
    report = live.run()
    assert len(hangs.updates) == 1
    assert report.sinks["hangs"].hung
    waiting = 5 if keeps_all else 1
    published = report.sinks["notes"].taken + report.sinks["notes"].dropped
    assert report.sinks["hangs"].dropped == published - 1 - waiting
    assert report.sinks["notes"].taken == len(notes.updates)
    assert not report.sinks["notes"].hung


def test_a_sink_that_raises_is_started_again_and_counted(engine):
    raises, notes = Raises("raises"), Notes()
    report = engine(Camera(60), Method(), raises, notes).run()
    assert report.sinks["raises"].failures == 1
    assert raises.started == 2
    assert raises.closed == 2
    assert len(raises.updates) > 1
    told = [each for each in notes.updates if "the other side is gone" in each.health.sinks["raises"].message]
    assert told
    assert report.sinks["raises"].message == ""
    assert report.sinks["notes"].failures == 0


def test_a_sink_that_cannot_start_is_tried_again_later_and_later(engine):
    class Refuses(Notes):
        def start(self, info, model):
            super().start(info, model)
            raise OSError("nobody listens")

    refuses = Refuses("refuses")
    report = engine(Camera(60), Method(), refuses).run()
    assert 2 <= refuses.started <= 2 + report.seconds / 0.04  # after 20, 40, 40, ... ms
    assert report.sinks["refuses"].failures == refuses.started
    assert not refuses.updates


def test_stop_ends_a_run_whose_source_hangs(engine, gate):
    class Stuck(Camera):
        def before(self):
            gate.wait(10.0)
            yield from ()

    live = engine(Stuck(1), Method())
    runner = threading.Thread(target=live.run)
    runner.start()
    live.stop()
    runner.join(3.0)
    assert not runner.is_alive()


def test_a_sink_comes_and_goes_while_the_engine_runs(engine):
    notes, guest = Notes(), Notes("guest")
    live = engine(Camera(100_000), Method(), notes)
    with live.running():
        live.add_sink(guest)
        wait_until(lambda: len(guest.updates) > 3)
        assert live.remove_sink(guest).failures == 0
        assert (guest.started, guest.closed) == (1, 1)
        count, seen = len(guest.updates), len(notes.updates)
        wait_until(lambda: len(notes.updates) > seen + 3)
        assert len(guest.updates) == count
        with pytest.raises(KeyError):
            live.remove_sink(guest)
    assert notes.closed == 1


def test_a_sink_is_not_started_before_the_run(engine):
    notes = Notes()
    engine(Camera(1), Method(), notes)
    time.sleep(0.02)
    assert notes.started == 0


def test_an_engine_runs_once(engine):
    live = engine(Camera(2), Method())
    live.run()
    with pytest.raises(RuntimeError, match="once"):
        live.run()


def test_thresholds_may_change_while_it_runs(engine):
    live = engine(Camera(100_000), Method(), Notes())
    with live.running():
        wait_until(lambda: live.latest() and live.latest().clinical.contact == "effective")
        live.contact = ContactSettings(window_n=(0.12, 0.3))
        wait_until(lambda: live.latest().clinical.contact == "unstable")


# What the intake does, with times that the tests state


def image(number):
    found = np.full((16, 16), 90, np.uint8)
    found[0, 0] = number
    return found


def intake(views=("camera",), info=None, settings=None, same_clock=True, apart=False):
    info, settings = info or SessionInfo(), settings or LiveSettings()
    return Intake(views, info, settings, same_clock=same_clock, apart=apart, on_fault=lambda: None)


def test_the_newest_frame_waits_and_the_others_are_dropped():
    taken = intake()
    for number in range(5):
        taken.add(Frame(number * MS, image(number)), number * MS)
    assert taken.take(0.0).observation.views["camera"][0, 0] == 4
    assert (taken.frames_in, taken.dropped) == (5, 4)
    assert taken.take(0.0) is None


def test_views_of_one_instant_come_together_and_a_lost_partner_does_not_stop_the_other():
    taken = intake(("a", "b"))
    for number in range(3):
        taken.add(Frame(number * 33 * MS, image(number), "a"), number * 33 * MS)
        assert taken.take(0.0) is None
        taken.add(Frame(number * 33 * MS + 2 * MS, image(100 + number), "b"), number * 33 * MS + 2 * MS)
        views = taken.take(0.0).observation.views
        assert (views["a"][0, 0], views["b"][0, 0]) == (number, 100 + number)
    for number in range(3, 12):
        taken.add(Frame(number * 33 * MS, image(number), "a"), number * 33 * MS)
    assert set(taken.take(0.0).observation.views) == {"a"}
    fault = taken.fault(11 * 33 * MS)
    assert (fault.camera, "view b" in fault.message) == ("late", True)


def test_a_frame_waits_no_longer_for_a_partner_than_two_images_may_differ():
    taken = intake(("a", "b"))
    for view in ("a", "b"):
        taken.add(Frame(0, image(0), view), 0)
    assert set(taken.take(0.0).observation.views) == {"a", "b"}
    taken.add(Frame(66 * MS, image(1), "a"), 66 * MS)  # its partner was dropped
    began_s = time.monotonic()
    assert set(taken.take(5.0).observation.views) == {"a"}
    assert time.monotonic() - began_s < 1.0


def test_a_view_whose_images_always_arrive_late_is_waited_for():
    taken = intake(("a", "b"))
    late_ns = round(2.5 * PAIR_S * 1e9)
    taken.add(Frame(0, image(0), "a"), 0)
    taken.add(Frame(0, image(0), "b"), late_ns)
    taken.take(0.0)
    taken.add(Frame(66 * MS, image(1), "a"), 66 * MS)
    threading.Timer(1.5 * PAIR_S, lambda: taken.add(Frame(66 * MS, image(1), "b"), 66 * MS + late_ns)).start()
    assert set(taken.take(5.0).observation.views) == {"a", "b"}


def test_views_that_are_exposed_in_turn_are_not_one_instant():
    taken = intake(("a", "b"))
    for number in range(4):
        taken.add(Frame(number * 66 * MS, image(number), "a"), number * 66 * MS)
        taken.add(Frame((number * 66 + 30) * MS, image(number), "b"), (number * 66 + 30) * MS)
        assert set(taken.take(0.0).observation.views) == {"a"}


def test_each_image_of_views_exposed_in_turn_is_an_instant_where_a_method_takes_any_view():
    taken = intake(("a", "b"), apart=True)
    shown = []
    for number in range(4):
        taken.add(Frame(number * 66 * MS, image(number), "a"), number * 66 * MS)
        taken.add(Frame((number * 66 + 30) * MS, image(100 + number), "b"), (number * 66 + 30) * MS)
        while (found := taken.take(0.0)) is not None:
            shown.append((*found.observation.views, *found.beside))
    while (found := taken.take(0.1)) is not None:  # the last one waits for a partner that may come
        shown.append((*found.observation.views, *found.beside))
    assert shown == [("a", "b"), ("b", "a")] * 4


def test_a_slow_method_gets_the_newest_image_of_each_view_the_older_one_first():
    taken = intake(("a", "b"), apart=True)
    for number in range(4):
        taken.add(Frame(number * 66 * MS, image(number), "a"), number * 66 * MS)
        taken.add(Frame((number * 66 + 30) * MS, image(100 + number), "b"), (number * 66 + 30) * MS)
    for view, at_ms in (("a", 264), ("b", 294)):
        taken.add(Frame(at_ms * MS, image(4), view), at_ms * MS)
    first, second = (taken.take(0.1) for _ in range(2))
    assert first is not None
    assert second is not None
    assert (first.observation.views["b"][0, 0], second.observation.views["a"][0, 0]) == (103, 4)
    assert taken.dropped == 4


def test_an_image_that_comes_after_a_later_one_was_taken_is_left_out():
    taken = intake(("a", "b"), apart=True, same_clock=False)
    taken.add(Frame(0, image(0), "a"), 0)
    assert taken.take(0.2) is not None
    taken.add(Frame(66 * MS, image(1), "a"), 66 * MS)
    assert taken.take(0.2) is not None
    taken.add(Frame(30 * MS, image(2), "b"), 90 * MS)
    assert taken.take(0.1) is None


def test_the_newest_image_of_a_view_that_is_not_read_is_kept_to_be_shown():
    taken = intake(("a",))
    for number in (1, 2):
        taken.add(Frame(number * MS, image(number), "b"), number * MS)
    taken.add(Frame(3 * MS, image(3), "a"), 3 * MS)
    found = taken.take(0.0)
    assert set(found.observation.views) == {"a"}
    assert found.beside["b"][0, 0] == 2


class LosesA(Camera):
    """Two views; of one nothing comes after ten images."""

    def __iter__(self):
        for event in super().__iter__():
            if event.view != "a" or self.number <= 10:
                yield event


@pytest.mark.parametrize("read", ["a", "b"])
def test_a_view_that_is_lost_ends_the_force_of_the_method_that_reads_it_alone(engine, read):
    method, notes = Method(), Notes()
    method.wanted_views = (read,)
    engine(LosesA(80, views=("a", "b")), method, notes).run()
    last = [each.estimate for each in notes.updates if each.health.camera != "lost" or each.estimate.valid][-1]
    if read == "b":
        assert last.valid
        assert set(notes.updates[-3].beside) <= {"a"}
    else:
        assert (last.valid, last.status) == (False, Status.STALE)
        assert "the last image of the view a is" in last.detail


class AnyView(Method):
    """Takes any of two views."""

    needs_all_views = False

    def update(self, observation):
        self.observations.append(observation)
        return force_estimate(observation.stamp_ns, 0.1 * len(observation.views))


def test_a_method_that_takes_any_view_goes_on_where_one_is_lost_and_the_run_says_so(engine):
    method, notes = AnyView(), Notes()
    method.wanted_views = ("a", "b")
    engine(LosesA(80, views=("a", "b")), method, notes).run()
    last = [each for each in notes.updates if each.estimate.valid][-1]
    assert set(last.frames) == {"b"}
    assert last.reads == ("a", "b")
    assert last.health.camera == "running"
    assert "the view a" in last.health.message


def test_a_source_on_another_clock_is_mapped_by_its_smallest_delay():
    taken = intake(same_clock=False)
    ahead = 10**15
    for number, delay in enumerate([30, 12, 25]):
        taken.add(Frame(ahead + number * 33 * MS, image(number), "camera"), number * 33 * MS + delay * MS)
    assert taken.take(0.0).captured_ns == 2 * 33 * MS + 12 * MS
    assert taken.stamp_at(100 * MS) == ahead + 88 * MS


def test_a_clock_that_begins_anew_begins_a_new_run_and_a_late_frame_is_left_out():
    taken = intake(same_clock=False)
    taken.add(Frame(10**10, image(0)), 10**10)
    first = taken.take(0.0)
    taken.add(Frame(10**10 - 5 * MS, image(1)), 10**10 + MS)
    assert taken.take(0.0) is None
    assert taken.dropped == 1
    taken.add(Frame(0, image(2)), 10**10 + 33 * MS)
    again = taken.take(0.0)
    assert again.run == first.run + 1
    assert again.captured_ns == 10**10 + 33 * MS


def test_the_latest_reading_of_a_drive_counts_within_its_age_and_what_is_stated_as_constant_always():
    info = SessionInfo(actuation=ActuationInfo(constant={"advance_mm": 3.0}))
    taken = intake(info=info)
    taken.add(Actuation(0, {"knob_deg": 10.0, "advance_mm": 3.0}), 0)
    taken.add(Frame(400 * MS, image(0)), 400 * MS)
    assert dict(taken.take(0.0).observation.actuation) == {"knob_deg": 10.0, "advance_mm": 3.0}
    taken.add(Frame(600 * MS, image(1)), 600 * MS)
    instant = taken.take(0.0)
    assert dict(instant.observation.actuation) == {"advance_mm": 3.0}
    assert instant.too_old_s == pytest.approx({"knob_deg": 0.6})
    taken.add(Actuation(620 * MS, {"knob_deg": 20.0}), 620 * MS)
    taken.add(Frame(630 * MS, image(2)), 630 * MS)
    assert taken.take(0.0).observation.actuation["knob_deg"] == 20.0


@pytest.mark.parametrize(("name", "wanted"), [("knob_deg", ("knob_deg",)), ("advance_mm", ())])
def test_an_actuation_that_is_too_old_is_a_missing_input(engine, name, wanted):
    class WithKnob(Camera):
        def before(self):
            yield Actuation(self.clock.now_ns(), {name: 5.0})

    method, notes = Method(), Notes()
    method.wanted_actuation = wanted
    engine(WithKnob(60), method, notes, settings=FAST.model_copy(update={"actuation_age_s": 0.1})).run()
    told = next(each for each in notes.updates if each.estimate.status is Status.MISSING_INPUT)
    assert f"{name} was read 0." in told.estimate.detail
    assert "at most 0.1 s" in told.estimate.detail
    assert any(each.estimate.valid for each in notes.updates if each.number < told.number)


def test_readings_and_frames_that_nobody_takes_do_not_pile_up():
    """Without a reader, and with a partner that never comes."""
    taken = intake(("a", "b"))
    kept = image(0)
    for number in range(600):
        taken.add(Frame(number * 1000 * MS, kept, "a"), number * 1000 * MS)
        for step in range(3):
            taken.add(Actuation(number * 1000 * MS + step, {"knob_deg": 1.0}), number * 1000 * MS)
    assert len(taken._waiting) <= 16
    assert sum(map(len, taken._series._stamps.values())) < 20
    assert all(len(frames) < 20 for frames in taken._pairing._frames.values())
    recent = RecentDelays()
    for number in range(5000):
        recent.add(number * 20 * MS, 0.001 * (number % 10))
    assert len(recent._delay_s) == 2048
    assert recent.percentiles(5000 * 20 * MS) == pytest.approx((0.0045, 0.009))
    assert recent.percentiles(5001 * 20 * MS) == pytest.approx((0.0045, 0.009))


def test_percentiles_of_a_whole_run_are_within_two_percent():
    delays, histogram = np.random.default_rng(1).gamma(3.0, 0.004, 5000), Histogram()
    for delay in delays:
        histogram.add(float(delay))
    for p in (50, 99):
        assert histogram.percentile(p) == pytest.approx(np.percentile(delays, p), rel=0.021)
