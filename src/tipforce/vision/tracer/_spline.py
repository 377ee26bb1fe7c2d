"""The axis of a shaft as a smoothing spline, fitted to noisy stations.

The curve is a cubic B-spline u(s), v(s), fitted by weighted least squares with a penalty on third differences (a
P-spline, Eilers and Marx 1996), which leaves circular arcs unchanged. Its domain extends beyond the last station, so
that the tip can be searched along the extended axis.
"""

import math
from typing import NamedTuple

import numpy as np

from ._pixels import fast
from ._stations import ARC, WEIGHT, U, V

TIP_STIFFNESS_FACTOR = 4.0
"""Factor of the stiffness at the tip, where the curve is measured from one side only."""
STIFFNESS = 0.05
"""Weight of the penalty on third differences."""
HEADING_RADII = 16.0
"""The direction of the shaft is fitted to this length before its end."""
OUTLIER_PX = 0.3
"""Stations at this distance from the fitted direction have a quarter of the weight."""


class Spline(NamedTuple):
    """A curve over arc lengths, of cubic B-splines with equal intervals.

    Attributes:
        coefficients: (at least ``intervals`` + 3, 2) in px.
        intervals: number of intervals.
        length: the curve is over [0, ``length``] in px.
    """

    coefficients: np.ndarray
    intervals: int
    length: float


class FitBuffers(NamedTuple):
    """Working memory of `fit_axis`.

    Attributes:
        coefficients: (100, 2).
        band: (100, 4).
        weights: (number of stations,).
    """

    coefficients: np.ndarray
    band: np.ndarray
    weights: np.ndarray


@fast
def _basis(t: float) -> tuple[float, float, float, float]:
    """Returns the four cubic B-splines that are not zero at the fraction ``t`` of an interval."""
    r = 1.0 - t
    return (
        r * r * r / 6.0,
        (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
        (3.0 * r * r * r - 6.0 * r * r + 4.0) / 6.0,
        t * t * t / 6.0,
    )


@fast
def spline_at(spline: Spline, s: float) -> tuple[float, float, float, float]:
    """Evaluates a spline.

    Args:
        spline: the curve.
        s: arc length in px.

    Returns:
        u, v in px and du/ds, dv/ds.
    """
    coefficients, intervals, length = spline.coefficients, spline.intervals, spline.length
    x = s / length * intervals
    k = int(x)
    if k < 0:
        k = 0
    if k > intervals - 1:
        k = intervals - 1
    t = x - k
    a, b, c, d = _basis(t)
    r = 1.0 - t
    scale = intervals / length
    da = -0.5 * r * r * scale
    db = (1.5 * t * t - 2.0 * t) * scale
    dc = -(1.5 * r * r - 2.0 * r) * scale
    dd = 0.5 * t * t * scale
    p, q, w, z = coefficients[k], coefficients[k + 1], coefficients[k + 2], coefficients[k + 3]
    return (
        a * p[0] + b * q[0] + c * w[0] + d * z[0],
        a * p[1] + b * q[1] + c * w[1] + d * z[1],
        da * p[0] + db * q[0] + dc * w[0] + dd * z[0],
        da * p[1] + db * q[1] + dc * w[1] + dd * z[1],
    )


@fast
def fit_spline(spline: Spline, stations: np.ndarray, n: int, band: np.ndarray, weights: np.ndarray) -> float:
    """Fits the coefficients of a spline to stations by weighted least squares.

    Args:
        spline: the curve; its coefficients are filled.
        stations: (k, 6) array of stations.
        n: number of stations.
        band: (spline.intervals + 3, 4) buffer, or longer.
        weights: (n,) weights of the stations; on return those for a further round, smaller where a station is off the
            curve.

    Returns:
        Weighted RMS distance of the stations in px.
    """
    coefficients, intervals, length = spline.coefficients, spline.intervals, spline.length
    m = intervals + 3
    for i in range(m):
        coefficients[i, 0] = 0.0
        coefficients[i, 1] = 0.0
        for j in range(4):
            band[i, j] = 0.0
    for i in range(n):
        x = stations[i, ARC] / length * intervals
        k = min(int(x), intervals - 1)
        basis = _basis(x - k)
        w = weights[i]
        for a in range(4):
            wa = w * basis[a]
            coefficients[k + a, 0] += wa * stations[i, U]
            coefficients[k + a, 1] += wa * stations[i, V]
            for b in range(a + 1):
                band[k + a, a - b] += wa * basis[b]
    for i in range(m - 3):
        penalty = (-1.0, 3.0, -3.0, 1.0)
        firm = STIFFNESS * (TIP_STIFFNESS_FACTOR if i > m - 7 else 1.0)
        for a in range(4):
            for b in range(a + 1):
                band[i + a, a - b] += firm * penalty[a] * penalty[b]
    # nothing is measured beyond the ends: keep the curve straight there
    for end in range(3):
        i = m - 3 - end
        second = (1.0, -2.0, 1.0)
        for a in range(3):
            for b in range(a + 1):
                band[i + a, a - b] += 0.001 * second[a] * second[b]
    # banded Cholesky, both right-hand sides solved in place
    for i in range(m):
        for j in range(max(0, i - 3), i + 1):
            total = band[i, i - j]
            for k in range(max(0, i - 3), j):
                total -= band[i, i - k] * band[j, j - k]
            if i == j:
                band[i, 0] = math.sqrt(max(total, 1e-9))
            else:
                band[i, i - j] = total / band[j, 0]
    for axis in range(2):
        for i in range(m):
            total = coefficients[i, axis]
            for k in range(max(0, i - 3), i):
                total -= band[i, i - k] * coefficients[k, axis]
            coefficients[i, axis] = total / band[i, 0]
        for i in range(m - 1, -1, -1):
            total = coefficients[i, axis]
            for k in range(i + 1, min(m, i + 4)):
                total -= band[k, k - i] * coefficients[k, axis]
            coefficients[i, axis] = total / band[i, 0]
    spread = 0.0
    weight = 0.0
    for i in range(n):
        u, v, du, dv = spline_at(spline, stations[i, ARC])
        off = ((stations[i, V] - v) * du - (stations[i, U] - u) * dv) / math.sqrt(du * du + dv * dv)
        spread += weights[i] * off * off
        weight += weights[i]
        weights[i] = off
    rms = math.sqrt(spread / max(weight, 1e-9))
    scale = max(4.0 * rms, 0.2)
    for i in range(n):
        odd = weights[i] / scale
        weights[i] = stations[i, WEIGHT] / ((1.0 + odd * odd) * (1.0 + odd * odd))
    return rms


@fast
def fit_axis(stations: np.ndarray, n: int, half: float, length: float, buffers: FitBuffers) -> tuple[Spline, float]:
    """Fits a spline to the stations of a shaft.

    Args:
        stations: (k, 6) array of stations.
        n: number of stations.
        half: half of the shaft's width in px, which sets the number of intervals.
        length: the spline is over [0, ``length``] in px.
        buffers: working memory; it holds the coefficients.

    Returns:
        The spline and the weighted RMS distance of the stations in px.
    """
    intervals = int(min(max(length / max(2.4 * half, 8.0), 6.0), 80.0))
    spline = Spline(buffers.coefficients, intervals, length)
    for i in range(n):
        buffers.weights[i] = stations[i, WEIGHT]
    rms = fit_spline(spline, stations, n, buffers.band, buffers.weights)
    return spline, rms


@fast
def axis_at(spline: Spline, straight: float, s: float) -> tuple[float, float, float, float]:
    """Evaluates a spline as `spline_at`, but straight beyond a point.

    Args:
        spline: the curve.
        straight: arc length in px beyond which the curve follows its tangent.
        s: arc length in px.

    Returns:
        u, v in px and du/ds, dv/ds.
    """
    u, v, du, dv = spline_at(spline, min(s, straight))
    over = max(0.0, s - straight)
    return u + over * du, v + over * dv, du, dv


@fast
def resample(spline: Spline, first: float, last: float, straight: float, work: np.ndarray, out: np.ndarray) -> float:
    """Samples a spline uniformly in arc length.

    In its round tip the shaft has no curvature of its own, so the curve follows its tangent there.

    Args:
        spline: the curve.
        first: arc length of the first point in px.
        last: arc length of the last point in px.
        straight: arc length in px beyond which the curve follows its tangent.
        work: (m,) buffer; the length is integrated in m - 1 steps.
        out: (n, 2) array that receives the points u, v in px.

    Returns:
        Length from the first to the last point in px.
    """
    n = out.shape[0]
    m = work.shape[0]
    pu, pv, _, _ = axis_at(spline, straight, first)
    total = 0.0
    work[0] = 0.0
    for i in range(1, m):
        u, v, _, _ = axis_at(spline, straight, first + (last - first) * i / (m - 1))
        total += math.sqrt((u - pu) ** 2 + (v - pv) ** 2)
        work[i] = total
        pu, pv = u, v
    k = 0
    for i in range(n):
        want = total * i / (n - 1)
        while k < m - 2 and work[k + 1] < want:
            k += 1
        part = (want - work[k]) / (work[k + 1] - work[k])
        u, v, _, _ = axis_at(spline, straight, first + (last - first) * (k + part) / (m - 1))
        out[i, 0] = u
        out[i, 1] = v
    return total


@fast
def heading(stations: np.ndarray, n: int, half: float, back: float) -> tuple[float, float, float, float]:
    """Finds the direction of the shaft near its last station by a robust parabola.

    Args:
        stations: (k, 6) array of stations.
        n: number of stations.
        half: half of the shaft's width in px.
        back: distance before the last station in px.

    Returns:
        u, v in px, angle in radians and curvature in 1/px, ``back`` before the last station.
    """
    low = n - 1
    while low > 0 and stations[n - 1, ARC] - stations[low - 1, ARC] < HEADING_RADII * half:
        low -= 1
    end_u, end_v = stations[n - 1, U], stations[n - 1, V]
    run_u, run_v = end_u - stations[low, U], end_v - stations[low, V]
    run = max(math.hypot(run_u, run_v), 1e-6)
    run_u /= run
    run_v /= run
    order = min(2, (n - low) // 4) + 1
    sums = np.zeros((3, 4))
    c = np.zeros(3)
    for turn in range(3):
        sums[:] = 0.0
        for i in range(low, n):
            x = ((stations[i, U] - end_u) * run_u + (stations[i, V] - end_v) * run_v) / half
            y = ((stations[i, V] - end_v) * run_u - (stations[i, U] - end_u) * run_v) / half
            off = (y - c[0] - x * (c[1] + x * c[2])) * half / OUTLIER_PX
            w = stations[i, WEIGHT] + 0.01
            if turn > 0:
                w /= (1.0 + off * off) * (1.0 + off * off)
            p = w
            for k in range(order):
                q = p
                for m in range(order):
                    sums[k, m] += q
                    q *= x
                sums[k, 3] += p * y
                p *= x
        for k in range(order):
            sums[k, k] *= 1.0 + 1e-9
            for m in range(k + 1, order):
                part = sums[m, k] / max(sums[k, k], 1e-12)
                for j in range(4):
                    sums[m, j] -= part * sums[k, j]
        for k in range(order - 1, -1, -1):
            total = sums[k, 3]
            for m in range(k + 1, order):
                total -= sums[k, m] * c[m]
            c[k] = total / max(sums[k, k], 1e-12)
    x = -back / half
    y = (c[0] + x * (c[1] + x * c[2])) * half
    slope = c[1] + 2.0 * x * c[2]
    bend = 2.0 * c[2] / half / (1.0 + slope * slope) ** 1.5
    angle = math.atan2(run_v, run_u) + math.atan(slope)
    return end_u + x * half * run_u - y * run_v, end_v + x * half * run_v + y * run_u, angle, bend
