"""Decodes the messages sensor_msgs/Image and CompressedImage."""

from typing import Any

import cv2
import numpy as np

from ...errors import FileFormatError
from ...types import Image
from .._image_size import check_pixels
from .._images import StreamDepth, decode_image

IMAGE_KINDS = ("Image", "CompressedImage")

_GREY_8, _GREY_16 = ("mono8", "8uc1"), ("mono16", "16uc1")
_CHANNELS = {"rgb8": 3, "bgr8": 3, "8uc3": 3, "rgba8": 4, "bgra8": 4, "8uc4": 4}
_TO_RGB: dict[str, int] = {
    "bgr8": cv2.COLOR_BGR2RGB,
    "8uc3": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "8uc4": cv2.COLOR_BGRA2RGB,
    # OpenCV names a pattern by its second row, ROS by its first
    "bayer_rggb8": cv2.COLOR_BayerBG2RGB,
    "bayer_bggr8": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGB2RGB,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUYV,
    "yuyv": cv2.COLOR_YUV2RGB_YUYV,
}


def image_of(content: Any, where: str, depth: StreamDepth) -> Image:
    """Decodes the image of a message.

    Args:
        content: the message.
        where: origin of the message, for errors.
        depth: bit depth of the stream, for images with more than 8 bits.

    Returns:
        (h, w) grey or (h, w, 3) RGB, uint8.

    Raises:
        FileFormatError: it is damaged or has pixels of another type.
    """
    if not hasattr(content, "encoding"):
        return decode_image(np.asarray(content.data, np.uint8).tobytes(), where, depth)
    encoding = str(content.encoding).lower()
    if encoding in _GREY_16:
        return decode_image(png_of_16_bits(content, where), where, depth)
    width, height = int(content.width), int(content.height)
    # YUV 4:2:2: two bytes a pixel, because two neighbours share their colour
    channels = 2 if encoding in ("yuv422", "uyvy", "yuv422_yuy2", "yuyv") else _CHANNELS.get(encoding, 1)
    if not (encoding in _GREY_8 or encoding == "rgb8" or encoding in _TO_RGB):
        raise FileFormatError(
            f"{where}: has pixels of the type {content.encoding!r}; expected 8 or 16 bits grey, RGB, BGR, Bayer or YUV "
            "4:2:2; choose another topic in bench.toml: bag.views"
        )
    pixels = _rows(content, width * channels, height, where)
    if encoding in _GREY_8:
        return pixels
    coloured = pixels if channels == 1 else pixels.reshape(height, width, channels)
    return coloured if encoding == "rgb8" else cv2.cvtColor(coloured, _TO_RGB[encoding])  # type: ignore[return-value]


def _rows(content: Any, width_bytes: int, height: int, where: str) -> "np.ndarray":  # type: ignore[type-arg]
    """Returns (height, width_bytes) bytes without the padding of rows. Raises FileFormatError if bytes are missing."""
    check_pixels(int(content.width), height, where)
    step, data = int(content.step), np.asarray(content.data, np.uint8).ravel()
    if step < width_bytes or len(data) < step * height or not height or not width_bytes:
        raise FileFormatError(
            f"{where}: has {len(data)} bytes, expected {height} rows of {step}, each of at least {width_bytes}; record "
            "it again"
        )
    return np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :width_bytes])


def png_of_16_bits(content: Any, where: str) -> bytes:
    """Encodes a grey image of 16 bits as PNG, so that it is read like other images with more than 8 bits.

    Args:
        content: the fields of a sensor_msgs/Image with one channel of 16 bits.
        where: the bag and the topic, for the message.

    Raises:
        FileFormatError: the image's bytes do not fit its size.
    """
    rows = _rows(content, 2 * int(content.width), int(content.height), where)
    pixels = rows.view(">u2" if content.is_bigendian else "<u2").astype(np.uint16)
    return cv2.imencode(".png", pixels)[1].tobytes()
