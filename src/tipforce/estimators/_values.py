"""Checks of the numbers in a stored model, which may have been changed: finite, right shape, plausible limits."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import Field, PlainSerializer, PlainValidator, TypeAdapter

from ..types import BoolArray, FloatArray

LARGEST = 1e12
"""Largest fitted number in any unit."""

StoredValues = Mapping[str, Any]
"""JSON values of a stored model by name."""
StoredArrays = Mapping[str, npt.NDArray[Any]]
"""Arrays of a stored model by name."""
StoredFiles = Mapping[str, bytes] | None
"""Whole files of a stored model by name; None: it has none."""
Count = Annotated[int, Field(ge=0, lt=1 << 53)]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
_THREE = TypeAdapter(tuple[bool, bool, bool])


def _as_known(value: Any) -> BoolArray:
    return value if isinstance(value, np.ndarray) else np.array(_THREE.validate_python(value), np.bool_)


Known = Annotated[BoolArray, PlainValidator(_as_known), PlainSerializer(lambda known: known.tolist())]
"""(3,) the force components that a method estimates."""


def stored_array(
    arrays: StoredArrays, name: str, shape: tuple[int | None, ...], *, low: float = -LARGEST, high: float = LARGEST
) -> FloatArray:
    """Returns an array of a stored model after checks.

    Args:
        arrays: all arrays by name.
        name: name of the array.
        shape: its expected shape; None: any length.
        low: smallest value.
        high: largest value.

    Raises:
        KeyError: there is no such array.
        ValueError: it has another shape, contains no numbers, or a number that is not finite or beyond the limits.
    """
    stored = arrays[name]
    if len(stored.shape) != len(shape) or any(
        want not in (None, got) for want, got in zip(shape, stored.shape, strict=True)
    ):
        raise ValueError(f"{name} has the shape {stored.shape}, expected {_text(shape)}")
    if stored.dtype.kind not in "biuf":  # NumPy's kinds: bool, int, unsigned int, float
        raise ValueError(f"{name} holds no numbers")
    values = np.array(stored, np.float64, order="C")
    if not ((values >= low) & (values <= high)).all():  # also False for NaN
        raise ValueError(f"{name} holds values that are not finite numbers from {low:g} to {high:g}")
    return values


def stored_number(arrays: StoredArrays, name: str, *, low: float = -LARGEST, high: float = LARGEST) -> float:
    """Returns a single number of a stored model; errors are those of `stored_array`.

    Args:
        arrays: all arrays by name.
        name: name of the number.
        low: smallest value.
        high: largest value.
    """
    return float(stored_array(arrays, name, (), low=low, high=high))


def _text(shape: tuple[int | None, ...]) -> str:
    return f"({', '.join('n' if length is None else str(length) for length in shape)}{',' * (len(shape) == 1)})"
