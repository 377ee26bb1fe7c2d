"""`record` on a bench of emulated devices: one file, health, clocks; faults, a full disk, a guide."""

import json
import os
import resource
import threading
import time

import numpy as np
import pytest

from tipforce.errors import DeviceError, InputError, OutputError
from tipforce.hardware.emulators import CameraEmulator, EncoderEmulator, GrblEmulator, NetFtEmulator, NetFtFaults
from tipforce.io import RecordingReader, RecordingWriter
from tipforce.pipelines import BenchRecording, Guide, missing_for_training
from tipforce.pipelines._guided import Phase
from tipforce.simulation import PRESETS
from tipforce.types import Actuation, Frame, SessionInfo, SystemClock, Wrench

BENCH = """
[sensor]
angle_deg = 0.0
reads = "tip-on-tissue"
[hardware.cameras.camera]
driver = "opencv"
device = "{camera}"
grey = true
fps = 100.0
width = 40
[hardware.force]
driver = "net-ft"
host = "127.0.0.1"
port = {port}
http_port = {http}
rate_hz = 1000.0
[hardware.stage]
driver = "grbl"
port = "{stage}"
[hardware.stage.axes.stage_forward_mm]
axis = "X"
low = -10.0
high = 10.0
[hardware.knob]
driver = "serial"
port = "{knob}"
"""


@pytest.fixture
def devices(tmp_path):
    """A bench.toml, and the emulators that it describes."""
    with (
        CameraEmulator(lambda k: np.full((24, 32), 50 + k % 50, np.uint8), fps=100) as camera,
        NetFtEmulator(lambda t: (0.1, 0.2, 0.0, 0.0, 0.0, 0.0), faults=NetFtFaults(loss=0.02, reorder=0.02)) as box,
        GrblEmulator(tmp_path / "stage") as stage,
        EncoderEmulator(tmp_path / "knob", lambda t: 10.0) as knob,
    ):
        path = tmp_path / "bench.toml"
        path.write_text(
            BENCH.format(camera=camera.url, port=box.port, http=box.http_port, stage=stage.path, knob=knob.path)
        )
        yield path, camera, box


def test_all_devices_are_recorded_into_one_file_on_one_clock(devices, tmp_path):
    bench, _, box = devices
    recording = BenchRecording(bench, seconds=1.0)
    assert any("cameras.camera: width is 32, not 40 as asked for" in line for line in recording.connect())
    assert box.faults.loss > 0
    report = recording.run(tmp_path / "run.mcap", tare="none", offset_ms="none")
    with RecordingReader(tmp_path / "run.mcap") as reader:
        info = reader.info
        _, force, _ = reader.wrenches()
        spans = [(stream.first_ns, stream.last_ns) for stream in info.streams.values()]
    assert set(info.streams) == {"camera", "force", "stage", "knob"}
    assert info.streams["force"].count > 500
    assert np.unique(np.round(force, 6), axis=0).tolist() == [[0.1, 0.2, 0.0]]
    assert max(first for first, _ in spans) < min(last for _, last in spans)
    clock = json.loads(info.metadata["tipforce.clock"]["streams"])
    assert "least delay" in clock["force"]["stamps"]
    assert clock["force"]["offset_s"] is not None
    assert json.loads(info.metadata["tipforce.hardware"]["json"])["force"]["driver"] == "net-ft"
    (counted,) = [d for d in json.loads(info.metadata["tipforce.devices"]["json"]) if d["name"] == "force"]
    assert counted["counts"]["lost"] > 0
    assert info.streams["force"].dropped >= counted["counts"]["late"]
    assert any(line.startswith("force: ") and "lost" in line for line in report.remarks)


def test_a_device_that_is_missing_is_named_unless_it_is_stated_that_it_may(devices, tmp_path, monkeypatch):
    bench, _, _ = devices
    monkeypatch.setattr("tipforce.pipelines._record_bench._CONNECT_S", 0.3)
    bench.write_text(bench.read_text().replace("/knob", "/none"))
    with pytest.raises(DeviceError, match=r"hardware\.knob: .*none cannot be opened.*state partial=True"):
        BenchRecording(bench).connect()
    recording = BenchRecording(bench, partial=True)
    assert any("none cannot be opened" in line for line in recording.connect())
    threading.Timer(1.0, recording.stop).start()
    report = recording.run(tmp_path / "run.mcap", tare="none", offset_ms="none")
    assert "knob" not in report.summary.info.streams
    assert any("nothing came of knob" in line for line in report.remarks)


def test_a_disk_that_is_full_keeps_what_was_written_and_says_so(tmp_path):
    rng = np.random.default_rng(0)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    stamp = 0

    def fill():
        nonlocal stamp
        with RecordingWriter(tmp_path / "run.mcap", SessionInfo("full"), lossless=True) as writer:
            for stamp in range(0, 100_000_000_000, 20_000_000):
                writer.write(Frame(stamp, rng.integers(0, 255, (60, 80), dtype=np.uint8)))

    resource.setrlimit(resource.RLIMIT_FSIZE, (700_000, limits[1]))
    try:
        with pytest.raises(OutputError, match=r"grows too large.*s of this recording are kept in .*run\.mcap\.part"):
            fill()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert os.path.getsize(tmp_path / "run.mcap.part") > 400_000
    with pytest.warns(UserWarning, match="messages recovered"):
        reader = RecordingReader(tmp_path / "run.mcap")
    with reader:
        stamps = reader.stamps()
        assert stamps.tolist() == list(range(0, int(stamps[-1]) + 1, 20_000_000))
        assert stamp - stamps[-1] < 1_500_000_000  # at most what waited to be written
        assert sum(1 for _ in reader.events("camera")) == len(stamps)


def test_what_is_recorded_and_for_how_long_has_to_be_stated(tmp_path):
    with pytest.raises(InputError, match="state either a bench"):
        BenchRecording()
    with pytest.raises(InputError, match="expected more than 0"):
        BenchRecording(tmp_path / "bench.toml", seconds=0.0)


def events(quiet=True, press_n=0.2, seconds=2.0):
    """A session of three phases of ``seconds`` each: 100 Hz force, 20 images a second."""
    for k in range(round(300 * seconds) + 10):
        t = k / 100
        stamp = 10**9 + k * 10**7
        moving, pressing = t > seconds, t > 2 * seconds
        shake = 0.0 if quiet or t > 3 * seconds else 0.1 * np.sin(3 * t)
        yield Wrench(stamp, np.array([0.3 + shake + press_n * pressing, 0.0, 0.0]), np.zeros(3), "sensor")
        if k % 5 == 0:
            yield Actuation(stamp, {"knob_deg": 10.0 * moving})
            yield Frame(stamp, np.full((48, 64), 100 + 50 * moving * (k % 2 == 0), np.uint8))


PHASES = (Phase("tare", 2.0, "tare"), Phase("move", 2.0, "move"), Phase("press", 2.0, "press"))


def guided(**more):
    guide = Guide(PHASES)
    prompts = []
    for event in events(**more):
        guide.take(event)
        prompts.append(guide.prompt())
    return guide, prompts


def test_a_guided_session_measures_what_it_asks_for():
    guide, prompts = guided()
    assert guide.done
    assert guide.lacking() == []
    assert guide.tare_s == pytest.approx((0.0, 2.0), abs=0.02)
    assert guide.peak_n == pytest.approx(0.2)
    assert prompts[0] == "tare: 2 s"
    assert any(line.startswith("press: 1 s (up to 200 mN so far)") for line in prompts)


def test_a_guided_session_says_what_is_missing():
    guide, prompts = guided(quiet=False, press_n=0.01)
    assert any("again: the force moved by" in line for line in prompts)
    said = " ".join(guide.lacking())
    assert "the force was never quiet" in said
    assert "phase 'tare' was over" in said or "at most" in said
    silent = Guide(PHASES)
    for event in events():
        if isinstance(event, Actuation):
            silent.take(event)
    assert "no force came" in " ".join(silent.lacking())
    assert "no image came: check [hardware.cameras]" in " ".join(silent.lacking())
    simulated = " ".join(silent.lacking(simulated=True))
    assert "no image came: the simulated bench is slow on this computer" in simulated
    assert "hardware" not in simulated
    weak, _ = guided(press_n=0.01)
    assert weak.lacking() == ["the tip pressed with 10 mN at most; press with more than 50"]


def test_what_a_recording_lacks_to_be_trained_on(tmp_path):
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo()) as writer:
        for event in events(seconds=0.3):
            writer.write(event)
    from tipforce.pipelines import summarise_recording

    said = missing_for_training(summarise_recording(tmp_path / "run.mcap"))
    assert any("is not tared" in line for line in said)
    assert any("sensor.angle_deg" in line for line in said)
    assert any("catheter is not detected" in line or "is detected in" in line for line in said)


class Simulation:
    """Stands for `LiveSimulation`, whose first second takes several."""

    def __init__(self, _settings, _seed, *, real_time):
        assert real_time
        self.clock = SystemClock(10**9)
        self.source = self
        self.session_info = SessionInfo("one", simulated=True)
        self.settings = PRESETS["bench-2021"]

    def __iter__(self):
        for event in events():
            self.clock.sleep_until_ns(event.stamp_ns)
            yield event

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def test_a_simulated_bench_is_recorded_in_real_time(tmp_path, monkeypatch):
    monkeypatch.setattr("tipforce.pipelines._record_bench.LiveSimulation", Simulation)
    recording = BenchRecording(simulated="bench-2021", seconds=0.3)
    begun = time.monotonic()
    report = recording.run(tmp_path / "run.mcap", tare="none", offset_ms="none")
    assert time.monotonic() - begun > 0.3
    assert report.summary.info.streams["force"].count == 31
    assert report.summary.session_info.simulated
    assert {stream.stream.name for stream in recording.health_at_end[0].streams} == {"force", "joints", "camera"}
