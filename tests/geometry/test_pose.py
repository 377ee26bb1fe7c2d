import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tipforce.geometry import Pose

numbers = st.floats(-3, 3)
triples = st.tuples(numbers, numbers, numbers).map(np.array)
poses = st.builds(Pose.from_axis_angle, triples, triples)


@given(triples)
def test_axis_and_angle_turn_as_opencv_has_it(vector):
    expected, _ = cv2.Rodrigues(vector)
    np.testing.assert_allclose(Pose.from_axis_angle(vector, np.zeros(3)).rotation, expected, atol=1e-12)


@given(triples, st.one_of(st.floats(0, math.pi), st.sampled_from([1e-300, 1e-9, math.pi - 1e-9, math.pi])))
def test_axis_and_angle_come_back(direction, angle):
    length = np.linalg.norm(direction)
    vector = direction / length * angle if length > 0.1 else np.array([0.0, 0.0, angle])
    back = Pose.from_axis_angle(vector, np.zeros(3)).axis_angle_rad
    if angle > math.pi - 1e-6:  # either sign of a half turn
        back = math.copysign(1.0, float(back @ vector)) * back
    np.testing.assert_allclose(back, vector, atol=1e-8)


@given(triples)
def test_euler_angles_turn_about_fixed_x_then_y_then_z(angles):
    expected = Rotation.from_euler("xyz", angles).as_matrix()
    np.testing.assert_allclose(Pose.from_euler(angles, np.zeros(3)).rotation, expected, atol=1e-12)


@given(poses, poses, triples)
def test_composition_applies_the_right_one_first(a, b, point):
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-10)


@given(poses, triples)
def test_inverse_leads_back(pose, point):
    np.testing.assert_allclose(pose.inverse().apply(pose.apply(point)), point, atol=1e-10)
    np.testing.assert_allclose(pose.apply(pose.inverse().apply(point)), point, atol=1e-10)


@given(poses, triples, triples)
def test_directions_turn_with_the_points(pose, point, way):
    np.testing.assert_allclose(pose.apply(point + way) - pose.apply(point), pose.rotate(way), atol=1e-10)


def test_many_points_at_once():
    points = np.arange(24.0).reshape(2, 4, 3)
    pose = Pose.from_euler([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(pose.apply(points)[1, 2], pose.apply(points[1, 2]))


@pytest.mark.parametrize("wrong", [np.diag([1.0, 1.0, -1.0]), 2 * np.eye(3), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_refused(wrong):
    with pytest.raises(ValueError, match="rotation"):
        Pose(wrong, np.zeros(3))


def test_a_place_at_infinity_is_refused():
    with pytest.raises(ValueError, match="translation_m"):
        Pose(np.eye(3), np.array([0.0, np.inf, 0.0]))
