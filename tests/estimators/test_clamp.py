"""A clamp that is advanced by a known way: the catheter is looked at as a camera on the clamp would see it."""

import math

import cv2
import numpy as np
import pytest

from tipforce.estimators._reading import Abstention, read_advance_m
from tipforce.estimators._session_detection import DetectedLine, SessionDetection
from tipforce.estimators.networks._image_input import catheter_window, crop_window, moved
from tipforce.estimators.session import LineFrame
from tipforce.types import Catheter, CentrelinePx, Image, Observation, SessionInfo, Status, ViewInfo
from tipforce.vision import INWARD, VisionSettings, image_from_clamp

SCALE = 0.2e-3
INFO = SessionInfo(
    "day 1",
    Catheter(diameter_m=2.4e-3, flexible_length_m=40e-3, rigid_length_m=8e-3),
    {"camera": ViewInfo(SCALE, "left", polarity="dark")},
)
MIDDLE_V = 240.0
FORTY_PX = np.array([40.0, 0.0])


def drawn(advance_px: int) -> Image:
    """A shaft 240 px long whose clamp stands ``advance_px`` inside the left border, on a ground with texture."""
    image = np.random.default_rng(3).normal(200, 3, (480, 640)).astype(np.uint8)
    s = np.linspace(0.0, 240.0, 200)
    curve = np.column_stack([s + advance_px, MIDDLE_V + 2e-4 * s**2])
    curve = np.vstack([[-20.0, MIDDLE_V], curve])
    cv2.polylines(image, [np.round(curve * 16).astype(np.int32)], False, 60, 12, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(image, (0, 0), 1.0)


def detect(detection: SessionDetection, advance_px: int, **actuation: float) -> DetectedLine:
    found = detection.read(Observation(0, {"camera": drawn(advance_px)}, actuation))
    assert isinstance(found, DetectedLine)
    return found


@pytest.mark.parametrize("side", INWARD)
def test_a_camera_that_went_along_sees_a_clamp_at_rest(side: str) -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 64), np.uint8)
    du, dv = INWARD[side]
    gone = image_from_clamp(image, side, 5)
    inner = gone[5:-5, 5:-5]
    assert np.array_equal(inner, np.roll(image, (-5 * dv, -5 * du), (0, 1))[5:-5, 5:-5])
    assert gone.shape == image.shape


def test_the_window_of_a_network_goes_along() -> None:
    image = drawn(0)
    window = catheter_window(INFO, "camera", image.shape, "left")
    at_rest = crop_window(image, window, 160)
    shifted = np.roll(image, 40, axis=1)
    assert np.array_equal(crop_window(shifted, moved(window, 40.0), 160)[:, :150], at_rest[:, :150])


def test_without_a_side_nobody_knows_where_the_base_lies() -> None:
    assert catheter_window(INFO, "camera", (480, 640), "left").at_base
    assert not catheter_window(INFO, "camera", (480, 640), None).at_base


def test_the_line_of_a_rod_begins_at_its_clamp() -> None:
    frame = LineFrame((640, 480), "left", SCALE)
    points = np.column_stack([np.linspace(0.0, 240.0, 64), np.full(64, MIDDLE_V)])
    at_rest = frame.line(CentrelinePx(points))
    advanced = frame.line(CentrelinePx(points + FORTY_PX), 40 * SCALE)
    assert advanced.points == pytest.approx(at_rest.points)
    assert advanced.middle == pytest.approx(at_rest.middle - (40 * SCALE, 0.0))


def test_a_shaft_on_an_advanced_clamp_ends_where_its_tip_is() -> None:
    """Without the reading the same length is looked for from the border, and the line ends short of the tip."""
    detection = SessionDetection(VisionSettings(), INFO, [drawn(0)] * 4)
    tip = detect(detection, 0).centreline.points[-1]
    advanced = detect(detection, 40, advance_mm=40 * 1e3 * SCALE)
    assert advanced.centreline.points[-1] == pytest.approx(tip + FORTY_PX, abs=1.5)
    assert advanced.advance_m == pytest.approx(40 * SCALE)
    assert advanced.shape.base is not None
    assert advanced.shape.base.origin_px[0] == pytest.approx(40.0, abs=1.5)


def test_a_reading_that_is_none_is_an_abstention() -> None:
    found = read_advance_m(Observation(0, {}, {"advance_mm": math.nan}))
    assert isinstance(found, Abstention)
    assert found.status is Status.MISSING_INPUT
    assert read_advance_m(Observation(0, {}, {})) == 0.0
