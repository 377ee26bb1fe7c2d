"""What is drawn can be found in the image again."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tipforce.geometry import curve_from_angle
from tipforce.types import BasePose, CentrelinePx, ForceEstimate, Status
from tipforce.vision import (
    DetectedShape,
    Inspection,
    NoFeatures,
    ShapeFeatureSettings,
    Tally,
    contact_sheet,
    draw_estimate,
    draw_shape,
    shaft_mask,
)

NAN = math.nan
GREY = np.full((480, 640), 128, np.uint8)
YELLOW, CYAN, MAGENTA, RED, GREEN = (255, 214, 0), (0, 225, 255), (255, 70, 220), (255, 60, 50), (60, 220, 80)


def seen(scale: float = 1.0, origin: tuple[float, float] = (60.0, 300.0)) -> DetectedShape:
    base = BasePose(np.array(origin) * scale, 0.0)
    points = base.to_image(curve_from_angle(np.array([0.2, 0.2]), 300.0 * scale, 64))
    return DetectedShape(Status.VALID, "", CentrelinePx(points), base, 14.0 * scale, 1.0)


def force(fx: float, fy: float, planar: bool = True) -> ForceEstimate:
    size = math.hypot(fx, fy)
    known = np.array([planar, planar, False])
    vector = np.where(known, [fx, fy, NAN], NAN)
    return ForceEstimate(
        0, vector, known, np.full((3, 3), NAN), np.full((3, 2), NAN), size, np.array([0.9 * size, 1.1 * size])
    )


def where(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """(n, 2) u, v of the pixels of nearly this colour."""
    return np.argwhere((np.abs(image.astype(int) - colour) < 40).all(axis=2))[:, ::-1]


def test_the_image_itself_is_left_alone() -> None:
    for image in (GREY.copy(), np.stack([GREY] * 3, axis=2)):
        before = image.copy()
        drawn = draw_shape(image, seen()), draw_estimate(image, seen(), force(0.1, 0.1))
        np.testing.assert_array_equal(image, before)
        assert all(d.shape == (480, 640, 3) and d.dtype == np.uint8 and not np.shares_memory(d, image) for d in drawn)


def test_the_centreline_and_the_base_frame_are_where_they_were_seen() -> None:
    shape = seen()
    image = draw_shape(GREY, shape, legend=False)
    away = np.hypot(*(where(image, YELLOW)[:, None] - shape.centreline.points[None]).T).min(axis=0)
    assert len(away) > 300
    assert away.max() < 5
    x_axis, y_axis = where(image, RED), where(image, GREEN)
    assert x_axis[:, 0].mean() > 75
    assert abs(x_axis[:, 1].mean() - 300) < 6
    assert y_axis[:, 1].mean() < 285, "y points up in the displayed image"


def test_a_hidden_part_is_dashed() -> None:
    visible = np.arange(64) < 40
    shape = replace(seen(), seen=visible)
    image = draw_shape(GREY, shape, legend=False)
    points = shape.centreline.points
    near = np.hypot(*(where(image, YELLOW)[:, None] - points[None]).T).min(axis=1) < 1.5
    assert near[15:38].all()
    assert 0.4 < near[42:60].mean() < 0.8


def test_the_mask_is_a_tube_of_the_shafts_diameter() -> None:
    mask = shaft_mask(seen(), (480, 640))
    assert mask.sum() == pytest.approx(300 * 14 + math.pi * 49, rel=0.05)
    assert not shaft_mask(DetectedShape(Status.NO_CATHETER), (480, 640)).any()
    tinted = draw_shape(GREY, seen(), legend=False)
    assert (tinted[mask][:, 2] > tinted[mask][:, 0]).mean() > 0.5


def test_the_fitted_curve_is_drawn_over_the_centreline() -> None:
    curve = seen().centreline.points - [0, 40]
    image = draw_shape(GREY, seen(), curve_px=curve, legend=False)
    magenta = where(image, MAGENTA)
    assert len(magenta) > 100
    assert np.hypot(*(magenta[:, None] - curve[None]).T).min(axis=0).max() < 5


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8), (0.6, -0.8)])
def test_the_force_arrow_points_at_the_tip_the_way_the_tissue_pushes(direction: tuple[float, float]) -> None:
    shape = seen()
    image = draw_estimate(GREY, shape, force(0.3 * direction[0], 0.3 * direction[1]))
    arrow = where(image[:400], CYAN)
    tip = shape.centreline.points[-1]
    towards_tail = arrow.mean(axis=0) - tip
    push = np.array([direction[0], -direction[1]])
    assert towards_tail @ push == pytest.approx(-np.hypot(*towards_tail), rel=0.02)
    assert np.hypot(*(arrow - tip).T).max() == pytest.approx(120, abs=12)


def test_a_longer_arrow_is_a_larger_force() -> None:
    reach = [
        np.hypot(*(where(draw_estimate(GREY, seen(), force(0, f))[:400], CYAN) - seen().centreline.points[-1]).T).max()
        for f in (0.1, 0.2, 0.3)
    ]
    assert reach[0] < reach[1] - 20 < reach[2] - 40


def test_a_magnitude_alone_has_a_value_but_no_arrow() -> None:
    image = draw_estimate(GREY, seen(), force(0.2, 0.1, planar=False))
    assert not len(where(image, CYAN))
    assert len(where(image[400:], (255, 255, 255))) > 100


@pytest.mark.parametrize("scale", [0.1, 1.0, 2.0])
def test_what_is_not_valid_shows_a_red_banner_and_no_force(scale: float) -> None:
    blank = np.full((round(480 * scale), round(640 * scale)), 128, np.uint8)
    lost = ForceEstimate.invalid(0, Status.CUT_OFF, "the catheter leaves the image at the top " * 3)
    image = draw_estimate(blank, seen(scale), lost)
    red = where(image, (182, 38, 38))
    assert len(red) > 0.3 * image.shape[1] * red[:, 1].max()
    assert red[:, 1].max() < 0.5 * image.shape[0]
    assert not len(where(image, CYAN))


def test_small_images_are_enlarged_so_that_letters_can_be_read() -> None:
    small = np.full((64, 64), 128, np.uint8)
    image = draw_estimate(small, seen(0.1), force(0.1, 0.2))
    assert image.shape == (448, 448, 3)
    tip = (seen(0.1).centreline.points[-1] + 0.5) * 7 - 0.5
    arrow = where(image[:360], CYAN)
    assert np.hypot(*(arrow - tip).T).min() < 14


def test_a_contact_sheet_holds_every_image() -> None:
    colours = [(250, 0, 0), (0, 250, 0), (0, 0, 250)]
    images = [np.full((48 + 10 * k, 64, 3), c, np.uint8) for k, c in enumerate(colours)]
    sheet = contact_sheet(images, 2, ["one", "two °", "three"], 160)
    assert all(len(where(sheet, c)) > 4000 for c in colours)
    assert where(sheet, colours[2])[:, 1].min() > where(sheet, colours[0])[:, 1].max()


def test_a_contact_sheet_of_a_long_video_samples_it_evenly_and_keeps_room_for_what_was_not_found() -> None:
    tally = Tally(6)
    settings = ShapeFeatureSettings()
    lost = DetectedShape(Status.CUT_OFF, "lost")
    for k in range(1000):
        shown = lost if 500 <= k < 510 else seen()
        features = NoFeatures(shown.status, shown.detail) if shown is lost else np.zeros(5)
        tally.add(f"{k}", Inspection(shown, features, settings, np.stack([GREY] * 3, axis=2)))
    kept = [entry[1].split() for entry in [*tally._found.best(4), *tally._lost.best(2)]]
    frames = [int(number) for number, status in kept if status == "valid"]
    assert len(frames) == 4
    assert np.diff(frames).min() > 200
    assert [status for _, status in kept].count("cut_off") == 2
    assert tally.share_found == 0.99
    assert tally.contact_sheet().shape[0] == 2 * (240 + 22 + 4) + 4
    assert "found in 990 of 1000 frames" in tally.text()
    assert "10 frames cut_off: lost" in tally.text()
