"""Access to pixels: grey levels, profiles across a shaft, and the edges in them.

The lowest layer of the tracer. Kernels get a frame as a `Raster`, so that grey and colour images take the same path
and only the sampled pixels are converted to grey.
"""

from typing import Any, NamedTuple

import numpy as np

from ..._system.compilation import STEADY, compiled_together

fast = compiled_together(__file__, "_*.py", STEADY)

_RED, _GREEN, _BLUE = 77, 150, 29
"""ITU-R 601 weights in 256ths, as OpenCV's cvtColor has them."""


class Raster(NamedTuple):
    """A frame and the part of it that may be read.

    Kernels read nothing outside the region that is searched, so it must be inside the frame.

    Attributes:
        pixels: all bytes, flat, row after row.
        row: bytes per row.
        channels: bytes per pixel, 1 or 3 (RGB).
        left: first column of the region.
        top: first row of the region.
        right: column behind the last one of the region.
        bottom: row behind the last one of the region.
    """

    pixels: np.ndarray
    row: int
    channels: int
    left: float
    top: float
    right: float
    bottom: float


@fast
def _grey256(pixels: np.ndarray, channels: int, i: int) -> Any:
    # unsigned indices save the test for negative ones in the innermost loop
    at = np.uint64(i)
    if channels == 1:
        return np.int32(pixels[at]) << 8
    return (
        _RED * np.int32(pixels[at])
        + _GREEN * np.int32(pixels[at + np.uint64(1)])
        + _BLUE * np.int32(pixels[at + np.uint64(2)])
    )


@fast
def grey_at(image: Raster, u: int, v: int) -> float:
    """Returns the grey level of one pixel.

    Args:
        image: the frame.
        u: column.
        v: row.
    """
    return _grey256(image.pixels, image.channels, v * image.row + u * image.channels) / 256.0


@fast
def grey_between(image: Raster, u: float, v: float) -> float:
    """Returns the grey level between pixels, bilinear.

    Args:
        image: the frame.
        u: position in px, left of the last column.
        v: position in px, above the last row.
    """
    pixels, row, channels = image.pixels, image.row, image.channels
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
def colour_between(image: Raster, channel: int, u: float, v: float) -> float:
    """Returns one channel between pixels, bilinear.

    Args:
        image: the frame.
        channel: number of the channel, below ``image.channels``.
        u: see `grey_between`.
        v: see `grey_between`.
    """
    pixels, row, channels = image.pixels, image.row, image.channels
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
    image: Raster,
    sign: float,
    u: float,
    v: float,
    du: float,
    dv: float,
    first: float,
    n: int,
    out: np.ndarray,
) -> None:
    """Fills ``out[:n]`` with the grey levels at (u, v) + (first + j) (du, dv); outside the region its border counts."""
    u += first * du
    v += first * dv
    end_u = u + (n - 1) * du
    end_v = v + (n - 1) * dv
    u_low, v_low = image.left, image.top
    u_high, v_high = image.right - 1.001, image.bottom - 1.001
    if min(u, end_u) >= u_low and max(u, end_u) <= u_high and min(v, end_v) >= v_low and max(v, end_v) <= v_high:
        for j in range(n):
            out[j] = sign * grey_between(image, u + j * du, v + j * dv)
    else:
        for j in range(n):
            a = min(max(u + j * du, u_low), u_high)
            b = min(max(v + j * dv, v_low), v_high)
            out[j] = sign * grey_between(image, a, b)


@fast
def edge_near(
    profile: np.ndarray, n: int, first: float, expected: float, reach: float, narrow: bool, other_way: float
) -> tuple[float, float]:
    """Finds the edge of a profile with sub-pixel accuracy.

    The steepest step counts; nearer ones are preferred. The edge is where the profile crosses the level half-way
    between its two sides.

    Args:
        profile: grey levels outward in steps of 1 px.
        n: number of values in ``profile`` that count.
        first: position of the first value in px.
        expected: expected position of the edge in px.
        reach: largest distance from ``expected`` in px.
        narrow: whether the shaft is narrow, so that steps are taken between fewer pixels.
        other_way: weight of rises (the wrong direction), 0 to 1.

    Returns:
        Position in px and drop of grey level; the drop is negative for a rise, 0 where there is no edge.
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
def measure_pair(
    image: Raster,
    sign: float,
    u: float,
    v: float,
    nu: float,
    nv: float,
    half: float,
    reach: float,
    scratch: np.ndarray,
) -> tuple[float, float, float, float]:
    """Measures both flanks of a shaft on a line across it.

    Args:
        image: the frame.
        sign: +1 for a light shaft, -1 for a dark one.
        u: position on the axis in px.
        v: position on the axis in px.
        nu: unit vector n of the line across, along u.
        nv: unit vector n of the line across, along v.
        half: expected distance of the flanks from (u, v) in px.
        reach: largest deviation from ``half`` in px.
        scratch: (k,) buffer of a profile.

    Returns:
        Position in px, outward, and drop in grey levels of the flank on the side of -n, then of the one on the side of
        +n; drops are positive for a shaft of this ``sign``.
    """
    narrow = half < 3.5
    extra = 2.0 if narrow else 3.0
    first = max(half - reach - extra, -0.3 * half)
    n = min(int(half + reach + extra - first) + 1, scratch.shape[0])
    _read_side(image, sign, u, v, -nu, -nv, first, n, scratch)
    left, left_drop = edge_near(scratch, n, first, half, reach, narrow, 0.55)
    _read_side(image, sign, u, v, nu, nv, first, n, scratch)
    right, right_drop = edge_near(scratch, n, first, half, reach, narrow, 0.55)
    return left, left_drop, right, right_drop
