"""The seams refuse what they must refuse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.types import BasePose, ForceEstimate, Frame, Status, Wrench


def test_an_invalid_estimate_carries_no_number() -> None:
    estimate = ForceEstimate.invalid(7, Status.CUT_OFF, "lost after 12 mm")
    numbers = [estimate.force_n, estimate.covariance_n2, estimate.interval_n, estimate.magnitude_interval_n]
    assert all(np.isnan(n).all() for n in numbers)
    assert math.isnan(estimate.magnitude_n)
    assert not estimate.known.any()


def test_an_invalid_estimate_with_a_number_is_refused() -> None:
    nan = math.nan
    with pytest.raises(ValueError, match="cut_off"):
        ForceEstimate(
            0,
            np.full(3, nan),
            np.zeros(3, bool),
            np.full((3, 3), nan),
            np.full((3, 2), nan),
            0.2,
            np.full(2, nan),
            Status.CUT_OFF,
        )


def test_arrays_in_the_seams_cannot_be_changed() -> None:
    wrench = Wrench(0, np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="read-only"):
        wrench.force_n[0] = 1.0


@pytest.mark.parametrize("image", [np.zeros((4, 4)), np.zeros((4, 4, 4), np.uint8), np.zeros(4, np.uint8)])
def test_a_frame_refuses_what_is_no_image(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="uint8"):
        Frame(0, image)


@given(
    st.floats(-math.pi, math.pi),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
)
def test_to_image_inverts_to_base(angle: float, origin: tuple[float, float], point: tuple[float, float]) -> None:
    pose = BasePose(np.array(origin), angle)
    there_and_back = pose.to_image(pose.to_base(np.array([point])))
    np.testing.assert_allclose(there_and_back, [point], atol=1e-9)


def test_y_is_counter_clockwise_from_x_as_displayed() -> None:
    pose = BasePose(np.array([10.0, 20.0]), 0.0)
    np.testing.assert_allclose(pose.to_base(np.array([[11.0, 20.0], [10.0, 19.0]])), [[1, 0], [0, 1]], atol=1e-12)
