"""Converts a decoded frame of a video to an image: upright, with square pixels, in 8 bits of full range.

The properties of pixels that a container or codec states are applied here or refused: display matrix (rotated and
mirrored), pixel aspect ratio, bit depth, limited range of grey, two views in one image. FFmpeg converts YUV of both
ranges.
"""

import threading
from collections.abc import Callable
from fractions import Fraction
from typing import Any, cast

import av
import numpy as np
import numpy.typing as npt
from av.sidedata.sidedata import SideDataContainer, Type
from av.video.reformatter import VideoReformatter

from ...errors import FileFormatError
from ...types import Image
from .._square_pixels import square_pixels

MAX_SKEW_SHARE = 0.02
"""A display matrix rotates by quarters of a circle only: its small elements are at most this share of the others."""
_LIMITED_RANGE = 1
"""Value of ``color_range`` for grey from 16 (black) to 235 (white)."""
_SIDE_BY_SIDE, _TOP_AND_BOTTOM, _LAST_ARRANGEMENT = 1, 2, 7
"""FFmpeg's ``AVStereo3DType``: arrangements of two views in one image; 0 is one view, 8 is unspecified."""
_HALVES = {
    _SIDE_BY_SIDE: ("side by side", "crop=iw/2:ih:0:0"),
    _TOP_AND_BOTTOM: ("one above the other", "crop=iw:ih/2:0:0"),
}


def shown_image(
    decoded: av.VideoFrame, stream: av.VideoStream, where: str, bits_in_use: Callable[[], int],
    change_stored: Callable[[Image], Image] = lambda image: image,
) -> Image:  # fmt: skip
    """Returns a frame as a player shows it: (h, w) grey where its pixels are grey, else (h, w, 3) RGB, 8 bits.

    Args:
        decoded: the frame.
        stream: the stream of the frame, which states the shape of its pixels.
        where: the file or address, for messages.
        bits_in_use: called for pixels of 16 bits that may hold fewer; returns how many bits are in use.
        change_stored: called with the stored image, before it is rotated or stretched; returns the image to use.

    Raises:
        FileFormatError: the frame states a property of its pixels that is not supported.
    """
    _check_one_view(decoded, where)
    levels = levels_of(decoded, where)
    if levels.dtype == np.uint16:  # the upper 8 of the bits in use remain
        levels >>= (16 if _states_its_depth(decoded) else bits_in_use()) - 8
    aspect = stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio or Fraction(1)
    image = square_pixels(change_stored(levels.astype(np.uint8)), aspect, where)
    return np.ascontiguousarray(_oriented(image, decoded, where), dtype=np.uint8)


def _states_its_depth(decoded: av.VideoFrame) -> bool:
    """Returns whether the pixel format states the bits in use; 16 bits may come from a camera of 12 bits."""
    return decoded.format.components[0].bits < 16 or not (_is_grey(decoded) or decoded.format.is_rgb)


def _is_grey(decoded: av.VideoFrame) -> bool:
    return decoded.format.name.startswith("gray")


def levels_of(decoded: av.VideoFrame, where: str) -> npt.NDArray[np.uint8 | np.uint16]:
    """Returns (h, w) grey or (h, w, 3) RGB as stored: uint8, or uint16 whose upper bits are in use.

    Args:
        decoded: a frame.
        where: the file, for the message.

    Raises:
        FileFormatError: the pixels are floating-point numbers, whose black and white are not stated.
    """
    bits = decoded.format.components[0].bits
    if "f32" in decoded.format.name or "f16" in decoded.format.name:
        raise FileFormatError(
            f"{where}: holds {decoded.format.name} pixels; write it with 8 or 16 bit: "
            "ffmpeg -i VIDEO -pix_fmt gray16le -c:v ffv1 GREY.mkv"
        )
    if _is_grey(decoded):
        deep = bits > 8
        levels = np.asarray(decoded.to_ndarray(), np.uint16) << np.uint16(16 - bits) if deep else grey_of(decoded)
        return _full_range(levels) if decoded.color_range == _LIMITED_RANGE else levels
    if bits > 8 and decoded.format.is_rgb:
        return np.asarray(_converted(decoded, "rgb48le"), np.uint16)
    return np.asarray(_converted(decoded, "rgb24"), np.uint8)


def grey_of(decoded: av.VideoFrame) -> Image:
    """Returns (h, w) grey levels in 8 bits, in the range of the file."""
    return np.asarray(_converted(decoded, "gray"), np.uint8)


class _Converter(threading.local):
    """Converts frames on the thread that asks; FFmpeg by itself starts threads for each frame, which takes 1 ms."""

    def __init__(self) -> None:
        self.reformatter = VideoReformatter()


_CONVERTER = _Converter()


def _converted(decoded: av.VideoFrame, pixel_format: str) -> npt.NDArray[Any]:
    """Returns the pixels of ``decoded`` in FFmpeg's ``pixel_format``."""
    return _CONVERTER.reformatter.reformat(decoded, format=pixel_format, threads=1).to_ndarray()


def _full_range(levels: npt.NDArray[np.uint8 | np.uint16]) -> npt.NDArray[np.uint8 | np.uint16]:
    scale = np.iinfo(levels.dtype).max / 255.0
    stretched = (levels.astype(np.float32) - np.float32(16.0 * scale)) * np.float32(255.0 / 219.0)
    return np.clip(np.rint(stretched), 0.0, 255.0 * scale).astype(levels.dtype)


def _check_one_view(decoded: av.VideoFrame, where: str) -> None:
    """Raises FileFormatError where each image of the video holds two views of a stereo camera."""
    stereo = _side_data(decoded, Type.STEREO3D)  # its first integer is the arrangement
    kind = int(stereo[0]) if len(stereo) else 0
    if not 0 < kind <= _LAST_ARRANGEMENT:
        return
    how, crop = _HALVES.get(kind, ("interleaved", ""))
    remedy = (
        f"cut one out: ffmpeg -i VIDEO -vf {crop} -crf 10 VIEW.mp4" if crop else "record one view in a file of its own"
    )
    raise FileFormatError(f"{where}: each image holds two views of a stereo camera, {how}; {remedy}")


def _side_data(decoded: av.VideoFrame, kind: Type) -> npt.NDArray[np.int32]:
    """Returns the side data of this kind as integers; none where the frame has none."""
    container = cast(SideDataContainer, decoded.side_data)
    raw = bytes(container[kind]) if kind in (data.type for data in container) else b""
    return np.frombuffer(raw[: len(raw) // 4 * 4], np.int32)


def _oriented(image: Image, decoded: av.VideoFrame, where: str) -> Image:
    """Returns ``image`` as a player shows it: a camera notes how it was held, and whether it mirrors.

    Args:
        image: (h, w) or (h, w, 3), as stored.
        decoded: the frame with the display matrix (a, b, u, c, d, v, x, y, w): a stored pixel (p, q) is shown at
            (a p + c q, b p + d q).
        where: the file, for the message.

    Raises:
        FileFormatError: the matrix rotates by another angle than quarters of a circle, or skews.
    """
    matrix = _side_data(decoded, Type.DISPLAYMATRIX)
    if len(matrix) != 9 or not matrix[[0, 1, 3, 4]].any():
        return image
    (a, b), (c, d) = (int(matrix[0]), int(matrix[1])), (int(matrix[3]), int(matrix[4]))
    straight, crossed = (abs(a), abs(d)), (abs(b), abs(c))
    # the signs of the remaining two elements mirror the image along its u and its v axis
    if max(crossed) <= MAX_SKEW_SHARE * min(straight):
        along_u, along_v = a, d
    elif max(straight) <= MAX_SKEW_SHARE * min(crossed):
        image, along_u, along_v = np.swapaxes(image, 0, 1), c, b
    else:
        shown = [round(element / 65536, 3) for element in (a, b, c, d)]
        raise FileFormatError(
            f"{where}: its display matrix {shown} turns by another angle than 90, 180 or 270 degrees; turn the images "
            "themselves: ffmpeg -i VIDEO -crf 10 TURNED.mp4"
        )
    image = image[:, ::-1] if along_u < 0 else image
    return np.ascontiguousarray(image[::-1] if along_v < 0 else image)
