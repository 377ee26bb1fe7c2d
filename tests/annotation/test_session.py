"""Proposals: the detector's line where the detector is right, else the line of the most similar finished frame."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tipforce.annotation import AnnotationSession, AnnotationStore, curve_through, uncertainty_of
from tipforce.errors import InputError, OutputError
from tipforce.types import DetectedShape

from .conftest import NOTHING, bends, shape_along, true_line  # type: ignore[import-not-found]

Make = Callable[[list[DetectedShape]], AnnotationSession]


def marks(line: np.ndarray, **more: object) -> dict[str, object]:
    return {"points_px": [*line[::40].tolist(), line[-1].tolist()], "done": True, **more}


def error_px(points: np.ndarray, line: np.ndarray) -> float:
    curve = curve_through(points, 200)
    return float(max(np.linalg.norm(line - point, axis=1).min() for point in curve))


def test_the_detected_line_is_proposed_as_few_points(make_session: Make) -> None:
    session = make_session([shape_along(true_line(bends()[0])), NOTHING])
    first, second = session.proposals()
    assert 4 <= len(first.points_px) <= 8
    assert error_px(first.points_px, true_line(bends()[0])) < 1.5
    assert len(second.points_px) == 0
    assert second.detail == "no shaft reaches a border"


def test_a_finished_line_is_carried_to_a_frame_where_nothing_was_detected(make_session: Make) -> None:
    session = make_session([NOTHING] * 3)
    session.mark(0, marks(true_line(bends()[0])))
    carried = session.proposals()[1]
    assert carried.carried_from == "img000.png"
    assert error_px(carried.points_px, true_line(bends()[1])) < 2.5
    still = error_px(true_line(bends()[0])[::40], true_line(bends()[1]))
    assert error_px(carried.points_px, true_line(bends()[1])) < 0.6 * still


def test_a_detector_that_was_wrong_in_the_similar_frame_is_not_used(make_session: Make) -> None:
    wrong = shape_along(true_line(0.5) + 30.0)
    session = make_session([wrong, wrong, wrong])
    session.mark(0, marks(true_line(bends()[0])))
    assert session.proposals()[1].carried_from == "img000.png"


def test_a_detector_that_was_right_in_the_similar_frame_is_used(make_session: Make) -> None:
    session = make_session([shape_along(true_line(bend)) for bend in bends()[:3]])
    session.mark(0, marks(true_line(bends()[0])))
    assert session.proposals()[1].carried_from == ""


def test_no_line_is_carried_from_a_frame_without_a_catheter_or_of_another_recording(
    make_session: Make, store: AnnotationStore
) -> None:
    session = make_session([NOTHING] * 3)
    session.mark(0, {"present": False, "done": True})
    assert len(session.proposals()[1].points_px) == 0
    session._groups = [0, 1, 1]
    session.mark(0, marks(true_line(bends()[0])))
    assert len(session.proposals()[1].points_px) == 0


def test_each_change_is_in_the_file(make_session: Make, folder: Path) -> None:
    session = make_session([NOTHING] * 2)
    session.mark(1, marks(true_line(0.6), tip_hidden=True))
    again = AnnotationStore(folder).frames["img001.png"]
    assert again.tip_hidden
    assert again.done


def test_marks_stay_as_they_were_where_they_cannot_be_saved(
    make_session: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = make_session([NOTHING] * 2)

    def full(*_: object) -> None:
        raise OutputError("no space left")

    monkeypatch.setattr("tipforce.annotation._store.write_atomic", full)
    with pytest.raises(OutputError):
        session.mark(0, marks(true_line(0.6)))
    assert not session.frames[0].done


def test_a_training_needs_two_frames_with_a_catheter(make_session: Make) -> None:
    session = make_session([NOTHING] * 3)
    session.mark(0, marks(true_line(0.5)))
    session.mark(1, {"present": False, "done": True})
    with pytest.raises(InputError, match="1 finished frames show a catheter; a training needs at least 2"):
        session.annotations()
    session.mark(2, marks(true_line(0.7)))
    annotations, images = session.annotations()
    assert [each.present for each in annotations] == [True, False, True]
    assert len(images) == 3


def test_a_frame_without_a_detection_is_the_most_uncertain() -> None:
    line = true_line(0.5)
    assert uncertainty_of(NOTHING) == 1.0
    assert uncertainty_of(shape_along(line, 0.9)) == pytest.approx(0.1)
    assert uncertainty_of(shape_along(line, float("nan"))) == 0.0  # both flanks seen all along
