"""Images without a catheter: every kind is drawn, has none, and can sway as in a session."""

import numpy as np
import pytest

pytest.importorskip("torch")

from bench.locator import empty
from bench.locator.tubes import Drawer

from tipforce.training.locator import CATHETER, WINDOW_FIELDS, WINDOW_PX, window

SIDE = WINDOW_PX


@pytest.fixture(scope="module")
def drawer() -> Drawer:
    return Drawer(SIDE, SIDE)


@pytest.mark.parametrize("kind", list(empty.KINDS))
def test_each_kind_is_an_image_without_a_catheter_that_the_locator_can_learn_from(kind: str, drawer: Drawer):
    scene = empty.draw(kind, np.random.default_rng(1), drawer, SIDE)
    assert scene.image.shape == (SIDE, SIDE, 3)
    assert not scene.present
    assert not (scene.kind == CATHETER).any()
    assert scene.image.std() > 2.0
    drawn = window(scene, np.random.default_rng(2))
    assert drawn.facts[0] == 0.0
    assert all(getattr(drawn, name) is not None for name in WINDOW_FIELDS)


@pytest.mark.parametrize("kind", ["cable", "hand", "ruler", "empty tube", "pen", "X-ray leads"])
def test_the_same_random_numbers_draw_the_same_scene_and_sway_moves_its_objects(kind: str, drawer: Drawer):
    def image(sway: float) -> np.ndarray:
        return empty.draw(kind, np.random.default_rng(5), drawer, SIDE, (sway, 0.0)).image.astype(int)

    assert (image(0.0) == image(0.0)).all()
    changed = np.abs(image(0.0) - image(4.0)).max(axis=2) > 20
    assert 0.0 < changed.mean() < 0.5
