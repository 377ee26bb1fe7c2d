"""Cholesky's factors of small matrices, in compiled loops: the calls of LAPACK take longer than the work."""

import math

import numpy as np

from ...types import FloatArray
from ._compile import compiled


@compiled
def factorise(matrix: FloatArray, damping: float, factor: FloatArray) -> float:
    """Computes the Cholesky factor of a symmetric matrix whose diagonal is first multiplied by 1 + ``damping``.

    Args:
        matrix: (n, n) matrix.
        damping: relative increase of the diagonal.
        factor: (n, n) array whose lower triangle is written.

    Returns:
        Logarithm of the determinant; NaN if the damped matrix is not positive definite.
    """
    count = matrix.shape[0]
    log_det = 0.0
    for i in range(count):
        for j in range(i + 1):
            value = matrix[i, j]
            if i == j:
                value *= 1.0 + damping
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i == j:
                if not value > 0.0:
                    return math.nan
                factor[i, i] = math.sqrt(value)
                log_det += math.log(value)
            else:
                factor[i, j] = value / factor[j, j]
    return log_det


@compiled
def solve_in(factor: FloatArray, answer: FloatArray) -> None:
    """Solves a linear system in place.

    Args:
        factor: (n, n) Cholesky factor of the matrix.
        answer: (n,) right-hand side, then the solution.
    """
    count = answer.size
    for i in range(count):  # forward substitution
        for k in range(i):
            answer[i] -= factor[i, k] * answer[k]
        answer[i] /= factor[i, i]
    for i in range(count - 1, -1, -1):  # backward substitution
        for k in range(i + 1, count):
            answer[i] -= factor[k, i] * answer[k]
        answer[i] /= factor[i, i]


@compiled
def inverse(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Returns the inverse (n, n) of a covariance and the logarithm of its determinant.

    The matrix is first scaled to one on the diagonal, because its units may differ by ten powers of ten.

    Raises:
        ValueError: the covariance is not positive definite.
    """
    count = len(covariance)
    std = np.sqrt(np.diag(covariance))
    factor, found = np.zeros((count, count)), np.eye(count)
    log_det = factorise(covariance / (std.reshape(count, 1) * std), 0.0, factor)
    if math.isnan(log_det):
        raise ValueError("a covariance has no inverse: it is not positive definite")
    for i in range(count):
        solve_in(factor, found[i])
        for j in range(count):
            found[i, j] /= std[i] * std[j]
        log_det += 2.0 * math.log(std[i])
    return found, log_det
