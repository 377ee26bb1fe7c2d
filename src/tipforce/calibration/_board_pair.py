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
        corners = [board_corners(image, settings) for image in pair]
        common = sorted(set(corners[0]) & set(corners[1]))
        if len(common) < 4:  # a plane's pose needs four points
            if k == 0:
                raise InputError(
                    f"the first pair of images shows {len(corners[0])} and {len(corners[1])} corners of the board, and "
                    f"{len(common)} in both, 4 are needed: check squares and dictionary of the board, and that both "
                    "cameras see it"
                )
            continue
        views.append([(np.array([c[i][0] for i in common]), np.array([c[i][1] for i in common])) for c in corners])
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
    # jackknife: the scatter of the poses, each found without one group of images
    changes = np.array([_change(cameras, reduced) for reduced in left_out])
    stds = np.sqrt((groups - 1) / groups * ((changes - changes.mean(axis=0)) ** 2).sum(axis=0))
    middles = [camera.camera_from_world.translation_m for camera in cameras]
    scales = [float(middle[2] / camera.focal_px[1]) for camera, middle in zip(cameras, middles, strict=True)]
    return BoardPair(cameras, stds, residual, len(views), (scales[0], scales[1]))


def _cameras(
    views: Sequence[Sequence[tuple[FloatArray, FloatArray]]],
    first: Sequence[tuple[FloatArray, FloatArray]],
    sizes: Sequence[tuple[int, int]],
) -> tuple[tuple[CameraModel, CameraModel], float]:
    """Calibrates the lens of each camera alone, then the pose of the second one relative to the first.

    Args:
        views: for each pair of images and each of its two cameras: (n, 3) corners on the board in m, (n, 2) pixels.
        first: the pair in which the middle of the board is the origin of the frame.
        sizes: (width, height) of the images of each camera in px.

    Returns:
        Both cameras, and the RMS residual in px.
    """
    board_points = [view[0][0].astype(np.float32) for view in views]
    corners = [[view[camera][1].astype(np.float32) for view in views] for camera in range(2)]
    lenses: list[tuple[FloatArray, FloatArray]] = []
    lens_flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3  # k2 and k3 need boards in every corner of the image
    for camera in range(2):
        _, matrix, lens, _, _ = cv2.calibrateCamera(
            board_points, corners[camera], sizes[camera], np.eye(3), np.zeros(5), flags=lens_flags
        )
        lenses.append((np.asarray(matrix, np.float64), np.asarray(lens, np.float64).ravel()[:5]))
    stereo: Any = cv2.stereoCalibrate  # its stub lacks these arguments
    rms, _, _, _, _, turn, shift, _, _ = stereo(
        board_points, corners[0], corners[1], *lenses[0], *lenses[1], sizes[0], flags=cv2.CALIB_FIX_INTRINSIC
    )
    board_middle_m = _middle(first[0], *lenses[0])
    second_from_first = Pose(_rotation(turn), np.asarray(shift, np.float64).ravel())
    poses = Pose(np.eye(3), board_middle_m), second_from_first @ Pose(np.eye(3), board_middle_m)
    models = [
        CameraModel(np.array([matrix[0, 0], matrix[1, 1]]), matrix[:2, 2], lens, pose)
        for (matrix, lens), pose in zip(lenses, poses, strict=True)
    ]
    return (models[0], models[1]), float(rms)


def _middle(view: tuple[FloatArray, FloatArray], matrix: FloatArray, lens: FloatArray) -> FloatArray:
    """Returns the (3,) middle of the board's corners in the camera's frame."""
    points, pixels = view
    _, turn, shift = cv2.solvePnP(points, pixels, matrix, lens)
    return _rotation(cv2.Rodrigues(turn)[0]) @ points.mean(axis=0) + np.asarray(shift, np.float64).ravel()


def _rotation(matrix: object) -> FloatArray:
    """Returns the rotation that is nearest to a (3, 3) matrix."""
    u, _, v = np.linalg.svd(np.asarray(matrix, np.float64))
    return u @ v


def _change(cameras: tuple[CameraModel, CameraModel], changed: tuple[CameraModel, CameraModel]) -> FloatArray:
    """Returns the (6,) difference of the second camera's pose between two calibrations.

    Args:
        cameras: both cameras by all images.
        changed: both cameras by a part of the images.

    Returns:
        Turn about the board's middle in rad, then shift in m, both along the second camera's axes.
    """
    pose, changed_pose = cameras[1].camera_from_world, changed[1].camera_from_world
    turn = Pose(_rotation(changed_pose.rotation @ pose.rotation.T), np.zeros(3)).axis_angle_rad
    # a longer focal length with a larger distance gives the same image: the distances are compared at one focal length
    shift = changed_pose.translation_m - pose.translation_m
    shift[2] = changed_pose.translation_m[2] / changed[1].focal_px[1] * cameras[1].focal_px[1] - pose.translation_m[2]
    return np.concatenate([turn, shift])
