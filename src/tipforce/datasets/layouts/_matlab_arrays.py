"""Arrays of MATLAB 7.3 files, whose axes h5py reads in reverse order."""

from pathlib import Path

import numpy as np

from ..._system.extras import import_extra
from ...errors import FileFormatError
from ...types import FloatArray, Image


def read_array(path: Path, key: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Returns an array of a MATLAB 7.3 file.

    Args:
        path: the file.
        key: name of the array.
        shape: its expected shape as h5py reads it; None: any length.

    Raises:
        MissingExtraError: h5py is not installed.
        FileFormatError: the file is of another kind, or the array has another shape or holds values that are no finite
            numbers.
    """
    h5py = import_extra("h5py", "real-data")
    try:
        with h5py.File(path, "r") as file:
            values = np.asarray(file[key], dtype=np.float64)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: expected a MATLAB 7.3 file with {key!r} ({error})") from None
    if values.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, values.shape, strict=True)):
        raise FileFormatError(f"{path}: {key} has the shape {values.shape}, expected {shape}")
    if not np.isfinite(values).all():
        sample = int(np.argwhere(~np.isfinite(values))[0, 0])
        raise FileFormatError(f"{path}: sample {sample} of {key} holds a value that is no finite number")
    return values


def upright_grey(images: FloatArray) -> Image:
    """Returns grey images (n, h, w) uint8 of stored ones (n, w, h) with values from 0 to 1."""
    levels = np.rint(np.clip(images.transpose(0, 2, 1), 0.0, 1.0) * 255.0)
    return np.ascontiguousarray(levels.astype(np.uint8))
