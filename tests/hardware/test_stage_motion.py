"""The motion of a heart stage: its limits are checked before anything moves, and a recording holds what was moved."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.hardware import MotionConfig, read_devices
from tipforce.hardware.emulators import CameraEmulator, GrblEmulator
from tipforce.io import RecordingReader
from tipforce.pipelines import BenchRecording, StageMotion
from tipforce.types import AxisLimits

LIMITS = {"stage_forward_mm": AxisLimits(-10.0, 10.0, 80.0, 500.0)}
BENCH = """
[hardware.cameras.camera]
driver = "opencv"
device = "{camera}"
grey = true
[hardware.stage]
driver = "grbl"
port = "{stage}"
[hardware.stage.motion]
{motion}
[hardware.stage.axes.stage_forward_mm]
axis = "X"
low = -10.0
high = 10.0
"""
SINE = "amplitude_mm = 4.0\nrate_hz = 1.2\nrespiration_mm = 2.0\nrest_s = 1.0"
HALF_WAVE = 'wave = "half-wave PQRST"\namplitude_mm = 3.0\nrate_hz = 1.0\nrest_s = 1.0'


def motion(**values: object) -> StageMotion:
    return StageMotion(MotionConfig.model_validate({"amplitude_mm": 4.0, "rate_hz": 1.2, **values}))


def test_speed_and_acceleration_are_those_of_the_waves() -> None:
    need = motion(respiration_mm=2.0).needs()["stage_forward_mm"]
    beat, breath = 2 * np.pi * 1.2, 2 * np.pi * 0.25
    assert need.max_speed == pytest.approx(4.0 * beat + 2.0 * breath, rel=1e-3)
    assert need.max_acceleration == pytest.approx(4.0 * beat**2 + 2.0 * breath**2, rel=1e-2)
    assert (need.low, need.high) == pytest.approx((-6.0, 6.0), abs=1e-3)
    assert set(motion(lateral_share=0.5).needs()) == {"stage_forward_mm", "stage_across_mm"}


@pytest.mark.parametrize("wave", ["sine", "half-wave PQRST"])
def test_the_motion_grows_from_rest_and_keeps_to_what_it_needs(wave: str) -> None:
    made = motion(wave=wave, respiration_mm=1.0)
    time_s = np.arange(0.0, 8.0, 1e-3)
    places = np.array([made.course(t)["stage_forward_mm"] for t in time_s])
    need = made.needs()["stage_forward_mm"]
    assert (places[0], need.low) == pytest.approx((-5.0, -5.0), abs=1e-3)
    assert abs(places[5] - places[0]) < 1e-3
    assert need.low - 1e-3 <= places.min()
    assert places.max() <= need.high + 1e-3
    assert np.abs(np.diff(places[2000:])).max() / 1e-3 <= 1.02 * need.max_speed


@pytest.mark.parametrize(
    ("wrong", "said", "mended"),
    [
        ({"amplitude_mm": 12.0}, "goes from -12 to 12 mm, beyond hardware.stage.axes.stage_forward_mm.low = -10",
         {"amplitude_mm": 4.0}),
        ({"middle_mm": 8.0}, "goes from 4 to 12 mm", {"middle_mm": 5.0}),
        ({"amplitude_mm": 8.0, "rate_hz": 2.0}, "needs 100.5 mm/s, but stage_forward_mm goes at most 80.0",
         {"amplitude_mm": 8.0, "rate_hz": 1.0}),
        ({"rate_hz": 2.5}, "needs 987 mm/s^2, but stage_forward_mm has at most 500", {"rate_hz": 1.5}),
    ],
)  # fmt: skip
def test_what_an_axis_cannot_do_is_said_before_it_moves(wrong: dict, said: str, mended: dict) -> None:
    with pytest.raises(InputError, match=rf"hardware\.stage\.motion {re.escape(said)}"):
        motion(**wrong).check(LIMITS)
    motion(**mended).check(LIMITS)
    with pytest.raises(InputError, match=r"moves stage_across_mm; add \[hardware.stage.axes.stage_across_mm\]"):
        motion(lateral_share=0.5).check(LIMITS)


def test_a_key_of_the_motion_that_is_not_known_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(BENCH.format(camera="x", stage="y", motion="amplitude_mm = 4.0\nrate_hz = 1.0\nheight = 1.0"))
    with pytest.raises(InputError, match=r"stage\.motion\.height is not known; .* may hold wave, amplitude_mm"):
        read_devices(path)


@pytest.mark.parametrize(
    "words", [pytest.param(SINE, id="sine"), pytest.param(HALF_WAVE, id="half-wave PQRST", marks=pytest.mark.slow)]
)
def test_a_recording_moves_the_stage_and_holds_where_it_was(tmp_path: Path, words: str) -> None:
    with (
        CameraEmulator(lambda k: np.full((24, 32), 50 + k % 50, np.uint8), fps=30) as camera,
        GrblEmulator(tmp_path / "stage") as grbl,
    ):
        bench = tmp_path / "bench.toml"
        bench.write_text(BENCH.format(camera=camera.url, stage=grbl.path, motion=words))
        recording = BenchRecording(bench, seconds=5.0)
        recording.connect()
        recording.run(tmp_path / "run.mcap", tare="none", offset_ms="none")
        assert grbl.overruns == 0
        deadline = time.monotonic() + 5.0
        while grbl._state == "Jog" and time.monotonic() < deadline:
            time.sleep(0.01)
        assert b"\x85" in grbl.realtime  # it was stopped at the end
    made = StageMotion(read_devices(bench).stage.motion)  # type: ignore[union-attr]
    with RecordingReader(tmp_path / "run.mcap") as reader:
        readings = reader.stage_readings()
    time_s = (np.array([stamp_ns for stamp_ns, _ in readings]) - readings[0][0]) * 1e-9
    places = np.array([values["stage_forward_mm"] for _, values in readings])
    assert np.abs(places[time_s < 0.5] - made.course(0.0)["stage_forward_mm"]).max() < 0.05  # at rest for the tare
    lates = np.arange(0.8, 2.5, 0.01)
    left = [
        np.sqrt(np.mean([(made.course(t - late)["stage_forward_mm"] - place) ** 2
                         for t, place in zip(time_s, places, strict=True) if t > 3.0]))
        for late in lates
    ]  # fmt: skip
    assert min(left) < 0.15 * np.ptp(places)  # 0.01 where the machine is not loaded
