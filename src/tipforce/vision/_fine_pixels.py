"""Reading grey levels and flanks out of a frame, a few pixels at a time: the smallest parts of `fine`.

Frames are handed over flat (uint8, row after row) with the bytes of one row and of one pixel, so that grey and
colour pictures take the same way and only the sampled pixels are ever converted to grey.
"""

from typing import Any

import numpy as np

from .._compile import STEADY, compiled_together
from ._fine_prefetch import prefetch

__all__ = [
    "add_station", "colour_between", "edge_near", "fast", "fetch_pair", "grey_at", "grey_between", "measure_pair",
]  # fmt: skip

fast = compiled_together(__file__, "_fine*.py", STEADY)

_RED, _GREEN, _BLUE = 77, 150, 29
"""ITU-R 601 weights in 256ths, as cvtColor has them."""


@fast
def _grey256(pixels: np.ndarray, channels: int, i: int) -> Any:
    # unsigned places spare the compiler its test for negative ones, in the innermost loop of all
    at = np.uint64(i)
    if channels == 1:
        return np.int32(pixels[at]) << 8
    return (
        _RED * np.int32(pixels[at])
        + _GREEN * np.int32(pixels[at + np.uint64(1)])
        + _BLUE * np.int32(pixels[at + np.uint64(2)])
    )


@fast
def grey_at(pixels: np.ndarray, row: int, channels: int, u: int, v: int) -> float:
    """Grey level of one pixel."""
    return _grey256(pixels, channels, v * row + u * channels) / 256.0


@fast
def grey_between(pixels: np.ndarray, row: int, channels: int, u: float, v: float) -> float:
    """Grey level between pixels, bilinear. The place must lie inside the picture, right and bottom column excluded."""
    iu = int(u)
    iv = int(v)
    fu = u - iu
    fv = v - iv
    i = iv * row + iu * channels
    j = i + row
    a = _grey256(pixels, channels, i)
    b = _grey256(pixels, channels, i + channels)
    c = _grey256(pixels, channels, j)
    d = _grey256(pixels, channels, j + channels)
    top = a + fu * (b - a)
    return (top + fv * (c + fu * (d - c) - top)) * 0.00390625


@fast
def colour_between(pixels: np.ndarray, row: int, channels: int, channel: int, u: float, v: float) -> float:
    """One channel between pixels, bilinear; the place as for `grey_between`."""
    iu = int(u)
    iv = int(v)
    fu = u - iu
    fv = v - iv
    i = iv * row + iu * channels + channel
    j = i + row
    a = float(pixels[np.uint64(i)])
    b = float(pixels[np.uint64(i + channels)])
    c = float(pixels[np.uint64(j)])
    d = float(pixels[np.uint64(j + channels)])
    top = a + fu * (b - a)
    return top + fv * (c + fu * (d - c) - top)


@fast
def _read_side(
    pixels: np.ndarray,
    row: int,
    channels: int,
    box: np.ndarray,
    sign: float,
    u: float,
    v: float,
    du: float,
    dv: float,
    first: float,
    n: int,
    out: np.ndarray,
) -> None:
    """Fill ``out[:n]`` with the grey levels at (u, v) + (first + j) (du, dv); beyond the box its border counts."""
    u += first * du
    v += first * dv
    end_u = u + (n - 1) * du
    end_v = v + (n - 1) * dv
    u_low, v_low = box[0], box[1]
    u_high, v_high = box[2] - 1.001, box[3] - 1.001
    if min(u, end_u) >= u_low and max(u, end_u) <= u_high and min(v, end_v) >= v_low and max(v, end_v) <= v_high:
        for j in range(n):
            out[j] = sign * grey_between(pixels, row, channels, u + j * du, v + j * dv)
    else:
        for j in range(n):
            a = min(max(u + j * du, u_low), u_high)
            b = min(max(v + j * dv, v_low), v_high)
            out[j] = sign * grey_between(pixels, row, channels, a, b)


@fast
def edge_near(
    profile: np.ndarray, n: int, first: float, expected: float, reach: float, narrow: bool, other_way: float
) -> tuple[float, float]:
    """Where the profile falls from the inside to the outside, sub-pixel, and by how much.

    ``profile[:n]`` runs outward in steps of 1 px from ``first``. The steepest place within ``reach`` of ``expected``
    is taken, nearer ones preferred, rises (the wrong way) with weight ``other_way``; then the crossing of the level
    half-way between the two sides. Returns (place, drop); drop is negative for a rise, 0 where there is nothing.
    """
    best = 0.0
    at = -1
    margin = 1 if narrow else 2
    for j in range(margin, n - margin):
        far = (first + j - expected) / reach
        if far * far > 1.0:
            continue
        if narrow:
            slope = profile[j - 1] - profile[j + 1]
        else:
            slope = 0.5 * (profile[j - 1] + profile[j - 2] - profile[j + 1] - profile[j + 2])
        score = abs(slope) * (1.0 - 0.4 * far * far)
        if slope < 0.0:
            score *= other_way
        if score > best:
            best = score
            at = j
    if at < 0:
        return expected, 0.0
    k = 2 if narrow else 3
    high = profile[max(0, at - k)]
    low = profile[min(n - 1, at + k)]
    if not narrow:
        high = 0.5 * (high + profile[at - 2])
        low = 0.5 * (low + profile[at + 2])
    level = 0.5 * (high + low)
    place = first + at
    nearest = 9.0
    for j in range(max(0, at - 2), min(n - 1, at + 2)):
        a = profile[j] - level
        b = profile[j + 1] - level
        if a * b <= 0.0 and a != b and (a - b) * (high - low) > 0.0:
            crossing = first + j + a / (a - b)
            if abs(crossing - first - at) < nearest:
                nearest = abs(crossing - first - at)
                place = crossing
    if nearest > 8.0:
        return place, 0.0
    return place, high - low


@fast
def _reach_of(half: float, reach: float) -> tuple[float, int]:
    """Where the profile of a flank begins, outward from the axis, and its pixels."""
    extra = 2.0 if half < 3.5 else 3.0
    first = max(half - reach - extra, -0.3 * half)
    return first, int(half + reach + extra - first) + 1


@fast
def fetch_pair(
    pixels: np.ndarray, row: int, channels: int, u: float, v: float, nu: float, nv: float, half: float, reach: float
) -> None:
    """Begin to bring what `measure_pair` would read there into the caches. It may lie outside the picture."""
    first, n = _reach_of(half, reach)
    for j in range(n):
        du, dv = (first + j) * nu, (first + j) * nv
        prefetch(pixels, int(v - dv) * row + int(u - du) * channels)
        prefetch(pixels, int(v + dv) * row + int(u + du) * channels)


@fast
def measure_pair(
    pixels: np.ndarray,
    row: int,
    channels: int,
    box: np.ndarray,
    sign: float,
    u: float,
    v: float,
    nu: float,
    nv: float,
    half: float,
    reach: float,
    scratch: np.ndarray,
) -> tuple[float, float, float, float]:
    """Both flanks of a shaft across (u, v), along the unit vector (nu, nv), expected ``half`` px away on either side.

    Returns (place, drop) of the flank on the side of -n and of the one on the side of +n, places counted outward.
    ``sign`` is +1 for a light shaft and -1 for a dark one; drops are positive for a shaft of that kind.
    """
    narrow = half < 3.5
    first, n = _reach_of(half, reach)
    n = min(n, scratch.shape[0])
    _read_side(pixels, row, channels, box, sign, u, v, -nu, -nv, first, n, scratch)
    left, left_drop = edge_near(scratch, n, first, half, reach, narrow, 0.55)
    _read_side(pixels, row, channels, box, sign, u, v, nu, nv, first, n, scratch)
    right, right_drop = edge_near(scratch, n, first, half, reach, narrow, 0.55)
    return left, left_drop, right, right_drop


@fast
def add_station(stations: np.ndarray, n: int, u: float, v: float, s: float, half: float, weight: float) -> int:
    """One more station of the second look, behind the first ``n``: at (u, v), arc length ``s``; returns n + 1."""
    stations[n, 0] = u
    stations[n, 1] = v
    stations[n, 2] = s
    stations[n, 3] = 2.0 * half
    stations[n, 4] = weight
    stations[n, 5] = 2.0
    return n + 1
