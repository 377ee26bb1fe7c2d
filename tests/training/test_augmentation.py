"""Data augmentation: the labels follow the image, and what is not asked for stays."""

import math

import cv2
import numpy as np
import pytest

from tipforce.training._augmentation import CURVATURE, Augmentation, _large_transform, augment_image
from tipforce.training._compact import CompactTask

NOTHING = dict.fromkeys(Augmentation.model_fields, 0.0)
SIZE, WIDE = 160, 208


def needle(angle: float) -> np.ndarray:
    """A bright line from the base at ``angle`` in the base frame (y up), in the middle of the left border."""
    image = np.zeros((WIDE, WIDE), np.uint8)
    margin = (WIDE - SIZE) // 2
    base = np.array([margin - 0.5, margin + 0.5 * SIZE - 0.5])
    end = base + 70.0 * np.array([math.cos(angle), -math.sin(angle)])
    ends = [tuple(np.rint(16 * point).astype(int).tolist()) for point in (base, end)]
    cv2.line(image, *ends, 255, 3, cv2.LINE_AA, 4)
    return image


def angle_seen(image: np.ndarray) -> float:
    v, u = np.nonzero(image > 100)
    far = u > 40
    slope = np.polyfit(u[far], v[far], 1)[0]
    return math.atan(-slope)


def task(**changes: float) -> CompactTask:
    return CompactTask(3, 4, SIZE, augmentation=Augmentation(**{**NOTHING, **changes}))


def test_the_base_frame_turns_with_the_image():
    angles = []
    for seed in range(6):
        force, draw = np.array([0.1, 0.05, 0.03], np.float32), np.random.default_rng(seed)
        out = augment_image(needle(0.2), None, force, np.zeros(4, np.float32), task(turn_deg=15.0), draw).image
        angles.append(angle_seen(out))
        assert np.array_equal(force, np.array([0.1, 0.05, 0.03], np.float32))
    assert np.ptp(angles) > math.radians(10.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_force_flips_with_the_image(seed):
    angle, changes = 0.2, {"mirror": 0.5}
    force = np.array([0.1 * math.cos(angle), 0.1 * math.sin(angle), 0.03], np.float32)
    metadata = np.array([0.1, 0.2, 0.3, 0.4], np.float32)
    out = augment_image(needle(angle), None, force, metadata, task(**changes), np.random.default_rng(seed)).image
    assert math.atan2(force[1], force[0]) == pytest.approx(angle_seen(out), abs=0.02)
    assert math.hypot(force[0], force[1]) == pytest.approx(0.1, rel=1e-5)
    assert force[2] == np.float32(0.03)
    assert metadata[CURVATURE] == np.float32(0.4 * np.sign(force[1]))


def test_nothing_asked_for_changes_nothing():
    image = np.random.default_rng(0).integers(0, 256, (WIDE, WIDE), np.uint8)
    force, metadata = np.ones(3, np.float32), np.ones(4, np.float32)
    out = augment_image(image, None, force, metadata, task(), np.random.default_rng(0)).image
    assert np.array_equal(out, image[24:184, 24:184])
    assert (force == 1).all()
    assert (metadata == 1).all()


def test_the_map_goes_where_the_image_goes():
    image = needle(0.1)
    heatmap = cv2.resize(image, (WIDE // 4, WIDE // 4), interpolation=cv2.INTER_AREA)
    changes = {"turn_deg": 10.0, "shift": 0.1, "mirror": 0.5, "zoom": 0.1}
    for seed in range(6):
        draw = np.random.default_rng(seed)
        found = augment_image(image, heatmap, np.zeros(3, np.float32), np.zeros(4, np.float32), task(**changes), draw)
        small = cv2.resize(found.image, (SIZE // 4, SIZE // 4), interpolation=cv2.INTER_AREA).astype(float)
        assert np.abs(small - found.heatmap).mean() < 3.0


def test_forces_of_another_frame_stay_as_they_are():
    force = np.array([0.1, 0.2, 0.3], np.float32)
    free = CompactTask(3, 4, SIZE, planar=None, augmentation=Augmentation(mirror=1.0))
    augment_image(needle(0.0), None, force, np.zeros(4, np.float32), free, np.random.default_rng(1))
    assert np.allclose(force, [0.1, 0.2, 0.3])


def test_other_actuation_keeps_images_out_of_the_mirror():
    force = np.array([0.1, 0.05, 0.0], np.float32)
    wired = CompactTask(3, 4, SIZE, augmentation=Augmentation(**{**NOTHING, "mirror": 1.0}), actuation=((0.0, 1.0),))
    out = augment_image(needle(0.2), None, force, np.ones(4, np.float32), wired, np.random.default_rng(0)).image
    assert np.array_equal(out, needle(0.2)[24:184, 24:184])
    assert force[1] == np.float32(0.05)


def test_a_share_is_moved_too_far_to_be_answered():
    in_distribution, changed = [], []
    for seed in range(300):
        draw = np.random.default_rng(seed)
        nothing = np.zeros(3, np.float32), np.zeros(4, np.float32)
        out = augment_image(needle(0.0), needle(0.0)[::4, ::4], *nothing, task(out_of_distribution=0.5), draw)
        in_distribution.append(out.in_distribution)
        changed.append(np.abs(out.image.astype(float) - needle(0.0)[24:184, 24:184]).mean())
    assert 0.4 < np.mean(in_distribution) < 0.6
    in_distribution, changed = np.array(in_distribution), np.array(changed)
    assert (changed[in_distribution] == 0.0).all()
    assert (changed[~in_distribution] > 0.5).mean() > 0.9  # a straight needle may be shifted along itself


@pytest.mark.parametrize("usual", [{}, {"turn_deg": 60.0, "zoom": 0.2, "shift": 0.3}])
def test_out_of_distribution_changes_are_larger_than_usual_ones(usual):
    how = Augmentation(**usual)
    size, kinds = 100, [0, 0, 0]
    for seed in range(300):
        angle, zoom, shift = _large_transform(how, size, np.random.default_rng(seed))
        turned = abs(math.degrees(angle)) >= max(12.0, min(180.0, 1.5 * how.turn_deg)) - 1e-9
        zoomed = abs(math.log(zoom)) >= max(0.15, 1.5 * how.zoom)
        shifted = np.hypot(*shift) >= size * max(0.12, 1.5 * how.shift)
        assert turned or zoomed or shifted
        kinds = [count + more for count, more in zip(kinds, (turned, zoomed, shifted), strict=True)]
    assert min(kinds) > 60
