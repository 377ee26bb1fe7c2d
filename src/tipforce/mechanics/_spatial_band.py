"""The Hessian of the spatial rod, 3x3 block-tridiagonal, as a band of half width 5: factors and solves.

Row r of ``band`` (3k, 6) holds H[r, r], H[r, r + 1], ... H[r, r + 5] before, and D[r], L[r + 1, r], ... after the
factorisation H = L D L'. The last block is kept apart as its inverse, for a dead moment makes it unsymmetric.
"""

from ..types import FloatArray
from ._spatial_compile import compiled

__all__ = ["factorise", "solve"]

WIDTH = 6


@compiled
def factorise(band: FloatArray, shift: float, skew: FloatArray, tail: FloatArray) -> int:
    """H + shift -> L D L' in place; returns the number of negative eigenvalues of the symmetric part.

    ``skew`` (3,): the axial vector of the unsymmetric part of the last block, which goes into ``tail`` (3, 3), the
    inverse of what is left of that block. A vanishing pivot is taken as a tiny positive one.
    """
    size = band.shape[0]
    body = size - 3
    negative = 0
    for r in range(body):
        pivot = band[r, 0] + shift
        if pivot == 0.0:
            pivot = 1e-300
        if pivot < 0.0:
            negative += 1
        band[r, 0] = pivot
        inverse = 1.0 / pivot
        reach = min(WIDTH, size - r)
        for i in range(1, reach):
            factor = band[r, i] * inverse
            for j in range(i, reach):
                band[r + i, j - i] -= factor * band[r, j]
        for i in range(1, reach):
            band[r, i] *= inverse
    a, b, c = band[body, 0] + shift, band[body, 1], band[body, 2]
    d, e, f = band[body + 1, 0] + shift, band[body + 1, 1], band[body + 2, 0] + shift
    second = d - b * b / a
    cross = e - b * c / a
    third = f - c * c / a - cross * cross / second
    negative += int(a < 0.0) + int(second < 0.0) + int(third < 0.0)
    x, y, z = skew[0], skew[1], skew[2]
    m01, m10, m02, m20, m12, m21 = b - z, b + z, c + y, c - y, e - x, e + x
    tail[0, 0] = d * f - m12 * m21
    tail[0, 1] = m02 * m21 - m01 * f
    tail[0, 2] = m01 * m12 - m02 * d
    tail[1, 0] = m12 * m20 - m10 * f
    tail[1, 1] = a * f - m02 * m20
    tail[1, 2] = m02 * m10 - a * m12
    tail[2, 0] = m10 * m21 - d * m20
    tail[2, 1] = m01 * m20 - a * m21
    tail[2, 2] = a * d - m01 * m10
    determinant = a * tail[0, 0] + m01 * tail[1, 0] + m02 * tail[2, 0]
    if determinant == 0.0:
        determinant = 1e-300
    for i in range(3):
        for j in range(3):
            tail[i, j] /= determinant
    return negative


@compiled
def solve(band: FloatArray, tail: FloatArray, rhs: FloatArray) -> None:
    """Overwrite ``rhs`` (3k,) by the solution, with the factors of `factorise`."""
    size = band.shape[0]
    body = size - 3
    for r in range(body):
        value = rhs[r]
        for i in range(1, min(WIDTH, size - r)):
            rhs[r + i] -= band[r, i] * value
    x, y, z = rhs[body], rhs[body + 1], rhs[body + 2]
    for i in range(3):
        rhs[body + i] = tail[i, 0] * x + tail[i, 1] * y + tail[i, 2] * z
    for r in range(body - 1, -1, -1):
        value = rhs[r] / band[r, 0]
        for i in range(1, min(WIDTH, size - r)):
            value -= band[r, i] * rhs[r + i]
        rhs[r] = value
