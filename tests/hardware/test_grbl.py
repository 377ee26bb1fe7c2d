"""The stage's driver against a GRBL controller: send-response, read-back, ramps, stops, alarms, a port that is gone."""

import math
import time

import numpy as np
import pytest

from tipforce.errors import DeviceError
from tipforce.hardware import AxisConfig, GrblConfig, GrblStage, HardwareSource
from tipforce.hardware.emulators import GrblEmulator
from tipforce.types import JOINTS, STAGE, Actuators, SystemClock

AXES = {
    "stage_forward_mm": AxisConfig(axis="X", low=-10.0, high=10.0, max_speed=80.0),
    "advance_mm": AxisConfig(axis="Y", low=-5.0, high=20.0, scale=-2.0),
}


@pytest.fixture
def bench(tmp_path):
    """A controller, its driver and a source that is connected."""
    with GrblEmulator(tmp_path / "stage") as grbl:
        stage = GrblStage(GrblConfig(port=str(grbl.path), axes=AXES, settings={"120": 2000.0, "130": 250.0}))
        with HardwareSource([stage]) as source:
            assert source.wait_connected(5.0) == (), source.health()[0].message
            yield grbl, stage, source


def read_for(stage, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        stage.read(0.05)


def until(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_the_controller_s_settings_are_read_back_and_the_lower_limit_holds(bench):
    _, stage, source = bench
    assert isinstance(stage.actuators, Actuators)
    limits = stage.actuators.limits
    assert limits["stage_forward_mm"].max_speed == 80.0  # stated; the controller would go 100
    assert limits["advance_mm"].max_speed == pytest.approx(50.0)  # 6000 mm/min of its units, two for one of ours
    assert limits["advance_mm"].max_acceleration == pytest.approx(1000.0)
    settings = {each.name: each for each in source.health()[0].settings}
    assert not settings["$120"].differs
    assert settings["$130"].differs
    assert settings["$130"].actual == 200.0


def test_axes_go_to_their_targets_at_their_speed_and_say_where_they_are(bench):
    grbl, stage, source = bench
    taken = stage.actuators.command({"stage_forward_mm": 6.0, "advance_mm": 99.0})
    assert taken.targets["advance_mm"] == 20.0
    assert taken.clipped == {"advance_mm": 99.0}
    until(lambda: stage.state == "Idle" and grbl.place[0] == 6.0)
    assert grbl.place[:2] == [6.0, -40.0]
    assert grbl.peak_mm_s <= 102.0  # 20 mm at 50 mm/s decide; along the path 101 of the controller's units
    until(lambda: stage.actuators.read().values["advance_mm"] == pytest.approx(20.0))
    source.stop()
    streams = {event.stream: event.values for event in source}
    assert streams[STAGE] == {"stage_forward_mm": 6.0}
    assert streams[JOINTS]["advance_mm"] == pytest.approx(20.0)


def test_a_target_may_be_changed_on_the_way(bench):
    grbl, stage, _ = bench
    stage.actuators.command({"stage_forward_mm": 9.0})
    until(lambda: grbl.place[0] > 1.0)
    stage.actuators.command({"stage_forward_mm": -3.0})
    until(lambda: grbl.place[0] == -3.0)
    assert len([line for line in grbl.heard if line.startswith("$J=")]) == 2
    stage.actuators.command({"stage_forward_mm": 1.0})
    stage.actuators.command({"stage_forward_mm": 2.0})  # further the same way: nothing has to stop
    until(lambda: grbl.place[0] == 2.0)


def test_a_stop_brakes_within_the_ramp_and_one_axis_can_be_stopped_alone(bench):
    grbl, stage, _ = bench
    stage.actuators.command({"stage_forward_mm": 10.0})
    until(lambda: grbl.place[0] > 2.0)
    stage.actuators.stop()
    until(lambda: stage.state == "Idle")
    here = grbl.place[0]
    assert 2.0 < here < 9.0
    time.sleep(0.05)
    assert grbl.place[0] == here
    stage.actuators.command({"stage_forward_mm": -10.0, "advance_mm": 10.0})
    until(lambda: grbl.place[1] < -2.0)
    stage.actuators.stop("stage_forward_mm")
    until(lambda: grbl.place[1] == -20.0)
    assert grbl.place[0] > -10.0
    with pytest.raises(ValueError, match="there is no such axis"):
        stage.actuators.stop("knob_deg")


def test_an_alarm_stops_commands_until_a_person_unlocks(bench):
    grbl, stage, source = bench
    stage.actuators.command({"stage_forward_mm": 8.0})
    until(lambda: grbl.place[0] > 1.0)
    grbl.trigger_limit()
    until(lambda: stage.alarm)
    with pytest.raises(DeviceError, match=r"hardware\.stage: alarm 1: a hard limit was hit"):
        stage.actuators.command({"stage_forward_mm": 0.0})
    assert "alarm 1" in source.health()[0].message
    stage.unlock()
    until(lambda: stage.state == "Idle")
    stage.actuators.command({"stage_forward_mm": 0.0})
    until(lambda: grbl.place[0] == 0.0)


def test_what_the_controller_refuses_is_said(tmp_path):
    with GrblEmulator(tmp_path / "stage", {"20": 1.0, "130": 5.0}) as grbl:
        stage = GrblStage(GrblConfig(port=str(grbl.path), axes=AXES))
        with HardwareSource([stage]) as source:
            assert source.wait_connected(5.0) == ()
            assert next(s for s in source.health()[0].settings if s.name == "stage_forward_mm.travel").differs
            stage.actuators.command({"stage_forward_mm": 8.0})
            until(lambda: "error:15" in source.health()[0].message)
            assert grbl.place[0] == 0.0


def test_a_stage_that_is_pulled_out_is_found_again(bench):
    grbl, stage, source = bench
    grbl.unplug()
    until(lambda: source.health()[0].state == "lost")
    with pytest.raises(DeviceError, match="is not connected"):
        stage.actuators.command({"stage_forward_mm": 1.0})
    stage.actuators.stop()  # nothing to stop, and no error on the way out
    grbl.plug_in()
    until(lambda: source.health()[0].state == "connected")
    stage.actuators.command({"stage_forward_mm": 1.0})
    until(lambda: grbl.place[0] == 1.0)


def test_a_stage_that_does_not_answer_is_lost(tmp_path, monkeypatch):
    with GrblEmulator(tmp_path / "stage") as grbl:
        stage = GrblStage(GrblConfig(port=str(grbl.path), axes=AXES))
        stage.connect(SystemClock())
        monkeypatch.setattr("tipforce.hardware._grbl.MAX_SILENCE_S", 0.1)
        monkeypatch.setattr("tipforce.hardware._grbl.MAX_WAKE_S", 0.1)
        grbl.mute = True
        with pytest.raises(DeviceError, match="has not answered"):
            read_for(stage, seconds=2.0)
        stage.close()
        with pytest.raises(DeviceError, match="does not answer"):
            stage.connect(SystemClock())
        stage.close()


def test_the_place_where_it_stands_can_be_made_the_zero(tmp_path):
    with GrblEmulator(tmp_path / "stage") as grbl:
        grbl.place[0] = 7.0
        stage = GrblStage(GrblConfig(port=str(grbl.path), axes=AXES, zero=True))
        with HardwareSource([stage]) as source:
            assert source.wait_connected(5.0) == ()
            until(lambda: stage.actuators.read().values["stage_forward_mm"] == 0.0)
            stage.actuators.command({"stage_forward_mm": 2.0})
            until(lambda: grbl.place[0] == 9.0)


def wave(time_s: float) -> dict[str, float]:
    """4 mm at 1.2 Hz, from rest."""
    share = min(1.0, time_s)
    return {"stage_forward_mm": 4.0 * share * share * (3.0 - 2.0 * share) * math.sin(2.0 * math.pi * 1.2 * time_s)}


def test_a_course_is_one_smooth_motion_in_time_and_a_stop_brakes_it(bench):
    grbl, stage, _ = bench
    began = time.monotonic()
    stage.actuators.follow(wave)
    with pytest.raises(DeviceError, match="follows a trajectory; stop it before another command"):
        stage.actuators.command({"stage_forward_mm": 0.0})
    seconds, places = [], []
    while time.monotonic() - began < 4.5:
        seconds.append(time.monotonic() - began)
        places.append(grbl.place[0])
        time.sleep(0.01)
    late_s, rms_mm = best_fit(np.array(seconds), np.array(places))
    assert late_s < 0.1
    assert rms_mm < 0.8  # of 8 mm; 0.1 where the machine is not loaded
    assert grbl.overruns == 0
    stage.actuators.stop()
    until(lambda: stage.state == "Idle")
    here = grbl.place[0]
    time.sleep(0.3)
    assert grbl.place[0] == here
    stage.actuators.command({"stage_forward_mm": 1.0})
    until(lambda: grbl.place[0] == 1.0)


def best_fit(seconds: np.ndarray, places: np.ndarray) -> tuple[float, float]:
    """The lateness that explains ``places`` best, and what is left: rms in mm, after two seconds."""
    lates = np.arange(0.0, 0.4, 0.005)
    left = [
        np.sqrt(np.mean([(wave(max(0.0, t - late))["stage_forward_mm"] - place) ** 2
                         for t, place in zip(seconds, places, strict=True) if t > 2.0]))
        for late in lates
    ]  # fmt: skip
    return float(lates[np.argmin(left)]), float(min(left))
