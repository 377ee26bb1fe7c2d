"""Array types by meaning, and the one place where shapes are checked."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]
"""(h, w) grey or (h, w, 3) RGB."""


def frozen(name: str, values: Any, shape: tuple[int | None, ...], dtype: Any = np.float64) -> npt.NDArray[Any]:
    """``values`` as a read-only array of ``shape`` (None: any length).

    Raises ValueError where the shape is another: a wrong shape here is a bug of the caller, not of a user's file.
    """
    array = np.array(values, dtype=dtype)
    if array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array
