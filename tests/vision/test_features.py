"""Shape features: the thesis's five, and those that every shape has."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tipforce.geometry import curve_from_angle
from tipforce.types import BasePose, CentrelinePx, Status
from tipforce.vision import (
    DetectedShape,
    NoFeatures,
    ShapeFeatureSettings,
    feature_names,
    fitted_curve,
    shape_features,
)

THESIS = ShapeFeatureSettings()
LEGENDRE = ShapeFeatureSettings(kind="legendre")
ALL = [
    ShapeFeatureSettings(kind=kind, degree=degree, constant=constant)
    for kind in ("polynomial", "legendre")
    for degree in (3, 4, 6)
    for constant in (True, False)
]
HOOK = [1.2, 1.7, 0.3]


def seen(series: list[float], angle: float = 0.1, origin: tuple[float, float] = (10.0, 240.0)) -> DetectedShape:
    base = BasePose(np.array(origin), angle)
    points = base.to_image(curve_from_angle(np.array(series), 300.0, 64))
    return DetectedShape(Status.VALID, "", CentrelinePx(points), base, 12.0, 1.0)


@given(st.floats(-math.pi, math.pi), st.tuples(st.floats(-500, 500), st.floats(-500, 500)))
def test_features_do_not_depend_on_where_the_base_lies_in_the_image(angle, origin) -> None:
    for settings in (THESIS, LEGENDRE):
        here = shape_features(seen([0.4, 0.5, 0.1]), settings)
        there = shape_features(seen([0.4, 0.5, 0.1], angle, origin), settings)
        np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-9)


def test_the_polynomial_is_that_of_the_centreline_in_the_base_frame() -> None:
    shape = seen([0.4, 0.5, 0.1])
    local = shape.base.to_base(shape.centreline.points)
    np.testing.assert_allclose(shape_features(shape, THESIS), np.polyfit(*local.T, 4), rtol=1e-8)


def test_the_angle_series_is_counter_clockwise_from_the_base_tangent() -> None:
    np.testing.assert_allclose(shape_features(seen([0.4, 0.5, 0.1]), LEGENDRE), [0.4, 0.5, 0.1, 0, 0], atol=1e-5)


@pytest.mark.parametrize("settings", ALL, ids=str)
def test_there_is_one_name_for_each_feature(settings: ShapeFeatureSettings) -> None:
    features = shape_features(seen([0.4, 0.5, 0.1]), settings)
    assert len(feature_names(settings)) == len(features)
    assert np.isfinite(features).all()


def test_a_shape_past_90_degrees_has_no_polynomial_but_an_angle_series() -> None:
    refused = shape_features(seen(HOOK), THESIS)
    assert isinstance(refused, NoFeatures)
    assert refused.status is Status.NOT_A_FUNCTION
    assert "past 90 degrees" in refused.detail
    np.testing.assert_allclose(shape_features(seen(HOOK), LEGENDRE), [*HOOK, 0, 0], atol=1e-3)


@given(st.floats(0.1, 3.0))
def test_the_polynomial_is_refused_exactly_where_the_tangent_passes_90_degrees(last: float) -> None:
    refused = isinstance(shape_features(seen([last / 2, last / 2]), THESIS), NoFeatures)
    if abs(last - math.pi / 2) > last / 63:
        assert refused == (last > math.pi / 2)


def test_what_was_not_found_has_no_features_and_the_same_reason() -> None:
    lost = shape_features(DetectedShape(Status.CUT_OFF, "lost after 80 px"), LEGENDRE)
    assert lost == NoFeatures(Status.CUT_OFF, "lost after 80 px")


def test_turning_the_base_changes_only_the_mean_angle() -> None:
    shape = seen([0.4, 0.5, 0.1])
    turned = DetectedShape(
        Status.VALID, "", shape.centreline, BasePose(shape.base.origin_px, shape.base.angle_rad + 0.2), 12.0
    )
    change = shape_features(turned, LEGENDRE) - shape_features(shape, LEGENDRE)
    np.testing.assert_allclose(change, [-0.2, 0, 0, 0, 0], atol=1e-9)
    without = ShapeFeatureSettings(kind="legendre", constant=False)
    np.testing.assert_allclose(shape_features(turned, without), shape_features(shape, without), atol=1e-9)


@pytest.mark.parametrize("settings", ALL, ids=str)
def test_the_fitted_curve_lies_on_the_shape_it_was_fitted_to(settings: ShapeFeatureSettings) -> None:
    shape = seen([0.3, 0.3, 0.05])
    curve = fitted_curve(shape, settings, shape_features(shape, settings), 400)
    away = np.hypot(*(shape.centreline.points[:, None] - curve[None]).T).min(axis=0)
    assert away.max() < (2.5 if settings.kind == "polynomial" else 0.5)


def test_a_curve_cannot_be_laid_on_what_was_not_found() -> None:
    with pytest.raises(ValueError, match="no_catheter"):
        fitted_curve(DetectedShape(Status.NO_CATHETER), THESIS, np.zeros(5))


@pytest.mark.parametrize("wrong", [{"kind": "spline"}, {"degree": 0}, {"degree": 40}, {"grade": 3}])
def test_settings_refuse_what_means_nothing(wrong) -> None:
    with pytest.raises(ValidationError):
        ShapeFeatureSettings(**wrong)
