import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.alignment import labels, observations
from tipforce.errors import InputError
from tipforce.io import ClockMap, RecordingReader, RecordingWriter, Tare
from tipforce.types import Actuation, Event, Frame, SensorInfo, SessionInfo, Wrench

GREY = np.zeros((8, 8), np.uint8)


def write(path: Path, events: list[Event], *facts: ClockMap | Tare | SensorInfo) -> Path:
    with RecordingWriter(path, SessionInfo()) as writer:
        for fact in facts:
            writer.state(fact)
        for event in sorted(events, key=lambda event: event.stamp_ns):
            writer.write(event)
    return path


def wrench(stamp: int, *force: float, frame: str = "sensor") -> Wrench:
    return Wrench(stamp, np.array(force), np.full(3, math.nan), frame)


def test_offset_tare_and_pose_are_applied_and_time_is_interpolated(tmp_path: Path) -> None:
    """Reading r(t) = (t, 0, 2 t) + bias; the camera's clock is 5 ms ahead; the sensor is turned by 90 degrees."""
    readings = [wrench(k * 2_000_000, 2e-3 * k + 0.5, 0.25, 4e-3 * k - 0.5) for k in range(100)]
    path = write(
        tmp_path / "run.mcap",
        [*readings, Frame(106_000_000, GREY), Frame(2_000_000, GREY), Frame(300_000_000, GREY)],
        ClockMap(5_000_000, "stated"),
        Tare(np.array([0.5, 0.25, -0.5]), how="stated"),
        SensorInfo(90.0, "tip-on-tissue"),
    )
    with RecordingReader(path) as reader:
        found = labels(reader)
    assert found.stamp_ns.tolist() == [2_000_000, 106_000_000, 300_000_000]
    # at 106 ms of the camera the log says 101 ms, between two readings; x of the sensor is y of the base, and reversed
    np.testing.assert_allclose(found.force_n[1], [0.0, -0.101, -0.202], atol=1e-12)
    assert np.isnan(found.force_n[[0, 2]]).all()
    assert found.known.all()


def test_there_is_no_label_across_a_gap_in_the_force_log(tmp_path: Path) -> None:
    readings = [wrench(k * 1_000_000, 1.0, 2.0, math.nan, frame="base") for k in range(400) if not 100 < k < 200]
    frames = [Frame(k * 10_000_000, GREY) for k in range(40)]
    with RecordingReader(write(tmp_path / "run.mcap", [*readings, *frames])) as reader:
        strict = labels(reader)
        loose = labels(reader, max_gap_s=0.2)
    np.testing.assert_array_equal(np.isnan(strict.force_n[:, 0]), [10 < k < 20 for k in range(40)])
    assert not np.isnan(loose.force_n[:, :2]).any()
    assert strict.known.tolist() == [True, True, False]


def test_the_label_is_the_same_wherever_the_chunks_end(tmp_path: Path) -> None:
    """Five seconds are ten chunks: a frame between the last reading of one and the first of the next has a label."""
    readings = [wrench(k * 1_000_000, float(np.sin(k / 100)), 0.0, 0.0, frame="base") for k in range(5000)]
    frames = [Frame(k * 3_700_000 + 500_000, GREY) for k in range(1300)]
    with RecordingReader(write(tmp_path / "run.mcap", [*readings, *frames])) as reader:
        found = labels(reader)
        times, force, _ = reader.wrenches()
    np.testing.assert_allclose(found.force_n[:, 0], np.interp(found.stamp_ns, times, force[:, 0]), atol=1e-15)


def test_readings_in_a_frame_that_nobody_stated_make_no_label(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", [wrench(0, 1.0, 1.0, 1.0), Frame(0, GREY)])
    with (
        RecordingReader(path) as reader,
        pytest.raises(InputError, match=r"sensor\.angle_deg and sensor\.reads in bench\.toml"),
    ):
        labels(reader)


@given(st.floats(-360, 360), st.sampled_from(["tip-on-tissue", "tissue-on-tip"]))
def test_the_pose_turns_without_stretching_and_the_two_readings_are_opposite(angle: float, reads: str) -> None:
    pose = SensorInfo(angle, reads)  # type: ignore[arg-type]
    np.testing.assert_allclose(pose.matrix @ pose.matrix.T, np.eye(3), atol=1e-12)
    other = SensorInfo(angle, "tip-on-tissue" if reads == "tissue-on-tip" else "tissue-on-tip")
    np.testing.assert_allclose(pose.matrix, -other.matrix)


@pytest.fixture
def moving() -> list[Event]:
    """A knob read five times a second while it turns 10 degrees a second, then left alone."""
    knob: list[Event] = [Actuation(k * 200_000_000, {"knob_deg": 2.0 * k}) for k in range(6)]
    return sorted([*knob, *(Frame(k * 41_000_000, GREY) for k in range(60))], key=lambda event: event.stamp_ns)


def test_a_frame_gets_the_knob_of_its_own_instant(moving: list[Event]) -> None:
    found = list(observations(moving))
    assert [o.stamp_ns for o in found] == [k * 41_000_000 for k in range(60)]
    for o in found:
        assert o.actuation["knob_deg"] == pytest.approx(min(o.stamp_ns * 1e-8, 10.0))
        assert o.views["camera"] is not None


def test_a_live_loop_that_does_not_wait_gets_the_last_reading(moving: list[Event]) -> None:
    for o in observations(moving, wait_s=0.0):
        assert o.actuation["knob_deg"] == pytest.approx(min(2.0 * (o.stamp_ns // 200_000_000), 10.0))


def test_a_live_loop_whose_images_arrive_late_interpolates_the_readings_at_hand(moving: list[Event]) -> None:
    arriving = sorted(moving, key=lambda event: event.stamp_ns + 250_000_000 * isinstance(event, Frame))
    for o in observations(arriving, wait_s=0.0):
        assert o.actuation["knob_deg"] == pytest.approx(min(o.stamp_ns * 1e-8, 10.0))


def test_files_and_streams_agree_on_the_actuation(moving: list[Event], tmp_path: Path) -> None:
    late: Callable[[int], int] = lambda stamp: stamp + 900_000_000 * (stamp > 600_000_000)  # noqa: E731
    events = [
        Actuation(late(e.stamp_ns), e.values) if isinstance(e, Actuation) else e
        for e in moving
        if e.stamp_ns > 100_000_000
    ]
    path = write(tmp_path / "run.mcap", events)
    with RecordingReader(path) as reader:
        streamed = [o.actuation.get("knob_deg", math.nan) for o in observations(reader)]
        np.testing.assert_allclose(reader.actuation_at(reader.stamps())["knob_deg"], streamed)
    assert np.isnan(streamed[:2]).all()
