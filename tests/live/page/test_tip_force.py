"""Axial, lateral and contact angle: known answers, whatever the catheter's direction in the image."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.live.server import tip_force
from tipforce.types import DetectedShape, ForceEstimate, Status

from .updates import estimate_in_space, estimate_of, shape_along  # type: ignore[import-not-found]


@pytest.mark.parametrize(
    ("force_n", "axial_n", "lateral_n", "angle_deg"),
    [
        ((-0.2, 0.0), 0.2, 0.0, 0.0),  # pressed straight on
        ((0.0, 0.2), 0.0, 0.2, 90.0),  # along the tissue
        ((-0.1, -0.1), 0.1, 0.1, 45.0),
        ((0.1, 0.0), -0.1, 0.0, 180.0),  # pulled
    ],
)
def test_known_answers(force_n: tuple[float, float], axial_n: float, lateral_n: float, angle_deg: float) -> None:
    found = tip_force(estimate_of(force_n, 0.01, shape_along()))
    assert found is not None
    assert (found.axial_n, found.lateral_n, found.angle_deg) == pytest.approx((axial_n, lateral_n, angle_deg), abs=1e-9)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), st.floats(0.02, 0.5))
def test_the_parts_make_up_the_force_and_the_direction_in_the_image_plays_no_part(
    base_rad: float, force_rad: float, size_n: float
) -> None:
    force = (size_n * math.cos(force_rad), size_n * math.sin(force_rad))
    found = tip_force(estimate_of(force, 0.01, shape_along(base_rad)))
    straight = tip_force(estimate_of(force, 0.01, shape_along()))
    assert found is not None
    assert straight is not None
    assert math.hypot(found.axial_n, found.lateral_n) == pytest.approx(size_n)
    assert found.axial_n == pytest.approx(straight.axial_n, abs=1e-9)
    assert found.angle_deg == pytest.approx(straight.angle_deg, abs=1e-5)


def test_half_of_the_angles_interval_is_that_of_the_force_across() -> None:
    found = tip_force(estimate_of((-0.2, 0.0), 0.02, shape_along()))
    assert found is not None
    assert found.angle_error_deg == pytest.approx(math.degrees(0.02 / 0.2), rel=1e-3)
    unknown = replace(estimate_of((-0.2, 0.0), 0.02, shape_along()), covariance_n2=np.full((3, 3), np.nan))
    found = tip_force(unknown)
    assert found is not None
    assert math.isnan(found.angle_error_deg)


def test_a_known_force_across_the_image_is_lateral() -> None:
    estimate = estimate_of((-0.3, 0.0), 0.02, shape_along())
    spatial = replace(
        estimate, force_n=np.array([-0.3, 0.0, 0.4]), known=np.ones(3, np.bool_), covariance_n2=1e-4 * np.eye(3),
        magnitude_n=0.5,
    )  # fmt: skip
    found = tip_force(spatial)
    assert found is not None
    assert (found.axial_n, found.lateral_n) == pytest.approx((0.3, 0.4))
    assert found.angle_error_deg == pytest.approx(math.degrees(1.6448536 * 0.01 / 0.5))


def test_without_force_or_direction_there_is_no_answer() -> None:
    assert tip_force(estimate_of((-0.2, 0.0))) is None
    assert tip_force(estimate_of((-0.2, 0.0), 0.02, DetectedShape(Status.CUT_OFF, "cut off"))) is None
    assert tip_force(ForceEstimate.invalid(0, Status.NO_CATHETER, "none", shape_along())) is None
    magnitude = replace(estimate_of((-0.2, 0.0), 0.02, shape_along()), known=np.zeros(3, np.bool_))
    assert tip_force(magnitude) is None


def test_a_tip_whose_direction_in_space_is_known_has_its_axial_force_along_it() -> None:
    axis = np.array([0.8, 0.0, 0.6])
    estimate = replace(estimate_in_space(), force_n=-0.2 * axis, tip_axis=axis)
    found = tip_force(estimate)
    assert found is not None
    assert (found.axial_n, found.lateral_n) == (pytest.approx(0.2), pytest.approx(0.0, abs=1e-12))
    in_the_image = tip_force(replace(estimate, tip_axis=None))
    assert in_the_image is not None
    assert (in_the_image.axial_n, in_the_image.lateral_n) == (pytest.approx(0.16), pytest.approx(0.12))
