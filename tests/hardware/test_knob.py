"""The knob's angle: an encoder at a serial port, a log, a constant."""

import time

import pytest

from tipforce.errors import DeviceError, InputError
from tipforce.hardware import (
    ConstantKnob,
    ConstantKnobConfig,
    HardwareSource,
    LogKnob,
    LogKnobConfig,
    SerialKnob,
    SerialKnobConfig,
)
from tipforce.hardware.emulators import EncoderEmulator
from tipforce.types import SystemClock


def test_an_encoder_s_numbers_become_degrees_and_what_is_no_number_is_counted(tmp_path):
    with EncoderEmulator(tmp_path / "knob", lambda _: 200.0, rate_hz=200) as encoder:
        knob = SerialKnob(SerialKnobConfig(port=str(encoder.path), scale=0.1, offset=-5.0))
        knob.connect(SystemClock(10**9))
        events = []
        while len(events) < 5:
            events += knob.read(0.1)
        assert {event.values["knob_deg"] for event in events} == {15.0}
        encoder.garbage = True
        time.sleep(0.05)
        while not knob.counts["malformed"]:
            events += knob.read(0.1)
        assert {event.values["knob_deg"] for event in events} == {15.0}
        knob.close()


def test_an_angle_that_no_knob_has_is_refused(tmp_path):
    with EncoderEmulator(tmp_path / "knob", lambda _: 1e9, rate_hz=200) as encoder:
        knob = SerialKnob(SerialKnobConfig(port=str(encoder.path)))
        knob.connect(SystemClock(10**9))
        while not knob.counts["malformed"]:
            assert not knob.read(0.1)
        assert "check scale and baud" in knob.remark
        knob.close()


def test_an_encoder_that_falls_silent_or_is_pulled_out_is_found_again(tmp_path, monkeypatch):
    monkeypatch.setattr("tipforce.hardware._knob.MAX_SILENCE_S", 0.1)
    with EncoderEmulator(tmp_path / "knob", lambda _: 10.0, rate_hz=200) as encoder:
        source = HardwareSource([SerialKnob(SerialKnobConfig(port=str(encoder.path), rate_hz=200.0))])
        with source:
            events = iter(source)
            next(events)
            encoder.silent = True
            wait(lambda: "has written no number" in source.health()[0].message)
            encoder.silent = False
            wait(lambda: source.health()[0].connections == 2)
            encoder.unplug()
            wait(lambda: source.health()[0].state == "lost")
            encoder.plug_in()
            wait(lambda: source.health()[0].connections == 3)
            source.stop()


def wait(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_a_port_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DeviceError, match=r"hardware\.knob: .*none cannot be opened"):
        SerialKnob(SerialKnobConfig(port=str(tmp_path / "none"))).connect(SystemClock())


def test_a_log_of_another_program_is_played_as_bench_states_it(tmp_path):
    path = tmp_path / "knob.csv"
    path.write_text("time;angle\n0;1,5\n10;2,5\n")
    with pytest.raises(InputError, match=r"hardware\.knob\.log\.time_unit"):
        LogKnob(LogKnobConfig(path=path)).connect(SystemClock())
    with pytest.raises(InputError, match=r"hardware\.knob\.log\.columns"):
        LogKnob(LogKnobConfig(path=path, log={"time_unit": "ms"})).connect(SystemClock())
    log = LogKnob(LogKnobConfig(path=path, log={"columns": ["time_ms", "knob_deg"]}))
    log.connect(SystemClock())
    assert [event.values["knob_deg"] for _ in range(3) for event in log.read(0.05)] == [1.5, 2.5]


def test_a_log_is_played_from_when_the_source_began_and_a_constant_is_told_at_once(tmp_path):
    (tmp_path / "knob.csv").write_text("time_s,knob_deg\n5.00,1\n5.01,2\n5.03,3\n")
    log = LogKnob(LogKnobConfig(path=tmp_path / "knob.csv"))
    clock = SystemClock(10**9)
    log.connect(clock)
    events = [event for _ in range(4) for event in log.read(0.05)]
    assert [event.values["knob_deg"] for event in events] == [1.0, 2.0, 3.0]
    assert events[2].stamp_ns - events[0].stamp_ns == 30_000_000
    assert clock.now_ns() >= events[2].stamp_ns
    constant = ConstantKnob(ConstantKnobConfig(value=12.0))
    constant.connect(clock)
    assert constant.read(0.05)[0].values == {"knob_deg": 12.0}
    assert constant.read(0.01) == ()
