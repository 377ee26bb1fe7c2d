"""From an image of any size to the network's: every pixel counts by the area it covers."""

import cv2
import numpy as np
import pytest

from tipforce.estimators.networks._image_input import RESNET_SIZE_PX, resize_to_resnet


@pytest.mark.parametrize("shape", [(480, 640), (1024, 1280), (224, 224), (225, 2000), (448, 672)])
@pytest.mark.parametrize("colour", [False, True])
def test_it_is_the_mean_over_the_area_that_a_pixel_covers(shape: tuple[int, int], colour: bool) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*shape, 3) if colour else shape, dtype=np.uint8)
    found = resize_to_resnet(image)
    wanted = cv2.resize(image.astype(np.float64), (RESNET_SIZE_PX, RESNET_SIZE_PX), interpolation=cv2.INTER_AREA)
    wanted = wanted if colour else np.repeat(wanted[:, :, None], 3, axis=2)
    assert found.shape == (RESNET_SIZE_PX, RESNET_SIZE_PX, 3)
    assert np.max(np.abs(found - wanted)) < 0.51


@pytest.mark.parametrize("level", [0, 1, 254, 255])
def test_an_even_image_stays_as_it_is(level: int) -> None:
    assert np.all(resize_to_resnet(np.full((481, 641), level, np.uint8)) == level)


def test_views_need_no_copy() -> None:
    image = np.random.default_rng(0).integers(0, 256, (500, 700, 3), dtype=np.uint8)
    for view in (image[::-1, ::-1], image[10:490, 30:600], image[:, :, 1], image.transpose(1, 0, 2)):
        assert np.array_equal(resize_to_resnet(view), resize_to_resnet(np.ascontiguousarray(view)))


def test_small_images_are_enlarged() -> None:
    image = np.tile(np.arange(100, dtype=np.uint8), (80, 1))
    found = resize_to_resnet(image)
    assert found.shape == (RESNET_SIZE_PX, RESNET_SIZE_PX, 3)
    assert np.all(np.diff(found[:, :, 0].astype(int), axis=1) >= 0)
