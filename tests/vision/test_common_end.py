"""Where several pictures together say that a catheter ends, whatever lies beneath it in each of them."""

import cv2
import numpy as np
import pytest

from tipforce.types import Catheter, Context
from tipforce.vision import FineTracer, VisionSettings, settle

LENGTH = 150.0
SHEET = Context("monday", Catheter("test tube", 0.012, 0.156, 0.0), 1e-3, {"base_side": "left"})


def _picture(turn: float, rail: float) -> np.ndarray:
    """A straight shaft from the left border, its metal end little darker than the ground; a dark rail lies behind it.

    ``rail``: how far behind the end the rail begins. The rail is darker than the metal end, so its border stands out
    more than the end itself.
    """
    rng = np.random.default_rng(round(1e4 * (turn + 1.0)))
    scale = 4
    image = np.full((200 * scale, 260 * scale), 170.0)
    base, way = np.array([-6.0, 100.0]), np.array([np.cos(turn), np.sin(turn)])
    tip = base + (LENGTH - 6.0 + 6.0 / np.cos(turn)) * way  # the round end reaches a radius further

    def bar(first: np.ndarray, last: np.ndarray, width: float, grey: float) -> None:
        ends = [np.rint((p + 0.5) * scale).astype(int).tolist() for p in (first, last)]
        cv2.line(image, ends[0], ends[1], grey, round(width * scale), cv2.LINE_8)

    aside = np.array([-way[1], way[0]])
    middle = tip + (rail + 12.0) * way
    bar(middle - 60 * aside, middle + 60 * aside, 12.0, 60.0)
    bar(base, tip - 30 * way, 12.0, 60.0)
    bar(tip - 30 * way, tip, 12.0, 120.0)
    small = cv2.GaussianBlur(cv2.resize(image, (260, 200), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    return np.clip(np.rint(small + rng.normal(0.0, 2.0, small.shape)), 0, 255).astype(np.uint8)


def test_an_edge_that_lies_elsewhere_in_every_picture_is_not_taken_for_the_end() -> None:
    rails = (2.0, 5.0, 8.0, 11.0, 3.5, 6.5, 14.0, 9.5)
    pictures = [_picture(0.05 * k - 0.2, rail) for k, rail in enumerate(rails)]
    settled = settle(VisionSettings(), pictures, SHEET)
    assert settled.length_px == pytest.approx(LENGTH, abs=1.5)
    assert settled.length_tolerance < 0.03
    for picture in pictures:
        seen = FineTracer(settled).see(picture).centreline
        assert seen is not None
        assert np.hypot(*np.diff(seen.points, axis=0).T).sum() == pytest.approx(LENGTH, abs=3.0)
