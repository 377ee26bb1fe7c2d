"""From noisy stations to one smooth curve, its tip and its points.

The curve is a cubic B-spline u(s), v(s), fitted by weighted least squares with a penalty on third differences (a
P-spline, Eilers and Marx 1996), which leaves circular arcs alone; a second round, with outliers silenced, also has
the ends measured more densely.
Its domain reaches beyond the last station, so that the tip can be looked for along the extended axis.
"""

import math

import numpy as np

from ._fine_pixels import edge_near, fast, grey_between, measure_pair

__all__ = ["TIP_BACK", "axis_at", "fit_spline", "measure_ends", "resample", "spline_at", "tip_place"]

_BASE_N, _BASE_STEP = 5, 0.4
"""Stations measured anew at the base, and the way between them in radii of the shaft."""
_TIP_N, _TIP_FIRST, _TIP_STEP = 6, 0.6, 0.35
"""Stations measured anew at the tip, how far the first one lies before it, and the way between them, in radii."""
TIP_BACK = 8.0
"""The least that is read before the last station, to see the level that a tip's edge falls from, in px."""
_TIP_FIRM = 4.0
"""How much stiffer the curve is at its tip, where it is measured from one side only."""


@fast
def _basis(t: float) -> tuple[float, float, float, float]:
    """The four cubic B-splines that are not zero at the fraction ``t`` of an interval."""
    r = 1.0 - t
    return (
        r * r * r / 6.0,
        (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
        (3.0 * r * r * r - 6.0 * r * r + 4.0) / 6.0,
        t * t * t / 6.0,
    )


@fast
def spline_at(coefficients: np.ndarray, intervals: int, length: float, s: float) -> tuple[float, float, float, float]:
    """u, v, du/ds, dv/ds of the spline over [0, length] at ``s``."""
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
def fit_spline(
    stations: np.ndarray,
    n: int,
    length: float,
    intervals: int,
    stiffness: float,
    coefficients: np.ndarray,
    band: np.ndarray,
    weights: np.ndarray,
) -> float:
    """Fill ``coefficients`` (intervals + 3, 2); returns the weighted RMS distance of the stations in px.

    ``stations`` (n, 6): u, v, s, width, weight, kind. ``weights`` (n,) are the ones used; on return they are those
    for a further round, smaller where a station lies off the curve. ``band`` is scratch.
    """
    m = intervals + 3
    for i in range(m):
        coefficients[i, 0] = 0.0
        coefficients[i, 1] = 0.0
        for j in range(4):
            band[i, j] = 0.0
    for i in range(n):
        x = stations[i, 2] / length * intervals
        k = min(int(x), intervals - 1)
        basis = _basis(x - k)
        w = weights[i]
        for a in range(4):
            wa = w * basis[a]
            coefficients[k + a, 0] += wa * stations[i, 0]
            coefficients[k + a, 1] += wa * stations[i, 1]
            for b in range(a + 1):
                band[k + a, a - b] += wa * basis[b]
    for i in range(m - 3):
        penalty = (-1.0, 3.0, -3.0, 1.0)
        firm = stiffness * (_TIP_FIRM if i > m - 7 else 1.0)
        for a in range(4):
            for b in range(a + 1):
                band[i + a, a - b] += firm * penalty[a] * penalty[b]
    # nothing is measured beyond the ends: there the curve is kept from bending on
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
        u, v, du, dv = spline_at(coefficients, intervals, length, stations[i, 2])
        off = ((stations[i, 1] - v) * du - (stations[i, 0] - u) * dv) / math.sqrt(du * du + dv * dv)
        spread += weights[i] * off * off
        weight += weights[i]
        weights[i] = off
    rms = math.sqrt(spread / max(weight, 1e-9))
    scale = max(4.0 * rms, 0.2)
    for i in range(n):
        odd = weights[i] / scale
        weights[i] = stations[i, 4] / ((1.0 + odd * odd) * (1.0 + odd * odd))
    return rms


@fast
def tip_place(
    pixels: np.ndarray,
    row: int,
    channels: int,
    box: np.ndarray,
    sign: float,
    coefficients: np.ndarray,
    intervals: int,
    length: float,
    last: float,
    half: float,
    back: float,
    ahead: float,
    typical: float,
    scratch: np.ndarray,
) -> tuple[float, float]:
    """Arc length of the tip: the half-way crossing along the axis, and the drop of grey level there.

    The drop is 0 where no clear edge ends the shaft between ``back`` px before the last station and ``ahead`` px behind
    it: it touches something of its own grey level, or runs out of the picture.
    """
    back = min(back, last - 1.0)
    first = last - back
    n = min(int(back + ahead + 4.0), scratch.shape[0], int(length - first))
    for j in range(n):
        u, v, du, dv = spline_at(coefficients, intervals, length, first + j)
        norm = math.sqrt(du * du + dv * dv)
        nu, nv = -dv / norm, du / norm
        total = 0.0
        for k in range(-2, 3):
            x = 0.15 * half * k
            a, b = u + x * nu, v + x * nv
            if a < box[0] or b < box[1] or a > box[2] - 1.001 or b > box[3] - 1.001:
                a = min(max(a, box[0]), box[2] - 1.001)
                b = min(max(b, box[1]), box[3] - 1.001)
            total += grey_between(pixels, row, channels, a, b)
        scratch[j] = sign * total / 5.0
    middle = last + 0.5 * (ahead - back + TIP_BACK - 1.0)
    reach = 0.5 * (ahead + back - TIP_BACK + 1.0) + 1.0
    place, drop = edge_near(scratch, n, first, middle, reach, half < 3.5, 0.6)
    if abs(drop) < max(8.0, 0.12 * typical):
        return last, 0.0
    return place, drop


@fast
def measure_ends(
    pixels: np.ndarray,
    row: int,
    channels: int,
    box: np.ndarray,
    sign: float,
    coefficients: np.ndarray,
    intervals: int,
    length: float,
    tip: float,
    half: float,
    heading: float,
    least: float,
    scratch: np.ndarray,
    stations: np.ndarray,
    n: int,
) -> int:
    """Measure the shaft more densely at its base and its tip, along the curve fitted so far.

    A curve fitted to one side only is unsure at its ends; there the stations are as far apart as elsewhere, and at a
    rounded tip the pair of flanks grows narrow but stays centred on the axis. ``stations[n:]`` receives the new ones;
    their number is returned. Both flanks must drop by ``least``.
    """
    room = min(n + 16, stations.shape[0])
    line_u, line_v = -math.sin(heading), math.cos(heading)
    for k in range(_BASE_N + _TIP_N):
        if n == room:
            break
        at_base = k < _BASE_N
        if at_base:
            s = 1.0 + _BASE_STEP * half * k
            wide = half
        else:
            # chords of the round end, then the full width
            j = k - _BASE_N
            back = (_TIP_FIRST + _TIP_STEP * j) * half
            s = tip - back
            wide = half * math.sqrt(1.0 - (1.0 - back / half) ** 2) if back < half else half
        if s < 0.0 or s > length:
            continue
        u, v, du, dv = spline_at(coefficients, intervals, length, s)
        norm = math.sqrt(du * du + dv * dv)
        nu, nv = -dv / norm, du / norm
        slant = 1.0
        margin = half + 2.0
        if at_base and (u - abs(nu) * margin < box[0] or u + abs(nu) * margin > box[2] - 1.0
                or v - abs(nv) * margin < box[1] or v + abs(nv) * margin > box[3] - 1.0):  # fmt: skip
            slant = max(0.5, nu * line_u + nv * line_v)
        pu, pv = (nu, nv) if slant == 1.0 else (line_u, line_v)
        reach = min(max(0.28 * wide, 1.5), 5.0)
        if u < box[0] or v < box[1] or u > box[2] - 1.001 or v > box[3] - 1.001:
            continue
        left, left_drop, right, right_drop = measure_pair(
            pixels, row, channels, box, sign, u, v, pu, pv, wide / slant, reach, scratch
        )
        if left_drop < least or right_drop < least:
            continue
        off = 0.5 * (right - left) * slant
        strange = 0.5 * (left + right) * slant - wide
        stations[n, 0] = u + off * nu
        stations[n, 1] = v + off * nv
        stations[n, 2] = s
        stations[n, 3] = (left + right) * slant
        stations[n, 4] = 0.05 / (0.05 + strange * strange)
        stations[n, 5] = 1.0
        n += 1
    return n


@fast
def axis_at(
    coefficients: np.ndarray, intervals: int, length: float, straight: float, s: float
) -> tuple[float, float, float, float]:
    """As `spline_at`, but straight on behind ``straight``."""
    u, v, du, dv = spline_at(coefficients, intervals, length, min(s, straight))
    over = max(0.0, s - straight)
    return u + over * du, v + over * dv, du, dv


@fast
def resample(
    coefficients: np.ndarray,
    intervals: int,
    length: float,
    first: float,
    last: float,
    straight: float,
    work: np.ndarray,
    out: np.ndarray,
) -> float:
    """``out`` (n, 2): points of the curve from ``first`` to ``last``, uniform in arc length; returns that length.

    Beyond ``straight`` the curve goes on along its tangent: in its round end the shaft has no curvature of its own.
    """
    n = out.shape[0]
    m = work.shape[0]
    pu, pv, _, _ = axis_at(coefficients, intervals, length, straight, first)
    total = 0.0
    work[0] = 0.0
    for i in range(1, m):
        u, v, _, _ = axis_at(coefficients, intervals, length, straight, first + (last - first) * i / (m - 1))
        total += math.sqrt((u - pu) ** 2 + (v - pv) ** 2)
        work[i] = total
        pu, pv = u, v
    k = 0
    for i in range(n):
        want = total * i / (n - 1)
        while k < m - 2 and work[k + 1] < want:
            k += 1
        part = (want - work[k]) / (work[k + 1] - work[k])
        u, v, _, _ = axis_at(coefficients, intervals, length, straight, first + (last - first) * (k + part) / (m - 1))
        out[i, 0] = u
        out[i, 1] = v
    return total
