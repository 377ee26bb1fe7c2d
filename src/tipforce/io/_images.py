"""Reads and writes image files; training and inference use the same reader.

Every image becomes (h, w) grey or (h, w, 3) RGB with 8 bits, rotated as its EXIF data state, without its alpha channel.

Of images with more than 8 bits the upper eight of those *in use* are kept. The number in use is decided once for a
whole stream (all images of one view in a folder, a recording or a set of shards), not for each image, because then the
brightness would change with the brightest pixel:

1. the number that the file states (a PNG's chunk ``sBIT``, a DICOM file's ``BitsStored``);
2. else 12 bits where no image of the stream has a value above 4095, because cameras of 12 bits write their numbers
   unchanged into files of 16 bits; else 16 bits.
"""

import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from .._system.atomic import check_folder, write_atomic
from ..errors import FileFormatError
from ..types import Image
from ._image_size import check_encoded, encoded_size, image_count, max_file_bytes, max_pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
MAX_12_BIT_VALUE = 4095
"""A stream of images without a greater value has 12 bits in use."""


class StreamDepth:
    """Number of bits that the images of one stream use; found at the first image with more than 8 bits, then kept.

    Args:
        contents: Gives the encoded images of the whole stream, one after the other.
    """

    def __init__(self, contents: Callable[[], Iterable[bytes | memoryview]]) -> None:
        self._contents = contents
        self._bits: int | None = None

    @classmethod
    def of_files(cls, paths: Sequence[Path]) -> "StreamDepth":
        """Returns the depth of the stream of the images in ``paths``."""
        return cls(_FileContents(tuple(paths)))

    @property
    def bits(self) -> int:
        """12 where no image has a value above 4095, else 16. Images that cannot be read are ignored here."""
        if self._bits is None:
            self._bits = bits_in_use(raw_image(data) for data in self._contents())
        return self._bits


def bits_in_use(images: Iterable[npt.NDArray[Any] | None]) -> int:
    """Returns 12 where no image of a stream has a value above 4095, else 16; only pixels of 16 bits count."""
    wide = (image for image in images if image is not None and image.dtype == np.uint16)
    return 16 if any(int(image.max()) > MAX_12_BIT_VALUE for image in wide) else 12


class _FileContents:
    """Reads files one after the other; a class, so that a store which holds it can be sent to another process."""

    def __init__(self, paths: tuple[Path, ...]) -> None:
        self._paths = paths

    def __call__(self) -> Iterable[bytes]:
        return (file_bytes(path) for path in self._paths if path.is_file())


def is_image(path: Path) -> bool:
    """Returns whether the name of the file is that of one image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def read_image(path: Path, depth: StreamDepth | None = None) -> Image:
    """Reads one image file.

    Args:
        path: A PNG, JPEG, TIFF, BMP or WebP file.
        depth: depth of the stream that the image belongs to; None for a single image.

    Returns:
        (h, w) grey or (h, w, 3) RGB, uint8; see the module's text for images with more than 8 bits.

    Raises:
        FileFormatError: where the file is missing, empty, damaged, too large or has pixels of another type.
    """
    return decode_image(file_bytes(path) if path.is_file() else b"", str(path), depth)


def file_bytes(path: Path) -> bytes:
    """Returns the content of an image file. Raises FileFormatError where it is larger than any image may be."""
    limit = max_file_bytes()
    if path.stat().st_size > limit:
        raise FileFormatError(
            f"{path}: has {path.stat().st_size} bytes, more than the largest image that is read ({limit} bytes, "
            f"{max_pixels() / 1e6:g} megapixels); convert it to PNG or JPEG"
        )
    return path.read_bytes()


def decode_image(data: bytes | memoryview, where: str, depth: StreamDepth | None = None) -> Image:
    """Decodes an image as `read_image` does.

    Args:
        data: the encoded image.
        where: its origin, for messages.
        depth: depth of the stream that the image belongs to; None for a single image.

    Returns:
        (h, w) grey or (h, w, 3) RGB, uint8.

    Raises:
        FileFormatError: it is missing, damaged, too large, one of several in the file, or has pixels of another type.
    """
    check_encoded(data, where)
    if image_count(data) > 1:
        raise FileFormatError(
            f"{where}: holds several images (pages, or frames of an animation), and one is expected here; open this "
            "file by itself, as you would a video, or write each of its images to a file of its own"
        )
    image = raw_image(data)
    if image is None:
        raise FileFormatError(f"{where}: the image is missing, empty or damaged; expected PNG, JPEG, TIFF, BMP or WebP")
    return eight_bits(image, where, lambda: _stated_bits(data) or (depth or StreamDepth(lambda: [data])).bits)


def eight_bits(image: npt.NDArray[Any], where: str, bits: Callable[[], int]) -> Image:
    """Returns a decoded image, (h, w) or (h, w, 3) BGR, in grey or RGB of 8 bits.

    Args:
        image: image of 8 or 16 bits.
        where: origin of the image, for messages.
        bits: called for pixels of 16 bits; returns the number of bits in use.

    Raises:
        FileFormatError: the pixels have another type.
    """
    if image.dtype == np.uint16:
        image = (image >> (bits() - 8)).astype(np.uint8)
    elif image.dtype != np.uint8:
        raise FileFormatError(f"{where}: holds {image.dtype} pixels; write it with 8 or 16 bit")
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)  # type: ignore[return-value]


def raw_image(data: bytes | memoryview) -> npt.NDArray[Any] | None:
    """Returns (h, w) or (h, w, 3) BGR in the type of the file; None where it is no image, or one that is too large."""
    size = encoded_size(data)
    if size is None or size[0] * size[1] > max_pixels():
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        return None


def _stated_bits(data: bytes | memoryview) -> int | None:
    """Returns the bits in use that a PNG states in its chunk ``sBIT``, 9 to 16; None where it states none."""
    head = bytes(data[:4096])
    pixels, name = head.find(b"IDAT"), head.find(b"sBIT")
    if not head.startswith(b"\x89PNG") or name < 0 or (0 <= pixels < name):  # among pixels it is no name
        return None
    bits = head[name + 4]
    return bits if 8 < bits <= 16 else None


def encode_image(image: Image, *, lossless: bool, jpeg_quality: int) -> tuple[str, bytes]:
    """Compresses an image.

    Args:
        image: (h, w) grey or (h, w, 3) RGB.
        lossless: whether to write PNG instead of JPEG.
        jpeg_quality: quality of a JPEG, 0 to 100.

    Returns:
        Name of the format, and the compressed bytes.
    """
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    if lossless:
        _, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        return "png", data.tobytes()
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    return "jpeg", data.tobytes()


def save_image(path: Path, drawing: "Image | Figure") -> None:
    """Writes an image completely or not at all.

    Args:
        path: the file, .png or .jpg.
        drawing: (h, w) grey or (h, w, 3) RGB, uint8; or a figure.

    Raises:
        FileFormatError: the name ends otherwise.
        OutputError: nothing can be written in the folder.
    """
    check_image_target(path)
    suffix = path.suffix.lower()
    if isinstance(drawing, np.ndarray):
        bgr = drawing if drawing.ndim == 2 else cv2.cvtColor(drawing, cv2.COLOR_RGB2BGR)
        write_atomic(path, cv2.imencode(suffix, bgr)[1].tobytes())
    else:
        buffer = io.BytesIO()
        drawing.savefig(buffer, format=suffix[1:])
        write_atomic(path, buffer.getvalue())


def check_image_target(path: Path, *, plot: bool = False) -> None:
    """Checks, before the work, that an image can be written.

    Args:
        path: the file that is to be written.
        plot: whether a plot is written (.png or .svg) rather than an image (.png or .jpg).

    Raises:
        FileFormatError: the name ends otherwise.
        OutputError: nothing can be written in the folder.
    """
    if path.suffix.lower() not in ((".png", ".svg") if plot else (".png", ".jpg", ".jpeg")):
        allowed = "plots are written as .png or .svg" if plot else "images are written as .png or .jpg"
        raise FileFormatError(f"{path}: {allowed}; name it {path.with_suffix('.png').name}")
    check_folder(path)
