"""How well an image supports a centreline, however it was found.

The tracer extrapolates where no flanks are visible. This module examines its result again, in colour: do both flanks
separate the shaft from the ground along the line; are they as clear before the tip as elsewhere; does an edge end the
shaft at the tip? Lengths are in radii of the shaft and contrasts are relative to the contrast of the line, so that the
figures have the same meaning at another scale and in another light.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ._pixels import Raster, colour_between, fast

INNER_RADII, OUTER_RADII = 0.55, 1.5
"""A flank separates the levels at these distances from the axis, in radii."""
MIN_OUTER_GAP_PX = 1.2
"""The outer level is read at least this far outside of the flank."""
MIN_FLANK_GREY = 6.0
"""Smallest contrast of a visible pair of flanks."""
MAX_FLANK_GREY = 60.0
"""Largest contrast of one pair of flanks that enters the mean contrast."""
END_RADII = 16.0
"""Length of the last piece before the tip."""
GROUP_COUNT, GROUP_RADII, GROUP_ROWS = 6, 1.4, 3
"""Number of groups of rows before the tip, their length, and their rows. The groups exist because rings change the
contrast."""
FIRST_GROUP_RADII = 0.7
"""The groups begin at this distance before the tip, because the tip is round."""
EDGE_RADII, MIN_EDGE_PX = 0.3, 0.7
"""Grey levels are compared at this distance on either side of a flank."""
FRONT_ROWS, FRONT_START_RADII, FRONT_STEP_RADII = 4, 0.35, 1 / 3
"""Rows before and behind the front of the tip, how far from it they begin, and how far they are apart, in radii."""
DIRECTION_RADII = 4.0
"""The direction at the tip is the mean over this length."""


class Evidence(NamedTuple):
    """Support of an image for a centreline."""

    seen: float
    """Share of the line on which both flanks are visible."""
    seen_end: float
    """Share of the last `END_RADII` before the tip on which both flanks are visible."""
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
    inner, outer = INNER_RADII * half, max(OUTER_RADII * half, half + MIN_OUTER_GAP_PX)
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
    clear = max(EDGE_RADII * half, MIN_EDGE_PX)
    power = 0.0
    for g in range(GROUP_COUNT):
        for c in range(image.channels):
            left = right = 0.0
            for r in range(GROUP_ROWS):
                s = (FIRST_GROUP_RADII + GROUP_RADII * (g + (r + 0.5) / GROUP_ROWS)) * half
                pu, pv = u - s * du, v - s * dv
                inner, outer = half - clear, half + clear
                left += _read(image, c, pu + inner * dv, pv - inner * du)
                left -= _read(image, c, pu + outer * dv, pv - outer * du)
                right += _read(image, c, pu - inner * dv, pv + inner * du)
                right -= _read(image, c, pu - outer * dv, pv + outer * du)
            if left * right > 0.0:
                power += min(left * left, right * right)
    return math.sqrt(power / (GROUP_ROWS * GROUP_ROWS * image.channels * GROUP_COUNT))


@fast
def _front(image: Raster, u: float, v: float, du: float, dv: float, half: float) -> float:
    """Returns by how many grey levels the round front of a tip at (u, v) separates the levels before and behind it."""
    total = 0.0
    for k in range(-2, 3):
        x = 0.35 * k
        back = half * (1.0 - math.sqrt(1.0 - x * x))
        pu, pv = u - x * half * dv - back * du, v + x * half * du - back * dv
        for c in range(image.channels):
            change = 0.0
            for r in range(FRONT_ROWS):
                s = half * (FRONT_START_RADII + FRONT_STEP_RADII * r)
                change += _read(image, c, pu - s * du, pv - s * dv) - _read(image, c, pu + s * du, pv + s * dv)
            total += (change / FRONT_ROWS) ** 2
    return math.sqrt(total / (5.0 * image.channels))


@fast
def line_evidence(frame: tuple[Any, ...], points: np.ndarray, half: float) -> Evidence:
    """Returns the support of an image for a centreline.

    Args:
        frame: fields of a `Raster` as a plain tuple.
        points: (k, 2) u, v in px, base to tip, uniform in arc length.
        half: radius of the shaft in px.
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
        contrast += min(pair, MAX_FLANK_GREY) / inside
        clear = 1.0 if pair > MIN_FLANK_GREY else 0.0
        seen += clear / inside
        if (n - 1 - i) * step < END_RADII * half:
            end += 1.0
            seen_end += clear
    u, v = points[n - 1, 0], points[n - 1, 1]
    back = min(n - 1, max(1, int(DIRECTION_RADII * half / step + 0.5)))
    du, dv = u - points[n - 1 - back, 0], v - points[n - 1 - back, 1]
    norm = max(math.hypot(du, dv), 1e-9)
    du /= norm
    dv /= norm
    typical = max(contrast, MIN_FLANK_GREY)
    flanks = _end_flanks(image, u, v, du, dv, half) / typical
    return Evidence(seen, seen_end / max(end, 1.0), flanks, _front(image, u, v, du, dv, half) / typical)
