"""The rough points of the locator: one course through the peaks, read in a window around the base."""

import numpy as np
import pytest

from tipforce.types import FloatArray
from tipforce.vision.locator import Prompts
from tipforce.vision.locator._peaks import STRIDE, course, peaks_at, shares_of

POINTS, ROWS, COLUMNS = 16, 40, 120


def _maps(*objects: tuple[float, float, FloatArray]) -> FloatArray:
    """Returns probabilities (k, h, w) with a peak for each (row, share of each point, columns (k,)) of ``objects``."""
    shares = np.zeros((POINTS, ROWS, COLUMNS))
    for row, share, columns in objects:
        for k, column in enumerate(columns):
            shares[k, int(row), int(column)] = share
    return shares


def test_the_points_stay_on_one_object_where_another_one_is_surer_in_some_maps():
    own = np.linspace(10.0, 40.0, POINTS)
    maps = _maps((20.0, 0.3, own))
    maps[5:9, 20, 100] = 0.5  # another object, far away, is surer of four points
    points, mass = course(maps)
    assert points[:, 0] == pytest.approx((np.rint(own - 0.5) + 0.5) * STRIDE - 0.5, abs=STRIDE)
    assert mass == pytest.approx(np.full(POINTS, 0.3))


def test_the_points_are_on_the_object_that_is_surer_along_its_whole_length():
    maps = _maps((10.0, 0.2, np.linspace(10.0, 40.0, POINTS)), (30.0, 0.6, np.linspace(70.0, 100.0, POINTS)))
    points, mass = course(maps)
    assert points[:, 1] == pytest.approx(30.5 * STRIDE - 0.5)
    assert mass == pytest.approx(np.full(POINTS, 0.6))


def test_a_peak_between_cells_is_found_between_them():
    shares = np.zeros((2, ROWS, COLUMNS))
    shares[1, 7, 30] = shares[1, 7, 31] = 0.4
    shares[0, 0, COLUMNS - 1] = 0.6
    points, mass = peaks_at(shares, np.array([1, 0]), np.array([7, 0]), np.array([30, COLUMNS - 1]))
    assert points[0] == pytest.approx([31.0 * STRIDE - 0.5, 7.5 * STRIDE - 0.5])
    assert points[1] == pytest.approx([(COLUMNS - 0.5) * STRIDE - 0.5, 0.5 * STRIDE - 0.5])
    assert mass == pytest.approx([0.8, 0.6])


def test_the_shares_of_a_map_without_evidence_are_small():
    assert shares_of(np.full((1, ROWS, COLUMNS), -20.0)).sum() < 1e-4
    assert shares_of(np.full((1, ROWS, COLUMNS), 20.0)).sum() == pytest.approx(1.0)


def test_the_image_is_read_around_the_base_as_far_as_the_length_reaches():
    base = np.array([300.0, 200.0])
    assert Prompts(base_px=base).window(480, 640) == (0, 0, 640, 480)
    assert Prompts(length_px=50.0).window(480, 640) == (0, 0, 640, 480)
    for given in (Prompts(base_px=base, length_px=100.0), Prompts(near_px=base, length_px=100.0)):
        assert given.window(480, 640) == (170, 70, 430, 330)
    assert Prompts(base_px=np.array([900.0, 200.0]), length_px=100.0).window(480, 640) == (0, 0, 640, 480)
    assert Prompts(region=(10, 20, 30, 40), length_px=100.0).window(480, 640) == (0, 0, 160, 170)


def test_prompts_move_into_the_window():
    given = Prompts(base_px=np.array([300.0, 20.0]), region=(290, 10, 310, 30), border="top", length_px=100.0)
    window = given.window(480, 640)
    moved = given.inside(window, 480, 640)
    assert moved.base_px == pytest.approx([300.0 - window[0], 20.0 - window[1]])
    assert moved.region == (290 - window[0], 10 - window[1], 310 - window[0], 30 - window[1])
    assert moved.border == "top"
    far = Prompts(base_px=np.array([300.0, 240.0]), border="top", length_px=100.0)
    assert far.inside(far.window(480, 640), 480, 640).border is None  # the window does not reach this border
