"""Rows times a matrix, each row the same however many there are."""

import numpy as np

from ...types import FloatArray

__all__ = ["times"]


def times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """(n, k) times (k, m). The library that does it rounds one row alone in another way than two and more."""
    many = rows if len(rows) != 1 else np.repeat(rows, 2, axis=0)
    return (many @ matrix)[: len(rows)]
