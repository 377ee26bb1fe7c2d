"""Where all pictures of a session agree that the catheter ends.

In one picture an edge of the ground may lie under the catheter's end and stand out more than the end itself. But the
catheter moves over the ground. So the strip of picture along each centreline is cut out, the steps of colour along it
are averaged over the pictures at equal arc length, with their signs: the end stays where it is and adds up, whatever
lies on the ground does not.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from ..geometry import arc_length
from ..types import FloatArray, Image
from ._fine_aim import ACROSS, ROWS, WIDTH

__all__ = ["common_end", "common_look", "read_along"]

_STEP_PX = 0.5
_ACROSS, _WIDTH = 9, 0.85
"""Places across the shaft, and how far the outermost lie from the axis in radii."""
_WINDOW, _APART_PX = 0.35, 0.5
"""What is compared before and behind a place, in radii, and how far from it that begins: edges are not sharp."""
_OUTLINE, _RIM = 0.5, 1.1
"""A metal end's bright middle may part from its dark rim more clearly than the rim from the ground: the outermost step
of this share of the clearest counts, if it lies within so many radii behind that."""
_REACH = 0.5
"""How far in radii the end of a single picture may lie from the common one."""
_LEAST = 5.0
"""Grey levels, root mean square over places and channels, that the common step must have."""


def common_end(
    images: Sequence[Image], lines: Sequence[FloatArray], half: float, expected: float, deviation: float
) -> tuple[float, FloatArray] | None:
    """Arc length from the lines' first point to the end, and (n,) that of each picture; None where none stands out.

    ``lines``: a centreline of each picture, (k, 2), which may end too early or too late. ``half``: the shaft's radius
    in px. ``expected`` with its standard ``deviation``: what is known of the length beforehand.
    """
    window = max(2, round(_WINDOW * half / _STEP_PX))
    margin = window + round(_APART_PX / _STEP_PX) + 1
    reach = 2.5 * deviation + _REACH * half
    at = np.arange(max(expected - reach, half), expected + reach, _STEP_PX)
    if len(at) < 3 * margin:
        return None
    beside = _WIDTH * np.linspace(-1.0, 1.0, _ACROSS)
    back = 1.0 - np.sqrt(1.0 - beside**2)  # the front is round: beside the axis it lies further back
    steps = np.array(
        [
            _steps(read_along(image, line, half, at, beside, back), window)
            for image, line in zip(images, lines, strict=True)
        ]
    )
    common = steps.mean(axis=0)
    clear = np.sqrt((common**2).mean(axis=1))
    clear[:margin] = clear[len(at) - margin :] = 0.0
    best = int(np.argmax(clear * np.exp(-0.5 * ((at - expected) / deviation) ** 2)))
    if clear[best] < _LEAST:
        return None
    last = min(best + int(_RIM * half / _STEP_PX), len(at) - 2)
    peaks = [
        k
        for k in range(best, last + 1)
        if clear[k] >= clear[k - 1] and clear[k] > clear[k + 1] and clear[k] >= _OUTLINE * clear[best]
    ]
    end = peaks[-1] if peaks else best
    # each picture's own end: where its steps are most like the common ones there
    most = min(int(_REACH * half / _STEP_PX), end - 2, len(at) - 3 - end)
    shifts = range(-most, most + 1)
    pattern = common[end - 2 : end + 3]
    likeness = [[(one[end + k - 2 : end + k + 3] * pattern).sum() for k in shifts] for one in steps]
    own = at[end] + _STEP_PX * (np.argmax(likeness, axis=1) - most)
    return float(at[end] - 0.5 * _STEP_PX), own - 0.5 * _STEP_PX


def common_look(images: Sequence[Image], lines: Sequence[FloatArray], half: float, length: float) -> tuple[int, ...]:
    """Grey levels over the last stretch of a catheter of known ``length``, as `FineTracer` wants to know them.

    The median over those half of the pictures that are most like all: in some the line lies beside the catheter, or
    something over it.
    """
    at = length - half * (np.arange(ROWS, dtype=np.float64)[::-1] + 0.5)
    beside = WIDTH * np.linspace(-1.0, 1.0, ACROSS)
    back = np.zeros(ACROSS)
    seen = np.array(
        [read_along(image, line, half, at, beside, back) for image, line in zip(images, lines, strict=True)]
    )
    off = np.abs(seen - np.median(seen, axis=0)).mean(axis=(1, 2))
    common = np.median(seen[off <= np.median(off)], axis=0)
    return tuple(np.rint(common[::-1]).astype(int).ravel().tolist())


def read_along(
    image: Image, line: FloatArray, half: float, at: FloatArray, beside: FloatArray, back: FloatArray
) -> FloatArray:
    """(n, cells) grey levels at arc lengths ``at`` less ``back`` (k,), ``beside`` the line (k,), in radii.

    The line goes straight on behind its end.
    """
    arc = arc_length(line)
    beyond = np.maximum(at - arc[-1], 0.0)
    ahead = line[-1] - line[-6]
    ahead /= np.hypot(*ahead)
    axis = np.column_stack([np.interp(at, arc, line[:, k]) + beyond * ahead[k] for k in range(2)])
    tangent = np.gradient(axis, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    places = axis[:, None] + half * (beside[:, None] * normal[:, None] - back[:, None] * tangent[:, None])
    u, v = places.astype(np.float32).transpose(2, 0, 1)
    read = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return read.reshape(len(at), -1).astype(np.float64)


def _steps(strip: FloatArray, window: int) -> FloatArray:
    """(n, cells) means over ``window`` rows behind each row's begin less those before it."""
    apart = round(_APART_PX / _STEP_PX)
    sums = np.concatenate([np.zeros((1, strip.shape[1])), np.cumsum(strip, axis=0)])
    steps = np.zeros_like(strip)
    k = np.arange(window + apart, len(strip) - window - apart)
    steps[k] = (sums[k + apart + window] - sums[k + apart] - sums[k - apart] + sums[k - apart - window]) / window
    return steps
