"""ROS bags and MCAP files of other programs: topics found or stated, stamps of headers, refusals with their advice."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import FileFormatError, InputError, MissingExtraError
from tipforce.io import is_bag, open_bag, open_source
from tipforce.pipelines import summarise_recording
from tipforce.types import Actuation, BagInfo, Frame, SessionInfo, info_from_facts

from ..short_run import draw_image, push  # type: ignore[import-not-found]
from .bag_files import START_S, Stamped, image, joints, number, run_messages, wrench, write_bag  # type: ignore[import-not-found]

KINDS = ("bag", "db3", "mcap", "folder")


def with_bag(**values: object) -> SessionInfo:
    return SessionInfo(bag=BagInfo(**values))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_gives_images_forces_and_drives_at_the_stamps_of_their_headers(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path, kind, run_messages(1.0))
    assert is_bag(path)
    bag = open_bag(path, with_bag(names={"knob_joint": "knob_deg"}))
    frames = list(bag.frames())
    assert [frame.stamp_ns for frame in frames] == [round((START_S + k / 24) * 1e9) for k in range(24)]
    np.testing.assert_array_equal(frames[5].image, draw_image(float(push(np.array(5 / 24)))))
    assert bag.force is not None
    assert bag.force.stamp_ns.tolist() == [round((START_S + k / 250) * 1e9) for k in range(250)]
    assert bag.force.force_n[10].tolist() == pytest.approx([0.3, -0.1, 0.0])
    assert bag.joints is not None
    np.testing.assert_allclose(bag.joints.values["knob_deg"], 10.0)
    said = " ".join(bag.remarks)
    assert "only topic of images, /camera/image_raw/compressed" in said
    assert "only topic of forces, /ft/wrench" in said
    assert "knob_deg is knob_joint of /joint_states, which a JointState holds in radians" in said


def test_a_bag_is_a_source_with_the_readings_of_its_drives(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", [*(image(k / 10) for k in range(5)), joints(0.2, ["knob_deg"], [7.0])])
    events = list(open_bag(path, SessionInfo()))
    assert [type(event) for event in events] == [Frame, Frame, Actuation, Frame, Frame, Frame]
    assert events[2].values == {"knob_deg": 7.0}  # type: ignore[union-attr]
    source = open_source(write_bag(tmp_path / "b", "db3", [image(0.1), image(0.2)]))
    assert [event.stamp_ns for event in source] == [round((START_S + s) * 1e9) for s in (0.1, 0.2)]


@pytest.mark.parametrize("kind", ["bag", "db3"])
@pytest.mark.parametrize("encoding", ["mono8", "bgr8", "rgb8", "mono16"])
def test_raw_images_are_read_with_their_padding_and_order_of_colours(tmp_path: Path, kind: str, encoding: str) -> None:
    path = write_bag(tmp_path, kind, [image(0.5, "/image", encoding), image(0.6, "/image", encoding)])
    frame = next(open_bag(path, SessionInfo()).frames())
    grey = draw_image(float(push(np.array(0.5))))
    expected = np.stack([grey // 2, grey, grey], axis=2) if encoding in ("bgr8", "rgb8") else grey
    np.testing.assert_array_equal(frame.image, expected)


def test_images_that_arrive_in_another_order_come_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    times = [0.0, 0.2, 0.1, 0.3, 0.5, 0.4]
    sent = [image(time) for time in times]
    moved = [Stamped(round((START_S + k) * 1e9), each.topic, each.kind, each.fields) for k, each in enumerate(sent)]
    path = write_bag(tmp_path, "db3", moved)
    assert len(list(open_bag(path, SessionInfo()).frames())) == 6


def test_drives_may_be_numbers_with_a_topic_each(tmp_path: Path) -> None:
    sent = [image(k / 10) for k in range(3)]
    sent += [number(k / 100, "/bench/knob_deg", 4.0) for k in range(20)]
    sent += [number(k / 100, "/bench/forward_mm", k) for k in range(20)]
    path = write_bag(tmp_path, "mcap", sent)
    bag = open_bag(path, with_bag(receive_times=("/bench/knob_deg", "bench/forward_mm")))
    assert bag.joints is not None
    assert bag.stage is not None
    assert list(bag.joints.values) == ["knob_deg"]
    np.testing.assert_array_equal(bag.stage.values["forward_mm"], np.arange(20.0))


CAMERAS = [*(image(k / 10, "/left") for k in range(4)), *(image(k / 10, "/right") for k in range(4))]
SENSORS = [*(image(k / 10) for k in range(4)), *(wrench(k / 10, f"/{side}") for side in "ab" for k in range(4))]
ARMS = [image(0.1), image(0.2), joints(0.1, ["a_deg"], [1.0], "/arm"), joints(0.1, ["b_deg"], [1.0], "/hand")]

STUCK = [image(k / 10, header_ns=START_S * 10**9) for k in range(4)]
JUMPING = [image(0.1), image(0.2), *(wrench(k / 10, header_ns=1 + k // 3 * START_S * 10**9) for k in range(6))]
JOINT = [image(0.1), image(0.2), joints(0.1, ["q1"], [0.1])]
UNSTAMPED = [each for each in run_messages(0.5, stamped=False) if each.topic != "/joint_states"]

REFUSED: dict[str, tuple[list[Stamped], str, list[str], list[str]]] = {
    "two cameras": (CAMERAS, "has several topics of images: /left (CompressedImage, 4 messages), /right", [],
        ['bag.views={camera="/right"}']),
    "two sensors": (SENSORS, 'state one in bench.toml: bag.force = "/a"', [], ["bag.force=/a"]),
    "two arms": (ARMS, 'bag.drives = ["/arm"], or [] for none', [], ['bag.drives=["/arm"]']),
    "no arm": (ARMS, 'bag.drives = ["/arm"], or [] for none', [], ["bag.drives=[]"]),
    "stamps that stand still": (STUCK, 'bag.receive_times = ["/camera/image_raw/compressed"]', [],
        ['bag.receive_times=["/camera/image_raw/compressed"]']),
    "stamps that jump": (JUMPING, 'bag.receive_times = ["/ft/wrench"]', [], ['bag.receive_times=["/ft/wrench"]']),
    "a joint without a unit": (JOINT, 'bag.names = { "q1" = "knob_deg" }', [], ['bag.names={"q1"="knob_deg"}']),
    "a joint that is not needed": (JOINT, "bag.drives = []", [], ["bag.drives=[]"]),
    "no stamps": (UNSTAMPED, 'bag.receive_times = ["/camera/image_raw/compressed", "/ft/wrench"]', [],
        ['bag.receive_times=["/camera/image_raw/compressed", "/ft/wrench"]']),
    "a wrong name": (CAMERAS, "has no topic '/front', as bag.views.camera in bench.toml states; those of the types",
        ['bag.views={camera="/front"}'], ['bag.views={camera="/left"}']),
    "a topic of another type": (SENSORS, "has messages of the type WrenchStamped in the topic '/a'",
        ['bag.views={camera="/a"}', "bag.force=/a"], ["bag.force=/a"]),
}  # fmt: skip
"""Messages, part of the error, what was stated, and what the error says to state."""


@pytest.mark.parametrize("name", REFUSED)
def test_the_advice_of_a_message_leads_to_a_bag_that_is_read(tmp_path: Path, name: str) -> None:
    sent, said, before, after = REFUSED[name]
    path = write_bag(tmp_path, "mcap", sent)
    with pytest.raises(InputError) as caught:
        list(open_bag(path, info_from_facts(before) if before else SessionInfo()))
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    bag = open_bag(path, info_from_facts(after))
    assert len(list(bag)) > 1
    if "receive_times" in said:
        assert any("times at which the messages were received" in remark for remark in bag.remarks)


def test_the_mcap_of_another_program_is_read_by_the_stamps_of_its_headers_or_refused(tmp_path: Path) -> None:
    """Its log times, which a recording of ours goes by, are those at which the messages were received."""
    path = write_bag(tmp_path, "mcap", [each for each in run_messages() if each.topic != "/joint_states"])
    with open_source(path) as source:
        first = next(event for event in source if isinstance(event, Frame))
    assert first.stamp_ns == START_S * 10**9
    with pytest.raises(FileFormatError, match="was written by another program") as caught:
        summarise_recording(path)
    advised = re.search(r"tipforce (import \S+) --bench bench\.toml -o NEW\.mcap", str(caught.value))
    assert advised is not None
    words = [*advised[1].split(), "--offset-ms", "none", "-o", str(tmp_path / "new.mcap")]
    assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0
    assert summarise_recording(tmp_path / "new.mcap").info.streams["camera"].count == 192


@pytest.mark.parametrize("kind", ["bag", "db3"])
def test_a_damaged_bag_is_refused_in_one_sentence(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path, kind, run_messages(0.2))
    whole = path.read_bytes()
    for content in (b"", whole[:100], whole[: len(whole) // 2], b"#ROSBAG V2.0\n" + b"\xff" * 999):
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"is no bag that can be read|has no topic of images"):
            list(open_bag(path, with_bag(names={"knob_joint": "knob_deg"})))


def test_a_missing_library_is_named_with_its_install_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    path = write_bag(tmp_path, "bag", [image(0.1)])
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[ros\]'"):
        open_bag(path, SessionInfo())
