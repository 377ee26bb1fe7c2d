"""Rough points of the first network: one object's in all points, and the size of the image at which they are read."""

from types import SimpleNamespace

import numpy as np
import pytest

from tipforce.vision.locator import Prompts, RoughPoints, read_points, rough_line
from tipforce.vision.locator import _locate as locate_module
from tipforce.vision.locator import _networks as networks
from tipforce.vision.locator._networks import POINTS, STRIDE, rough_points
from tipforce.vision.locator._session import _length, _likely_bases

CELLS = 40
BLANK = np.full((CELLS * STRIDE, CELLS * STRIDE, 3), 127, np.uint8)
ROWS = np.arange(POINTS) + 10


def heat(*columns_of_peaks: tuple[int, np.ndarray]) -> np.ndarray:
    """Returns heat maps (1, POINTS, CELLS, CELLS) of vertical objects: column and logits of the points."""
    maps = np.full((1, POINTS, CELLS, CELLS), -4.0, np.float32)
    for column, logits in columns_of_peaks:
        maps[0, np.arange(POINTS), ROWS, column] = logits
    return maps


@pytest.fixture
def two_alike(monkeypatch: pytest.MonkeyPatch) -> tuple[int, int]:
    """Two objects look alike: the peaks of most points are higher on one, those of six points on the other."""
    one, other = np.full(POINTS, 8.0), np.full(POINTS, 7.0)
    other[5:11] = 9.0
    outputs = heat((8, one), (30, other)), np.zeros((1, POINTS, 3), np.float32), np.zeros(1, np.float32)
    monkeypatch.setattr(networks, "_graph", lambda *_: SimpleNamespace(run=lambda *_: outputs))
    return 8, 30


def columns(points: np.ndarray) -> np.ndarray:
    return (points[:, 0] + 0.5) / STRIDE - 0.5


def test_all_points_are_on_one_of_two_objects_that_look_alike(two_alike) -> None:
    first, _ = two_alike
    found = rough_points(BLANK, Prompts())
    np.testing.assert_allclose(columns(found.points), first, atol=0.1)
    assert (found.mass[5:11] < 0.5).all()


def test_all_points_are_on_the_object_whose_base_is_marked(two_alike) -> None:
    _, second = two_alike
    u, v = second * STRIDE, int(ROWS[0]) * STRIDE
    found = rough_points(BLANK, Prompts(region=(u - 8, v - 8, u + 8, v + 8)))
    np.testing.assert_allclose(columns(found.points), second, atol=0.1)


def reading(points: np.ndarray, mass: float = 0.8, present: float = 1.0) -> RoughPoints:
    each = np.full(POINTS, mass)
    return RoughPoints(points, each, np.ones((POINTS, 3)) / 3.0, present, points[0], 0.0, 1.0)


def straight(base: tuple[float, float], tip: tuple[float, float]) -> np.ndarray:
    return np.linspace(base, tip, POINTS)


def test_a_few_points_far_away_do_not_bend_the_line() -> None:
    points = straight((100.0, 100.0), (100.0, 160.0))
    points[[4, 9]] = (430.0, 120.0)
    off = np.abs(rough_line(reading(points, 0.5))[:, 0] - 100.0)
    assert off.max() < 3.0


def test_the_reading_counts_that_its_repetition_confirms(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the coarse sizes a tube looks like one catheter with its catheter; at the size of its length it does not."""
    whole, catheter = straight((300.0, 20.0), (300.0, 260.0)), straight((300.0, 200.0), (300.0, 260.0))

    def read(image: np.ndarray, _prompts: Prompts, scale: float, _network: object) -> RoughPoints:
        side = scale * image.shape[1]
        if side < 250.0:
            return reading(whole, 0.7)
        return reading(catheter, 0.5) if side > 450.0 else reading(straight((30.0, 60.0), (500.0, 90.0)), 0.1)

    monkeypatch.setattr(locate_module, "_read_at", read)
    found = read_points(np.zeros((480, 640, 3), np.uint8), Prompts())
    np.testing.assert_allclose(found.points[[0, -1]], catheter[[0, -1]])


def test_the_base_of_the_surest_reading_is_tried() -> None:
    """The lines at the size of the measured length begin elsewhere, but are unsure."""
    line = SimpleNamespace(
        points=straight((300.0, 150.0), (300.0, 260.0)), sureness=0.2, other_base_px=np.array([9.0, 9.0]),
        other_base_mass=0.05,
    )  # fmt: skip
    sure = reading(straight((300.0, 200.0), (300.0, 260.0)))
    np.testing.assert_allclose(_likely_bases([line], [sure], 6.0, None)[0], (300.0, 200.0))  # type: ignore[list-item]


def test_a_length_is_unsure_where_nothing_states_it_and_no_image_shows_the_tip() -> None:
    hidden = SimpleNamespace(
        points=straight((300.0, 200.0), (300.0, 260.0)), length_px=60.0, tip_seen=0.2, tip_peak=0.9
    )
    length, error = _length([hidden, hidden], np.array([300.0, 200.0]), None)  # type: ignore[list-item]
    assert length == pytest.approx(60.0)
    assert error > 10.0
