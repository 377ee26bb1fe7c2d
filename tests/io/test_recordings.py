import math
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory

from tipforce.errors import FileFormatError, InputError, TimeError
from tipforce.io import ClockMap, RecordingReader, RecordingWriter, Tare
from tipforce.io import _cdr as cdr
from tipforce.types import (
    Actuation,
    Catheter,
    ForceEstimate,
    Frame,
    SensorInfo,
    SessionInfo,
    SimulatedClock,
    Status,
    ViewInfo,
    Wrench,
)

numbers = st.floats(allow_nan=True, allow_infinity=False, width=64)
names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
stamps = st.integers(0, 2**31 * 10**9 - 1)


def decoded(schema: str, raw: bytes) -> object:
    from mcap.records import Schema

    decode = DecoderFactory().decoder_for("cdr", Schema(1, cdr.SCHEMAS[schema].encode(), "ros2msg", schema))
    assert decode is not None
    return decode(raw)


@given(stamps, names, st.lists(numbers, min_size=6, max_size=6))
def test_a_wrench_is_what_the_ros2_decoder_reads(stamp: int, frame: str, values: list[float]) -> None:
    raw = cdr.pack_wrench(stamp, frame, np.array(values[:3]), np.array(values[3:]))
    message = decoded(cdr.WRENCH_STAMPED, raw)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(stamp, 10**9)
    assert message.header.frame_id == frame
    force, torque = message.wrench.force, message.wrench.torque
    np.testing.assert_array_equal([force.x, force.y, force.z, torque.x, torque.y, torque.z], values)
    ours = cdr.unpack_wrench(raw)
    assert ours[:2] == (stamp, frame)
    np.testing.assert_array_equal(np.concatenate(ours[2:]), values)


@given(stamps, st.dictionaries(names, numbers, max_size=5))
def test_a_joint_state_is_what_the_ros2_decoder_reads(stamp: int, values: dict[str, float]) -> None:
    raw = cdr.pack_joints(stamp, values)
    message = decoded(cdr.JOINT_STATE, raw)
    assert list(message.name) == list(values)
    np.testing.assert_array_equal(message.position, list(values.values()))
    assert list(message.velocity) == list(message.effort) == []
    found = cdr.unpack_joints(raw)
    assert found[0] == stamp
    np.testing.assert_equal(found[1], values)


def assert_same_estimate(found: ForceEstimate, estimate: ForceEstimate) -> None:
    for field in fields(ForceEstimate):
        np.testing.assert_equal(getattr(found, field.name), getattr(estimate, field.name))


@given(stamps, names, st.lists(numbers, min_size=20, max_size=20), st.sampled_from(list(Status)))
def test_an_estimate_is_what_the_ros2_decoder_reads(stamp: int, detail: str, n: list[float], status: Status) -> None:
    estimate = ForceEstimate.invalid(stamp, status, detail) if status is not Status.VALID else ForceEstimate(
        stamp, np.array(n[:3]), np.array([True, False, True]), np.array(n[3:12]).reshape(3, 3),
        np.array(n[12:18]).reshape(3, 2), 0.25, np.array(n[18:]), detail=detail, contact=0.5,
    )  # fmt: skip
    raw = cdr.pack_estimate(stamp, estimate)
    message = decoded(cdr.FORCE_ESTIMATE, raw)
    assert (message.status, message.detail, message.header.frame_id) == (status.value, detail, "base")
    np.testing.assert_array_equal(message.force_n, estimate.force_n)
    np.testing.assert_array_equal(message.covariance_n2, estimate.covariance_n2.ravel())
    np.testing.assert_array_equal(message.interval_n, estimate.interval_n.ravel())
    np.testing.assert_array_equal(message.magnitude_interval_n, estimate.magnitude_interval_n)
    np.testing.assert_array_equal([message.magnitude_n, message.contact], [estimate.magnitude_n, estimate.contact])
    assert list(message.known) == estimate.known.tolist()
    assert_same_estimate(cdr.unpack_estimate(raw), estimate)


def test_estimates_are_a_stream_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    estimates = [ForceEstimate.invalid(at, Status.STALE, "the camera is late") for at in (1_000, 2_000)]
    with RecordingWriter(path, SessionInfo()) as writer:
        writer.write(Frame(1_000, np.zeros((4, 4), np.uint8)))
        for estimate in estimates:
            writer.write_estimate(estimate)
    with RecordingReader(path) as reader:
        assert reader.info.streams["estimate"].kind == "estimate"
        assert [type(event) for event in reader] == [Frame]
        for found, estimate in zip(reader.estimates(), estimates, strict=True):
            assert_same_estimate(found, estimate)
        assert not list(reader.estimates("camera"))


@given(stamps, names, st.binary(max_size=50))
def test_an_image_is_what_the_ros2_decoder_reads(stamp: int, view: str, data: bytes) -> None:
    raw = cdr.pack_image(stamp, view, "png", data)
    message = decoded(cdr.COMPRESSED_IMAGE, raw)
    assert (message.header.frame_id, message.format, bytes(message.data)) == (view, "png", data)
    found = cdr.unpack_image(raw)
    assert (found[0], found[1], bytes(found[2])) == (stamp, "png", data)


def test_ros2_tools_read_every_message_of_a_recording(recording: Path) -> None:
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        found = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    counts = {topic: sum(there == topic for there, _ in found) for topic in {topic for topic, _ in found}}
    assert counts == {"/camera/compressed": 25, "/force": 1000, "/joints": 10}


def test_what_was_written_comes_back(recording: Path) -> None:
    with RecordingReader(recording) as reader:
        assert reader.session_info == SessionInfo(
            "first", views={"camera": ViewInfo(2e-4)}, sensor=SensorInfo(90.0, "tip-on-tissue")
        )
        events = list(reader)
        assert [event.stamp_ns for event in events] == sorted(event.stamp_ns for event in events)
        assert list(reader.events("camera"))[3].stamp_ns == 120_000_000
        times, force, torque = reader.wrenches()
        np.testing.assert_array_equal(times, np.arange(1000) * 1_000_000)
        np.testing.assert_array_equal(force[:, 0], np.arange(1000) * 1e-3)
        assert np.isnan(torque).all()
        frame = reader.frame_at(7)
        assert (frame.stamp_ns, frame.image.shape) == (280_000_000, (48, 64))
        assert abs(int(frame.image.mean()) - 57) <= 1
        streams = reader.info.streams
        assert (streams["camera"].count, streams["camera"].rate_hz, streams["camera"].dropped) == (25, 25.0, 0)
        np.testing.assert_allclose(reader.actuation_at(np.array([50_000_000]))["knob_deg"], [0.5])


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_lossless_images_come_back_bit_by_bit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo(), lossless=True) as writer:
        writer.write(Frame(0, image))
    with RecordingReader(tmp_path / "run.mcap") as reader:
        np.testing.assert_array_equal(reader.frame_at(0).image, image)
        assert reader.session_info.name == "run"


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tipforce.tare", {"force_n": "[" * 100_000}),
        ("tipforce.tare", {"force_n": "[1, 2"}),
        ("tipforce.tare", {"stretches_s": "[1]"}),
        ("tipforce.inertia", {"axes": '["a"]', "gain_kg": "[1]"}),
        ("tipforce.inertia", {"lag_ns": "soon"}),
        ("tipforce.clock_offset", {"offset_ns": "1e6"}),
        ("tipforce.session", {"json": "[" * 100_000}),
        ("tipforce.session", {"json": "[]"}),
    ],
)
def test_metadata_that_cannot_be_read_are_one_sentence(tmp_path: Path, name: str, values: dict[str, str]) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        writer.add_metadata(name, values)
        writer.finish()
    with pytest.raises(FileFormatError) as caught, RecordingReader(path) as reader:
        _ = reader.info
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert ("session metadata" if name == "tipforce.session" else name) in said
    assert said.endswith("; import it again")
    assert "\n" not in said
    assert len(said) < len(str(path)) + 250


def test_facts_come_back_and_the_last_of_a_kind_holds(tmp_path: Path) -> None:
    stated = SessionInfo("s", Catheter("decapolar", 0.002, 0.04), {"camera": ViewInfo(1e-4)}, remarks="silicone")
    with RecordingWriter(tmp_path / "run.mcap", stated) as writer:
        writer.state(ClockMap(1, "stated"))
        writer.state(ClockMap(-7, "estimated", 0.5, 0.99, rate=0.8, rate_stderr=1e-5, reference_ns=9))
        writer.state(Tare(np.array([0.1, 0.2, 0.0]), np.array([1e-3, 2e-3, math.nan]), ((0.0, 5.0),), "stated", "x"))
        writer.state(SensorInfo(12.5, "tissue-on-tip"))
        writer.write(Actuation(0, {"knob_deg": 1.0}))
    with RecordingReader(tmp_path / "run.mcap") as reader:
        info = reader.info
        assert reader.session_info == replace(stated, sensor=SensorInfo(12.5, "tissue-on-tip"))
        assert info.clock_map == ClockMap(-7, "estimated", 0.5, 0.99, rate=0.8, rate_stderr=1e-5, reference_ns=9)
        assert (info.tare.how, info.tare.stretches_s, info.tare.detail) == ("stated", ((0.0, 5.0),), "x")
        np.testing.assert_array_equal(info.tare.force_n, [0.1, 0.2, 0.0])
        np.testing.assert_array_equal(info.tare.stderr_n, [1e-3, 2e-3, math.nan])
        assert info.sensor == SensorInfo(12.5, "tissue-on-tip")


def test_streams_that_arrive_out_of_order_are_read_in_order(tmp_path: Path) -> None:
    """A camera delivers its frames late: half a second and several chunks after the force of the same instant."""
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo()) as writer:
        for k in range(300):
            writer.write(Wrench(k * 10_000_000, np.ones(3), np.ones(3)))
            if k >= 60 and k % 4 == 0:
                writer.write(Frame((k - 60) * 10_000_000 + 1, np.zeros((8, 8), np.uint8)))
    with RecordingReader(tmp_path / "run.mcap") as reader:
        found = [event.stamp_ns for event in reader]
    assert len(found) == 360
    assert found == sorted(found)


def test_what_is_pending_reaches_the_file_by_the_clock(tmp_path: Path) -> None:
    clock = SimulatedClock()
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo(), clock=clock) as writer:
        writer.write(Actuation(0, {"a_mm": 1.0}))
        small = writer.part.stat().st_size
        clock.sleep_until_ns(300_000_000)
        time.sleep(0.6)
        assert writer.part.stat().st_size == small, "on simulated time the machine's own pace may not show in the file"
        writer.write(Actuation(1, {"a_mm": 2.0}))
        assert writer.part.stat().st_size > small


def test_a_finished_recording_is_not_overwritten_unless_asked(recording: Path) -> None:
    before = recording.read_bytes()
    with pytest.raises(FileFormatError, match="exists already"):
        RecordingWriter(recording, SessionInfo())
    assert recording.read_bytes() == before
    with RecordingWriter(recording, SessionInfo("second"), overwrite=True) as writer:
        assert recording.read_bytes() == before
        writer.write(Actuation(0, {"a_mm": 1.0}))
    with RecordingReader(recording) as reader:
        assert reader.session_info.name == "second"


def test_a_stamp_before_zero_is_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo()) as writer, pytest.raises(TimeError, match="before zero"):
        writer.write(Actuation(-1, {"a_mm": 1.0}))


def test_dropped_frames_are_counted(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo()) as writer:
        for k in range(50):
            if k not in (10, 20, 21):
                writer.write(Frame(k * 40_000_000, np.zeros((8, 8), np.uint8)))
    with RecordingReader(tmp_path / "run.mcap") as reader:
        camera = reader.info.streams["camera"]
    assert (camera.count, camera.dropped, camera.rate_hz) == (47, 3, pytest.approx(25.0))


def test_an_unknown_stream_is_named_beside_those_there_are(recording: Path) -> None:
    with RecordingReader(recording) as reader, pytest.raises(InputError, match="'left'; it has camera, force, joints"):
        reader.stamps("left")


@pytest.mark.parametrize(
    ("content", "said"), [(b"", "is empty"), (b"ftypmp42" * 50, "is not a recording"), (None, "no such file")]
)
def test_what_is_no_recording_is_called_so(tmp_path: Path, content: bytes | None, said: str) -> None:
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FileFormatError, match=said):
        RecordingReader(path)


@pytest.mark.parametrize("force_n", [math.inf, -1e300, 2e4])
def test_a_force_that_no_sensor_reads_is_refused(tmp_path: Path, force_n: float) -> None:
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, SessionInfo("run")) as writer:
        for k, value in enumerate((0.1, force_n, math.nan)):
            writer.write(Wrench(k * 10**9, np.array([0.0, value, math.nan]), np.full(3, math.nan), "sensor"))
    with RecordingReader(path) as reader, pytest.raises(FileFormatError, match=r"run\.mcap: force at 1\.000 s is"):
        reader.wrenches()


def test_a_knob_that_turns_for_years_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, SessionInfo("run")) as writer:
        writer.write(Actuation(0, {"knob_deg": 10.0}))
        writer.write(Actuation(10**9, {"knob_deg": 1e59}))
    with RecordingReader(path) as reader, pytest.raises(FileFormatError, match=r"knob_deg at 1\.000 s is 1e\+59, exp"):
        list(reader.events())
