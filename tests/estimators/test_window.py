"""The window that `compact` looks at: it follows the sheet, and a turned bench shows the same."""

import numpy as np
import pytest

from tipforce.estimators.networks._window import cut, widened, window_of
from tipforce.types import Catheter, SessionInfo, ViewInfo

CATHETER = Catheter("7F", 2.33e-3, 40e-3, 8e-3, 4.3e-4)


def bench(metres_per_px: float | None = 0.2e-3) -> SessionInfo:
    return SessionInfo("day 1", CATHETER, {"camera": ViewInfo(metres_per_px)})


def picture(channels: int | None = None) -> np.ndarray:
    shape = (480, 640) if channels is None else (480, 640, channels)
    rough = np.random.default_rng(0).integers(0, 256, (60, 80), np.uint8)
    smooth = np.kron(rough, np.ones((8, 8), np.uint8))
    return smooth if channels is None else np.repeat(smooth[:, :, None], channels, axis=2).reshape(shape)


@pytest.mark.parametrize(("side", "turns"), [("left", 0), ("top", 1), ("right", 2), ("bottom", 3)])
def test_a_turned_bench_shows_the_same_cut(side, turns):
    upright = picture()
    turned = np.ascontiguousarray(np.rot90(upright, -turns))
    as_it_is = cut(upright, window_of(bench(), "camera", upright.shape, "left"), 160)
    assert np.array_equal(as_it_is, cut(turned, window_of(bench(), "camera", turned.shape, side), 160))


def test_the_window_follows_length_and_scale():
    near = window_of(bench(0.1e-3), "camera", (480, 640), "left")
    far = window_of(bench(0.2e-3), "camera", (480, 640), "left")
    assert near.size_px == pytest.approx(2 * far.size_px) == pytest.approx(1.35 * 48e-3 / 0.1e-3)


def test_a_spot_shows_where_the_window_says():
    image = np.zeros((480, 640), np.uint8)
    image[300:304, 420:424] = 255  # the base at the bottom, in its middle: ahead is up, to the left is left
    window = window_of(bench(), "camera", image.shape, "bottom")
    v, u = np.unravel_index(int(cut(image, window, 160).argmax()), (160, 160))
    pixel = window.size_px / 160
    assert (u + 0.5) * pixel == pytest.approx(479.5 - 301.5, abs=pixel)
    assert (v + 0.5) * pixel - window.size_px / 2 == pytest.approx(421.5 - 319.5, abs=pixel)


def test_grey_and_colour_agree_and_areas_are_averaged():
    window = window_of(bench(), "camera", (480, 640), "left")
    assert np.array_equal(cut(picture(), window, 160), cut(picture(3), window, 160))
    assert abs(float(cut(picture(), window, 32).mean()) - float(picture()[78:402, :324].mean())) < 1.0


def test_beyond_the_border_the_border_goes_on():
    flat = np.full((480, 640), 77, np.uint8)
    wide = widened(window_of(bench(), "camera", flat.shape, "left"), 1.3)
    assert (cut(flat, wide, 208) == 77).all()


def test_the_middle_of_a_wider_cut_is_the_cut():
    image, window = picture(), window_of(bench(), "camera", (480, 640), "left")
    wide = cut(image, widened(window, 1.3), 208)
    assert np.abs(wide[24:184, 24:184].astype(int) - cut(image, window, 160)).max() <= 1


def test_without_a_sheet_it_is_the_whole_picture():
    window = window_of(SessionInfo(), (64, 64), None)
    assert window.size_px == 64
    assert np.array_equal(cut(picture()[:64, :64], window, 64), picture()[:64, :64])
