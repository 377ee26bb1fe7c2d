"""Two descriptions of a planar curve: the polynomial y(x), and the tangent angle over arc length."""

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from numpy.polynomial import legendre

from ..types import FloatArray


@njit(cache=True, nogil=True)
def fit_polynomial(x: FloatArray, y: FloatArray, degree: int, constant: bool = True) -> FloatArray:
    """Fits a polynomial y(x) by least squares, thesis eq. (2).

    The fit uses polynomials that are orthogonal on the given points (Forsythe 1957), so no system of equations is
    solved.

    Args:
        x: (n,) abscissae.
        y: (n,) ordinates.
        degree: degree of the polynomial.
        constant: whether there is a constant term; without it y(0) = 0, and the last coefficient is exactly zero.

    Returns:
        (degree + 1,) coefficients, highest power first.

    Raises:
        ValueError: there are fewer than ``degree + 1`` different x, or the lengths of x and y differ.

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
    residual = np.empty(n)
    previous, current = np.zeros(n), np.ones(n)
    q_previous, q_current, total = np.zeros(degree + 1), np.zeros(degree + 1), np.zeros(degree + 1)
    q_current[0] = 1.0
    for i in range(n):
        t[i] = (x[i] - middle) / half
        residual[i] = y[i]
    if not constant:
        # If the first polynomial is p = x instead of p = 1, every later one is a multiple of x.
        q_current[0] = middle / half
        q_current[1] = 1.0
        for i in range(n):
            current[i] = x[i] / half
    norm_previous = 0.0
    for _ in range(0 if constant else 1, degree + 1):
        norm, along, weighted = 0.0, 0.0, 0.0
        for i in range(n):
            square = current[i] * current[i]
            norm += square
            weighted += t[i] * square
            along += residual[i] * current[i]
        if norm < 1e-18 * n:
            raise ValueError("too few different x for a polynomial of this degree")
        # Forsythe's recurrence: p_next = (t - a) p - b p_previous is orthogonal to all earlier polynomials.
        share, a = along / norm, weighted / norm
        b = norm / norm_previous if norm_previous > 0.0 else 0.0
        norm_previous = norm
        for j in range(degree, -1, -1):
            total[j] += share * q_current[j]
            raised = q_current[j - 1] if j > 0 else 0.0
            q_previous[j] = raised - a * q_current[j] - b * q_previous[j]
        q_previous, q_current = q_current, q_previous
        for i in range(n):
            residual[i] -= share * current[i]
            previous[i] = (t[i] - a) * current[i] - b * previous[i]
        previous, current = current, previous
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
    """Returns the (n,) arc lengths from the first of ``points`` (n, d) to each, along straight pieces, in their unit.

    >>> arc_length(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 6.0]])).tolist()
    [0.0, 5.0, 7.0]
    """
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def resampled(points: FloatArray, count: int) -> FloatArray:
    """Returns (count, d) points evenly in arc length along ``points`` (n, d), both ends among them.

    >>> resampled(np.array([[0.0, 0.0], [1.0, 0.0], [4.0, 0.0]]), 3).tolist()
    [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]
    """
    arc = arc_length(points)
    wanted = np.linspace(0.0, arc[-1], count)
    return np.column_stack([np.interp(wanted, arc, column) for column in points.T])


def tangents_and_normals(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the unit tangents and unit normals of a line, (n, 2) each.

    A normal is its tangent turned from the first axis toward the second: in an image (u right, v down) it points to the
    right of the way along the line.

    Args:
        points: (n, 2) points of the line, at least two.

    >>> tangents, normals = tangents_and_normals(np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]))
    >>> tangents[0].tolist(), normals[0].tolist()
    ([1.0, 0.0], [-0.0, 1.0])
    """
    tangents = np.gradient(points, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9)
    return tangents, np.column_stack([-tangents[:, 1], tangents[:, 0]])


@njit(cache=True, nogil=True)
def turning_angles(points: FloatArray, cos: float, sin: float) -> FloatArray:
    """Returns the angles of the chords of a curve against an axis.

    The angles are summed from chord to chord, so they continue beyond 180 degrees.

    Args:
        points: (n, 2) points of the curve.
        cos: cosine of the axis' angle.
        sin: sine of the axis' angle.

    Returns:
        (n - 1,) angles in rad.

    Raises:
        ValueError: ``points`` has another shape.
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
    """Returns the matrix from the chord angles of a curve to its Legendre coefficients.

    The curve is uniform in arc length. A chord's direction is the mean of the tangent angle along it up to third order,
    so the matrix fits the means of the series over the chords.

    Args:
        points: number of points of the curve.
        degree: degree of the series.

    Returns:
        (degree + 1, points - 1) matrix.

    Raises:
        ValueError: there are fewer than ``degree + 2`` points.
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
    """Returns the curve from the origin whose tangent angle has these coefficients, see `angle_matrix`.

    Args:
        coefficients: (k,) Legendre coefficients of the tangent angle in rad.
        length: arc length of the curve.
        points: number of points; they are uniform in arc length.

    Returns:
        (points, 2) points, in the unit of ``length``.
    """
    nodes, weights = legendre.leggauss(4)
    edges = np.linspace(-1.0, 1.0, points)
    half_step = 1.0 / (points - 1)
    arc = edges[:-1, None] + half_step * (1.0 + nodes)
    angle = legendre.legval(arc, coefficients)
    steps = np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], axis=1) * (0.5 * half_step * length)
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
