"""Reads a multi-frame DICOM file (XA, or any other with grey or RGB pixels) as frames with their own stamps."""

import importlib
import sys
from collections.abc import Iterator
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._system.extras import import_extra
from ..errors import FileFormatError, TimeError
from ..types import Frame, Image
from ._dicom_view import DicomView, view_from_header
from ._image_size import check_pixels
from ._square_pixels import square_pixels, square_size

_MAGIC_AT = 128
"""Bytes before the mark "DICM"."""


def is_dicom(path: Path) -> bool:
    """Returns whether the content of the file is marked as DICOM, under any name."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(_MAGIC_AT + 4)[_MAGIC_AT:] == b"DICM"


def _checked_count(path: Path, data: Any) -> int:
    """Returns the number of frames that the header claims.

    Raises:
        FileFormatError: they have more pixels than the limit, or are more than the file can hold.
    """
    try:
        width, height, count = (int(data.get(name) or 1) for name in ("Columns", "Rows", "NumberOfFrames"))
    except Exception:  # an element is parsed when it is read, and its faults raise many kinds of errors
        raise FileFormatError(f"{path}: its header states no size in numbers; copy it again from its archive") from None
    check_pixels(width, height, str(path))
    if not 1 <= count <= path.stat().st_size:
        raise FileFormatError(
            f"{path}: its header claims {count} frames, which a file of {path.stat().st_size} bytes cannot hold; copy "
            "it again from its archive"
        )
    return count


def _read(path: Path, *, pixels: bool) -> Any:
    pydicom = import_extra("pydicom", "dicom")
    try:
        return pydicom.dcmread(path, stop_before_pixels=not pixels)
    except Exception as error:  # several parsers read a damaged file, and each raises its own kind of error
        raise FileFormatError(f"{path}: cannot be read as DICOM ({error}); copy it again from its archive") from None


def _check_decoder(path: Path, data: Any) -> None:
    """Raises FileFormatError where the images are compressed in a way that cannot be decoded here."""
    syntax = getattr(data.file_meta, "TransferSyntaxUID", None)
    if syntax is None or not syntax.is_compressed or not syntax.is_encapsulated:
        return
    pixels: Any = importlib.import_module("pydicom.pixels")
    try:
        decoder = pixels.get_decoder(syntax)
    except NotImplementedError:
        decoder = None
    if decoder is not None and decoder.is_available:
        return
    install = "" if decoder is None else f"`{sys.executable} -m pip install python-gdcm`, or "
    raise FileFormatError(
        f"{path}: its images are compressed ({syntax.name}), and no decoder for them is installed; {install}save it "
        "uncompressed, for example with gdcmconv"
    )


def _start_ns(data: Any) -> int | None:
    """Returns ContentDate (YYYYMMDD) and ContentTime (HHMMSS.FFFFFF) in ns: FrameDelay counts from them.

    Without a date it is the time of day. None where no valid time is stated.
    """
    clock = str(data.get("ContentTime") or "")
    digits, _, fraction = clock.partition(".")
    if not (digits.isdecimal() and len(digits) == 6 and (not fraction or fraction.isdecimal())):
        return None
    seconds = int(digits[:2]) * 3600 + int(digits[2:4]) * 60 + int(digits[4:])
    day = str(data.get("ContentDate") or "")
    try:
        seconds += 86_400 * datetime.strptime(day, "%Y%m%d").toordinal() if day else 0
    except ValueError:
        return None
    return seconds * 1_000_000_000 + int(f"{fraction:0<9}"[:9])


class DicomFile:
    """A DICOM file that can be read any number of times.

    Raises MissingExtraError without pydicom, and FileFormatError.

    Attributes:
        path: the file.
        frame_count: number of its frames.
        view: geometry that the header states.
        start_ns: time of its clock's zero; None where it is not stated.
    """

    def __init__(self, path: Path) -> None:
        """Reads the header, and checks the number of frames and that a decoder for the images is installed."""
        self.path = path
        data = _read(path, pixels=False)
        self.frame_count = _checked_count(path, data)
        _check_decoder(path, data)
        try:
            size = square_size(int(data.Columns), int(data.Rows), _aspect(data))
        except Exception:  # see `_checked_count`
            raise FileFormatError(f"{path}: its header is damaged; copy it again from its archive") from None
        self.view: DicomView = view_from_header(data, *size)
        self.start_ns = _start_ns(data)

    def frames(self, view: str = "camera") -> Iterator[Frame]:
        """Yields all frames, 8 bit, with square pixels: grey where the file is grey, else RGB.

        Where more than 8 bits are stored, the upper eight are kept. Stamps come from FrameTimeVector, FrameTime or
        CineRate, in this order; the first frame is at FrameDelay, or at 0 without one (DICOM PS3.3 C.7.6.5.1).

        Raises:
            FileFormatError: the file holds no images, or none that can be decoded here.
            TimeError: the file does not state the times of its frames.
        """
        return _frames(self.path, view)

    def span_ns(self) -> tuple[int, int]:
        """Returns the stamps of the first and the last frame; raises the errors of `frames`."""
        data = _read(self.path, pixels=False)
        stamps = _checked_stamps_ns(self.path, data, self.frame_count)
        return stamps[0], stamps[-1]


def _frames(path: Path, view: str) -> Iterator[Frame]:
    """Yields the frames of the file; see `DicomFile.frames`."""
    data = _read(path, pixels=True)
    count = _checked_count(path, data)
    stamps = _checked_stamps_ns(path, data, count)
    try:
        coloured, stored = int(data.get("SamplesPerPixel", 1)) == 3, int(data.get("BitsStored", 8))
        signed, aspect = bool(int(data.get("PixelRepresentation") or 0)), _aspect(data)
    except Exception as error:  # see `_checked_count`
        raise FileFormatError(f"{path}: its header is damaged ({error}); copy it again from its archive") from None
    if signed:
        raise FileFormatError(f"{path}: holds signed pixels, whose black is not stated; save it with unsigned ones")
    number = 0
    try:
        # one by one: together they may be a thousand times as large as the file
        for pixels in importlib.import_module("pydicom.pixels").iter_pixels(data):
            if number == count or pixels.ndim != (3 if coloured else 2):
                raise ValueError(f"more than {count} frames" if number == count else f"{pixels.ndim} dimensions")
            image = _eight_bit(pixels, stored, str(data.PhotometricInterpretation))
            yield Frame(stamps[number], square_pixels(image, aspect, str(path)), view)
            number += 1
        if number < count:
            raise ValueError(f"{number} of {count} frames")
    except Exception as error:  # see `_checked_count`
        raise FileFormatError(f"{path}: its images cannot be decoded ({error}); save it uncompressed") from None


def _eight_bit(pixels: npt.NDArray[Any], stored: int, shown: str) -> Image:
    small = pixels >> (stored - 8) if stored > 8 else pixels
    image = np.ascontiguousarray(small).astype(np.uint8)
    return 255 - image if shown == "MONOCHROME1" else image


def _aspect(data: Any) -> Fraction:
    """Returns width by height of a pixel: by PixelAspectRatio, else by the distances of rows and columns (in mm)."""
    for name in ("PixelAspectRatio", "ImagerPixelSpacing", "PixelSpacing"):  # each: along a column, along a row
        stated = data.get(name)
        if stated is not None and len(stated) == 2 and min(stated) > 0:
            height, width = (Fraction(float(value)).limit_denominator(10_000) for value in stated)
            return width / height
    return Fraction(1)


def _checked_stamps_ns(path: Path, data: Any, count: int) -> list[int]:
    """Returns the stamps of the frames; raises FileFormatError where the header is damaged, and TimeError."""
    try:
        return _stamps_ns(path, data, count)
    except TimeError:
        raise
    except Exception as error:  # see `_checked_count`
        raise FileFormatError(f"{path}: its header is damaged ({error}); copy it again from its archive") from None


def _stamps_ns(path: Path, data: Any, count: int) -> list[int]:
    """Returns the stamps of ``count`` frames by the times in the header; see `DicomFile.frames`."""
    delay_ms = float(data.get("FrameDelay") or 0)
    if count == 1:
        return [round(delay_ms * 1e6)]
    vector = data.get("FrameTimeVector")
    if vector is not None and len(vector) == count:
        steps_ms = np.array([0.0, *(float(step) for step in vector[1:])])  # the first is 0 by definition
    elif float(data.get("FrameTime") or 0) > 0:
        steps_ms = np.array([0.0] + [float(data.FrameTime)] * (count - 1))
    elif float(data.get("CineRate") or 0) > 0:
        steps_ms = np.array([0.0] + [1e3 / float(data.CineRate)] * (count - 1))
    else:
        raise TimeError(
            f"{path}: does not say when its {count} frames were taken (FrameTimeVector, FrameTime or CineRate); save "
            "it as a folder of images with a stamps.csv"
        )
    if (steps_ms[1:] <= 0).any():
        raise TimeError(f"{path}: FrameTimeVector does not rise; save it as a folder of images with a stamps.csv")
    return np.round((delay_ms + np.cumsum(steps_ms)) * 1e6).astype(np.int64).tolist()
