"""Where a shaft ends: the position of its tip along the axis, and denser stations at both ends.

Two ways of finding the tip. `tip_by_contrast`: the first clear edge of grey level along the axis. `tip_by_colour`, for
a catheter of known length: a metal tip may have the luminance of the ground, or of the tissue that it touches, but
seldom its colour and the same lustre across. So the image is straightened along the axis over all likely positions of
the tip, and the round front is moved along it. The tip is where the means on its two sides differ most, in every
channel and at every distance from the axis, and where the length is likely. For white noise that is the difference in
the mixture of channels and distances that separates them best (Fisher's linear discriminant).
"""

import math

import numpy as np

from ._pixels import Raster, colour_between, edge_near, fast, grey_between, measure_pair
from ._spline import Spline, axis_at, spline_at
from ._stations import ARC, KIND, SHAFT, WEIGHT, WIDTH, U, V

BASE_STATIONS, BASE_STEP_RADII = 5, 0.4
"""Stations measured again at the base, and the distance between them in radii of the shaft."""
TIP_STATIONS, TIP_FIRST_RADII, TIP_STEP_RADII = 6, 0.6, 0.35
"""Stations measured again at the tip, the distance of the first one from it and between them, in radii."""
TIP_BACK = 8.0
"""Least length in px that is read before the last station, for the grey level before the edge of the tip."""
POINTS_ACROSS = 9
ACROSS_RADII = 0.85
"""Points across the shaft, and the distance of the outermost from the axis in radii."""
ROWS = 160
CELLS = 3 * POINTS_ACROSS
WINDOW_RADII = 1.3
"""Length that is compared before and behind the front."""
MAX_RIM_RADII = 0.7
"""Largest width of the dark rim of a metal tip."""
CLEAR_SHARE, CLEAR_RATIO = 0.45, 1.4
"""A clear edge has at least this share of the steepest one nearby, and this ratio to the average."""
TIP_SIZE = (ROWS + 1) * CELLS + ROWS
"""Numbers of working memory that `tip_by_colour` needs."""


@fast
def tip_by_contrast(
    image: Raster, sign: float, spline: Spline, last: float, half: float, back: float, ahead: float, typical: float,
    profile: np.ndarray,
) -> tuple[float, float]:  # fmt: skip
    """Finds the tip where the axis crosses half the grey level.

    The drop is 0 where no clear edge ends the shaft: it touches something of its own grey level, or leaves the image.

    Args:
        image: the frame.
        sign: +1 for a light shaft, -1 for a dark one.
        spline: the axis.
        last: arc length of the last station in px.
        half: half of the shaft's width in px.
        back: length in px that is searched before the last station.
        ahead: length in px that is searched behind it.
        typical: contrast of the shaft in grey levels.
        profile: (k,) buffer.

    Returns:
        Arc length of the tip in px, and the drop of grey level there.
    """
    back = min(back, last - 1.0)
    first = last - back
    n = min(int(back + ahead + 4.0), profile.shape[0], int(spline.length - first))
    for j in range(n):
        u, v, du, dv = spline_at(spline, first + j)
        norm = math.sqrt(du * du + dv * dv)
        nu, nv = -dv / norm, du / norm
        total = 0.0
        for k in range(-2, 3):
            x = 0.15 * half * k
            a, b = u + x * nu, v + x * nv
            if a < image.left or b < image.top or a > image.right - 1.001 or b > image.bottom - 1.001:
                a = min(max(a, image.left), image.right - 1.001)
                b = min(max(b, image.top), image.bottom - 1.001)
            total += grey_between(image, a, b)
        profile[j] = sign * total / 5.0
    middle = last + 0.5 * (ahead - back + TIP_BACK - 1.0)
    reach = 0.5 * (ahead + back - TIP_BACK + 1.0) + 1.0
    place, drop = edge_near(profile, n, first, middle, reach, half < 3.5, 0.6)
    if abs(drop) < max(8.0, 0.12 * typical):
        return last, 0.0
    return place, drop


@fast
def measure_ends(
    image: Raster, sign: float, spline: Spline, tip: float, half: float, heading: float, least: float,
    profile: np.ndarray, stations: np.ndarray, n: int,
) -> int:  # fmt: skip
    """Measures the shaft more densely at its base and its tip, along the curve fitted so far.

    A curve fitted from one side only is uncertain at its ends, where the stations are as far apart as elsewhere; and at
    a rounded tip the pair of flanks grows narrow but stays centred on the axis.

    Args:
        image: the frame.
        sign: +1 for a light shaft, -1 for a dark one.
        spline: the curve fitted so far.
        tip: arc length of the tip in px.
        half: half of the shaft's width in px.
        heading: direction into the image at the base in radians, across the base line.
        least: smallest drop of each flank in grey levels.
        profile: (k,) buffer.
        stations: (k, 6) array of stations; new ones are added.
        n: number of stations.

    Returns:
        Number of all stations.
    """
    room = min(n + 16, stations.shape[0])
    line_u, line_v = -math.sin(heading), math.cos(heading)
    for k in range(BASE_STATIONS + TIP_STATIONS):
        if n == room:
            break
        at_base = k < BASE_STATIONS
        if at_base:
            s = 1.0 + BASE_STEP_RADII * half * k
            wide = half
        else:
            # chords of the round end, then the full width
            j = k - BASE_STATIONS
            back = (TIP_FIRST_RADII + TIP_STEP_RADII * j) * half
            s = tip - back
            wide = half * math.sqrt(1.0 - (1.0 - back / half) ** 2) if back < half else half
        if s < 0.0 or s > spline.length:
            continue
        u, v, du, dv = spline_at(spline, s)
        norm = math.sqrt(du * du + dv * dv)
        nu, nv = -dv / norm, du / norm
        slant = 1.0
        margin = half + 2.0
        leaves = u - abs(nu) * margin < image.left or u + abs(nu) * margin > image.right - 1.0
        leaves = leaves or v - abs(nv) * margin < image.top or v + abs(nv) * margin > image.bottom - 1.0
        if at_base and leaves:
            slant = max(0.5, nu * line_u + nv * line_v)
        pu, pv = (nu, nv) if slant == 1.0 else (line_u, line_v)
        reach = min(max(0.28 * wide, 1.5), 5.0)
        if u < image.left or v < image.top or u > image.right - 1.001 or v > image.bottom - 1.001:
            continue
        left, left_drop, right, right_drop = measure_pair(image, sign, u, v, pu, pv, wide / slant, reach, profile)
        if left_drop < least or right_drop < least:
            continue
        off = 0.5 * (right - left) * slant
        deviation = 0.5 * (left + right) * slant - wide
        stations[n, U] = u + off * nu
        stations[n, V] = v + off * nv
        stations[n, ARC] = s
        stations[n, WIDTH] = (left + right) * slant
        stations[n, WEIGHT] = 0.05 / (0.05 + deviation * deviation)
        stations[n, KIND] = SHAFT
        n += 1
    return n


@fast
def tip_by_colour(
    image: Raster, spline: Spline, straight: float, expected: float, spread: float, half: float, work: np.ndarray
) -> tuple[float, float]:
    """Finds the tip as the front across which the colours differ most, near where it is expected.

    The axis is the spline, straight beyond ``straight``.

    Args:
        image: the frame.
        spline: the axis.
        straight: arc length in px beyond which the axis follows its tangent.
        expected: expected arc length of the tip in px.
        spread: standard deviation of ``expected`` in px.
        half: half of the shaft's width in px.
        work: working memory of `TIP_SIZE` numbers.

    Returns:
        Arc length of the tip in px, and its contrast: the difference between before and behind the front in grey
        levels, root mean square; 0 where the image ends before.
    """
    step = max(1.0, half / 6.0)
    window = max(3, int(WINDOW_RADII * half / step + 0.5))
    reach = min(2.3 * spread, 0.5 * (ROWS - 2 * window - 8) * step)
    start = expected - reach - (window + 2) * step
    if start < 1.0:
        start = 1.0
    rows = min(ROWS, int((expected + reach - start) / step) + window + 3)
    channels = image.channels
    cells = channels * POINTS_ACROSS
    sums = work[: (ROWS + 1) * CELLS].reshape((ROWS + 1, CELLS))
    slope = work[(ROWS + 1) * CELLS :]
    sums[0, :] = 0.0
    seen = 0
    for j in range(rows):
        s = start + j * step
        u, v, du, dv = axis_at(spline, straight, s)
        if u < image.left or v < image.top or u > image.right - 1.001 or v > image.bottom - 1.001:
            break
        norm = math.sqrt(du * du + dv * dv)
        du /= norm
        dv /= norm
        for k in range(POINTS_ACROSS):
            x = ACROSS_RADII * (2.0 * k / (POINTS_ACROSS - 1) - 1.0)
            # the front is round: beside the axis it is further back
            back = half * (1.0 - math.sqrt(1.0 - x * x))
            a = min(max(u - x * half * dv - back * du, image.left), image.right - 1.001)
            b = min(max(v + x * half * du - back * dv, image.top), image.bottom - 1.001)
            for c in range(channels):
                m = k * channels + c
                sums[j + 1, m] = sums[j, m] + colour_between(image, c, a, b)
        seen += 1
    best, at = 0.0, -1
    for j in range(window + 1, seen - window - 1):
        far = (start + j * step - expected) / spread
        total = 0.0
        for m in range(cells):
            apart = sums[j - 1, m] - sums[j - 1 - window, m] - sums[j + 2 + window, m] + sums[j + 2, m]
            total += apart * apart
        total = math.sqrt(total / cells) / window * math.exp(-0.5 * far * far)
        if total > best:
            best, at = total, j
    if at < 0:
        return expected, 0.0
    stands = best * math.exp(0.5 * ((start + at * step - expected) / spread) ** 2)
    # lustre ends before the metal does: the outermost clear edge near by is the outline
    for j in range(2, seen - 2):
        total = 0.0
        for m in range(cells):
            apart = sums[j, m] - sums[j - 2, m] - sums[j + 3, m] + sums[j + 1, m]
            total += apart * apart
        far = (start + j * step - expected) / spread
        slope[j] = math.sqrt(total / cells) * math.exp(-0.5 * far * far)
    low, high = max(3, at - window // 2), min(seen - 4, at + int(MAX_RIM_RADII * half / step + 0.5))
    steepest = plain = 0.0
    for j in range(low, high + 1):
        steepest = max(steepest, slope[j])
    for j in range(2, seen - 2):
        plain += min(slope[j], steepest) / (seen - 4)
    place = float(at)
    for j in range(low, high + 1):
        here = slope[j]
        if here < slope[j - 1] or here <= slope[j + 1] or here < max(CLEAR_SHARE * steepest, CLEAR_RATIO * plain):
            continue
        place = j + 0.5 * (slope[j - 1] - slope[j + 1]) / (slope[j - 1] - 2.0 * here + slope[j + 1])
    return start + place * step, stands


@fast
def base_offset(spline: Spline, heading: float, entry_u: float, entry_v: float, depth: float) -> float:
    """Returns the arc length at which the curve, extended along its first tangent, meets the base line.

    Args:
        spline: the axis.
        heading: direction into the image in radians, across the base line.
        entry_u: position of the entry in px.
        entry_v: position of the entry in px.
        depth: distance of the entry from the base line in px.

    Returns:
        Arc length in px, negative before the first station; at most 3 px, at least -``depth`` - 3 px.
    """
    u, v, du, dv = spline_at(spline, 0.0)
    inward_u, inward_v = math.cos(heading), math.sin(heading)
    rate = du * inward_u + dv * inward_v
    inside = (u - entry_u) * inward_u + (v - entry_v) * inward_v + depth
    first = -inside / rate if rate > 0.3 else 0.0
    return min(max(first, -depth - 3.0), 3.0)
