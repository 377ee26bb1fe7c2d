"""Files at the pace of their own stamps, on a clock that does not wait."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.live import PacedSource
from tipforce.types import Actuation, Frame, SessionInfo, SimulatedClock

MS = 1_000_000


class File:
    session_info = SessionInfo("file")

    def __init__(self, *events):
        self.events, self.rounds = events, 0

    def __iter__(self):
        self.rounds += 1
        return iter(self.events)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def frame(at_ms):
    return Frame(at_ms * MS, np.zeros((4, 4), np.uint8))


def taken(source, count):
    found = []
    for event in source:
        found.append((type(event).__name__, event.stamp_ns // MS, source.clock.now_ns() // MS))
        if len(found) == count:
            break
    return found


def test_events_come_when_their_time_has_passed_with_stamps_on_the_clock():
    source = PacedSource(
        File(frame(1000), Actuation(1010 * MS, {"knob_deg": 1.0}), frame(1040)), clock=SimulatedClock(7 * MS)
    )
    assert taken(source, 9) == [("Frame", 7, 7), ("Actuation", 17, 17), ("Frame", 47, 47)]


def test_a_rate_takes_the_place_of_the_stamps():
    source = PacedSource(
        File(frame(0), frame(1), Actuation(1 * MS, {"knob_deg": 1.0}), frame(2)), clock=SimulatedClock(), rate_hz=50
    )
    assert [stamp for _, stamp, _ in taken(source, 9)] == [0, 20, 20, 40]


def test_a_loop_goes_on_with_the_same_period_and_later_stamps():
    file = File(frame(500), frame(540), frame(580))
    source = PacedSource(file, clock=SimulatedClock(), loop=True)
    assert [stamp for _, stamp, _ in taken(source, 8)] == [0, 40, 80, 120, 160, 200, 240, 280]
    assert file.rounds == 3


def test_a_file_without_frames_is_not_looped():
    with pytest.raises(InputError, match="holds no frame"):
        taken(PacedSource(File(), clock=SimulatedClock(), loop=True), 1)


def test_a_file_that_is_read_too_slowly_plays_slower():
    """Its images are late where they are read late, but not for ever."""
    source = PacedSource(File(frame(0), frame(40), frame(80), frame(120)), clock=SimulatedClock())
    stamps = []
    for event in source:
        stamps.append(event.stamp_ns // MS)
        source.clock.sleep_until_ns(event.stamp_ns + (30 if len(stamps) != 2 else 300) * MS)
    assert stamps == [0, 40, 340, 380]


def test_a_reading_that_stands_behind_a_later_frame_does_not_hold_the_file_up():
    knob = [Actuation(at * MS, {"knob_deg": 1.0}) for at in (10, 110)]
    source = PacedSource(File(frame(0), frame(100), knob[0], frame(200), knob[1], frame(300)), clock=SimulatedClock())
    assert [stamp for kind, stamp, _ in taken(source, 9) if kind == "Frame"] == [0, 100, 200, 300]
