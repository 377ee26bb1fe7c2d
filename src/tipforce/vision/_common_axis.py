"""Where the axis of a catheter's end lies in all pictures of a session, told by symmetry.

A line that is continued straight on from the shaft may run beside a metal end in most pictures of a session, always to
the same side; how the end looks would then be learnt beside it too. But an end is round: what lies left of its axis
lies right of it as well, whatever its colours. So the strips of picture along the lines' last stretch are averaged,
which blurs the ground away, and the line is turned to where their steps of colour mirror each other best.
"""

from collections.abc import Sequence

import numpy as np

from ..geometry import arc_length
from ..types import FloatArray, Image
from ._common_end import read_along

__all__ = ["common_axis", "turn_end"]

_LONG, _FROM = 9.0, 0.8
"""The stretch that is looked at, in radii before the tip; the line is turned about its begin."""
_CELLS = 8
"""Places across in a radius."""
_MOST = 12
"""The most that the tip is moved aside, in cells."""
_LOW, _HIGH = 5, 9
"""A flank may be seen so many cells from the axis: lustre ends nearer to it, a shadow further off."""
_GROUPS = 4
_BETTER = 1.1
"""By this factor the steps must mirror each other better beside the line than on it."""


def common_axis(images: Sequence[Image], lines: Sequence[FloatArray], half: float, length: float) -> float:
    """How far in px, on average, the tip lies beside the ``lines`` (k, 2), to their right; 0 where they are right.

    ``half``: the shaft's radius in px. ``length``: arc length from a line's first point to the tip, in px.
    """
    before = np.arange(_FROM * half, _LONG * half, 0.5)[::-1]
    wide = _MOST + _HIGH + 1
    beside = np.arange(-wide, wide + 1) / _CELLS
    back = np.zeros(len(beside))
    strips = [read_along(i, p, half, length - before, beside, back) for i, p in zip(images, lines, strict=True)]
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


def turn_end(line: FloatArray, half: float, length: float, aside: float) -> FloatArray:
    """The ``line`` (k, 2) with its last stretch turned so that its point at ``length`` moves by ``aside`` px."""
    arc = arc_length(line)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    share = np.maximum(arc - length + _LONG * half, 0.0) / (_LONG * half)
    return line + aside * share[:, None] * np.column_stack([-tangent[:, 1], tangent[:, 0]])
