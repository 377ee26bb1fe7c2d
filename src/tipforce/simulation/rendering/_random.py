"""Random numbers as a hash of (key, pixel): any frame can be drawn alone, in any order, on any thread."""

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from numba import njit

from ..._system.compilation import STEADY

FloatImage = npt.NDArray[np.float32]
_TABLE_BITS = 12


@lru_cache(maxsize=1)
def gauss_table() -> FloatImage:
    """Returns (4096,) quantiles of a Gaussian with corrected tails: moments 2, 4 and 6 are a Gaussian's (1, 3, 15).

    Without the correction the missing tails of a table would show: sums of two entries would have a kurtosis of 2.996.
    """
    from scipy.special import ndtri

    n = 1 << _TABLE_BITS
    z = ndtri((np.arange(n) + 0.5) / n)
    powers = np.stack([z, z**3, z**5])
    weights = np.array([1.0, 0.0, 0.0])
    for _ in range(20):
        bent = weights @ powers
        miss = np.array([(bent**k).mean() for k in (2, 4, 6)]) - (1.0, 3.0, 15.0)
        slope = np.array([[(k * bent ** (k - 1) * p).mean() for p in powers] for k in (2, 4, 6)])
        weights -= np.linalg.solve(slope, miss)
    table = (weights @ powers).astype(np.float32)
    table.flags.writeable = False  # it is handed out again
    return table


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def hash_row(first: int, key: npt.NDArray[np.uint32], words: npt.NDArray[np.uint32]) -> None:
    """Writes a random 32-bit word for each pixel of a row.

    Args:
        first: number of the row's first pixel in the image.
        key: (3,) key of the image.
        words: (w,) words that are written.
    """
    start, k1, k2 = np.uint32(key[0] + np.uint32(first)), key[1], key[2]
    for u in range(words.size):
        x = np.uint32(np.uint32(u) + start)
        x = np.uint32(x ^ (x >> np.uint32(17)))
        x = np.uint32(x * np.uint32(0xED5AD4BB))
        x = np.uint32(x ^ (x >> np.uint32(11)))
        x = np.uint32(np.uint32(x + k1) * np.uint32(0xAC4C1B51))
        x = np.uint32(x ^ (x >> np.uint32(15)))
        x = np.uint32(np.uint32(x + k2) * np.uint32(0x31848BAB))
        words[u] = np.uint32(x ^ (x >> np.uint32(14)))


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def gauss_row(words: npt.NDArray[np.uint32], table: FloatImage, row: FloatImage) -> None:
    """Writes Gaussian numbers of variance 1, each from the upper and lower 12 bits of a word.

    Args:
        words: (w,) random words.
        table: `gauss_table`.
        row: (w,) numbers that are written.
    """
    half = np.float32(math.sqrt(0.5))
    for u in range(words.size):
        row[u] = half * (table[words[u] & np.uint32(4095)] + table[words[u] >> np.uint32(20)])
