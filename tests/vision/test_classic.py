"""Thesis algorithm 1, line by line."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.types import Status
from tipforce.vision import (
    ClassicDetector,
    ShapeFeatureSettings,
    VisionSettings,
    figure_17,
    figure_18,
    fitted_curve,
    shape_features,
)

DARK_LEFT = VisionSettings(method="classic", polarity="dark", base_side="left")


def step_image() -> np.ndarray:
    """Three rows thick, level over the first 20 columns and a little way on, then one row up every four columns."""
    image = np.full((60, 100), 200, np.uint8)
    for u in range(80):
        v = 30 - max(0, u - 30) // 4
        image[v - 1 : v + 2, u] = 50
    return image


def test_each_line_of_the_algorithm_gives_what_can_be_counted_by_hand() -> None:
    steps = ClassicDetector(DARK_LEFT).steps(step_image())
    assert steps.status is Status.VALID
    assert steps.binary.sum() == 80 * 3
    assert len(steps.base_px) == 20 * 3
    np.testing.assert_allclose(steps.base.origin_px, [9.5, 30.0])
    assert steps.base.angle_rad == pytest.approx(0.0, abs=1e-12)
    rows = [30 - max(0, u - 30) // 4 for u in range(80)]
    np.testing.assert_allclose(steps.single_px, np.column_stack([np.arange(80), rows]))
    np.testing.assert_allclose(
        steps.single_local, np.column_stack([np.arange(80) - 9.5, 30 - np.array(rows)]), atol=1e-9
    )
    np.testing.assert_allclose(
        steps.coefficients, np.polyfit(np.arange(80) - 9.5, 30 - np.array(rows, float), 4), rtol=1e-9
    )
    assert steps.diameter_px == pytest.approx(3.0, abs=0.15)
    assert steps.coverage == 1.0


def test_the_features_of_what_is_seen_are_the_five_coefficients_of_the_algorithm(tube) -> None:
    chain = ClassicDetector(DARK_LEFT)
    image = tube("bent", noise=5)
    features = shape_features(chain.detect(image), ShapeFeatureSettings())
    assert features.shape == (5,)
    np.testing.assert_allclose(features, chain.steps(image).coefficients, rtol=1e-9)


def test_density_below_the_constant_is_catheter_and_density_at_it_is_not() -> None:
    image = step_image()
    for c, catheter in ((50, False), (51, True), (200, True), (201, False)):
        steps = ClassicDetector(DARK_LEFT.model_copy(update={"threshold": c})).steps(image)
        assert (steps.status is Status.VALID) == catheter
        assert steps.threshold == c


def test_the_axis_of_a_tube_is_followed_to_its_tip(tube, axis_of) -> None:
    shape = ClassicDetector(DARK_LEFT).detect(tube("bent", noise=5))
    points, truth = shape.centreline.points, axis_of("bent")
    away = np.hypot(*(points[:, None] - truth[None]).T).min(axis=0)
    assert np.median(away) < 1.0
    assert np.hypot(*(points[-1] - truth[-1])) < 12.0
    np.testing.assert_allclose(points[0], shape.base.origin_px)
    steps = np.hypot(*np.diff(points, axis=0).T)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.15)
    assert len(points) == DARK_LEFT.points


@pytest.mark.parametrize(("side", "turns"), [("left", 0), ("bottom", 1), ("right", 2), ("top", 3)])
@pytest.mark.parametrize("polarity", ["dark", "light"])
def test_the_shape_is_the_same_from_every_side_and_in_both_polarities(tube, side, turns, polarity) -> None:
    image = tube("bent", noise=5)
    expected = shape_features(ClassicDetector(DARK_LEFT).detect(image), ShapeFeatureSettings())
    turned = np.ascontiguousarray(np.rot90(image if polarity == "dark" else 255 - image, turns))
    chain = ClassicDetector(VisionSettings(method="classic", polarity=polarity, base_side=side))
    np.testing.assert_allclose(shape_features(chain.detect(turned), ShapeFeatureSettings()), expected, rtol=1e-7)


def test_colour_and_grey_images_are_detected_alike(tube) -> None:
    image = tube("bent")
    grey, colour = (ClassicDetector(DARK_LEFT).steps(p) for p in (image, np.stack([image] * 3, axis=2)))
    np.testing.assert_array_equal(grey.coefficients, colour.coefficients)


def test_a_region_of_interest_shifts_nothing(tube) -> None:
    image = tube("bent")
    wide = np.full((600, 800), 40, np.uint8)
    wide[60:540, 90:730] = image
    inside = ClassicDetector(DARK_LEFT.model_copy(update={"roi": (90, 60, 730, 540)})).steps(wide)
    np.testing.assert_allclose(inside.single_px - [90, 60], ClassicDetector(DARK_LEFT).steps(image).single_px)
    np.testing.assert_allclose(inside.coefficients, ClassicDetector(DARK_LEFT).steps(image).coefficients, rtol=1e-9)


def test_a_marked_base_region_serves_a_catheter_that_does_not_reach_the_border(tube) -> None:
    image = tube("bent")
    image[:, :60] = 220
    assert ClassicDetector(DARK_LEFT).detect(image).status is Status.NO_CATHETER
    steps = ClassicDetector(DARK_LEFT.model_copy(update={"base_region": (70, 300, 90, 380)})).steps(image)
    assert steps.status is Status.VALID
    assert 70 <= steps.base.origin_px[0] <= 90
    assert steps.single_px[0, 0] == 70


@pytest.mark.parametrize(
    ("image", "status", "words"),
    [
        (np.full((480, 640), 200, np.uint8), Status.NO_CATHETER, "first 20 columns at the left border"),
        (np.zeros((480, 640), np.uint8), Status.NO_CATHETER, "first 20 columns"),
        (np.random.default_rng(0).integers(100, 140, (480, 640), np.uint8), Status.NO_CATHETER, "form no shaft"),
    ],
    ids=["light", "black", "noise"],
)
def test_an_image_without_a_catheter_is_said_to_have_none(image, status, words) -> None:
    shape = ClassicDetector(DARK_LEFT).detect(image)
    assert shape.status is status
    assert words in shape.detail
    assert shape.centreline is None


def test_a_shape_past_90_degrees_is_refused_with_the_columns_where_it_folds(tube) -> None:
    shape = ClassicDetector(DARK_LEFT).detect(tube("hook"))
    assert shape.status is Status.NOT_A_FUNCTION
    assert "past 90 degrees" in shape.detail


def test_a_catheter_whose_tip_is_outside_is_cut_off(tube) -> None:
    shape = ClassicDetector(DARK_LEFT).detect(tube("long"))
    assert shape.status is Status.CUT_OFF


@pytest.mark.parametrize(
    "shape", ["long", *(pytest.param(shape, marks=pytest.mark.slow) for shape in ("bent", "hook"))]
)
def test_the_thesis_figures_can_be_drawn_of_any_frame(tube, shape, tmp_path: Path) -> None:
    steps = ClassicDetector(DARK_LEFT).steps(tube(shape, noise=5))
    for number, figure in (("17", figure_17(steps)), ("18", figure_18(steps))):
        figure.savefig(tmp_path / f"{number}.png", dpi=40)
        words = " ".join(text.get_text() for axes in figure.axes for text in axes.texts).replace("\n", " ")
        assert (steps.status.replace("_", " ") in words) == (steps.coefficients is None and number == "17")


def real_frame(number: int) -> np.ndarray:
    folder = os.environ.get("TIPFORCE_REAL_DATA")
    if not folder:
        pytest.skip("TIPFORCE_REAL_DATA names no folder with real data")
    (path,) = Path(folder, "tendon-manipulator", "frames").glob(f"{number}_*.png")
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


@pytest.mark.parametrize("number", [142, 302, 487])
def test_the_real_manipulator_is_seen_within_a_region_of_interest(number: int) -> None:
    settings = VisionSettings(method="classic", polarity="light", base_side="bottom", roi=(60, 60, 500, 300))
    shape = ClassicDetector(settings).detect(real_frame(number))
    features = shape_features(shape, ShapeFeatureSettings())
    assert shape.diameter_px == pytest.approx(19.3, abs=1.0)
    curve = fitted_curve(shape, ShapeFeatureSettings(), features)
    away = np.hypot(*(shape.fitted_px[:, None] - curve[None]).T).min(axis=0)
    assert np.median(away) < 3.0
