import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.alignment import observations
from tipforce.errors import FileFormatError, InputError, TimeError
from tipforce.io import RecordingReader, open_source, require_actuation, write_video
from tipforce.io._force_log import read_force_log
from tipforce.types import Actuation, ForceLogInfo, Frame, SessionInfo

REAL = Path(os.environ.get("TIPFORCE_REAL_DATA", "")) / "tendon-manipulator"


def grey(level: int, size: tuple[int, int] = (48, 64)) -> np.ndarray:
    return np.full(size, level, np.uint8)


def images(folder: Path, names: list[str]) -> Path:
    folder.mkdir(exist_ok=True)
    for place, name in enumerate(names):
        cv2.imwrite(str(folder / name), grey(10 * place))
    return folder


@pytest.mark.parametrize("size", [(48, 64), (47, 63), (48, 64, 3)])
def test_a_video_gives_back_stamps_and_images(tmp_path: Path, size: tuple[int, ...]) -> None:
    stamps = np.cumsum(np.random.default_rng(0).integers(30_000_000, 60_000_000, 30))
    frames = [Frame(int(stamp), np.full(size, 60 + 4 * k, np.uint8)) for k, stamp in enumerate(stamps)]
    write_video(tmp_path / "v.mp4", frames, 24)
    with open_source(tmp_path / "v.mp4", actuation={"knob_deg": 10.0}) as source:
        for _ in range(2):  # may be iterated again
            events = list(source)
            assert events[0] == Actuation(0, {"knob_deg": 10.0})
            found = [event for event in events if isinstance(event, Frame)]
            assert np.abs(np.array([f.stamp_ns for f in found]) - (stamps - stamps[0])).max() < 12_000
            assert found[7].image.shape == (48, 64, 3)
            assert np.abs(found[7].image.astype(int) - 88).max() <= 4
    assert (tmp_path / "v.mp4").read_bytes()[4:8] == b"ftyp"
    assert b"moov" in (tmp_path / "v.mp4").read_bytes()[:1000], "the index must stand in front"
    assert all(o.actuation == {"knob_deg": 10.0} for o in observations(source))


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_a_lossless_video_gives_every_pixel_back(tmp_path: Path, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    frames = [Frame(k * 40_000_000, rng.integers(0, 256, shape, np.uint8)) for k in range(3)]
    write_video(tmp_path / "v.mp4", frames, 25, lossless=True)
    with open_source(tmp_path / "v.mp4") as source:
        for event, frame in zip(source, frames, strict=True):
            wanted = frame.image if frame.image.ndim == 3 else np.stack([frame.image] * 3, axis=2)
            np.testing.assert_array_equal(event.image, wanted)


def test_a_first_frame_later_than_the_clocks_zero_keeps_its_stamp(tmp_path: Path) -> None:
    stamps = [3_217_000, 41_000_000, 84_500_000]
    write_video(tmp_path / "v.mp4", (Frame(stamp, grey(k)) for k, stamp in enumerate(stamps)), 24, zero_ns=0)
    with open_source(tmp_path / "v.mp4") as source:
        assert [event.stamp_ns for event in source] == pytest.approx(stamps, abs=1e9 / 90_000)


def test_a_video_that_fails_halfway_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(TimeError, match="not later"):
        write_video(tmp_path / "v.mp4", [Frame(0, grey(0)), Frame(0, grey(1))], 24)
    with pytest.raises(InputError, match="follows frames of"):
        write_video(tmp_path / "v.mp4", [Frame(0, grey(0)), Frame(10**8, grey(1, (24, 24)))], 24)
    with pytest.raises(InputError, match="not one frame"):
        write_video(tmp_path / "v.mp4", [], 24)
    assert not list(tmp_path.iterdir())


def test_what_is_no_video_is_called_so(tmp_path: Path) -> None:
    write_video(tmp_path / "whole.mp4", (Frame(k * 40_000_000, grey(k)) for k in range(100)), 25)
    whole = (tmp_path / "whole.mp4").read_bytes()
    rng = np.random.default_rng(0)
    cases = {
        "empty.mp4": (b"", "is empty"),
        "text.mp4": (b"this is no video at all\n" * 50, "cannot be opened as a video"),
        "noise.avi": (rng.bytes(5000), "no video that FFmpeg can read"),
        "headless.mp4": (whole[: whole.index(b"moov")], "has no index"),
        "cut.mp4": (whole[: len(whole) * 2 // 3], "cut off|cannot be read beyond"),
    }
    for name, (content, said) in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileFormatError, match=said) as caught:
            list(open_source(tmp_path / name))
        assert name in str(caught.value)
    with pytest.raises(FileFormatError, match="no such file or folder"):
        open_source(tmp_path / "missing.mp4")


def test_a_video_with_repeated_stamps_is_refused(tmp_path: Path) -> None:
    """Two frames at 90 kHz ticks, moved onto one another in a container that keeps whole milliseconds."""
    import av

    with av.open(str(tmp_path / "v.mkv"), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        packets = []
        for k in range(4):
            frame_k = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 50 * k, np.uint8), format="rgb24")
            packets += stream.encode(frame_k)
        packets += stream.encode(None)
        for packet, pts in zip(packets, [0, 1, 1, 2], strict=True):
            packet.pts = packet.dts = pts
            container.mux_one(packet)
    with pytest.raises(TimeError, match=r"frame 2 .* repeats the stamp"):
        list(open_source(tmp_path / "v.mkv"))


@pytest.mark.parametrize(
    "names",
    [
        ["b_1723092491-697277832.png", "a_1723092491-730713135.png"],
        ["x_1723092491697277832.png", "x_1723092491730713135.png"],
        ["1723092491.697277832.jpg", "1723092491.730713135.jpg"],
        ["f_1723092491697277832_ns.png", "f_1723092491730713135_ns.png"],
    ],
)
def test_stamps_are_read_from_names(tmp_path: Path, names: list[str]) -> None:
    with open_source(images(tmp_path / "frames", names)) as source:
        assert [event.stamp_ns for event in source] == [1723092491697277832, 1723092491730713135]


def test_stamps_and_drives_are_read_from_a_table(tmp_path: Path) -> None:
    folder = images(tmp_path / "frames", ["b.png", "a.png", "c.png"])
    (folder / "stamps.csv").write_text("file_name,time_s,knob_deg,fx_n\nb.png,0.2,3,9\na.png,0.1,2,9\nc.png,0.3,4,9\n")
    found = list(observations(open_source(folder)))
    assert [(o.stamp_ns, dict(o.actuation)) for o in found] == [
        (100_000_000, {"knob_deg": 2.0}),
        (200_000_000, {"knob_deg": 3.0}),
        (300_000_000, {"knob_deg": 4.0}),
    ]
    assert [int(o.views["camera"].max()) for o in found] == [10, 0, 20]  # type: ignore[union-attr]
    with pytest.raises(InputError, match="do not state it a second time"):
        open_source(folder, actuation={"knob_deg": 1.0})


def test_a_folder_without_images_or_stamps_says_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="holds no images"):
        open_source(tmp_path / "empty")
    with pytest.raises(FileFormatError, match=r"stamps\.csv with the columns file_name,stamp_ns"):
        open_source(images(tmp_path / "some", ["frame_1.png", "frame_2_ns.png"]))
    with pytest.raises(TimeError, match=r"1_5_ns\.png and 2_5_ns\.png carry the same stamp"):
        open_source(images(tmp_path / "twice", ["1_5_ns.png", "2_5_ns.png"]))
    folder = images(tmp_path / "gone", ["a.png"])
    (folder / "stamps.csv").write_text("file_name,stamp_ns\na.png,1\nb.png,2\n")
    with pytest.raises(FileFormatError, match=r"line 3: there is no image \S+b\.png"):
        open_source(folder)
    (folder / "a.png").write_bytes(b"")
    (folder / "stamps.csv").write_text("file_name,stamp_ns\na.png,1\n")
    with pytest.raises(FileFormatError, match=r"a\.png: the image is missing, empty or damaged"):
        list(open_source(folder))


def test_still_images_are_a_second_apart_in_the_order_of_their_names(tmp_path: Path) -> None:
    source = open_source(images(tmp_path / "counted", ["frame_0002.png", "frame_0001.png", "frame_0010.png"]))
    assert [event.stamp_ns for event in source] == [0, 1_000_000_000, 2_000_000_000]


def test_a_recording_is_a_source_too(recording: Path) -> None:
    with open_source(recording) as source:
        assert source.session_info.name == "first"
        assert sum(isinstance(event, Frame) for event in source) == 25
    with open_source(recording, stated=SessionInfo()) as source:
        assert isinstance(source, RecordingReader)  # nothing was stated, so nothing stands in between
    with open_source(recording, stated=SessionInfo("other")) as source:
        assert source.session_info.name == "other"
    with pytest.raises(InputError, match="carries knob_deg itself"):
        open_source(recording, actuation={"knob_deg": 1.0, "wire_mm": 2.0})


def test_what_a_source_never_carries_is_known_before_it_is_read(recording: Path, tmp_path: Path) -> None:
    folder = images(tmp_path / "images", ["a.png"])
    (folder / "stamps.csv").write_text("file_name,stamp_ns,knob_deg\na.png,1,7\n")
    for path in (recording, folder):
        with open_source(path) as source:
            require_actuation(source, ["knob_deg"])
            with pytest.raises(
                InputError, match=rf"{path.name}: does not carry wire_mm,.* actuation\.constant\.wire_mm$"
            ):
                require_actuation(source, ["knob_deg", "wire_mm"])
        with open_source(path, actuation={"wire_mm": 2.0}) as source:
            require_actuation(source, ["knob_deg", "wire_mm"])
            assert list(observations(source))[-1].actuation["wire_mm"] == 2.0


def test_a_source_that_cannot_tell_what_will_come_is_not_asked() -> None:
    class Live:
        def __iter__(self):
            raise AssertionError("it was read")

    require_actuation(Live(), ["knob_deg"])


@pytest.mark.skipif(not REAL.is_dir(), reason="TIPFORCE_REAL_DATA names no folder with tendon-manipulator")
def test_real_frames_and_force_logs_are_read_as_they_are() -> None:
    frames = [event for event in open_source(REAL / "frames") if isinstance(event, Frame)]
    assert [frame.stamp_ns % 10**9 for frame in frames] == [375700928, 710305664, 883211914, 458522217]
    assert {frame.image.shape[:2] for frame in frames} == {(480, 640)}
    found = read_force_log(sorted((REAL / "sessions").glob("data_*.csv"))[0], ForceLogInfo(force_unit="mN"))
    assert np.isfinite(found.force_n).all()
    assert 20 < 1e9 / np.median(np.diff(found.stamp_ns)) < 40
