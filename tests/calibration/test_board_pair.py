"""The poses of two cameras from a board that both see, at first in Python and then as a user writes it."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.calibration import BoardSettings, calibrate_board_pair
from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.geometry import CameraModel, Pose
from tipforce.types import read_bench

BOARD = BoardSettings((9, 6), 8e-3, 6e-3)
PIXELS = 60
SIZE = (448, 320)
FIRST = CameraModel(np.array([700.0, 700.0]), np.array([223.5, 159.5]))
SECOND_FROM_FIRST = Pose.from_euler([0.05, -0.6, 0.1], [0.14, 0.01, 0.05])
SECOND = CameraModel(np.array([650.0, 650.0]), np.array([220.0, 165.0]), camera_from_world=SECOND_FROM_FIRST)
TURNS = (
    (0.0, 0.3, 0.0), (0.3, 0.3, 0.1), (-0.3, 0.3, 0.0), (0.0, 0.0, 0.2), (0.0, 0.6, -0.2), (0.3, 0.5, 0.3),
    (-0.3, 0.1, -0.1), (0.25, 0.05, 0.0), (-0.2, 0.55, 0.2),
)  # fmt: skip


def draw(camera: CameraModel, board_in_world: Pose) -> np.ndarray:
    """(320, 448) grey: the board in an image of the camera."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    flat = cv2.aruco.CharucoBoard(BOARD.squares, 8e-3, 6e-3, dictionary).generateImage((9 * PIXELS, 6 * PIXELS))
    pose = camera.camera_from_world @ board_in_world
    step = 8e-3 / PIXELS
    metres = np.array([[step, 0.0, 0.5 * step - 0.036], [0.0, step, 0.5 * step - 0.024], [0.0, 0.0, 1.0]])
    plane = camera.matrix @ np.column_stack([pose.rotation[:, :2], pose.translation_m]) @ metres
    fine = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]])
    size = (2 * SIZE[0], 2 * SIZE[1])
    drawn = cv2.warpPerspective(flat, fine @ plane, size, flags=cv2.INTER_LINEAR, borderValue=255)
    return cv2.resize(drawn, SIZE, interpolation=cv2.INTER_AREA)


def pairs() -> list[tuple[np.ndarray, np.ndarray]]:
    found = []
    for k, turn in enumerate(TURNS):
        board = Pose.from_euler(list(turn), [2e-3 * (k % 3), 2e-3 * (k % 2), 0.25])
        found.append((draw(FIRST, board), draw(SECOND, board)))
    return found


@pytest.fixture(scope="module")
def images() -> list[tuple[np.ndarray, np.ndarray]]:
    return pairs()


def test_two_cameras_are_found_within_their_standard_deviations(images: list[tuple[np.ndarray, np.ndarray]]) -> None:
    found = calibrate_board_pair(images, BOARD)
    first, second = found.cameras
    relative = second.camera_from_world @ first.camera_from_world.inverse()
    turn = np.degrees((relative @ SECOND_FROM_FIRST.inverse()).axis_angle_rad)
    assert np.abs(turn).max() < 1.0
    assert np.abs(turn / np.degrees(found.stds[:3])).max() < 3.0
    assert np.abs(relative.translation_m - SECOND_FROM_FIRST.translation_m).max() < 10e-3
    assert first.focal_px[0] == pytest.approx(700.0, rel=0.03)
    assert found.images == len(images)
    assert found.residual_px < 0.5


def test_a_board_that_one_camera_does_not_see_is_refused(images: list[tuple[np.ndarray, np.ndarray]]) -> None:
    blank = np.full(SIZE[::-1], 255, np.uint8)
    with pytest.raises(
        InputError, match=r"the first pair of images shows \d+ and 0 corners of the board, and 0 in both"
    ):
        calibrate_board_pair([(images[0][0], blank)], BOARD)
    with pytest.raises(InputError, match="both cameras see the board in 3 of 3 pairs of images, 6 are needed"):
        calibrate_board_pair(images[:3], BOARD)


def write(folder: Path, images: list[tuple[np.ndarray, np.ndarray]], place: int) -> Path:
    folder.mkdir()
    for k, pair in enumerate(images):
        cv2.imwrite(str(folder / f"{k:02}.png"), pair[place])
    return folder


def test_two_folders_write_the_poses_of_both_views(images: list[tuple[np.ndarray, np.ndarray]], tmp_path: Path) -> None:
    boards = write(tmp_path / "board_a", images, 0), write(tmp_path / "board_b", images, 1)
    words = ["calibrate", "--board", *map(str, (boards[0], "--board", boards[1]))]
    words += ["--squares", "9x6,8,6", "-o", str(tmp_path / "bench.toml")]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "9 pairs of images show the board to both cameras" in " ".join(result.output.split())
    info = read_bench(tmp_path / "bench.toml")
    assert list(info.views) == ["a", "b"]
    assert info.view("a").pose_uncertainty_deg == (0.0, 0.0, 0.0)
    stds = info.view("b").pose_uncertainty_deg
    assert stds is not None
    assert 0.0 < max(stds) < 3.0
    for name, true in (("a", FIRST), ("b", SECOND)):
        view = info.view(name)
        assert view.projection is not None
        assert view.projection_frame == "board"
        camera = CameraModel.from_projection(view.projection)
        assert camera.focal_px == pytest.approx(true.focal_px, rel=0.03)
        assert view.metres_per_px == pytest.approx(
            camera.camera_from_world.translation_m[2] / camera.focal_px[1], rel=1e-4
        )


def test_folders_of_different_length_are_no_pairs(images: list[tuple[np.ndarray, np.ndarray]], tmp_path: Path) -> None:
    boards = write(tmp_path / "board_a", images, 0), write(tmp_path / "board_b", images[:7], 1)
    words = ["calibrate", "--board", str(boards[0]), "--board", str(boards[1]), "--squares", "9x6,8"]
    result = CliRunner().invoke(app, words)
    assert isinstance(result.exception, InputError)
    assert "has 9 images of the board" in str(result.exception)
    assert "has 7: leave in both those that were taken at the same instants" in str(result.exception)
