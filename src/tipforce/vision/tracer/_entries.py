"""Finds where a shaft may enter the image: pairs of opposite edges along one line of pixels.

The base line is the border of the image, or of the region that the user stated. A shaft that crosses it appears there
as a rise of grey level followed by a fall (or the reverse for a dark shaft). Each such pair is a candidate; the one
with the highest contrast is traced first.
"""

from typing import Any, NamedTuple

import numpy as np

from ._pixels import Raster, fast, grey_at

AVERAGED_ROWS = 3
"""The base line is averaged over this many parallel lines of pixels, toward the inside of the image."""
MAX_EDGES_PER_ENTRY = 6
"""A rising edge is paired with at most this many edges behind it."""
EDGE_TO_CONTRAST = 1.3
"""The contrast of an entry is at most this multiple of its weaker edge: a slow slope is no flank."""


class BaseLine(NamedTuple):
    """A line of pixels; one step along it is (du, dv), one step into the image is (inward_u, inward_v)."""

    u: int
    v: int
    du: int
    dv: int
    pixels: int
    """Number of pixels."""
    inward_u: int
    inward_v: int


@fast
def _average_line(image: Raster, base: BaseLine, sign: float, line: np.ndarray, slope: np.ndarray) -> None:
    """Fills ``line`` with the grey levels of the base line times ``sign``, and ``slope`` with their derivative."""
    n = base.pixels
    for i in range(n):
        total = 0.0
        for k in range(AVERAGED_ROWS):
            u, v = base.u + i * base.du + k * base.inward_u, base.v + i * base.dv + k * base.inward_v
            total += grey_at(image, u, v)
        line[i] = sign * total / AVERAGED_ROWS
    for i in range(2, n - 2):
        slope[i] = 0.5 * (line[i + 1] + line[i + 2] - line[i - 1] - line[i - 2])
    slope[0] = slope[1] = slope[n - 1] = slope[n - 2] = 0.0


@fast
def _find_edges(slope: np.ndarray, n: int, min_slope: float, edges: np.ndarray) -> int:
    """Fills ``edges`` with the indices of the local extrema of ``slope`` above ``min_slope``; returns their number."""
    count = 0
    for i in range(2, n - 2):
        steepness = abs(slope[i])
        if steepness >= min_slope and steepness >= abs(slope[i - 1]) and steepness > abs(slope[i + 1]):
            if slope[i] * slope[i - 1] < 0.0 and steepness == abs(slope[i - 1]):
                continue
            edges[count] = i
            count += 1
            if count == edges.shape[0]:
                break
    return count


@fast
def _insert_entry(entries: np.ndarray, count: int, centre: float, width: float, contrast: float, level: float) -> int:
    """Inserts an entry in the order of contrast, highest first; returns the number of entries."""
    row = count
    while row > 0 and entries[row - 1, 2] < contrast:
        row -= 1
    if row >= entries.shape[0]:
        return count
    if count < entries.shape[0]:
        count += 1
    for k in range(count - 1, row, -1):
        for column in range(4):
            entries[k, column] = entries[k - 1, column]
    entries[row, 0] = centre
    entries[row, 1] = width
    entries[row, 2] = contrast
    entries[row, 3] = level
    return count


@fast
def find_entries(
    frame: tuple[Any, ...], start: tuple[int, ...], sign: float, min_width: float, max_width: float,
    threshold: float, min_contrast: float, line: np.ndarray, slope: np.ndarray, edges: np.ndarray, entries: np.ndarray,
) -> int:  # fmt: skip
    """Finds candidates for the shaft on one line: pairs of opposite edges.

    Args:
        frame: fields of a `Raster` as a plain tuple; numba needs some 2 us to accept a named one.
        start: fields of a `BaseLine` as a plain tuple.
        sign: +1 for a light shaft, -1 for a dark one.
        min_width: smallest width along the line in px.
        max_width: largest width along the line in px.
        threshold: grey level between catheter and ground; negative if unknown.
        min_contrast: smallest contrast in grey levels.
        line: buffer, at least as long as the base line.
        slope: buffer, at least as long as the base line.
        edges: buffer of integers; its length limits the number of edges.
        entries: (k, 4) array that receives centre and width along the line in px, contrast, and grey level inside.

    Returns:
        The number of rows of ``entries`` that were filled, the highest contrast first.
    """
    image, base = Raster(*frame), BaseLine(*start)
    n = base.pixels
    _average_line(image, base, sign, line, slope)
    edge_count = _find_edges(slope, n, 0.5 * min_contrast, edges)
    count = 0
    for p in range(edge_count):
        rise = edges[p]
        if slope[rise] <= 0.0:
            continue
        for q in range(p + 1, min(p + 1 + MAX_EDGES_PER_ENTRY, edge_count)):
            fall = edges[q]
            width = float(fall - rise)
            if width > max_width:
                break
            if slope[fall] >= 0.0 or width < min_width:
                continue
            inside = 0.0
            for k in range(rise + 1, fall):
                inside += line[k]
            inside /= fall - rise - 1
            outside = max(line[max(0, rise - 3)], line[min(n - 1, fall + 3)])
            contrast = min(inside - outside, min(slope[rise], -slope[fall]) * EDGE_TO_CONTRAST)
            if contrast < min_contrast or (threshold >= 0.0 and inside < sign * threshold):
                continue
            count = _insert_entry(entries, count, 0.5 * (rise + fall), width, contrast, sign * inside)
    return count
