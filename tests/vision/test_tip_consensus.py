"""The tip from several images together, whatever lies beneath it in each of them."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from tipforce.types import Catheter, FloatArray, SessionInfo, Status, ViewInfo
from tipforce.vision import DetectedShape, ResolvedVision, Tracer, VisionSettings, auto_calibrate, for_session
from tipforce.vision._auto_calibrate import TEMPLATE_ROUNDS
from tipforce.vision._session_size import learn_tip_template
from tipforce.vision._tip_consensus import axis_offset, shift_tip

LENGTH = 150.0
SESSION = SessionInfo("monday", Catheter("test tube", 0.012, 0.156, 0.0), {"camera": ViewInfo(1e-3, "left")})


def _draw_image(turn: float, rail: float, cloth: float = 0.0, shadow: bool = False, patch: float = 0.0) -> np.ndarray:
    """A straight shaft from the left border, its metal end little darker than the ground; a dark rail lies behind it.

    ``rail``: how far behind the end the rail begins. The rail is darker than the metal end, so its border stands out
    more than the end itself. ``cloth``: angle to the shaft, in radians, of the border of a cloth of the shaft's own
    grey, which lies under the last 90 px of it and to one side.
    ``shadow``: the metal end throws one to its right. ``patch``: grey of a thing that lies over one half of it.
    """
    rng = np.random.default_rng(round(1e4 * (turn + 1.0)))
    scale = 4
    image = np.full((200 * scale, 260 * scale), 170.0)
    base, way = np.array([-6.0, 100.0]), np.array([np.cos(turn), np.sin(turn)])
    tip = base + (LENGTH - 6.0 + 6.0 / np.cos(turn)) * way  # the round end reaches a radius further

    def bar(first: np.ndarray, last: np.ndarray, width: float, grey: float) -> None:
        ends = [np.rint((p + 0.5) * scale).astype(int).tolist() for p in (first, last)]
        cv2.line(image, ends[0], ends[1], grey, round(width * scale), cv2.LINE_8)

    aside = np.array([-way[1], way[0]])
    middle = tip + (rail + 12.0) * way
    bar(middle - 60 * aside, middle + 60 * aside, 12.0, 60.0)
    if cloth:
        border = np.array([np.cos(turn + cloth), np.sin(turn + cloth)])
        first = tip - 90 * way - 7.0 * aside
        corners = [first, first + 300 * border, first + 300 * border + 300 * aside, first + 300 * aside]
        cv2.fillPoly(image, [np.rint((np.array(corners) + 0.5) * scale).astype(np.int32)], 60.0)
    bar(base, tip - 30 * way, 12.0, 60.0)
    if shadow:
        bar(tip - 30 * way + 5 * aside, tip + 5 * aside, 12.0, 150.0)
    bar(tip - 30 * way, tip, 12.0, 120.0)
    if patch:
        bar(tip - 30 * way + 4 * aside, tip + 4 * aside, 8.0, patch)
    small = cv2.GaussianBlur(cv2.resize(image, (260, 200), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    return np.clip(np.rint(small + rng.normal(0.0, 2.0, small.shape)), 0, 255).astype(np.uint8)


def _beside(sight: DetectedShape, turn: float) -> float:
    """How far the line lies beside the shaft's axis at most, in px."""
    assert sight.centreline is not None
    aside = np.array([-np.sin(turn), np.cos(turn)])
    return float(np.abs((sight.centreline.points - np.array([-6.0, 100.0])) @ aside).max())


def test_an_edge_that_lies_elsewhere_in_every_image_is_not_taken_for_the_tip() -> None:
    rails = (2.0, 5.0, 8.0, 11.0, 3.5, 6.5, 14.0, 9.5)
    images = [_draw_image(0.05 * k - 0.2, rail) for k, rail in enumerate(rails)]
    resolved = auto_calibrate(VisionSettings(), images, SESSION)
    assert resolved.length_px == pytest.approx(LENGTH, abs=1.5)
    assert resolved.length_tolerance < 0.03
    for image in images:
        seen = Tracer(resolved).detect(image).centreline
        assert seen is not None
        assert np.hypot(*np.diff(seen.points, axis=0).T).sum() == pytest.approx(LENGTH, abs=3.0)


def test_a_shaft_lost_on_a_cloth_of_its_own_grey_is_found_again_by_the_tip_template() -> None:
    clear = [_draw_image(0.05 * k - 0.2, 40.0) for k in range(8)]
    resolved = auto_calibrate(VisionSettings(least_probability=0.0), clear, SESSION)
    assert resolved.tip_template is not None
    unaware = resolved.model_copy(update={"tip_template": None})
    for turn, cloth in ((-0.1, -0.15), (0.0, -0.05), (0.1, -0.1)):
        image = _draw_image(turn, 40.0, cloth)
        lost = Tracer(unaware).detect(image)
        assert not lost.found or _beside(lost, turn) > 5.0
        assert _beside(Tracer(resolved).detect(image), turn) < 0.6


@pytest.mark.parametrize("aside", [-3.0, 0.0, 3.0])
def test_lines_that_lie_beside_the_tip_in_every_image_are_put_on_its_axis(aside: float) -> None:
    """Whichever side the end's shadow lies on."""
    turns = [0.05 * k - 0.2 for k in range(8)]
    images = [_draw_image(turn, 40.0, shadow=True) for turn in turns]
    lines = []
    for turn in turns:
        axis = np.array([-6.0, 100.0]) + np.linspace(6.0, LENGTH, 64)[:, None] * [np.cos(turn), np.sin(turn)]
        lines.append(shift_tip(axis, 6.0, LENGTH - 6.0, aside))
    assert axis_offset(images, lines, 6.0, LENGTH - 6.0) == pytest.approx(-aside, abs=0.6)


def test_a_tip_that_differs_from_the_template_is_refused() -> None:
    resolved = auto_calibrate(VisionSettings(), [_draw_image(0.05 * k - 0.2, 40.0) for k in range(8)], SESSION)
    for turn in (-0.1, 0.0, 0.1):
        assert Tracer(resolved).detect(_draw_image(turn, 40.0)).found
        sight = Tracer(resolved).detect(_draw_image(turn, 40.0, patch=250.0))
        assert sight.status is Status.CUT_OFF
        assert "an object covers it" in sight.detail


def test_a_tip_template_that_no_image_fits_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    times = []

    def learn(settings: ResolvedVision, given: Sequence[np.ndarray], lines: Sequence[FloatArray | None]):
        learnt = learn_tip_template(settings, given, lines)
        assert learnt.tip_template is not None
        times.append(learnt)
        wrong = tuple(255 * (k % 2) for k in range(len(learnt.tip_template)))
        return learnt.model_copy(update={"tip_template": wrong}) if len(times) == TEMPLATE_ROUNDS else learnt

    images = [_draw_image(0.05 * k - 0.2, 40.0) for k in range(8)]
    monkeypatch.setattr("tipforce.vision._auto_calibrate.learn_tip_template", learn)
    resolved = auto_calibrate(VisionSettings(), images, SESSION)
    assert resolved.tip_template is None
    assert all(Tracer(resolved).detect(image).found for image in images)


def test_a_tip_template_is_not_used_in_another_session_and_not_learnt_from_several() -> None:
    images = [_draw_image(0.05 * k - 0.2, 40.0) for k in range(8)]
    resolved = auto_calibrate(VisionSettings(), images, SESSION)
    nearer = SessionInfo("tuesday", SESSION.catheter, {"camera": ViewInfo(0.8e-3, "left")})
    assert for_session(resolved, nearer).tip_template is None
    assert auto_calibrate(VisionSettings(), images, [SESSION] * 8).tip_template is None
