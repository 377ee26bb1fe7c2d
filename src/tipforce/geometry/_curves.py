"""Two sets of numbers for a planar curve: the polynomial y(x), and the tangent angle over arc length."""

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from numpy.polynomial import legendre

from ..types import FloatArray


@njit(cache=True, nogil=True)
def fit_polynomial(x: FloatArray, y: FloatArray, degree: int, constant: bool = True) -> FloatArray:
    """Least-squares polynomial y(x), thesis eq. (2): coefficients (degree + 1,), highest power first.

    ``x``, ``y`` (n,). Without ``constant`` the curve is held at y(0) = 0 and the last coefficient is exactly zero.
    Built from polynomials that are orthogonal on the given points (Forsythe 1957), so that no system of equations is
    solved. Raises ValueError where there are fewer than ``degree + 1`` different x, or not as many y.

    >>> x = np.array([0.0, 1.0, 2.0, 3.0])
    >>> np.round(fit_polynomial(x, 2 * x**2 - x + 5, 2), 12)
    array([ 2., -1.,  5.])
    """
    n = x.shape[0]
    if y.shape[0] != n or degree < (0 if constant else 1):
        raise ValueError("a polynomial needs as many y as x, and a degree of 0 or more, without a constant 1 or more")
    low, high = np.inf, -np.inf
    for i in range(n):
        low, high = min(low, x[i]), max(high, x[i])
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    if n < degree + 1 or not half > 0.0:
        raise ValueError("too few different x for a polynomial of this degree")
    t = np.empty(n)
    left = np.empty(n)
    before, now = np.zeros(n), np.ones(n)
    q_before, q_now, total = np.zeros(degree + 1), np.zeros(degree + 1), np.zeros(degree + 1)
    q_now[0] = 1.0
    for i in range(n):
        t[i] = (x[i] - middle) / half
        left[i] = y[i]
    if not constant:
        # Starting from p = x instead of p = 1 keeps every later polynomial a multiple of x.
        q_now[0] = middle / half
        q_now[1] = 1.0
        for i in range(n):
            now[i] = x[i] / half
    norm_before = 0.0
    for _ in range(0 if constant else 1, degree + 1):
        norm, along, weighted = 0.0, 0.0, 0.0
        for i in range(n):
            square = now[i] * now[i]
            norm += square
            weighted += t[i] * square
            along += left[i] * now[i]
        if norm < 1e-18 * n:
            raise ValueError("too few different x for a polynomial of this degree")
        share, a = along / norm, weighted / norm
        b = norm / norm_before if norm_before > 0.0 else 0.0
        norm_before = norm
        for j in range(degree, -1, -1):
            total[j] += share * q_now[j]
            raised = q_now[j - 1] if j > 0 else 0.0
            q_before[j] = raised - a * q_now[j] - b * q_before[j]
        q_before, q_now = q_now, q_before
        for i in range(n):
            left[i] -= share * now[i]
            before[i] = (t[i] - a) * now[i] - b * before[i]
        before, now = now, before
    # From powers of t = (x - middle) / half to powers of x: scale, then shift by repeated synthetic division.
    scale = 1.0
    for j in range(degree + 1):
        total[j] *= scale
        scale /= half
    for j in range(degree):
        for i in range(degree - 1, j - 1, -1):
            total[i] -= middle * total[i + 1]
    if not constant:
        total[0] = 0.0
    return total[::-1].copy()


def arc_length(points: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """(n,): the way along the straight pieces from the first of ``points`` (n, d) to each, in their unit.

    >>> arc_length(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 6.0]])).tolist()
    [0.0, 5.0, 7.0]
    """
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


@njit(cache=True, nogil=True)
def turning_angles(points: FloatArray, cos: float, sin: float) -> FloatArray:
    """Angle of each of the n - 1 chords of ``points`` (n, 2) against the axis (``cos``, ``sin``), in rad.

    Summed up from chord to chord, so that it runs on past 180 degrees. Raises ValueError for points of another shape.
    """
    n = points.shape[0]
    if n < 1 or points.shape[1] != 2:
        raise ValueError("chords need points (n, 2)")
    angles = np.empty(n - 1)
    angle, u, v = 0.0, cos, sin
    for i in range(n - 1):
        du, dv = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        angle += np.arctan2(u * dv - v * du, u * du + v * dv)
        angles[i] = angle
        u, v = du, dv
    return angles


@lru_cache(maxsize=64)
def angle_matrix(points: int, degree: int) -> FloatArray:
    """(degree + 1, points - 1): chord angles of a curve, uniform in arc length, -> its Legendre coefficients.

    A chord's direction is the mean of the tangent angle along it up to third order, so the unknown series is compared
    by its means over the chords. Raises ValueError where ``points`` are too few.
    """
    if points < degree + 2:
        raise ValueError(f"angle series of degree {degree}: expected at least {degree + 2} points, got {points}")
    edges = np.linspace(-1.0, 1.0, points)
    means = np.empty((points - 1, degree + 1))
    for k in range(degree + 1):
        integral = legendre.legint(np.eye(degree + 1)[k])
        means[:, k] = np.diff(legendre.legval(edges, integral)) / np.diff(edges)
    matrix = np.ascontiguousarray(np.linalg.pinv(means), dtype=np.float64)
    matrix.setflags(write=False)
    return matrix


def curve_from_angle(coefficients: FloatArray, length: float, points: int = 64) -> FloatArray:
    """(points, 2): the curve from the origin with these coefficients of its tangent angle, see `angle_matrix`.

    ``length`` is its arc length; the points are uniform in it.
    """
    nodes, weights = legendre.leggauss(4)
    edges = np.linspace(-1.0, 1.0, points)
    half = 1.0 / (points - 1)
    at = edges[:-1, None] + half * (1.0 + nodes)
    angle = legendre.legval(at, coefficients)
    steps = np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], axis=1) * (0.5 * half * length)
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
