"""Where a catheter of known length ends, told by all colours at once.

A metal tip may have the ground's luminance, or the tissue's that it touches, but hardly its colour too and hardly the
same lustre across. So the picture is straightened along the axis as far as the tip can lie, and the round front is
moved along it: where the means on its two sides differ most, in every channel and at every distance from the axis, and
where the length is likely, there is the tip; for even noise that is the difference in the mixture of channels and
distances which shows it best (Fisher's direction).
"""

import math

import numpy as np

from ._fine_fit import axis_at
from ._fine_pixels import colour_between, fast

__all__ = ["END_SIZE", "end_place"]

_ACROSS = 9
_WIDTH = 0.85
"""Places across the shaft, and how far the outermost lie from the axis in radii."""
_ROWS = 160
_CELLS = 3 * _ACROSS
_WINDOW = 1.3
"""What is compared before and behind the front, in radii."""
_RIM = 0.7
"""A metal end's dark rim is not wider than so many radii."""
_CLEAR, _ABOVE = 0.45, 1.4
"""An edge is clear from this share of the steepest one near by, and so far above the average."""
END_SIZE = (_ROWS + 1) * _CELLS + _ROWS


@fast
def end_place(
    pixels: np.ndarray, row: int, channels: int, box: np.ndarray, coefficients: np.ndarray, intervals: int,
    length: float, straight: float, expected: float, spread: float, half: float, work: np.ndarray,
) -> tuple[float, float]:  # fmt: skip
    """Arc length of the tip, and how much it stands out; ``expected`` with the standard deviation ``spread``.

    The axis is the spline's, straight on behind ``straight``. What stands out is the difference between before and
    behind the front in grey levels, root mean square; 0 where the picture ends before. ``work``: of `END_SIZE`.
    """
    step = max(1.0, half / 6.0)
    window = max(3, int(_WINDOW * half / step + 0.5))
    reach = min(2.3 * spread, 0.5 * (_ROWS - 2 * window - 8) * step)
    start = expected - reach - (window + 2) * step
    if start < 1.0:
        start = 1.0
    rows = min(_ROWS, int((expected + reach - start) / step) + window + 3)
    cells = channels * _ACROSS
    sums = work[: (_ROWS + 1) * _CELLS].reshape((_ROWS + 1, _CELLS))
    slope = work[(_ROWS + 1) * _CELLS :]
    sums[0, :] = 0.0
    seen = 0
    for j in range(rows):
        s = start + j * step
        u, v, du, dv = axis_at(coefficients, intervals, length, straight, s)
        if u < box[0] or v < box[1] or u > box[2] - 1.001 or v > box[3] - 1.001:
            break
        norm = math.sqrt(du * du + dv * dv)
        du /= norm
        dv /= norm
        for k in range(_ACROSS):
            x = _WIDTH * (2.0 * k / (_ACROSS - 1) - 1.0)
            # the front is round: beside the axis it lies further back
            back = half * (1.0 - math.sqrt(1.0 - x * x))
            a = min(max(u - x * half * dv - back * du, box[0]), box[2] - 1.001)
            b = min(max(v + x * half * du - back * dv, box[1]), box[3] - 1.001)
            for c in range(channels):
                m = k * channels + c
                sums[j + 1, m] = sums[j, m] + colour_between(pixels, row, channels, c, a, b)
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
    low, high = max(3, at - window // 2), min(seen - 4, at + int(_RIM * half / step + 0.5))
    steepest = plain = 0.0
    for j in range(low, high + 1):
        steepest = max(steepest, slope[j])
    for j in range(2, seen - 2):
        plain += min(slope[j], steepest) / (seen - 4)
    place = float(at)
    for j in range(low, high + 1):
        here = slope[j]
        if here < slope[j - 1] or here <= slope[j + 1] or here < max(_CLEAR * steepest, _ABOVE * plain):
            continue
        place = j + 0.5 * (slope[j - 1] - slope[j + 1]) / (slope[j - 1] - 2.0 * here + slope[j + 1])
    return start + place * step, stands
