"""Recordings of several cameras: written, stamped, read back, paired."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from tipforce.alignment import labels, nearest_frames, observations
from tipforce.cli import app
from tipforce.datasets import open_dataset
from tipforce.errors import InputError
from tipforce.io import RecordingReader, RecordingWriter
from tipforce.pipelines import inspect_frames, plot_summary, record, summarise_recording
from tipforce.types import Actuation, Frame, SessionInfo, Wrench
from tipforce.vision import ShapeFeatureSettings, VisionSettings

STEP_NS = 66_666_667


def draw_image(view: str, number: int) -> np.ndarray:
    return np.full((24, 32 if view == "a" else 40), 5 * number + (100 if view == "b" else 0), np.uint8)


def two_views(count: int = 12, dropped=(("b", 4), ("a", 7)), late_ns: int = 3_000_000):
    """Events of a session: view b is ``late_ns`` behind a; force at 1 kHz; the knob at 50 Hz."""
    events = []
    for number in range(count):
        for view, late in (("a", 0), ("b", late_ns)):
            if (view, number) not in dropped:
                events.append(Frame(number * STEP_NS + late, draw_image(view, number), view))
    end = count * STEP_NS
    events += [
        Wrench(stamp, np.array([stamp * 1e-9, 0.0, 0.1]), np.zeros(3)) for stamp in range(0, end + 10**8, 1_000_000)
    ]
    events += [Actuation(stamp, {"knob_deg": stamp * 1e-9}) for stamp in range(0, end, 20_000_000)]
    return sorted(events, key=lambda event: event.stamp_ns)


class Bench:
    session_info = SessionInfo("two views")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __iter__(self):
        return iter(two_views())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("views") / "run.mcap"
    record(Bench(), path, tare="none", offset_ms="none", lossless=True)
    return path


def test_every_view_comes_back_with_its_own_stamps_and_pixels(run):
    with RecordingReader(run) as reader:
        assert reader.views == ("a", "b")
        for view, late, gone in (("a", 0, 7), ("b", 3_000_000, 4)):
            numbers = [number for number in range(12) if number != gone]
            assert reader.stamps(view).tolist() == [number * STEP_NS + late for number in numbers]
            for place in (0, 5, 10):
                np.testing.assert_array_equal(reader.frame_at(place, view).image, draw_image(view, numbers[place]))
        order = [event.stamp_ns for event in reader.events("a", "b")]
        assert order == sorted(order)


def test_an_observation_holds_what_all_views_show_of_its_instant(run):
    with RecordingReader(run) as reader:
        found = list(observations(reader, ("a", "b")))
        alone = list(observations(reader, "b"))
    assert [set(each.views) for each in found] == [{"a", "b"}] * 4 + [{"a"}] + [{"a", "b"}] * 6
    for each in found:
        number = round(each.stamp_ns / STEP_NS)
        for view, image in each.views.items():
            np.testing.assert_array_equal(image, draw_image(view, number))
        assert each.actuation["knob_deg"] == pytest.approx(each.stamp_ns * 1e-9, abs=0.02)
    assert len(alone) == 11
    assert set(alone[0].views) == {"b"}


def test_a_partner_further_off_than_stated_is_none(run):
    with RecordingReader(run) as reader:
        strict = list(observations(reader, ("a", "b"), pair_s=0.002))
        other_way = list(observations(reader, ("b", "a")))
    assert all(set(each.views) == {"a"} for each in strict)
    assert sum(len(each.views) == 2 for each in other_way) == 10


def test_observations_keep_no_more_frames_than_they_need():
    seen = 0

    def endless():
        nonlocal seen
        for number in range(500):
            seen = number
            yield Frame(number * STEP_NS, draw_image("b", number % 20), "b")
        yield Frame(500 * STEP_NS, draw_image("a", 1), "a")

    (only,) = observations(endless(), ("a", "b"))
    assert seen == 499
    assert set(only.views) == {"a"}


@given(st.lists(st.integers(0, 10**6), unique=True), st.lists(st.integers(0, 10**6), unique=True))
def test_the_nearest_frame_is_nearest(ours, theirs):
    ours, theirs = np.array(sorted(ours), np.int64), np.array(sorted(theirs), np.int64)
    for stamp, place in zip(ours.tolist(), nearest_frames(ours, theirs, 1e-4).tolist(), strict=True):
        away = np.abs(theirs - stamp)
        near = len(theirs) > 0 and away.min() <= 10**5
        assert (place >= 0) == near
        if near:
            assert away[place] == away.min()


def test_a_summary_counts_pairs_and_labels_of_all_views(run, tmp_path):
    summary = summarise_recording(run)
    assert summary.paired == {"b": 10}
    assert summary.labelled == 22
    assert summary.image_size == (32, 24)
    assert summary.figures()["paired_frames"] == {"b": 10}
    plot_summary(summary, tmp_path / "drawn.png")
    result = CliRunner().invoke(app, ["inspect", str(run), "-o", str(tmp_path / "plot.png")])
    assert result.exit_code == 0
    assert "10 frames of the first view have one of b" in result.output


def test_labels_are_those_of_the_first_view_unless_another_is_named(run):
    with RecordingReader(run) as reader:
        first, second = labels(reader), labels(reader, camera="b")
    np.testing.assert_allclose(first.force_n[:, 0], first.stamp_ns * 1e-9, atol=1e-6)
    np.testing.assert_allclose(second.force_n[:, 0], second.stamp_ns * 1e-9, atol=1e-6)
    assert second.stamp_ns[0] == 3_000_000


def test_a_dataset_of_such_recordings_gives_both_views(run):
    dataset = open_dataset(run)
    (one, without) = dataset.subset(np.array([0, 4])).observations()
    np.testing.assert_array_equal(one.views["b"], draw_image("b", 0))
    assert set(without.views) == {"a"}
    assert dataset.names_of("a")[4] == dataset.names[4] == "run.mcap frame 4"
    assert dataset.subset(np.array([4])).names_of("b").tolist() == ["run.mcap frame 4, view b beside it"]


def test_looking_for_a_view_that_is_not_there_says_which_are(run):
    with pytest.raises(InputError, match=r"there is no view 'c'; there are a and b: for example vision\.view=a"):
        inspect_frames(run, VisionSettings(view="c"), ShapeFeatureSettings())
    assert inspect_frames(run, VisionSettings(), ShapeFeatureSettings()).figures["frames"] == 11


def test_one_view_is_written_as_ever(tmp_path):
    events = [event for event in two_views() if not isinstance(event, Frame) or event.view == "a"]
    with RecordingWriter(tmp_path / "one.mcap", SessionInfo("one")) as writer:
        for event in events:
            writer.write(Frame(event.stamp_ns, event.image) if isinstance(event, Frame) else event)
    summary = summarise_recording(tmp_path / "one.mcap")
    assert summary.paired == {}
    assert "paired_frames" not in summary.figures()
    with RecordingReader(tmp_path / "one.mcap") as reader:
        assert reader.views == ("camera",)
