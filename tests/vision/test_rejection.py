"""Detection that rejects an object that cannot be the catheter, on drawn sessions: sheaths, posts, two objects."""

from dataclasses import replace

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.types import BaseSide, Catheter, Image, SessionInfo, Status, ViewInfo
from tipforce.vision import (
    ResolvedVision,
    SessionDetector,
    ShapeDetector,
    VisionSettings,
    auto_calibrate,
)

from .drawn_tubes import SIDES_AND_LIGHT, SIZE, draw_tubes  # type: ignore[import-not-found]

DIAMETER, LENGTH = 10.0, 180.0
MOUTH = np.array([60.0, 120.0])
SESSION = SessionInfo("monday", Catheter("drawn", 0.01, 0.16, 0.02), {"camera": ViewInfo(1e-3, "left")})
BENDS = np.linspace(-0.5, 0.5, 5)


def _arc(base: np.ndarray, turn: float, length: float = LENGTH) -> np.ndarray:
    """(n, 2) points of a shaft clamped along +u at ``base``, which turns by ``turn`` to its tip."""
    s = np.linspace(0.0, length, 200)
    angle = turn * (s / length) ** 2
    steps = np.column_stack([np.cos(angle), np.sin(angle)]) * (s[1] - s[0])
    return base + np.vstack([np.zeros(2), np.cumsum(steps[:-1], axis=0)])


def _straight(u0: float, u1: float, v: float) -> np.ndarray:
    return np.column_stack([np.linspace(u0, u1, 100), np.full(100, v)])


def _sheathed(light: bool = False, grey: float = 90.0) -> tuple[list[Image], list[np.ndarray]]:
    shafts = [_arc(MOUTH, turn) for turn in BENDS]
    sheath = (_straight(-20.0, MOUTH[0], MOUTH[1]), 1.9 * DIAMETER, grey)
    return [draw_tubes(k, (shaft, DIAMETER, 60.0), sheath, light=light) for k, shaft in enumerate(shafts)], shafts


@pytest.mark.parametrize(("side", "light"), SIDES_AND_LIGHT)
def test_the_base_lies_at_the_mouth_of_a_sheath(side: BaseSide, light: bool) -> None:
    images, shafts = _sheathed(light)
    width = SIZE[0]

    def turned(image: Image) -> Image:
        ways = {"left": image, "right": image[:, ::-1], "top": image.T, "bottom": image.T[::-1]}
        return np.ascontiguousarray(ways[side])

    def at(points: np.ndarray) -> np.ndarray:
        u, v = points.T
        ways = {"left": (u, v), "right": (width - 1 - u, v), "top": (v, u), "bottom": (v, width - 1 - u)}
        return np.column_stack(ways[side])

    info = SessionInfo("monday", SESSION.catheter, {"camera": ViewInfo(1e-3, side)})
    detector = ShapeDetector(auto_calibrate(VisionSettings(), [turned(image) for image in images], info))
    for image, shaft in zip(images, shafts, strict=True):
        line = detector.detect(turned(image)).centreline
        assert line is not None
        assert np.linalg.norm(line.points[0] - at(shaft)[0]) < 3.0
        assert np.linalg.norm(line.points[-1] - at(shaft)[-1]) < 2.0


def test_a_sheath_without_a_shaft_of_the_stated_length_is_not_taken() -> None:
    sheath = (_straight(-20.0, MOUTH[0], MOUTH[1]), 1.9 * DIAMETER, 90.0)
    images = [draw_tubes(k, (_arc(MOUTH, turn, 120.0), DIAMETER, 60.0), sheath) for k, turn in enumerate(BENDS)]
    detector = ShapeDetector(SessionDetector(VisionSettings(), SESSION, images).vision)
    assert not any(detector.detect(image).found for image in images)


def _moving(k: int) -> tuple[np.ndarray, float, float]:
    return _straight(200.0 + 8 * k, 240.0 + 8 * k, 210.0), 30.0, 120.0


def test_a_shaft_that_stands_still_while_the_images_change_is_not_the_catheter() -> None:
    still = (_arc(MOUTH, 0.2), DIAMETER, 60.0), (_straight(-20.0, MOUTH[0], MOUTH[1]), 1.9 * DIAMETER, 90.0)
    waiting = [draw_tubes(k, *still) for k in range(8)]
    assert auto_calibrate(VisionSettings(), waiting, SESSION).base_side == "left"
    passed = [draw_tubes(k, *still, _moving(k)) for k in range(8)]
    with pytest.raises(InputError, match="neither moves nor bends"):
        auto_calibrate(VisionSettings(), passed, SESSION)


def _posts() -> list[Image]:
    post = (_straight(-20.0, 175.0, 60.0), DIAMETER, 60.0)
    return [draw_tubes(k, post, (_straight(200.0 + 8 * k, 240.0 + 8 * k, 180.0), 30.0, 120.0)) for k in range(5)]


REFUSED = r"visible in 0 of 5 images|px long, the stated length is|neither moves nor bends"
REFUSED += r"|is the catheter with a probability of 0% at most"


def test_a_post_is_not_the_catheter() -> None:
    with pytest.raises(InputError, match=REFUSED):
        auto_calibrate(VisionSettings(), _posts(), SESSION)


def test_of_two_shafts_with_sheaths_it_asks_which() -> None:
    images = []
    for k, turn in enumerate(BENDS):
        tubes = []
        for v in (70.0, 170.0):
            base = np.array([MOUTH[0], v])
            tubes += [(_arc(base, 0.5 * turn), DIAMETER, 60.0), (_straight(-20.0, base[0], v), 1.9 * DIAMETER, 90.0)]
        images.append(draw_tubes(k, *tubes))
    with pytest.raises(InputError, match=r"two objects could be the catheter.*mark the shaft's base"):
        auto_calibrate(VisionSettings(), images, SESSION)


def test_what_is_marked_already_is_not_asked_for_again() -> None:
    """The mark lies on the post, whose width is not the catheter's."""
    post = (_straight(-20.0, 240.0, 60.0), 2.4 * DIAMETER, 60.0)
    images = [
        draw_tubes(k, post, (_arc(np.array([60.0, 180.0]), turn), DIAMETER, 60.0)) for k, turn in enumerate(BENDS)
    ]
    view = replace(SESSION.views["camera"], base_region=(2, 45, 24, 75))
    with pytest.raises(InputError) as refused:
        auto_calibrate(VisionSettings(), images, replace(SESSION, views={"camera": view}))
    assert "mark the shaft's base" not in str(refused.value)
    assert "base_region" in str(refused.value)


def test_a_cable_that_something_moves_over_is_not_the_catheter() -> None:
    cable = (_straight(-20.0, 190.0, 60.0), DIAMETER, 60.0)
    ends = np.linspace(168.0, 182.0, 5)
    images = [draw_tubes(k, cable, (_straight(end, 230.0, 60.0), 40.0, 200.0)) for k, end in enumerate(ends)]
    with pytest.raises(InputError, match=REFUSED):
        auto_calibrate(VisionSettings(), images, SESSION)


def _clamped() -> list[Image]:
    return [draw_tubes(k, (_arc(np.array([-8.0, 120.0]), turn), DIAMETER, 60.0)) for k, turn in enumerate(BENDS)]


def test_a_line_that_the_image_supports_is_probably_right_and_one_that_ends_hidden_is_refused() -> None:
    images = _clamped()
    settings = auto_calibrate(VisionSettings(), images, SESSION)
    plain = ShapeDetector(settings).detect(images[2])
    assert plain.found
    assert plain.probability_right > 0.95
    assert plain.centreline is not None
    hidden = images[2].copy()
    u, v = np.rint(plain.centreline.points[-12:]).astype(int).T
    for a, b in zip(u.tolist(), v.tolist(), strict=True):
        hidden[b - 8 : b + 9, a - 8 : a + 9] = 200
    assert not ShapeDetector(settings).detect(hidden).found


@pytest.mark.parametrize(("least", "found"), [(0.0, True), (1.0, False)])
def test_what_is_right_with_less_than_the_least_probability_is_refused(least: float, found: bool) -> None:
    images = _clamped()
    settings = auto_calibrate(VisionSettings(), images, SESSION).model_copy(update={"least_probability": least})
    shape = ShapeDetector(settings).detect(images[2])
    assert shape.found is found
    assert found or "probability" in shape.detail


def test_a_session_that_is_refused_is_refused_in_each_of_its_images() -> None:
    posts = _posts()
    alone = SessionDetector(VisionSettings(), SESSION, posts).vision
    assert isinstance(alone, ResolvedVision)
    shape = ShapeDetector(alone).detect(posts[0])
    assert shape.status is Status.NO_CATHETER
    assert "base_region" in shape.detail


def test_where_the_metadata_tell_no_size_each_image_is_looked_at_by_itself() -> None:
    empty = [draw_tubes(k) for k in range(4)]
    assert SessionDetector(VisionSettings(), SessionInfo(), empty).vision == VisionSettings()
