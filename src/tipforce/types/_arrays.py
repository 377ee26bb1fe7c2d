"""Types of arrays by meaning, and the check of their shapes."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]
"""(h, w) grey or (h, w, 3) RGB."""


def frozen(name: str, values: Any, shape: tuple[int | None, ...], dtype: Any = np.float64) -> npt.NDArray[Any]:
    """Returns a read-only array of a given shape.

    Args:
        name: name of the array, for the message.
        values: its values.
        shape: expected length of each axis; None for any length.
        dtype: type of its elements.

    Raises:
        ValueError: the shape differs; this is a bug of the caller, not of a user's file.
    """
    array = np.array(values, dtype=dtype)
    if array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array
