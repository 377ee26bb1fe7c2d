"""Scale from a ChArUco board, a ruler and the shaft; tilt and lens are said where they matter."""

import cv2
import numpy as np
import pytest

from tipforce.calibration import (
    BoardSettings,
    CalibrationSession,
    calibrate_board,
    scale_from_diameter,
    scale_from_ruler,
)
from tipforce.errors import InputError

BOARD = BoardSettings((9, 6), 8e-3, 6e-3)
FOCAL, DISTANCE = 1200.0, 0.25
MATRIX = np.array([[FOCAL, 0.0, 223.5], [0.0, FOCAL, 159.5], [0.0, 0.0, 1.0]])
PIXELS = 120
TILTS = ((0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4), (0.3, 0.3), (-0.3, 0.3))


def board_image(turn: tuple[float, float, float], k1: float = 0.0) -> np.ndarray:
    """(320, 448) grey: the board turned about its middle, through a lens."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    flat = cv2.aruco.CharucoBoard(BOARD.squares, 8e-3, 6e-3, dictionary).generateImage((9 * PIXELS, 6 * PIXELS))
    fine = 2
    u, v = np.meshgrid((np.arange(448 * fine) + 0.5) / fine - 0.5, (np.arange(320 * fine) + 0.5) / fine - 0.5)
    seen = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    rays = np.c_[cv2.undistortPoints(seen, MATRIX, np.array([k1, 0.0, 0.0, 0.0])).reshape(-1, 2), np.ones(u.size)]
    rotation, middle = cv2.Rodrigues(np.array(turn))[0], np.array([0.0, 0.0, DISTANCE])
    points = (rays * ((rotation[:, 2] @ middle) / (rays @ rotation[:, 2]))[:, None] - middle) @ rotation
    places = ((points[:, :2] + (0.036, 0.024)) / 8e-3 * PIXELS - 0.5).astype(np.float32).reshape(*u.shape, 2)
    drawn = cv2.remap(flat, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255)
    return cv2.resize(drawn, (448, 320), interpolation=cv2.INTER_AREA)


def test_one_image_of_a_board_gives_the_scale() -> None:
    found = calibrate_board([board_image((0.0, 0.0, 0.05))], BOARD)
    assert abs(found.metres_per_px - DISTANCE / FOCAL) < 3.0 * found.scale_std
    assert found.scale_std < 5e-3 * found.metres_per_px
    assert found.distortion is None
    assert found.quantity.doubt == ""


def test_a_tilted_board_is_said_with_what_it_costs() -> None:
    found = calibrate_board([board_image((0.25, 0.0, 0.0))], BOARD)
    assert found.scale_range > 0.02
    assert "of the force; detection does not undistort" in found.quantity.doubt


def test_several_images_give_lens_and_tilt() -> None:
    images = [board_image((0.02, 0.0, 0.0), 0.3), *(board_image((*tilt, 0.0), 0.3) for tilt in TILTS)]
    found = calibrate_board(images, BOARD)
    assert found.images == len(images)
    assert found.focal_px == pytest.approx(FOCAL, rel=0.03)
    assert found.distortion is not None
    assert found.distortion[0] == pytest.approx(0.3, abs=0.1)
    assert found.lens_px > 1.0
    assert found.tilt_deg < 4.0


def test_what_is_no_board_is_refused_in_one_sentence() -> None:
    blank = np.full((100, 100), 200, np.uint8)
    with pytest.raises(InputError, match="0 corners and 0 markers in the first image"):
        calibrate_board([blank], BOARD)
    with pytest.raises(InputError, match="a board needs 3 x 3 squares or more"):
        calibrate_board([blank], BoardSettings((2, 5), 8e-3))
    with pytest.raises(InputError, match="dictionary DICT_9: OpenCV does not know it"):
        calibrate_board([blank], BoardSettings((7, 5), 8e-3, dictionary="DICT_9"))
    with pytest.raises(InputError, match="20 x 20 squares has 200 markers, DICT_4X4_50 50"):
        calibrate_board([blank], BoardSettings((20, 20), 8e-3))


def test_a_ruler_gives_the_scale_and_says_when_it_is_short() -> None:
    found = scale_from_ruler((0.0, 0.0, 300.0, 400.0), 100.0)
    assert found.value == pytest.approx(2e-4)
    assert found.doubt == ""
    assert "is only 50 px" in scale_from_ruler((0.0, 0.0, 50.0, 0.0), 10.0).doubt
    with pytest.raises(InputError, match="mark them farther"):
        scale_from_ruler((1.0, 1.0, 1.0, 1.0), 10.0)


def test_the_shaft_checks_the_scale(session: CalibrationSession) -> None:
    found = scale_from_diameter([session])
    assert found is not None
    assert found.value == pytest.approx(2e-4)
    assert not found.written
    session.diameter_px[:] *= 2.0
    try:
        found = scale_from_diameter([session])
        assert found is not None
        assert "-50% from the stated scale" in found.doubt
    finally:
        session.diameter_px[:] /= 2.0
