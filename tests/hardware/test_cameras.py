"""Cameras: OpenCV over a real stream, stamps of a driver, GenICam (a producer where there is one), video files."""

import importlib.util
import sys
import threading
import time
import types
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import DeviceError, MissingExtraError
from tipforce.hardware import (
    GenICamCamera,
    GenICamCameraConfig,
    HardwareSource,
    OpenCvCamera,
    OpenCvCameraConfig,
    Video,
    VideoConfig,
)
from tipforce.hardware.emulators import CameraEmulator
from tipforce.io import write_video
from tipforce.types import Frame, SystemClock

WIDTH, HEIGHT = 64, 48


def numbered(number):
    """An image whose brightness tells its number."""
    return np.full((HEIGHT, WIDTH), 10 + 2 * (number % 100), np.uint8)


def test_two_network_cameras_at_once_reach_the_source_with_their_latency():
    with CameraEmulator(numbered, fps=100) as a, CameraEmulator(numbered, fps=100) as b:
        drivers = [
            OpenCvCamera(OpenCvCameraConfig(device=a.url, grey=True, width=WIDTH, fps=25.0, latency_ms=30.0), "a"),
            OpenCvCamera(OpenCvCameraConfig(device=b.url), "b"),
        ]
        with HardwareSource(drivers) as source:
            assert source.wait_connected(10.0) == (), source.health()
            events = []
            for event in source:
                events.append(event)
                if len(events) == 1:
                    late_s = (source.clock.now_ns() - event.stamp_ns) * 1e-9
                if {e.view for e in events[-20:]} == {"a", "b"} and len(events) > 20:
                    source.stop()
            settings = {each.name: each for each in source.health()[0].settings}
    assert {e.image.shape for e in events if e.view == "a"} == {(HEIGHT, WIDTH)}
    assert {e.image.shape for e in events if e.view == "b"} == {(HEIGHT, WIDTH)}  # grey as it is sent
    assert late_s >= (0.03 if events[0].view == "a" else 0.0)
    assert not settings["width"].differs
    assert settings["width"].actual == WIDTH


def test_who_is_slow_finds_the_newest_frame_only():
    with CameraEmulator(numbered, fps=200) as camera:
        driver = OpenCvCamera(OpenCvCameraConfig(device=camera.url))
        with HardwareSource([driver], newest_only=True) as source:
            frames = iter(source)
            first = next(frames)
            time.sleep(0.3)
            second = next(frames)
            health = source.health()[0].streams[0]
            assert (source.clock.now_ns() - second.stamp_ns) * 1e-9 < 0.1
            assert second.stamp_ns - first.stamp_ns > 0.2e9
            assert health.dropped > 10
            source.stop()


class Capture:
    """A camera as OpenCV's V4L2 has it: POS_MSEC is the monotonic clock at which the image was taken."""

    def __init__(self, _device, *, late_s=0.05, stamped=True, size_changes=False):
        self.values, self.late_s, self.stamped, self.size_changes, self.count = {}, late_s, stamped, size_changes, 0

    def isOpened(self):
        return True

    def set(self, number, value):
        self.values[number] = value

    def read(self):
        self.count += 1
        time.sleep(0.002)
        self.taken_s = time.monotonic() - self.late_s
        if self.count > 30:
            return False, None
        return True, np.zeros((HEIGHT, WIDTH + 2 * (self.size_changes and self.count > 10), 3), np.uint8)

    def get(self, number):
        import cv2

        if number == cv2.CAP_PROP_POS_MSEC:
            return 1e3 * self.taken_s if self.stamped else 0.0
        return self.values.get(number, 0.0) if number != cv2.CAP_PROP_FPS else 30.0

    def release(self):
        pass


def read_until_it_fails(driver, taken=None, reads=60):
    for _ in range(reads):
        frames = driver.read(0.02)
        if taken is not None:
            taken += frames


@pytest.mark.parametrize(("stamped", "late_s"), [(True, 0.05), (False, 0.02)])
def test_stamps_are_the_driver_s_where_it_gives_them_else_those_of_the_arrival(stamped, late_s):
    config = OpenCvCameraConfig(device=0, fps=60.0, fourcc="MJPG", latency_ms=20.0)
    driver = OpenCvCamera(config, open_capture=lambda device: Capture(device, stamped=stamped))
    clock = SystemClock(10**9)
    settings = {each.name: each for each in driver.connect(clock)}
    assert settings["fps"].differs
    assert settings["fps"].actual == 30.0
    assert settings["fourcc"].actual == "MJPG"
    ages = []
    for _ in range(15):
        (frame,) = driver.read(0.1)
        ages.append((clock.now_ns() - frame.stamp_ns) * 1e-9)
    assert min(ages[8:]) == pytest.approx(late_s, abs=0.005)
    assert bool(driver.clocks()) == stamped


def test_a_camera_whose_images_change_their_size_or_stop_is_lost():
    driver = OpenCvCamera(OpenCvCameraConfig(device=0), open_capture=lambda d: Capture(d, size_changes=True))
    driver.connect(SystemClock())
    with pytest.raises(DeviceError, match="the size of its images changed"):
        read_until_it_fails(driver)
    driver = OpenCvCamera(OpenCvCameraConfig(device=0), open_capture=Capture)
    driver.connect(SystemClock())
    with pytest.raises(DeviceError, match="gives no image any more"):
        read_until_it_fails(driver)


def test_images_of_a_driver_with_stamps_are_as_old_as_their_stamps_after_a_pause_of_this_program():
    """V4L2 keeps the images before the pause; their stamps are on the monotonic clock."""
    capture = Capture(0)
    driver = OpenCvCamera(OpenCvCameraConfig(device=0), open_capture=lambda _: capture)
    clock = SystemClock(10**9)
    driver.connect(clock)
    for _ in range(8):
        driver.read(0.1)
    capture.late_s = 1.6  # as after a pause
    (old,) = driver.read(0.1)
    assert (clock.now_ns() - old.stamp_ns) * 1e-9 == pytest.approx(1.6, abs=0.1)
    capture.late_s = 0.05
    (new,) = driver.read(0.1)
    assert (clock.now_ns() - new.stamp_ns) * 1e-9 == pytest.approx(0.05, abs=0.02)
    capture.late_s, capture.count = 3.0, -3000
    with pytest.raises(DeviceError, match=r"arrive 3\.\d s late, so it is connected anew"):
        read_until_it_fails(driver, reads=3000)


def test_images_from_before_the_computer_slept_are_discarded(monkeypatch):
    slept_s = 0.0
    capture = Capture(0)
    driver = OpenCvCamera(OpenCvCameraConfig(device=0), open_capture=lambda _: capture)
    clock = SystemClock(10**9)
    true_now = SystemClock.now_ns
    monkeypatch.setattr(SystemClock, "now_ns", lambda self: true_now(self) + round(slept_s * 1e9))
    driver.connect(clock)
    for _ in range(8):
        assert driver.read(0.1)
    slept_s = 3600.0
    assert driver.read(0.1) == ()  # taken 50 ms before, on a clock that stood still meanwhile
    capture.late_s = 0.0
    time.sleep(0.06)
    assert driver.read(0.1)


def coded(number):
    """An image that holds its number."""
    image = np.full((HEIGHT, WIDTH), 20 + 4 * (number % 50), np.uint8)
    image[:, WIDTH // 2 :] = 20 + 4 * (number // 50)
    return image


def number_in(image):
    halves = image[:, 4 : WIDTH // 2 - 4], image[:, WIDTH // 2 + 4 : -4]
    low, high = (round((float(half.mean()) - 20.0) / 4.0) for half in halves)
    return low + 50 * high


@pytest.mark.parametrize("driver", ["opencv", "video"])
def test_images_that_waited_while_nobody_read_do_not_count_as_current(driver):
    sent: list[int] = []

    def image(number):
        sent.append(time.monotonic_ns())
        return coded(number)

    with CameraEmulator(image, fps=50) as camera:
        if driver == "opencv":
            device = OpenCvCamera(OpenCvCameraConfig(device=camera.url, grey=True))
        else:
            device = Video(VideoConfig(source=camera.url, grey=True))
        clock = SystemClock(10**9)
        device.connect(clock)
        ahead_ns = clock.now_ns() - time.monotonic_ns()
        frames: list[Frame] = []
        paused = False
        while len(frames) < 50:
            frames += device.read(0.1)
            if len(frames) >= 30 and not paused:
                paused = True
                time.sleep(1.0)
        device.close()
    true_ages = []
    for frame in frames:
        sent_ns = sent[number_in(frame.image)] + ahead_ns
        assert frame.stamp_ns - frame.max_delay_ns <= sent_ns + 60_000_000, "the bound holds"
        true_ages.append((frame.stamp_ns - sent_ns) * 1e-9)
    assert max(true_ages) < 0.3
    assert device.counts["discarded, for they had waited in a buffer"] > 20


@pytest.mark.parametrize("driver", ["opencv", "video"])
def test_a_network_camera_whose_images_change_their_size_is_refused(driver):
    """OpenCV's own reader of streams scales them to the first size."""
    large = threading.Event()

    def image(number):
        return np.full((HEIGHT * (1 + large.is_set()), WIDTH * (1 + large.is_set())), 40 + number % 100, np.uint8)

    with CameraEmulator(image, fps=100) as camera:
        config = (
            OpenCvCamera(OpenCvCameraConfig(device=camera.url))
            if driver == "opencv"
            else Video(VideoConfig(source=camera.url))
        )
        config.connect(SystemClock())
        while not config.read(0.1):
            pass
        large.set()
        with pytest.raises(DeviceError, match="the size of its images changed from 64x48 to 128x96"):
            read_until_it_fails(config)
        config.close()


def test_a_camera_that_is_gone_is_found_again():
    with (
        CameraEmulator(numbered, fps=100) as camera,
        HardwareSource([OpenCvCamera(OpenCvCameraConfig(device=camera.url))]) as source,
    ):
        next(iter(source))
        camera.gone = True
        end = time.monotonic() + 10.0
        while source.health()[0].state == "connected":
            assert time.monotonic() < end
            time.sleep(0.01)
        camera.gone = False
        before = source.health()[0].streams[0].count
        while source.health()[0].streams[0].count == before:
            assert time.monotonic() < end
            time.sleep(0.01)
        assert source.health()[0].connections == 2


def test_a_video_file_plays_in_its_own_time_and_ends(tmp_path):
    path = tmp_path / "video.mp4"
    write_video(path, (Frame(k * 20_000_000, numbered(k)) for k in range(10)), 50)
    with HardwareSource([Video(VideoConfig(source=str(path), grey=True))]) as source:
        frames = [(frame, source.clock.now_ns()) for frame in source]
    stamps = np.array([frame.stamp_ns for frame, _ in frames])
    np.testing.assert_allclose(np.diff(stamps), 20e6, atol=2e4)
    assert all(now >= frame.stamp_ns for frame, now in frames)
    assert source.health()[0].state == "ended"


def test_a_stream_of_the_network_is_opened_through_ffmpeg():
    with CameraEmulator(numbered, fps=100) as camera:
        driver = Video(VideoConfig(source=camera.url, options={"probesize": "5000"}))
        clock = SystemClock(10**9)
        settings = {each.name: each.actual for each in driver.connect(clock)}
        frames: list[Frame] = []
        while len(frames) < 10:
            frames += driver.read(0.1)
        driver.close()
    assert settings["codec"] == "mjpeg"
    assert frames[0].image.shape == (HEIGHT, WIDTH)  # grey as it is sent
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] <= clock.now_ns()
    with pytest.raises(DeviceError, match="cannot be opened"):
        Video(VideoConfig(source="rtsp://127.0.0.1:9/none")).connect(clock)


def fake_harvesters(monkeypatch, stamped=True):
    """A module with the part of harvesters' API that the driver uses, as harvesters 1.4.3 has it."""

    class Node:
        def __init__(self, value, most=None):
            self._value, self._most = value, most

        @property
        def value(self):
            return self._value

        @value.setter
        def value(self, value):
            self._value = value if self._most is None else min(value, self._most)

    class Buffer:
        def __init__(self, number):
            data = np.full(WIDTH * HEIGHT, number, np.uint8)
            part = types.SimpleNamespace(data=data, width=WIDTH, height=HEIGHT, data_format="Mono8")
            self.payload = types.SimpleNamespace(components=[part] if number != 3 else [])
            self.number = number

        @property
        def timestamp_ns(self):
            if not stamped:
                raise RuntimeError("not available")
            return 77 * 10**9 + self.number * 10**7

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    class Acquirer:
        def __init__(self):
            nodes = {"Width": Node(WIDTH), "Height": Node(HEIGHT), "PixelFormat": Node("Mono8")}
            nodes["AcquisitionFrameRate"] = Node(20.0, most=60.0)
            self.remote_device = types.SimpleNamespace(node_map=types.SimpleNamespace(**nodes))
            self.number = 0

        def start(self):
            pass

        stop = destroy = start

        def try_fetch(self, *, timeout):
            self.number += 1
            if self.number > 8:
                time.sleep(timeout)
                return None
            time.sleep(0.01)
            return Buffer(self.number)

    class Harvester:
        device_info_list = (types.SimpleNamespace(serial_number="red"), types.SimpleNamespace(serial_number="blue"))

        def add_file(self, path):
            assert Path(path).is_file()

        def update(self):
            pass

        reset = update

        def create(self, wanted):
            assert wanted in (0, {"serial_number": "blue"})
            return Acquirer()

    core = types.ModuleType("harvesters.core")
    core.Harvester = Harvester  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "harvesters", types.ModuleType("harvesters"))
    monkeypatch.setitem(sys.modules, "harvesters.core", core)


@pytest.mark.parametrize("stamped", [True, False])
def test_a_genicam_camera_is_set_up_read_back_and_read(monkeypatch, tmp_path, stamped):
    fake_harvesters(monkeypatch, stamped)
    monkeypatch.setattr("tipforce.hardware._genicam.MAX_SILENCE_S", 0.05)
    producer = tmp_path / "maker.cti"
    producer.touch()
    driver = GenICamCamera(GenICamCameraConfig(producer=producer, serial_number="blue", fps=100.0))
    clock = SystemClock(10**9)
    settings = {each.name: each for each in driver.connect(clock)}
    assert settings["AcquisitionFrameRate"].differs
    assert settings["AcquisitionFrameRate"].actual == 60.0
    frames: list[Frame] = []
    with pytest.raises(DeviceError, match="has given no image"):
        read_until_it_fails(driver, frames)
    driver.close()
    assert [int(frame.image[0, 0]) for frame in frames] == [1, 2, 4, 5, 6, 7, 8]
    assert driver.counts["incomplete"] == 1
    assert bool(driver.clocks()) == stamped
    if stamped:
        np.testing.assert_allclose(np.diff([frame.stamp_ns for frame in frames[2:]]), 1e7, atol=5e6)
    with pytest.raises(DeviceError, match="is not there; there are red, blue"):
        GenICamCamera(GenICamCameraConfig(producer=producer, serial_number="green")).connect(clock)


def test_a_genicam_camera_of_a_real_producer():
    """The producer that the package genicam brings along: three cameras that play a game."""
    pytest.importorskip("harvesters")
    found = importlib.util.find_spec("genicam")
    assert found is not None
    assert found.origin is not None
    config = GenICamCameraConfig(producer=Path(found.origin).parent / "viky.cti", serial_number="1", fps=50.0)
    driver = GenICamCamera(config)
    settings = {each.name: each.actual for each in driver.connect(SystemClock(10**9))}
    try:
        frames = []
        while len(frames) < 3:
            frames += driver.read(1.0)
    finally:
        driver.close()
    assert frames[0].image.shape == (settings["Height"], settings["Width"], 3)
    assert frames[0].stamp_ns < frames[1].stamp_ns < frames[2].stamp_ns


def test_without_harvesters_the_line_that_installs_it_is_said(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "harvesters", None)
    monkeypatch.setitem(sys.modules, "harvesters.core", None)
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[hardware\]'"):
        GenICamCamera(GenICamCameraConfig(producer=tmp_path)).connect(SystemClock())
