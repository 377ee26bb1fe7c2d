"""The window that `compact` looks at: it follows the session's metadata, and a turned bench shows the same."""

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.estimators.networks._image_input import catheter_window, crop_window, enlarged
from tipforce.types import Catheter, SessionInfo, ViewInfo

CATHETER = Catheter("7F", 2.33e-3, 40e-3, 8e-3, 4.3e-4)


def bench(metres_per_px: float | None = 0.2e-3) -> SessionInfo:
    return SessionInfo("day 1", CATHETER, {"camera": ViewInfo(metres_per_px)})


def random_image(channels: int | None = None) -> np.ndarray:
    shape = (480, 640) if channels is None else (480, 640, channels)
    rough = np.random.default_rng(0).integers(0, 256, (60, 80), np.uint8)
    smooth = np.kron(rough, np.ones((8, 8), np.uint8))
    return smooth if channels is None else np.repeat(smooth[:, :, None], channels, axis=2).reshape(shape)


@pytest.mark.parametrize(("side", "turns"), [("left", 0), ("top", 1), ("right", 2), ("bottom", 3)])
def test_a_turned_bench_shows_the_same_cut(side, turns):
    upright = random_image()
    turned = np.ascontiguousarray(np.rot90(upright, -turns))
    as_it_is = crop_window(upright, catheter_window(bench(), "camera", upright.shape, "left"), 160)
    assert np.array_equal(as_it_is, crop_window(turned, catheter_window(bench(), "camera", turned.shape, side), 160))


def test_the_window_follows_length_and_scale():
    near = catheter_window(bench(0.1e-3), "camera", (480, 640), "left")
    far = catheter_window(bench(0.2e-3), "camera", (480, 640), "left")
    assert near.size_px == pytest.approx(2 * far.size_px) == pytest.approx(1.35 * 48e-3 / 0.1e-3)


def test_a_spot_shows_where_the_window_says():
    image = np.zeros((480, 640), np.uint8)
    image[300:304, 420:424] = 255  # the base at the bottom, in its middle: ahead is up, to the left is left
    window = catheter_window(bench(), "camera", image.shape, "bottom")
    v, u = np.unravel_index(int(crop_window(image, window, 160).argmax()), (160, 160))
    pixel = window.size_px / 160
    assert (u + 0.5) * pixel == pytest.approx(479.5 - 301.5, abs=pixel)
    assert (v + 0.5) * pixel - window.size_px / 2 == pytest.approx(421.5 - 319.5, abs=pixel)


def test_grey_and_colour_agree_and_areas_are_averaged():
    window = catheter_window(bench(), "camera", (480, 640), "left")
    assert np.array_equal(crop_window(random_image(), window, 160), crop_window(random_image(3), window, 160))
    assert abs(float(crop_window(random_image(), window, 32).mean()) - float(random_image()[78:402, :324].mean())) < 1.0


def test_beyond_the_border_the_border_goes_on():
    flat = np.full((480, 640), 77, np.uint8)
    wide = enlarged(catheter_window(bench(), "camera", flat.shape, "left"), 1.3)
    assert (crop_window(flat, wide, 208) == 77).all()


def test_the_middle_of_a_wider_cut_is_the_cut():
    image, window = random_image(), catheter_window(bench(), "camera", (480, 640), "left")
    wide = crop_window(image, enlarged(window, 1.3), 208)
    assert np.abs(wide[24:184, 24:184].astype(int) - crop_window(image, window, 160)).max() <= 1


def test_without_session_metadata_it_is_the_whole_image():
    window = catheter_window(SessionInfo(), "camera", (64, 64), None)
    assert window.size_px == 64
    assert np.array_equal(crop_window(random_image()[:64, :64], window, 64), random_image()[:64, :64])


def test_a_scale_that_is_not_in_metres_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"0\.048 m at views\.camera\.metres_per_px = 1e-08 would be 4\.8e\+06 px long"
    ):
        catheter_window(bench(1e-8), "camera", (480, 640), "left")
