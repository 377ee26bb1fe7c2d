"""The source of a bench: order, drops, clocks, ends; and what bench.toml may say of its devices."""

import threading
import time

import numpy as np
import pytest

from tipforce.errors import DeviceError, FileFormatError, InputError
from tipforce.hardware import (
    ArrivalClock,
    ConstantKnob,
    ConstantKnobConfig,
    DeclaredStream,
    Driver,
    EndOfStream,
    HardwareSource,
    NetFtConfig,
    OpenCvCameraConfig,
    VideoConfig,
    open_bench,
    read_devices,
)
from tipforce.types import Actuation, Frame, Source, Wrench, read_bench


class Scripted(Driver):
    """A driver that gives what it is told, one list a call; an exception is raised."""

    def __init__(self, name, kind, script, connect=()):
        super().__init__(name)
        self.kind, self.script, self.refusals = kind, list(script), list(connect)

    @property
    def streams(self):
        return (
            DeclaredStream({"wrench": "force", "actuation": "joints"}.get(self.kind, "camera"), self.kind, None, ""),
        )

    def connect(self, clock):
        if self.refusals:
            raise self.refusals.pop(0)
        return ()

    def read(self, timeout_s):
        if not self.script:
            time.sleep(timeout_s)
            return ()
        step = self.script.pop(0)
        if isinstance(step, Exception) or step is EndOfStream:
            raise step
        return step

    def close(self):
        pass


def wrench(stamp):
    return Wrench(stamp, np.zeros(3), np.zeros(3), "sensor")


def frame(stamp):
    return Frame(stamp, np.zeros((4, 4), np.uint8))


def test_events_come_in_the_order_of_arrival_until_the_cameras_have_ended():
    source = HardwareSource([
        Scripted("cameras.camera", "frame", [[frame(k)] for k in range(5)] + [EndOfStream]),
        ConstantKnob(ConstantKnobConfig(value=3.0)),
    ])  # fmt: skip
    assert isinstance(source, Source)
    with source as events:
        found = list(events)
    assert [event.stamp_ns for event in found if isinstance(event, Frame)] == [0, 1, 2, 3, 4]
    assert [s.name for s in source.streams] == ["camera", "knob"]
    assert all(event.values == {"knob_deg": 3.0} for event in found if isinstance(event, Actuation))


def test_a_full_queue_drops_the_oldest_and_counts_and_stamps_that_do_not_rise_are_refused():
    stamps = [*range(100), 50, *range(100, 120)]
    source = HardwareSource([Scripted("cameras.camera", "frame", [[frame(k) for k in stamps], EndOfStream])])
    with source:
        while source.health()[0].state != "ended":
            time.sleep(0.001)
        kept = [event.stamp_ns for event in source]
    stream = source.health()[0].streams[0]
    assert kept == list(range(56, 120))
    assert (stream.count, stream.dropped, stream.unsorted) == (120, 56, 1)


def test_what_waited_before_the_recording_began_is_no_part_of_it_and_it_ends_in_time():
    source = HardwareSource([Scripted("force", "wrench", [[wrench(k) for k in range(10)]])])
    with source:
        while source.health()[0].streams[0].count < 10:
            time.sleep(0.001)
        source.begin(0.05)
        begun = time.monotonic()
        assert list(source) == []
    assert 0.04 < time.monotonic() - begun < 2.0


def test_a_device_is_connected_again_with_growing_pauses(monkeypatch):
    monkeypatch.setattr("tipforce.hardware._source.MIN_WAIT_S", 0.01)
    gone = [DeviceError("it is not there")] * 3
    driver = Scripted("force", "wrench", [[wrench(1)], DeviceError("it was pulled out"), [wrench(2)]], gone)
    with HardwareSource([driver]) as source:
        begun = time.monotonic()
        events = iter(source)
        assert [next(events).stamp_ns, next(events).stamp_ns] == [1, 2]
        assert time.monotonic() - begun > 0.07  # 10, 20 and 40 ms
        health = source.health()[0]
        assert (health.connections, health.state) == (2, "connected")
        source.stop()


def test_devices_that_do_not_answer_are_told():
    driver = Scripted("force", "wrench", [], [DeviceError("it is not there")] * 99)
    with HardwareSource([driver]) as source:
        (missing,) = source.wait_connected(0.05)
    assert (missing.name, missing.message, missing.connections) == ("force", "it is not there", 0)


def test_a_mistake_in_a_driver_is_raised_and_not_lost():
    source = HardwareSource([Scripted("force", "wrench", [ZeroDivisionError("a bug")])])
    with source, pytest.raises(ZeroDivisionError):
        next(iter(source))


def test_two_devices_of_one_stream_are_refused():
    with pytest.raises(ValueError, match="two devices give the stream 'force'"):
        HardwareSource([Scripted("a", "wrench", []), Scripted("b", "wrench", [])])


def test_it_can_be_stopped_from_another_thread():
    with HardwareSource([Scripted("force", "wrench", [])]) as source:
        threading.Timer(0.02, source.stop).start()
        assert list(source) == []


def test_the_least_delay_of_late_tells_the_clocks_apart():
    rng = np.random.default_rng(0)
    device = np.arange(0, 30_000_000_000, 10_000_000)
    true = device * (1 + 40e-6) + 5_000_000_000  # 40 ppm slow
    arrival = true + rng.exponential(2e6, len(device)) + 300_000
    clock = ArrivalClock()
    stamps = np.array([clock.host_ns(int(d), int(a)) for d, a in zip(device, arrival, strict=True)])
    assert np.all(np.diff(stamps) > 0)
    error_ms = 1e-6 * (stamps - true)[200:]
    assert np.abs(error_ms - 0.3).max() < 0.5  # the least delay stays in; ten seconds of drift are 0.4 ms
    report = clock.report()
    assert report.drift_ppm == pytest.approx(40, abs=3)
    assert report.delay_s == pytest.approx(2.2e-3, abs=1e-3)


def test_a_device_whose_clock_stood_still_is_found_within_two_seconds():
    device = np.arange(0, 8_000_000_000, 10_000_000)
    arrival = device + 1_000_000_000 + 400_000_000 * (device > 4_000_000_000)
    clock = ArrivalClock()
    stamps = np.array([clock.host_ns(int(d), int(a)) for d, a in zip(device, arrival, strict=True)])
    assert np.all(np.diff(stamps) > 0)
    assert (arrival - stamps)[device > 6_500_000_000].max() == 0


BENCH = """
[views.camera]
metres_per_px = 2.0e-4
[hardware.cameras.camera]
driver = "opencv"
device = 0
fps = 60.0
[hardware.cameras.b]
driver = "video"
source = "b.mp4"
[hardware.force]
driver = "net-ft"
host = "192.168.1.1"
"""


def test_bench_toml_describes_devices_beside_the_metadata(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(BENCH)
    devices = read_devices(path)
    assert devices.cameras["camera"] == OpenCvCameraConfig(device=0, fps=60.0)
    assert devices.cameras["b"] == VideoConfig(source=str(tmp_path / "b.mp4"))
    assert devices.force == NetFtConfig(host="192.168.1.1")
    assert read_bench(path).view("camera").metres_per_px == 2.0e-4
    assert [driver.name for driver in devices.drivers()] == ["cameras.camera", "cameras.b", "force"]
    assert open_bench(path).described["force"]["port"] == 49152


@pytest.mark.parametrize(
    ("was", "now", "message"),
    [
        ("fps = 60.0", "fsp = 60.0", r"hardware\.cameras\.camera\.fsp is not known; .* may hold driver, device, width"),
        (
            "fps = 60.0",
            "fps = -1.0",
            r"hardware\.cameras\.camera\.fps = -1\.0 is refused: input should be greater than 0",
        ),
        ('host = "192.168.1.1"', "", r"hardware\.force\.host is missing"),
        ("net-ft", "netft", r"hardware\.force\.driver = 'netft' is refused: expected one of net-ft, daq"),
        ("[hardware.force]", "[hardware.forces]", r"hardware\.forces is not known; hardware may hold cameras, force"),
    ],
)
def test_what_bench_toml_must_not_say_is_refused_in_one_sentence(tmp_path, was, now, message):
    path = tmp_path / "bench.toml"
    path.write_text(BENCH.replace(was, now))
    with pytest.raises(InputError, match=message):
        read_devices(path)


def test_a_key_within_an_axis_is_named_and_a_calibration_that_is_missing_too(tmp_path):
    path = tmp_path / "bench.toml"
    stage = '[hardware.stage]\ndriver = "grbl"\nport = "/dev/ttyUSB0"\n[hardware.stage.axes.advance_mm]\naxis = "X"\n'
    path.write_text(stage + "low = 0.0\nhigh = 1.0\nspeed = 3.0\n")
    with pytest.raises(
        InputError, match=r"hardware\.stage\.axes\.advance_mm\.speed is not known; .* may hold axis, low"
    ):
        read_devices(path)
    path.write_text('[hardware.force]\ndriver = "daq"\nchannels = "Dev1/ai0:5"\ncalibration = "a.cal"\n')
    with pytest.raises(FileFormatError, match=r"a\.cal: cannot be read"):
        open_bench(path)


def test_a_bench_without_devices_says_what_to_add(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text("[views.camera]\nmetres_per_px = 2.0e-4\n")
    with pytest.raises(InputError, match=r"describes no device; add \[hardware\.cameras\.camera\]"):
        open_bench(path)


def test_health_names_a_clipped_force_sensor():
    rng = np.random.default_rng(0)
    push = 0.3 * np.maximum(0.0, np.sin(np.arange(5000) * 7e-3))
    force = np.round((np.outer(push, [1.0, 0.3, 0.0]) + 3e-3 * rng.standard_normal((5000, 3))) / 5e-3) * 5e-3
    force[:, 0] = np.minimum(force[:, 0], 0.2)
    readings = [Wrench((k + 1) * 1_000_000, force[k], np.zeros(3), "sensor") for k in range(5000)]
    with HardwareSource([Scripted("force", "wrench", [readings])]) as source:
        for _ in range(100):
            (device,) = source.health()
            if device.streams[0].count == 5000:
                break
            time.sleep(0.05)
        (device,) = source.health()
    assert "clipped" in device.message
    assert "fx stays at 0.2 N, the end of its range" in device.message
