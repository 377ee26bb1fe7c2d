"""From light to a file: a sensor with a mosaic of colours and its noise, interpolation, sharpening, maybe grey.

Interpolation spreads each photosite's noise over its neighbours and couples the colours; sharpening lifts it again. So
the noise of neighbouring pixels is correlated, as in the files of real cameras.
"""

import cv2
import numpy as np
import numpy.typing as npt

from ....types import Image
from ._scene import SensorNoise, SensorPipeline
from ._sensor_noise import add_noise

FloatImage = npt.NDArray[np.float32]


def develop(
    clean: FloatImage, pipeline: SensorPipeline, noise: SensorNoise, key: npt.NDArray[np.uint32], table: FloatImage
) -> Image:
    """Makes the image that a camera with this pipeline saves.

    Args:
        clean: (3, h, w) RGB or (1, h, w) grey light before noise, grey levels.
        pipeline: mosaic, sharpening and conversion to grey.
        noise: noise of the sensor.
        key: (3,) key of the frame, see `frame_key`.
        table: `gauss_table`.

    Returns:
        (h, w, 3) RGB or (h, w) grey image.
    """
    mosaic = pipeline.mosaic and len(clean) == 3
    light = _mosaic(clean) if mosaic else clean
    sites = np.empty(light.shape, np.uint8)
    add_noise(light, key, table, noise.grey_per_electron, noise.read_grey, sites)
    if mosaic:
        image = cv2.cvtColor(sites[0], cv2.COLOR_BayerBG2RGB)  # OpenCV names the pattern by its second row: RGGB
    else:
        image = sites[0] if len(sites) == 1 else cv2.merge(list(sites))
    if pipeline.grey and image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if pipeline.sharpen > 0.0:
        soft = cv2.GaussianBlur(image, (0, 0), pipeline.sharpen_px)
        image = cv2.addWeighted(image, 1.0 + pipeline.sharpen, soft, -pipeline.sharpen, 0.0)
    return np.asarray(image, np.uint8)


def _mosaic(clean: FloatImage) -> FloatImage:
    """Returns (1, h, w): the one colour of each pixel that its photosite detects: red, green / green, blue."""
    sites = clean[1].copy()
    sites[0::2, 0::2] = clean[0, 0::2, 0::2]
    sites[1::2, 1::2] = clean[2, 1::2, 1::2]
    return sites[None]
