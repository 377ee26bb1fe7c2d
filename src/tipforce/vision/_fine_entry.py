"""Where a shaft may enter: pairs of opposite edges on one line along the base side."""

import numpy as np

from ._fine_pixels import fast, grey_at

__all__ = ["find_entries"]


@fast
def find_entries(
    pixels: np.ndarray,
    row: int,
    channels: int,
    start: np.ndarray,
    sign: float,
    width_low: float,
    width_high: float,
    threshold: float,
    least: float,
    line: np.ndarray,
    slope: np.ndarray,
    edges: np.ndarray,
    entries: np.ndarray,
) -> int:
    """Candidates for the shaft on one line, best first.

    ``start``: u, v of the line's first pixel; du, dv along it; its number of pixels; eu, ev into the picture (three
    pixels are averaged that way). ``sign`` +1: light shaft. ``threshold`` < 0: none. ``least``: contrast asked for.
    ``entries`` (k, 4) receives centre and width along the line in px, contrast and the inside's grey level; the
    count is returned. ``line``, ``slope`` and ``edges`` are scratch of at least the line's length.
    """
    u0, v0, du, dv, n, eu, ev = start[0], start[1], start[2], start[3], start[4], start[5], start[6]
    for i in range(n):
        total = 0.0
        for k in range(3):
            total += grey_at(pixels, row, channels, u0 + i * du + k * eu, v0 + i * dv + k * ev)
        line[i] = sign * total / 3.0
    for i in range(2, n - 2):
        slope[i] = 0.5 * (line[i + 1] + line[i + 2] - line[i - 1] - line[i - 2])
    slope[0] = slope[1] = slope[n - 1] = slope[n - 2] = 0.0
    n_edges = 0
    for i in range(2, n - 2):
        a = abs(slope[i])
        if a >= 0.5 * least and a >= abs(slope[i - 1]) and a > abs(slope[i + 1]):
            if slope[i] * slope[i - 1] < 0.0 and a == abs(slope[i - 1]):
                continue
            edges[n_edges] = i
            n_edges += 1
            if n_edges == edges.shape[0]:
                break
    count = 0
    for p in range(n_edges):
        i = edges[p]
        if slope[i] <= 0.0:
            continue
        for q in range(p + 1, min(p + 7, n_edges)):
            j = edges[q]
            width = float(j - i)
            if width > width_high:
                break
            if slope[j] >= 0.0 or width < width_low:
                continue
            inside = 0.0
            for k in range(i + 1, j):
                inside += line[k]
            inside /= j - i - 1
            outside = max(line[max(0, i - 3)], line[min(n - 1, j + 3)])
            contrast = min(inside - outside, min(slope[i], -slope[j]) * 1.3)
            if contrast < least or (threshold >= 0.0 and inside < sign * threshold):
                continue
            at = count
            while at > 0 and entries[at - 1, 2] < contrast:
                at -= 1
            if at >= entries.shape[0]:
                continue
            if count < entries.shape[0]:
                count += 1
            for k in range(count - 1, at, -1):
                for m in range(4):
                    entries[k, m] = entries[k - 1, m]
            entries[at, 0] = 0.5 * (i + j)
            entries[at, 1] = width
            entries[at, 2] = contrast
            entries[at, 3] = sign * inside
    return count
