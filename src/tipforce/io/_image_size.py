"""Reads size and number of pages from the header of an image file before it is decoded, and limits the size."""

import os
import struct
from collections.abc import Callable, Iterator

from ..errors import FileFormatError, InputError

MAX_MEGAPIXELS = "TIPFORCE_MAX_MEGAPIXELS"
"""The environment variable that replaces the limit of `DEFAULT_MAX_MEGAPIXELS`."""
DEFAULT_MAX_MEGAPIXELS = 100.0
MAX_BYTES_PER_PIXEL = 8
"""Bytes in a pixel of an uncompressed image with four channels of 16 bits."""

_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of the segments that state a JPEG's size."""
_JPEG_ALONE = frozenset((0x00, 0x01, *range(0xD0, 0xD9)))
"""Markers without a segment."""
MAX_JPEG_SEGMENTS, MAX_JPEG_GAP_BYTES = 4096, 65536
"""Number of segments, and of bytes between two of them, in which the size is searched for."""
_TIFF_KIND, _TIFF_WIDTH, _TIFF_HEIGHT = 254, 256, 257
_TIFF_FORMATS = {3: "H", 4: "I", 16: "Q"}
_TIFF_REDUCED_OR_MASK = 0b101
"""Bits of a TIFF page's kind: a smaller copy of another page, a mask of its transparency."""
MAX_TIFF_PAGES, MAX_TIFF_ENTRIES = 1_000_000, 4096
"""Number of pages, and of entries of one page, that are read of a file that may be damaged."""
_WEBP_ANIMATED = 0b10


def max_pixels() -> int:
    """Returns the largest number of pixels of one image: 100 million, or the value of ``TIPFORCE_MAX_MEGAPIXELS``.

    Raises InputError where the variable is no number from 1 to 10,000.
    """
    stated = os.environ.get(MAX_MEGAPIXELS)
    try:
        megapixels = DEFAULT_MAX_MEGAPIXELS if stated is None else float(stated)
    except ValueError:
        megapixels = 0.0
    if not 1 <= megapixels <= 10_000:
        raise InputError(f"{MAX_MEGAPIXELS}={stated}: expected a number from 1 to 10000")
    return round(megapixels * 1e6)


def max_file_bytes() -> int:
    """Returns the largest size of the file of one image in bytes: that of the largest image, uncompressed."""
    return MAX_BYTES_PER_PIXEL * max_pixels()


def check_pixels(width: int, height: int, where: str) -> None:
    """Checks the size of an image.

    Args:
        width: width in px.
        height: height in px.
        where: the file that holds the image, for the message.

    Raises:
        FileFormatError: the image has too many pixels.
    """
    limit = max_pixels()
    if width * height > limit:
        raise FileFormatError(
            f"{where}: its header claims {width} x {height} pixels, more than the limit of {limit / 1e6:g} megapixels; "
            f"reduce it, or state a higher limit by the environment variable {MAX_MEGAPIXELS}"
        )


def check_encoded(data: bytes | memoryview, where: str) -> None:
    """Checks format and size of an encoded image before it is decoded.

    Args:
        data: the encoded image.
        where: the file and the frame, for the message.

    Raises:
        FileFormatError: the image is in none of the formats of `encoded_size`, or has too many pixels.
    """
    size = encoded_size(data)
    if size is None:
        raise FileFormatError(f"{where}: the image is missing, empty or damaged; expected PNG, JPEG, TIFF, BMP or WebP")
    check_pixels(*size, where)


def encoded_size(data: bytes | memoryview) -> tuple[int, int] | None:
    """Returns width and height in the header of a PNG, JPEG, TIFF, BMP, WebP or GIF file; None for other data.

    >>> import cv2, numpy as np
    >>> [encoded_size(cv2.imencode(kind, np.zeros((3, 5), np.uint8))[1].tobytes()) for kind in (".png", ".tif")]
    [(5, 3), (5, 3)]
    """
    data = memoryview(data)
    begin = bytes(data[:16])
    for magic, read in _READERS.items():
        if begin.startswith(magic):
            try:
                width, height = read(data)
            except (struct.error, IndexError, KeyError, ValueError):  # the header is cut off or damaged
                return None
            return (width, height) if width > 0 and height > 0 else None
    return None


def _png(data: memoryview) -> tuple[int, int]:
    """Returns width and height in px. Raises ValueError for a chunk that is longer than the file."""
    offset = 8  # bytes of the signature
    while offset + 4 <= len(data):
        (length,) = struct.unpack_from(">I", data, offset)
        if length > len(data):  # the decoder would reserve that much memory before it checks
            raise ValueError("a chunk is longer than the file")
        offset += 12 + length  # length, name and crc have 4 bytes each
    return struct.unpack_from(">II", data, 16)


def _gif(data: memoryview) -> tuple[int, int]:
    return struct.unpack_from("<HH", data, 6)


def _bmp(data: memoryview) -> tuple[int, int]:
    if struct.unpack_from("<I", data, 14)[0] == 12:
        return struct.unpack_from("<HH", data, 18)
    width, height = struct.unpack_from("<ii", data, 18)
    return abs(width), abs(height)  # negative: the rows run downwards


def _webp(data: memoryview) -> tuple[int, int]:
    """Returns width and height in px: 24 bits each (extended), or 14 bits each (lossless, lossy)."""
    kind = bytes(data[8:16])
    if kind == b"WEBPVP8X":
        return _little(data[24:27]) + 1, _little(data[27:30]) + 1
    if kind == b"WEBPVP8L":
        bits = _little(data[21:25])
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"WEBPVP8 ":
        return _little(data[26:28]) & 0x3FFF, _little(data[28:30]) & 0x3FFF
    raise ValueError("no WebP")


def _little(data: memoryview) -> int:
    return int.from_bytes(data, "little")


def _jpeg(data: memoryview) -> tuple[int, int]:
    """Returns width and height in px. A segment is 0xFF, its marker and, for most markers, a length and content."""
    offset = 2
    for _ in range(MAX_JPEG_SEGMENTS):
        gap = bytes(data[offset : offset + MAX_JPEG_GAP_BYTES]).find(0xFF)  # decoders skip bytes between segments
        if gap < 0:
            break
        offset += gap + 1
        marker = data[offset]
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, offset + 4)
            return width, height
        if marker == 0xFF:  # a fill byte
            continue
        offset += 1 if marker in _JPEG_ALONE else 1 + struct.unpack_from(">H", data, offset + 1)[0]
    raise ValueError("no size in it")


def _tiff(data: memoryview) -> tuple[int, int]:
    """Returns width and height of the first page, px."""
    first = next(_tiff_pages(data))
    return first[_TIFF_WIDTH], first[_TIFF_HEIGHT]


def _tiff_pages(data: memoryview) -> Iterator[dict[int, int]]:
    """Yields kind, width and height (tag -> value) of each page of a TIFF file, as far as they are stated.

    A page is a list of entries: tag, type and number of values, value. The position of the next page follows it.
    """
    order = "<" if data[0] == ord("I") else ">"
    if struct.unpack_from(order + "H", data, 2)[0] == 43:  # BigTIFF
        position_type, count_type, entry_bytes, value_offset, first_offset = "Q", "Q", 20, 12, 8
    else:
        position_type, count_type, entry_bytes, value_offset, first_offset = "I", "H", 12, 8, 4
    (page,) = struct.unpack_from(order + position_type, data, first_offset)
    for _ in range(MAX_TIFF_PAGES):  # a damaged file may point back to an earlier page
        (count,) = struct.unpack_from(order + count_type, data, page)
        entries = page + struct.calcsize(count_type)
        values: dict[int, int] = {}
        for entry in range(entries, entries + min(count, MAX_TIFF_ENTRIES) * entry_bytes, entry_bytes):
            tag, kind = struct.unpack_from(order + "HH", data, entry)
            if tag in (_TIFF_KIND, _TIFF_WIDTH, _TIFF_HEIGHT):
                (values[tag],) = struct.unpack_from(order + _TIFF_FORMATS[kind], data, entry + value_offset)
        yield values
        (page,) = struct.unpack_from(order + position_type, data, entries + count * entry_bytes)
        if page == 0:
            return


def tiff_pages(data: bytes | memoryview) -> dict[int, tuple[int, int]]:
    """Returns number -> (width, height) of the pages of a TIFF file, without thumbnails and masks.

    Raises struct.error, IndexError or KeyError where its header is cut off or damaged.
    """
    return {
        number: (page[_TIFF_WIDTH], page[_TIFF_HEIGHT])
        for number, page in enumerate(_tiff_pages(memoryview(data)))
        if not page.get(_TIFF_KIND, 0) & _TIFF_REDUCED_OR_MASK
    }


def image_count(data: bytes | memoryview) -> int:
    """Returns the number of images in a file: pages of a TIFF file, or frames of an animated PNG or WebP file.

    Thumbnails and masks are not counted. A damaged file counts as 1; an animated WebP file, whose header states no
    number of frames, counts as 2.

    >>> import cv2, numpy as np
    >>> image_count(cv2.imencodemulti(".tif", [np.zeros((3, 5), np.uint8)] * 4)[1].tobytes())
    4
    """
    data = memoryview(data)
    begin = bytes(data[:4])
    try:
        if begin in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return max(1, len(tiff_pages(data)))
        if begin == b"\x89PNG":
            name = bytes(data[:4096]).find(b"acTL")  # this chunk is in front of the pixels
            return max(1, struct.unpack_from(">I", data, name + 4)[0]) if name > 0 else 1
        if bytes(data[8:16]) == b"WEBPVP8X":
            return 2 if data[20] & _WEBP_ANIMATED else 1
    except (struct.error, IndexError, KeyError):  # cut off or damaged, which the decoder reports
        pass
    return 1


_READERS: dict[bytes, Callable[[memoryview], tuple[int, int]]] = {
    b"\x89PNG\r\n\x1a\n": _png,
    b"\xff\xd8": _jpeg,
    b"II*\0": _tiff,
    b"MM\0*": _tiff,
    b"II+\0": _tiff,
    b"MM\0+": _tiff,
    b"BM": _bmp,
    b"RIFF": _webp,
    b"GIF8": _gif,
}
