import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.geometry import CameraModel, Pose
from tipforce.types import BasePose

small = st.floats(-0.3, 0.3)
poses = st.builds(
    Pose.from_axis_angle,
    st.tuples(small, small, st.floats(-3, 3)).map(np.array),
    st.tuples(small, small, st.floats(0.6, 2.0)).map(np.array),
)
lenses = st.tuples(
    st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-0.05, 0.05)
).map(np.array)
cameras = st.builds(
    CameraModel,
    st.tuples(st.floats(700, 1500), st.floats(700, 1500)).map(np.array),
    st.tuples(st.floats(250, 400), st.floats(150, 300)).map(np.array),
    lenses,
    poses,
)


def cloud(seed, n=40):
    return np.random.default_rng(seed).uniform(-0.12, 0.12, (n, 3))


@given(cameras, st.integers(0, 1000))
def test_projects_as_opencv_does(camera, seed):
    points = cloud(seed)
    pose = camera.camera_from_world
    expected, _ = cv2.projectPoints(points, pose.rotation, pose.translation_m, camera.matrix, camera.distortion)
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-8)


@given(cameras, st.integers(0, 1000))
def test_undistorts_as_opencv_does(camera, seed):
    pixels = np.random.default_rng(seed).uniform([0, 0], [640, 480], (40, 2))
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    expected = cv2.undistortPointsIter(pixels, camera.matrix, camera.distortion, np.eye(3), camera.matrix, until)
    found = camera.undistort(pixels)
    seen = np.isfinite(found[:, 0])
    np.testing.assert_allclose(found[seen], expected[seen, 0], atol=1e-6)
    # What OpenCV answers for the rest is no ray that the lens would show there.
    rays = np.column_stack([(expected[~seen, 0] - camera.centre_px) / camera.focal_px, np.ones((~seen).sum())])
    again = camera.project(camera.camera_from_world.inverse().apply(rays))
    assert not (np.abs(again - pixels[~seen]) < 1e-6).any()


@given(lenses, st.floats(0, 2 * math.pi))
def test_every_ray_that_the_lens_shows_comes_back(lens, direction):
    camera = CameraModel([1000.0, 1000.0], [0.0, 0.0], lens)
    reach = np.linspace(0, 1.5, 301)
    ahead = np.column_stack([np.outer(reach, [math.cos(direction), math.sin(direction)]), np.ones(301)])
    pixels = camera.project(ahead)
    first = np.append(np.flatnonzero(np.isnan(pixels[:, 0])), 301)[0]
    shown = np.maximum(first - 1, 0)  # of the fold itself no more than 0.005 is left out
    rays = camera.rays(pixels[:shown])
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], ahead[:shown, :2], atol=1e-8)


@given(cameras, st.integers(0, 1000))
def test_rays_lead_back_to_their_points(camera, seed):
    points = cloud(seed)
    rays = camera.rays(camera.project(points))
    reach = np.linalg.norm(points - camera.position_m, axis=1)
    np.testing.assert_allclose(camera.position_m + reach[:, None] * rays, points, atol=1e-10)


@given(cameras, st.integers(0, 1000))
def test_points_of_a_plane_come_back(camera, seed):
    normal = np.array([0.2, -0.1, 1.0])
    origin = np.array([0.01, 0.02, -0.03])
    points = cloud(seed)
    points -= np.outer((points - origin) @ normal / (normal @ normal), normal)
    np.testing.assert_allclose(camera.on_plane(camera.project(points), origin, normal), points, atol=1e-10)


@given(cameras, st.integers(0, 1000))
def test_the_projection_matrix_is_the_camera_without_its_lens(camera, seed):
    points = cloud(seed)
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ camera.projection_matrix.T
    np.testing.assert_allclose(
        homogeneous[:, :2] / homogeneous[:, 2:], camera.undistort(camera.project(points)), atol=1e-8
    )


@given(cameras, st.integers(0, 1000))
def test_slopes_are_the_derivatives(camera, seed):
    points, step = cloud(seed, 5), 1e-6
    pixels, slopes = camera.project_with_slopes(points)
    np.testing.assert_array_equal(pixels, camera.project(points))
    for axis in range(3):
        way = np.eye(3)[axis] * step
        numeric = (camera.project(points + way) - camera.project(points - way)) / (2 * step)
        np.testing.assert_allclose(slopes[:, :, axis], numeric, atol=1e-3)


@given(st.floats(-math.pi, math.pi), st.integers(0, 1000))
def test_a_facing_camera_sees_what_the_base_pose_says(angle, seed):
    base = BasePose(np.array([100.0, 300.0]), angle)
    camera = CameraModel.facing(base, 2e-4, 0.5, (319.5, 239.5))
    flat = cloud(seed) * [1, 1, 0]
    np.testing.assert_allclose(camera.project(flat), base.to_image(flat[:, :2] / 2e-4), atol=1e-8)
    assert camera.position_m[2] == pytest.approx(0.5)  # z points toward the camera


def test_what_comes_nearer_grows():
    camera = CameraModel.facing(BasePose(np.array([0.0, 240.0]), 0.0), 2e-4, 0.5, (0.0, 240.0))
    near, far = camera.project([[0.04, 0.0, 0.1], [0.04, 0.0, 0.0]])
    assert near[0] == pytest.approx(250.0)
    assert far[0] == pytest.approx(200.0)


def test_a_negative_focal_length_mirrors_the_image():
    points = np.array([[0.1, 0.05, 1.0], [-0.2, 0.1, 1.5]])
    lens = [-0.1, 0.02, 0.001, -0.002, 0.0]
    plain, mirrored = (CameraModel([f, 800.0], [320.0, 240.0], lens) for f in (800.0, -800.0))
    seen = mirrored.project(points)
    np.testing.assert_allclose(seen, plain.project(points) * (-1, 1) + (640, 0))
    np.testing.assert_allclose(mirrored.rays(seen), points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-9)


def test_what_lies_behind_the_camera_is_not_seen():
    camera = CameraModel([800.0, 800.0], [320.0, 240.0])
    assert np.isnan(camera.project([[0.0, 0.0, -1.0], [0.1, 0.0, 0.0]])).all()
    np.testing.assert_allclose(camera.project([[0.0, 0.0, 1.0]]), [[320.0, 240.0]])


def test_a_lens_that_folds_back_shows_nothing_there():
    camera = CameraModel([800.0, 800.0], [320.0, 240.0], [-0.3, 0.0, 0.0, 0.0, 0.0])
    # r (1 - 0.3 r^2) is largest at r = 1.054 with 0.703: no ray is seen farther out than that
    seen = camera.project([[1.0, 0.0, 1.0], [1.1, 0.0, 1.0]])
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1]).all()
    rays = camera.rays([[320.0 + 800 * 0.70, 240.0], [320.0 + 800 * 0.71, 240.0]])
    np.testing.assert_array_equal(np.isnan(rays[:, 0]), [False, True])


def test_a_plane_behind_or_along_the_ray_is_not_met():
    camera = CameraModel([800.0, 800.0], [320.0, 240.0])
    assert np.isnan(camera.on_plane([[320.0, 240.0]], (0.0, 0.0, -1.0))).all()
    assert np.isnan(camera.on_plane([[320.0, 240.0]], (1.0, 0.0, 0.0), (1.0, 0.0, 0.0))).all()


@pytest.mark.parametrize(
    ("focal", "centre", "match"), [([0.0, 1.0], [0.0, 0.0], "positive focal"), ([1.0, 1.0], [np.nan, 0.0], "finite")]
)
def test_impossible_cameras_are_refused(focal, centre, match):
    with pytest.raises(ValueError, match=match):
        CameraModel(focal, centre)


def test_points_of_another_shape_are_refused():
    camera = CameraModel([800.0, 800.0], [320.0, 240.0])
    with pytest.raises(ValueError, match=r"points_m: expected shape \(n, 3\), got \(3,\)"):
        camera.project([0.0, 0.0, 1.0])
