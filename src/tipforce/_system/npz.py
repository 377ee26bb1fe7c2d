"""Reads archives of arrays (.npz) of unknown origin: nothing is unpacked before its size is checked."""

import io
import math
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FileFormatError

MAX_ARRAYS = 4096
"""Largest number of arrays in an archive."""
MAX_BYTES = 4 << 30
"""Largest number of bytes that an archive may unpack to; the true values of an hour at 60 Hz take 1 GiB."""
MAX_RATIO = 20
"""An archive larger than `SMALL_BYTES` may unpack to at most this multiple of its own size: arrays of measured numbers
compress by less."""
SMALL_BYTES = 64 << 20
MAX_HEADER_BYTES = 1 << 16
"""Longest header of an array, in front of its numbers."""

_FAULTS = (
    KeyError,
    TypeError,
    ValueError,
    OSError,
    EOFError,
    RuntimeError,
    NotImplementedError,
    OverflowError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
"""Errors of zip and NumPy for files that are damaged or of another kind."""


def read_npz(
    source: Path | bytes, where: str, remedy: str = "make it again or copy it again"
) -> dict[str, npt.NDArray[Any]]:
    """Returns all arrays of an archive; their checksums (CRC-32) are verified.

    Args:
        source: the file, or its content.
        where: its name in the error messages.
        remedy: end of the error messages.

    Raises:
        FileFormatError: the file is no such archive or damaged, an array contains objects or its header states another
            size than it has, or the archive would unpack to more than `MAX_BYTES`, or more than `MAX_RATIO` times its
            own size.
    """
    length = len(source) if isinstance(source, bytes) else source.stat().st_size
    try:
        with zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source) as archive:
            members = archive.infolist()
            if len(members) > MAX_ARRAYS:
                raise FileFormatError(f"{where}: holds {len(members)} arrays, more than {MAX_ARRAYS}; {remedy}")
            unpacked = sum(each.file_size for each in members)
            limit = min(MAX_BYTES, max(SMALL_BYTES, MAX_RATIO * length))
            if unpacked > limit:
                raise FileFormatError(
                    f"{where}: would unpack to {unpacked} bytes, but a file of {length} bytes may to {limit}; {remedy}"
                )
            return {each.filename.removesuffix(".npy"): _member(archive, each, where, remedy) for each in members}
    except _FAULTS as error:
        reason = str(error).strip().split("\n")[0][:200] or type(error).__name__
        raise FileFormatError(f"{where}: no readable arrays ({reason}); {remedy}") from None


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, where: str, remedy: str) -> npt.NDArray[Any]:
    with archive.open(member) as stream:
        data = stream.read()
    head = io.BytesIO(data[:MAX_HEADER_BYTES])
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    try:
        shape, _, kind = read[np.lib.format.read_magic(head)](head)
    except Exception:  # the header is read as literals of Python, and each step has errors of its own
        raise ValueError(f"{member.filename[:100]!r} is no array") from None
    held = len(data) - head.tell()
    if kind.hasobject or any(n < 0 for n in shape) or math.prod(shape) * kind.itemsize != held:
        raise FileFormatError(
            f"{where}: the array {member.filename[:100]!r} claims the shape {shape} of {kind}, but has {held} bytes; "
            f"{remedy}"
        )
    return np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
