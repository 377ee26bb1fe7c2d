"""The tip of the catheter from many images of one session: its arc length, the axis there, and its template.

In one image an edge of the ground may be under the tip and have more contrast than the tip itself. But the catheter
moves over the ground. So the strip of image along each centreline is cut out, and the steps of colour along it are
averaged over the images at equal arc length, with their signs: the tip stays in place and adds up, the ground does not.

A centreline that is extended straight from the shaft may be beside a metal tip in most images of a session, always on
the same side; the tip template would then be learnt beside it, too. But a tip is round: it is symmetric about its
axis. So the strips along the last stretch are averaged, which blurs the ground, and the centreline is
shifted to where their steps of colour are mirror images best.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from ..geometry import arc_length, tangents_and_normals
from ..types import FloatArray, Image
from .tracer import TEMPLATE_COLUMNS, TEMPLATE_ROWS, TEMPLATE_WIDTH

_STEP_PX = 0.5
_ACROSS, _WIDTH = 9, 0.85
"""Points across the shaft, and the distance of the outermost from the axis in radii."""
_WINDOW, _APART_PX = 0.35, 0.5
"""Length that is compared before and behind a point, in radii, and its distance from the point: edges are not sharp."""
_OUTLINE, _RIM = 0.5, 1.1
"""The bright middle of a metal tip may have more contrast to its dark rim than the rim to the ground: the outermost
step of this share of the clearest counts, if it is within this number of radii behind that."""
_REACH = 0.5
"""Largest distance in radii of the tip of a single image from the common one."""
_LEAST = 5.0
"""Grey levels, root mean square over points and channels, that the common step must have."""
_LONG, _FROM = 9.0, 0.8
"""The stretch that is compared, in radii before the tip; the line is turned about its first point."""
_CELLS = 8
"""Points across in a radius."""
_MOST = 12
"""Largest sideways shift of the tip, in cells."""
_LOW, _HIGH = 5, 9
"""Distance of a flank from the axis in cells: lustre ends nearer to it, a shadow further off."""
_GROUPS = 4
_BETTER = 1.1
"""By this factor the symmetry must be better beside the line than on it."""


def common_tip(
    images: Sequence[Image], lines: Sequence[FloatArray], half: float, expected: float, deviation: float
) -> tuple[float, FloatArray] | None:
    """Returns the arc length from the first point of the lines to the tip, and (n,) that of each image; or None.

    None where no tip is clear. ``lines``: a centreline of each image, (k, 2), which may end too early or too late.
    ``half``: the radius of the shaft in px. ``expected`` with its standard ``deviation``: the length known beforehand.
    """
    window = max(2, round(_WINDOW * half / _STEP_PX))
    margin = window + round(_APART_PX / _STEP_PX) + 1
    reach = 2.5 * deviation + _REACH * half
    at = np.arange(max(expected - reach, half), expected + reach, _STEP_PX)
    if len(at) < 3 * margin:
        return None
    beside = _WIDTH * np.linspace(-1.0, 1.0, _ACROSS)
    back = 1.0 - np.sqrt(1.0 - beside**2)  # the front is round: beside the axis it is further back
    steps = np.array(
        [
            _steps(_read_along(image, line, half, at, beside, back), window)
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
    # the tip of each image: where its steps are most like the common ones
    most = min(int(_REACH * half / _STEP_PX), end - 2, len(at) - 3 - end)
    shifts = range(-most, most + 1)
    pattern = common[end - 2 : end + 3]
    likeness = [[(one[end + k - 2 : end + k + 3] * pattern).sum() for k in shifts] for one in steps]
    own = at[end] + _STEP_PX * (np.argmax(likeness, axis=1) - most)
    return float(at[end] - 0.5 * _STEP_PX), own - 0.5 * _STEP_PX


def build_tip_template(
    images: Sequence[Image], lines: Sequence[FloatArray], half: float, length: float
) -> tuple[int, ...]:
    """Returns the grey levels over the last stretch of a catheter of known ``length``, as `Tracer` uses them.

    The median over that half of the images that are most like all: in some the line is beside the catheter, or
    another object covers it.
    """
    at = length - half * (np.arange(TEMPLATE_ROWS, dtype=np.float64)[::-1] + 0.5)
    beside = TEMPLATE_WIDTH * np.linspace(-1.0, 1.0, TEMPLATE_COLUMNS)
    back = np.zeros(TEMPLATE_COLUMNS)
    seen = np.array(
        [_read_along(image, line, half, at, beside, back) for image, line in zip(images, lines, strict=True)]
    )
    off = np.abs(seen - np.median(seen, axis=0)).mean(axis=(1, 2))
    common = np.median(seen[off <= np.median(off)], axis=0)
    return tuple(np.rint(common[::-1]).astype(int).ravel().tolist())


def _read_along(
    image: Image, line: FloatArray, half: float, at: FloatArray, beside: FloatArray, back: FloatArray
) -> FloatArray:
    """Returns (n, cells) grey levels at arc lengths ``at`` less ``back`` (k,), ``beside`` the line (k,), in radii.

    The line is straight behind its end.
    """
    arc = arc_length(line)
    beyond = np.maximum(at - arc[-1], 0.0)
    ahead = line[-1] - line[-6]
    ahead /= np.hypot(*ahead)
    axis = np.column_stack([np.interp(at, arc, line[:, k]) + beyond * ahead[k] for k in range(2)])
    tangent = np.gradient(axis, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    points = axis[:, None] + half * (beside[:, None] * normal[:, None] - back[:, None] * tangent[:, None])
    u, v = points.astype(np.float32).transpose(2, 0, 1)
    read = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return read.reshape(len(at), -1).astype(np.float64)


def _steps(strip: FloatArray, window: int) -> FloatArray:
    """Returns (n, cells): means over ``window`` rows behind each row minus those before it."""
    apart = round(_APART_PX / _STEP_PX)
    sums = np.concatenate([np.zeros((1, strip.shape[1])), np.cumsum(strip, axis=0)])
    steps = np.zeros_like(strip)
    k = np.arange(window + apart, len(strip) - window - apart)
    steps[k] = (sums[k + apart + window] - sums[k + apart] - sums[k - apart] + sums[k - apart - window]) / window
    return steps


def axis_offset(images: Sequence[Image], lines: Sequence[FloatArray], half: float, length: float) -> float:
    """Returns the mean distance in px of the tip from the ``lines`` (k, 2), to their right; 0 if on them.

    ``half``: the radius of the shaft in px. ``length``: arc length from the first point of a line to the tip, in px.
    """
    before = np.arange(_FROM * half, _LONG * half, 0.5)[::-1]
    wide = _MOST + _HIGH + 1
    beside = np.arange(-wide, wide + 1) / _CELLS
    back = np.zeros(len(beside))
    strips = [_read_along(i, p, half, length - before, beside, back) for i, p in zip(images, lines, strict=True)]
    strip: FloatArray = np.mean(np.array(strips), axis=0).reshape(len(before), len(beside), -1)
    steps = np.zeros_like(strip)
    steps[:, 1:-1] = 0.5 * (strip[:, 2:] - strip[:, :-2])
    rows = np.arange(len(before))
    groups = np.array_split(rows, _GROUPS)
    share = 1.0 - before / (_LONG * half)
    away = np.arange(_LOW, _HIGH + 1)
    moves = np.arange(-_MOST, _MOST + 1)
    mirrored = np.zeros(len(moves))
    for k, move in enumerate(moves.tolist()):
        middle = wide + np.rint(move * share).astype(int)[:, None]
        left, right = steps[rows[:, None], middle - away], steps[rows[:, None], middle + away]
        mirrored[k] = -sum(float((left[group].mean(axis=0) * right[group].mean(axis=0)).sum()) for group in groups)
    best = int(np.argmax(mirrored))
    if mirrored[best] < _BETTER * max(mirrored[_MOST], 0.0) or not 0 < best < len(moves) - 1:
        return 0.0
    low, top, high = mirrored[best - 1 : best + 2].tolist()
    return (best - _MOST + 0.5 * (low - high) / (low - 2.0 * top + high)) / _CELLS * half


def shift_tip(line: FloatArray, half: float, length: float, offset: float) -> FloatArray:
    """Returns ``line`` (k, 2) with its last stretch turned so that its point at ``length`` moves by ``offset`` px."""
    arc = arc_length(line)
    _, normal = tangents_and_normals(line)
    share = np.maximum(arc - length + _LONG * half, 0.0) / (_LONG * half)
    return line + offset * share[:, None] * normal
