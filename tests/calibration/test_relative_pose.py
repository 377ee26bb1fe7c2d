"""The relative pose of two views is refined from the tip; its standard deviations hold; contradictions are found."""

import math

import numpy as np
import pytest

from tipforce.calibration import StatedPose, TipPairs, moved_camera, refine_relative_pose, relative_covariance
from tipforce.errors import InputError
from tipforce.geometry import CameraModel, CArm, Pose, epipolar_angles

ARMS = [CArm(primary, secondary, 1.1, 0.75, 0.25e-3) for primary, secondary in ((-30.0, 10.0), (55.0, -5.0))]
CAMERAS = (ARMS[0].camera(), ARMS[1].camera())
STDS = np.array([*np.radians([1.0, 1.0, 0.5]), 2e-3, 2e-3, 5e-3])
COVARIANCE = relative_covariance(CAMERAS, (STDS, STDS))


def true_tips(rng: np.random.Generator, reach_m: float, frames: int = 100) -> tuple[np.ndarray, np.ndarray]:
    """Tips (n, 3) in a ball about a point near the isocentre, and the catheter's direction, in the patient's frame."""
    points = np.array([5e-3, -8e-3, 12e-3]) + reach_m * rng.uniform(-1.0, 1.0, (frames, 3))
    axes = np.array([0.1, 0.2, 1.0]) + 0.2 * rng.normal(size=(frames, 3))
    return points, axes / np.linalg.norm(axes, axis=1, keepdims=True)


def seen_tips(rng: np.random.Generator, reach_m: float, noise_px: float = 0.5, bias_px: float = 0.5) -> TipPairs:
    points, directions = true_tips(rng, reach_m)
    tips = np.stack([camera.project(points) for camera in CAMERAS], axis=1)
    axes = np.stack([camera.project(points + 1e-4 * directions) for camera in CAMERAS], axis=1) - tips
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    off = axes * bias_px * rng.normal(size=(1, 2, 1)) + noise_px * rng.normal(size=tips.shape)
    return TipPairs(tips + off, axes)


def missed(found: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Error of a found change (6,) where the stated camera was moved by ``change`` from the true one."""
    back = Pose.from_axis_angle(change[:3], np.zeros(3)).inverse().axis_angle_rad
    return found - np.concatenate([back, -change[3:]])


def test_a_point_has_one_epipolar_angle_in_both_views() -> None:
    points = true_tips(np.random.default_rng(0), 30e-3)[0]
    angles = epipolar_angles(CAMERAS, np.stack([camera.project(points) for camera in CAMERAS], axis=1))
    np.testing.assert_allclose(angles[:, 0], angles[:, 1], atol=1e-12)
    with pytest.raises(ValueError, match="at the same position"):
        epipolar_angles((CAMERAS[0], CAMERAS[0]), np.zeros((1, 2, 2)))


def test_a_projection_matrix_gives_its_camera_back() -> None:
    for camera in CAMERAS:
        found = CameraModel.from_projection(-2.0 * camera.projection_matrix)
        np.testing.assert_allclose(found.row, camera.row, atol=1e-9)
    with pytest.raises(ValueError, match="without a finite distance"):
        CameraModel.from_projection([[1e3, 0, 0, 320], [0, -1e3, 0, 240], [0, 0, 0, 1]])


@pytest.mark.slow
def test_standard_deviations_hold_over_many_sessions() -> None:
    rng = np.random.default_rng(1)
    scores: list[np.ndarray] = []
    resolved: list[np.ndarray] = []
    for _ in range(25):
        change = np.linalg.cholesky(COVARIANCE) @ rng.normal(size=6)
        stated = StatedPose((CAMERAS[0], moved_camera(CAMERAS[1], change)), COVARIANCE)
        found = refine_relative_pose(stated, seen_tips(rng, 15e-3))
        scores.append(missed(found.change, change) / np.sqrt(np.diag(found.covariance)))
        resolved.append(found.resolved)
    share = np.mean(np.abs(scores) < 1.645, axis=0)
    assert (share > 0.65).all(), share  # 0.9 +- 0.06 expected
    assert np.mean(resolved, axis=0).max() > 0.85


def test_a_tip_that_moves_far_finds_turns_of_the_pose() -> None:
    rng = np.random.default_rng(2)
    change = np.array([*np.radians([1.5, 0.0, -0.8]), 0.0, 3e-3, 0.0])
    stated = StatedPose((CAMERAS[0], moved_camera(CAMERAS[1], change)), COVARIANCE)
    found = refine_relative_pose(stated, seen_tips(rng, 30e-3))
    left = missed(found.change, change)
    assert abs(math.degrees(left[0])) < 0.3
    assert abs(math.degrees(left[2])) < 0.3
    assert abs(left[4]) < 0.5e-3
    assert found.rms_px < 1.5 < 5.0 < found.rms_before_px
    assert not found.differs


def test_the_angle_between_the_views_stays_as_stated() -> None:
    found = refine_relative_pose(StatedPose(CAMERAS, COVARIANCE), seen_tips(np.random.default_rng(3), 10e-3))
    assert found.resolved[1] < 0.1
    assert abs(math.degrees(found.change[1])) < 0.5
    assert found.covariance[1, 1] == pytest.approx(COVARIANCE[1, 1], rel=0.1)


def test_a_pose_that_is_off_by_degrees_is_contradicted_and_its_uncertainty_is_widened() -> None:
    small = COVARIANCE / 100.0  # 0.1 degree is stated
    change = np.array([math.radians(3.0), 0.0, math.radians(2.0), 0.0, 1e-3, 0.0])
    stated = StatedPose((CAMERAS[0], moved_camera(CAMERAS[1], change)), small)
    found = refine_relative_pose(stated, seen_tips(np.random.default_rng(4), 15e-3))
    assert found.differs
    assert found.p_value < 1e-6
    assert abs(math.degrees(missed(found.change, change)[0])) < 3.0 * math.degrees(math.sqrt(found.covariance[0, 0]))


def test_wrong_tips_of_some_frames_do_not_count() -> None:
    rng = np.random.default_rng(5)
    tips = seen_tips(rng, 15e-3)
    pixels = np.array(tips.tips_px)
    pixels[::7] += 40.0
    change = np.array([math.radians(1.0), 0.0, 0.0, 0.0, 2e-3, 0.0])
    stated = StatedPose((CAMERAS[0], moved_camera(CAMERAS[1], change)), COVARIANCE)
    found = refine_relative_pose(stated, TipPairs(pixels, tips.axes))
    score = missed(found.change, change) / np.sqrt(np.diag(found.covariance))
    assert np.abs(score).max() < 3.0
    assert found.rms_px < 2.0


def test_too_few_tips_are_refused() -> None:
    tips = seen_tips(np.random.default_rng(6), 10e-3)
    with pytest.raises(InputError, match="in both views in 5 frames, and 20 are needed"):
        refine_relative_pose(StatedPose(CAMERAS, COVARIANCE), TipPairs(tips.tips_px[:5], tips.axes[:5]))
