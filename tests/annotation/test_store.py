"""The file of annotations: saved after every change, read again, refused with one sentence where it is damaged."""

import json
from pathlib import Path

import numpy as np
import pytest

from tipforce.annotation import AnnotationStore, MarkedFrame, store_path
from tipforce.errors import FileFormatError, InputError

LINE = np.array([[1.0, 2.0], [30.0, 8.0], [60.0, 40.0]])


def test_marks_are_read_as_they_were_saved(folder: Path) -> None:
    frames = [
        MarkedFrame("img000.png", LINE, tip_hidden=True, done=True),
        MarkedFrame("img001.png", np.empty((0, 2)), present=False, done=True),
        MarkedFrame("img002.png", LINE[:2]),
        MarkedFrame.empty("img003.png"),
    ]
    AnnotationStore(folder).add(frames)
    again = AnnotationStore(folder)
    assert again.file == folder.parent / "frames.annotations.json"
    assert [frame.values() for frame in again.frames.values()] == [frame.values() for frame in frames]
    assert [frame.image for frame in again.finished] == ["img000.png", "img001.png"]


def test_a_finished_frame_becomes_a_line_for_the_training() -> None:
    annotation = MarkedFrame("a.png", LINE, tip_hidden=True, done=True).annotation()
    assert annotation.points_px.shape == (64, 2)
    assert annotation.tip_hidden
    none = MarkedFrame("a.png", np.empty((0, 2)), present=False, done=True).annotation()
    assert not none.present
    assert none.points_px.shape == (0, 2)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"points_px": [[1, 2]], "done": True}, "expected at least 2 points"),
        ({"points_px": [[1, 2], [1, 2]], "done": True}, "two points in a row"),
        ({"points_px": [[1, "x"]]}, "points_px.0.1"),
        ({"points_px": [[1, 1e300]]}, "less than or equal to 100000"),
        ({"points_px": [[0, 0]] * 201}, "at most 200 items"),
        ({"done": "perhaps"}, "done"),
        ({"colour": 1}, "colour"),
    ],
)
def test_marks_that_cannot_be_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        MarkedFrame.from_values("a.png", values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is no JSON"),
        ("{}", "is no file of annotations"),
        ('{"format": "tipforce-annotations", "version": 2}', "has version 2, expected 1"),
        ('{"format": "tipforce-annotations", "version": 1, "source": "a", "frames": [{}]}', "frames.0.image"),
    ],
)
def test_a_damaged_file_is_refused_and_stays(folder: Path, text: str, message: str) -> None:
    file = store_path(folder)
    file.write_text(text)
    with pytest.raises(FileFormatError, match=message):
        AnnotationStore(folder)
    assert file.read_text() == text


def test_a_recording_has_its_file_beside_it(tmp_path: Path) -> None:
    store = AnnotationStore(tmp_path / "monday.mcap")
    store.save()
    assert json.loads((tmp_path / "monday.annotations.json").read_text())["source"] == "monday.mcap"
