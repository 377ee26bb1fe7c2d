"""The poses of two cameras from images of a ChArUco board that both see at the same instants."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..errors import InputError
from ..geometry import CameraModel, Pose
from ..types import FloatArray, Image
from ._camera import MIN_LENS_IMAGES, BoardSettings, board_corners

MAX_GROUPS = 12
"""Largest number of groups of images that the jackknife leaves out one by one."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPair:
    """Two cameras in the frame of the board's first image: its middle, x right, y down, z ahead of the first camera.

    Attributes:
        cameras: both cameras, with their lenses.
        stds: (6,) standard deviations of the second pose relative to the first: turn about the board's middle in rad,
            then shift in m, both along the second camera's axes; by a jackknife over the images.
        residual_px: epipolar and reprojection residual of the corners, RMS.
        images: number of pairs of images in which both cameras see the board.
        scales_m_per_px: scale of each view at the board's middle in the first pair.
    """

    cameras: tuple[CameraModel, CameraModel]
    stds: FloatArray
    residual_px: float
    images: int
    scales_m_per_px: tuple[float, float]


def calibrate_board_pair(images: Sequence[tuple[Image, Image]], settings: BoardSettings) -> BoardPair:
    """Finds lenses and relative pose of two cameras.

    Args:
        images: pairs that both cameras took at the same instant, with the board in different poses; in the first pair
            the board is where the catheter will be.
        settings: the board.

    Returns:
        The cameras.

    Raises:
        InputError: the values of the board are not possible, the first pair does not show it, or fewer than
            `MIN_LENS_IMAGES` pairs do.
    """
    views: list[list[tuple[FloatArray, FloatArray]]] = []
    for k, pair in enumerate(images):
        found = [board_corners(image, settings) for image in pair]
        common = sorted(set(found[0]) & set(found[1]))
        if len(common) < 4:  # a plane's pose needs four points
            if k == 0:
                raise InputError(
                    f"the first pair of images shows {len(found[0])} and {len(found[1])} corners of the board, and "
                    f"{len(common)} in both, 4 are needed: check squares and dictionary of the board, and that both "
                    "cameras see it"
                )
            continue
        views.append([(np.array([c[i][0] for i in common]), np.array([c[i][1] for i in common])) for c in found])
    if len(views) < MIN_LENS_IMAGES:
        raise InputError(
            f"both cameras see the board in {len(views)} of {len(images)} pairs of images, {MIN_LENS_IMAGES} are "
            "needed: tilt it in different directions"
        )
    sizes = [(image.shape[1], image.shape[0]) for image in images[0]]
    cameras, residual = _cameras(views, views[0], sizes)
    groups = min(MAX_GROUPS, len(views))
    left_out = [
        _cameras([view for k, view in enumerate(views) if k % groups != g], views[0], sizes)[0] for g in range(groups)
    ]
    changes = np.array([_change(cameras, each) for each in left_out])
    stds = np.sqrt((groups - 1) / groups * ((changes - changes.mean(axis=0)) ** 2).sum(axis=0))
    middles = [camera.camera_from_world.translation_m for camera in cameras]
    scales = [float(middle[2] / camera.focal_px[1]) for camera, middle in zip(cameras, middles, strict=True)]
    return BoardPair(cameras, stds, residual, len(views), (scales[0], scales[1]))


def _cameras(
    views: Sequence[Sequence[tuple[FloatArray, FloatArray]]],
    first: Sequence[tuple[FloatArray, FloatArray]],
    sizes: Sequence[tuple[int, int]],
) -> tuple[tuple[CameraModel, CameraModel], float]:
    """Returns both cameras in the frame of the board in the pair ``first``, and the RMS residual in px."""
    board = [view[0][0].astype(np.float32) for view in views]
    corners = [[view[place][1].astype(np.float32) for view in views] for place in range(2)]
    lenses: list[tuple[FloatArray, FloatArray]] = []
    for place in range(2):
        _, matrix, lens, _, _ = cv2.calibrateCamera(
            board, corners[place], sizes[place], np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
        )
        lenses.append((np.asarray(matrix, np.float64), np.asarray(lens, np.float64).ravel()[:5]))
    stereo: Any = cv2.stereoCalibrate  # its stub lacks these arguments
    rms, _, _, _, _, turn, shift, _, _ = stereo(
        board, corners[0], corners[1], *lenses[0], *lenses[1], sizes[0], flags=cv2.CALIB_FIX_INTRINSIC
    )
    middle = _middle(first[0], *lenses[0])
    second_from_first = Pose(_rotation(turn), np.asarray(shift, np.float64).ravel())
    poses = Pose(np.eye(3), middle), second_from_first @ Pose(np.eye(3), middle)
    made = [
        CameraModel(np.array([matrix[0, 0], matrix[1, 1]]), matrix[:2, 2], lens, pose)
        for (matrix, lens), pose in zip(lenses, poses, strict=True)
    ]
    return (made[0], made[1]), float(rms)


def _middle(view: tuple[FloatArray, FloatArray], matrix: FloatArray, lens: FloatArray) -> FloatArray:
    """Returns the (3,) middle of the board's corners in the camera's frame."""
    points, pixels = view
    _, turn, shift = cv2.solvePnP(points, pixels, matrix, lens)
    return _rotation(cv2.Rodrigues(turn)[0]) @ points.mean(axis=0) + np.asarray(shift, np.float64).ravel()


def _rotation(matrix: object) -> FloatArray:
    """Returns the rotation that is nearest to a (3, 3) matrix."""
    u, _, v = np.linalg.svd(np.asarray(matrix, np.float64))
    return u @ v


def _change(cameras: tuple[CameraModel, CameraModel], others: tuple[CameraModel, CameraModel]) -> FloatArray:
    """Returns the (6,) change of the second pose: turn about the board's middle in rad, shift in m."""
    own, other = cameras[1].camera_from_world, others[1].camera_from_world
    turn = Pose(_rotation(other.rotation @ own.rotation.T), np.zeros(3)).axis_angle_rad
    # a longer focal length with a larger distance gives the same image
    shift = other.translation_m - own.translation_m
    shift[2] = other.translation_m[2] / others[1].focal_px[1] * cameras[1].focal_px[1] - own.translation_m[2]
    return np.concatenate([turn, shift])
