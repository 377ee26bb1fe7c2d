"""The inverse of a covariance whose units lie ten powers of ten apart."""

import math

import numpy as np
from numba import njit

from ...types import FloatArray

__all__ = ["inverse"]


@njit(cache=True, nogil=True)
def inverse(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Inverse (n, n) and logarithm of the determinant, scaled to one on the diagonal; raises ValueError for none.

    By Cholesky's root R: the inverse is (1 / R)^T (1 / R).
    """
    count = len(covariance)
    std = np.empty(count)
    root = np.zeros((count, count))
    log_det = 0.0
    for i in range(count):
        std[i] = math.sqrt(covariance[i, i])
        for j in range(i + 1):
            rest = covariance[i, j] / (std[i] * std[j])
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            if j < i:
                root[i, j] = rest / root[j, j]
            elif rest > 0.0:
                root[i, i] = math.sqrt(rest)
            else:
                raise ValueError("a covariance has no inverse: it is not positive definite")
        log_det += 2.0 * math.log(root[i, i] * std[i])
    for j in range(count):  # column by column of the root's inverse, in place: no later column asks for an earlier one
        root[j, j] = 1.0 / root[j, j]
        for i in range(j + 1, count):
            total = 0.0
            for k in range(j, i):
                total -= root[i, k] * root[k, j]
            root[i, j] = total / root[i, i]
    found = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, count):
                total += root[k, i] * root[k, j]
            found[i, j] = found[j, i] = total / (std[i] * std[j])
    return found, log_det
