"""Image files: which they are, compressed and written."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..errors import FileFormatError
from ..types import Image
from ._files import part_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_image_target", "encode_image", "is_image", "save_image"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}


def is_image(path: Path) -> bool:
    """Whether the file's name says that it is one picture."""
    return path.suffix.lower() in _SUFFIXES


def encode_image(image: Image, *, lossless: bool, jpeg_quality: int) -> tuple[str, bytes]:
    """The format's name and the compressed bytes of (h, w) grey or (h, w, 3) RGB."""
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    if lossless:
        _, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        return "png", data.tobytes()
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    return "jpeg", data.tobytes()


def save_image(path: Path, picture: "Image | Figure") -> None:
    """Write ``path`` (.png, .jpg) whole or not at all. Raises FileFormatError where its kind or folder is none."""
    check_image_target(path)
    suffix = path.suffix.lower()
    if isinstance(picture, np.ndarray):
        data = cv2.imencode(suffix, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
    else:
        buffer = io.BytesIO()
        picture.savefig(buffer, format=suffix[1:])
        data = buffer.getvalue()
    part = part_of(path)
    part.write_bytes(data)
    part.replace(path)


def check_image_target(path: Path, *, plot: bool = False) -> None:
    """Raises FileFormatError where `save_image` (or `plot_summary`) could not write ``path``; ask first."""
    if not path.parent.is_dir():
        raise FileFormatError(f"{path}: the folder {path.parent} does not exist; make it first")
    if path.suffix.lower() not in ((".png", ".svg") if plot else (".png", ".jpg", ".jpeg")):
        what = "plots are written as .png or .svg" if plot else "pictures are written as .png or .jpg"
        raise FileFormatError(f"{path}: {what}; name it {path.with_suffix('.png').name}")
