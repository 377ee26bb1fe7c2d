"""Perturbed images: what is drawn, what the force is then, and that nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest

from tipforce.datasets import PERTURBATIONS, Blur, Dataset, Disc, Light, Noise, Perturbation, Warp, in_memory, perturbed
from tipforce.errors import InputError
from tipforce.types import Observation, SessionInfo, ShapeFeatures

SEED = (0, 0)


class Images:
    """A store that counts what is read."""

    def __init__(self, views):
        self.views, self.reads = views, 0

    def read(self, rows):
        for row in rows.tolist():
            self.reads += 1
            yield Observation(row, {"camera": self.views[row]}, {"knob_deg": 10.0})


def dataset_of(views, force_n=(0.2, 0.1, np.nan)):
    count = len(views)
    return Dataset(
        store=Images(views),
        session=np.full(count, "s"),
        stamp_ns=np.arange(count),
        actuation={},
        force_n=np.tile(force_n, (count, 1)),
        known=np.isfinite(force_n),
        names=np.array([f"{i}.png" for i in range(count)]),
        session_info={"s": SessionInfo("s")},
        rows=np.arange(count),
        title="images",
    )


def spot(u, v, size=(61, 81)):
    image = np.zeros(size, np.uint8)
    image[v - 1 : v + 2, u - 1 : u + 2] = 200
    return image


def middle(image):
    v, u = np.nonzero(image > 100)
    return u.mean(), v.mean()


def test_a_shift_moves_what_is_seen():
    assert middle(Warp(right_px=10, down_px=-5)(spot(40, 30), SEED)) == (50, 25)


def test_a_turn_is_counter_clockwise_as_shown_about_the_middle():
    assert middle(Warp(turn_deg=90)(spot(50, 30), SEED)) == (40, 20)
    assert middle(Warp(turn_deg=-90)(spot(50, 30), SEED)) == (40, 40)


def test_a_force_turned_along_goes_the_way_of_the_image():
    shown = np.array([10.0, 0.0, 0.0])  # the spot lies to the right of the middle; y is up
    turned = Perturbation("turn", "", Warp(turn_deg=90), force_turn_deg=90).force(shown[None])[0]
    u, v = middle(Warp(turn_deg=90)(spot(50, 30), SEED))
    assert turned == pytest.approx([u - 40, 30 - v, 0])


def test_a_zoom_enlarges_about_the_middle():
    assert middle(Warp(zoom=2.0)(spot(45, 30), SEED)) == (50, 30)


def test_borders_are_filled_with_their_outermost_pixels():
    image = np.tile(np.arange(81, dtype=np.uint8), (61, 1))
    assert Warp(right_px=20)(image, SEED)[30].tolist() == [0] * 20 + list(range(61))


@pytest.mark.parametrize("shape", [(40, 60), (40, 60, 3)])
def test_light_scales_grey_levels_and_saturates(shape):
    image = np.full(shape, 100, np.uint8)
    assert (Light(1.4)(image, SEED) == 140).all()
    assert (Light(4.0)(image, SEED) == 255).all()
    slope = Light(slope=0.4)(image, SEED)
    assert slope[0, 0].min() == 60
    assert slope[0, -1].max() == 140
    assert Blur(2.0)(image, SEED).shape == shape


def test_noise_has_its_sigma_and_is_the_same_for_the_same_seed():
    image = np.full((200, 200), 128, np.uint8)
    first = Noise(10.0)(image, (3, 7))
    assert first.astype(float).std() == pytest.approx(10, rel=0.02)
    assert (first == Noise(10.0)(image, (3, 7))).all()
    assert (first != Noise(10.0)(image, (3, 8))).mean() > 0.9


@pytest.mark.parametrize("shape", [(200, 300), (200, 300, 3)])
def test_an_object_has_its_size_and_lies_elsewhere_in_each_image(shape):
    image = np.full(shape, 128, np.uint8)
    places = []
    for row in range(20):
        changed = Disc(0.2)(image, (0, row)) != image
        v, u = np.nonzero(changed if image.ndim == 2 else changed.any(axis=2))
        assert 0.2 * np.pi * 20**2 < len(v) < 1.15 * np.pi * 20**2  # it may be cut by the border
        places.append((u.mean(), v.mean()))
    assert np.ptp(places, axis=0).min() > 80
    assert (image == 128).all()


def test_a_perturbed_dataset_leaves_the_one_it_came_from_alone():
    views = [spot(20 + i, 30) for i in range(4)]
    data = dataset_of(views)
    before = data.derive("middle", lambda seen: middle(seen.views["camera"]))
    shifted = perturbed(data, Perturbation("shift", "10 px", Warp(right_px=10)))
    after = shifted.derive("middle", lambda seen: middle(seen.views["camera"]))
    assert after == [(u + 10, v) for u, v in before]
    assert data.derive("middle", lambda seen: None) == before
    assert next(shifted.observations()).actuation == {"knob_deg": 10.0}
    np.testing.assert_array_equal(shifted.force_n, data.force_n)
    quarter = perturbed(data, Perturbation("turn", "", Warp(turn_deg=90), force_turn_deg=90.0))
    assert quarter.force_n[0, :2] == pytest.approx([-0.1, 0.2])
    assert quarter.magnitude_n == pytest.approx(data.magnitude_n)


def test_held_samples_are_read_once():
    data = dataset_of([spot(20 + i, 30) for i in range(6)])
    kept = in_memory(data.subset(np.array([1, 4])))
    for _ in range(3):
        assert [seen.stamp_ns for seen in kept.observations()] == [1, 4]
    assert data.store.reads == 2


def test_shape_numbers_cannot_be_perturbed():
    data = perturbed(dataset_of([ShapeFeatures(("A1",), np.ones(1))]), PERTURBATIONS[0])
    with pytest.raises(InputError, match="only images can be perturbed"):
        list(data.observations())

    kinds = {}
    for each in PERTURBATIONS:
        kinds.setdefault(each.kind, set()).add(each.size)
    assert {kind: len(sizes) for kind, sizes in kinds.items()} == {
        "shift": 3, "turn": 3, "turn, force turned along": 3, "zoom": 3, "light": 3, "blur": 3, "noise": 3,
        "object": 3,
    }  # fmt: skip
    assert len(set(PERTURBATIONS)) == len(PERTURBATIONS)
    assert len({replace(each, kind="", way="", size="") for each in PERTURBATIONS}) == len(PERTURBATIONS)
