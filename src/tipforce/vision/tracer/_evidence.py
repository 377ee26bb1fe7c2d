"""How well an image supports a centreline, however it was found.

The tracer follows what it takes for the shaft, and extrapolates where nothing is seen. Here the line that came out is
looked at again, in colour: whether both flanks separate the shaft from the ground along the line, whether they do so
before the tip as clearly as elsewhere, and whether something ends at the tip. All is measured in radii of the shaft
and relative to its own contrast, so that it means the same in images of another scale or another light.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ._pixels import Raster, colour_between, fast

_IN, _OUT = 0.55, 1.5
"""A flank separates the levels at these distances from the axis, in radii."""
_OUT_PX = 1.2
"""But the outer level is read so many px outside of the flank at least."""
_FLANK = 6.0
"""Grey levels that a visible pair of flanks separates."""
_MOST = 60.0
"""Most that one pair of flanks counts in the mean contrast, in grey levels."""
_END = 16.0
"""The last stretch, in radii."""
_GROUPS, _GROUP, _ROWS = 6, 1.4, 3
"""Groups of rows before the tip, their length in radii, and their rows: rings change the contrast."""
_FIRST = 0.7
"""The groups begin so many radii before the tip, for it is round."""
_EDGE, _EDGE_PX = 0.3, 0.7
"""Levels so many radii, but at least px, on either side of a flank are compared."""
_FRONT, _FRONT_FROM, _FRONT_STEP = 4, 0.35, 1 / 3
"""Rows before and behind the front of the tip, how far from it they begin, and how far they are apart, in radii."""
_BACK = 4.0
"""The direction at the tip is that over so many radii."""


class Evidence(NamedTuple):
    """What an image says of a centreline."""

    seen: float
    """Share of the line on which both flanks are visible."""
    seen_end: float
    """The same of the last 16 radii before the tip."""
    flanks: float
    """Contrast of both flanks in the last 9 radii, in shares of the mean contrast of the line."""
    front: float
    """Contrast of the front of the tip, likewise."""


@fast
def _read(image: Raster, channel: int, u: float, v: float) -> float:
    a = min(max(u, image.left), image.right - 1.001)
    b = min(max(v, image.top), image.bottom - 1.001)
    return colour_between(image, channel, a, b)


@fast
def _pair(image: Raster, u: float, v: float, du: float, dv: float, half: float) -> float:
    """Returns by how many grey levels both flanks at (u, v) separate the shaft from the ground, to the same side."""
    inner, outer = _IN * half, max(_OUT * half, half + _OUT_PX)
    total = 0.0
    for c in range(image.channels):
        left = _read(image, c, u + inner * dv, v - inner * du) - _read(image, c, u + outer * dv, v - outer * du)
        right = _read(image, c, u - inner * dv, v + inner * du) - _read(image, c, u - outer * dv, v + outer * du)
        if left * right > 0.0:
            total += min(left * left, right * right)
    return math.sqrt(total / image.channels)


@fast
def _end_flanks(image: Raster, u: float, v: float, du: float, dv: float, half: float) -> float:
    """Returns by how many grey levels both flanks separate the levels right beside them, before a tip at (u, v)."""
    clear = max(_EDGE * half, _EDGE_PX)
    power = 0.0
    for g in range(_GROUPS):
        for c in range(image.channels):
            left = right = 0.0
            for r in range(_ROWS):
                s = (_FIRST + _GROUP * (g + (r + 0.5) / _ROWS)) * half
                pu, pv = u - s * du, v - s * dv
                inner, outer = half - clear, half + clear
                left += _read(image, c, pu + inner * dv, pv - inner * du)
                left -= _read(image, c, pu + outer * dv, pv - outer * du)
                right += _read(image, c, pu - inner * dv, pv + inner * du)
                right -= _read(image, c, pu - outer * dv, pv + outer * du)
            if left * right > 0.0:
                power += min(left * left, right * right)
    return math.sqrt(power / (_ROWS * _ROWS * image.channels * _GROUPS))


@fast
def _front(image: Raster, u: float, v: float, du: float, dv: float, half: float) -> float:
    """Returns by how many grey levels the round front of a tip at (u, v) separates what is before and behind it."""
    total = 0.0
    for k in range(-2, 3):
        x = 0.35 * k
        back = half * (1.0 - math.sqrt(1.0 - x * x))
        pu, pv = u - x * half * dv - back * du, v + x * half * du - back * dv
        for c in range(image.channels):
            change = 0.0
            for r in range(_FRONT):
                s = half * (_FRONT_FROM + _FRONT_STEP * r)
                change += _read(image, c, pu - s * du, pv - s * dv) - _read(image, c, pu + s * du, pv + s * dv)
            total += (change / _FRONT) ** 2
    return math.sqrt(total / (5.0 * image.channels))


@fast
def line_evidence(frame: tuple[Any, ...], points: np.ndarray, half: float) -> Evidence:
    """Returns what an image says of a centreline.

    ``frame``: the fields of a `Raster`, as a plain tuple. ``points`` (k, 2): u, v in px, base to tip, uniform in arc
    length. ``half``: radius of the shaft in px.
    """
    image = Raster(*frame)
    n = points.shape[0]
    step = math.hypot(points[1, 0] - points[0, 0], points[1, 1] - points[0, 1])
    inside = max(1, n - 1 - int(half / step + 0.5))
    seen = seen_end = end = contrast = 0.0
    for i in range(inside):
        before = max(i - 1, 0)
        du, dv = points[i + 1, 0] - points[before, 0], points[i + 1, 1] - points[before, 1]
        norm = max(math.hypot(du, dv), 1e-9)
        pair = _pair(image, points[i, 0], points[i, 1], du / norm, dv / norm, half)
        contrast += min(pair, _MOST) / inside
        clear = 1.0 if pair > _FLANK else 0.0
        seen += clear / inside
        if (n - 1 - i) * step < _END * half:
            end += 1.0
            seen_end += clear
    u, v = points[n - 1, 0], points[n - 1, 1]
    back = min(n - 1, max(1, int(_BACK * half / step + 0.5)))
    du, dv = u - points[n - 1 - back, 0], v - points[n - 1 - back, 1]
    norm = max(math.hypot(du, dv), 1e-9)
    du /= norm
    dv /= norm
    typical = max(contrast, _FLANK)
    flanks = _end_flanks(image, u, v, du, dv, half) / typical
    return Evidence(seen, seen_end / max(end, 1.0), flanks, _front(image, u, v, du, dv, half) / typical)
