"""From the knob's angle to the curvature without load: gain, offset and hysteresis.

The curvature follows the knob through a play (`mechanics.Play`): it stands still until the knob has crossed
the gap. For every width of the gap on a grid the curvature is a straight line over what the play lets through; the
best width leaves the least. What the knob's curvature drifts is not independent from frame to frame, so the standard
deviations come from a bootstrap over blocks of time.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mechanics import Play
from ..types import FloatArray, IntArray

_LEAST_FRAMES = 8
_LEAST_RANGE_DEG = 3.0
"""Of the knob's angle: less tells no gain."""
_WIDEST_DEG, _STEP_DEG = 8.0, 0.1
_STARTS = np.linspace(-0.5, 0.5, 9)
"""Where in the gap the knob rests at first, as a share of it."""
_BLOCK_S = 2.0
_REPLICATES = 60
_TURNS_DEG = 2.0
"""A way back longer than this shows the gap, if it is there."""


@dataclass(frozen=True, slots=True, eq=False)
class KnobFit:
    """Curvature = ``offset_per_m`` + ``gain_per_m_deg`` x (the knob's angle behind a gap of ``play_deg``).

    NaN where it is not told: of one angle only ``curvature_per_m`` there. ``told_deg`` (n,), ``measured_per_m`` (n,):
    angles and curvatures of the frames; ``turning`` (n,): 1 where the knob last went up, -1 down, 0 before it moved.
    """

    gain_per_m_deg: float
    gain_std: float
    offset_per_m: float
    offset_std: float
    play_deg: float
    play_std: float
    curvature_per_m: float
    curvature_std: float
    start_deg: float
    low_deg: float
    high_deg: float
    residual_per_m: float
    frames: int
    told_deg: FloatArray
    measured_per_m: FloatArray
    turning: FloatArray
    transmitted_deg: FloatArray

    def through(self, series: tuple[IntArray, FloatArray], stamp_ns: IntArray) -> FloatArray:
        """(n,) what the play lets through at ``stamp_ns`` (n,), each among the stamps of ``series``."""
        stamps, angle = series
        known = np.isfinite(angle)
        stamps, angle = stamps[known], angle[known]
        if math.isfinite(self.play_deg):
            angle = Play(self.play_deg, output=float(angle[0]) + self.start_deg).run(angle)
        return angle[np.clip(np.searchsorted(stamps, stamp_ns), 0, len(stamps) - 1)]

    def curvature_at(self, transmitted_deg: FloatArray) -> FloatArray:
        """(n,) of what the play lets through."""
        if math.isnan(self.gain_per_m_deg):
            return np.full(len(transmitted_deg), self.curvature_per_m)
        return self.offset_per_m + self.gain_per_m_deg * transmitted_deg


def fit_knob(
    series: tuple[IntArray, FloatArray],
    stamp_ns: IntArray,
    curvature_per_m: FloatArray,
    curvature_std: FloatArray,
    *,
    common_std_per_m: float = 0.0,
) -> KnobFit:
    """The map of the knob.

    Args:
        series: stamps and angles of all its readings in degrees, which move the play.
        stamp_ns: (n,) of the frames, each among those of ``series``.
        curvature_per_m: (n,) found in them without load.
        curvature_std: (n,) of each, without what all have in common.
        common_std_per_m: of that.

    Raises:
        InputError: there is no knob, or there are too few frames.
    """
    stamps, angle = series
    known = np.isfinite(angle)
    if not known.any():
        raise InputError("no angle of the knob is recorded; state actuation.constant.knob_deg where it stands still")
    if len(stamp_ns) < _LEAST_FRAMES:
        raise InputError(f"{len(stamp_ns)} frames without much force, {_LEAST_FRAMES} are needed for the knob")
    stamps, angle = stamps[known], angle[known]
    at = np.clip(np.searchsorted(stamps, stamp_ns), 0, len(stamps) - 1)
    weight = 1.0 / (curvature_std**2 + float(np.median(curvature_std)) ** 2)
    block = np.floor((stamp_ns - stamp_ns[0]) * 1e-9 / _BLOCK_S).astype(np.int64)
    numbers, block = np.unique(block, return_inverse=True)
    told = angle[at]
    low, high = float(told.min()), float(told.max())
    nan = math.nan
    mean = float(np.average(curvature_per_m, weights=weight))
    blocks = np.array(
        [np.average(curvature_per_m[block == k], weights=weight[block == k]) for k in range(len(numbers))]
    )
    spread = (
        float(np.std(blocks, ddof=1)) / math.sqrt(len(blocks)) if len(blocks) > 2 else float(np.median(curvature_std))
    )
    if high - low < _LEAST_RANGE_DEG or len(numbers) < 4:
        return KnobFit(
            nan, nan, nan, nan, nan, nan, mean, math.hypot(spread, common_std_per_m), 0.0, low, high,
            float(np.std(curvature_per_m - mean)), len(told), told, curvature_per_m, np.zeros(len(told)), told,
        )  # fmt: skip
    turns = _turns(angle)
    ways = np.abs(np.diff(angle[turns]))
    widths = np.arange(0.0, min(_WIDEST_DEG, high - low), _STEP_DEG) if (ways > _TURNS_DEG).sum() > 1 else np.zeros(1)
    cases = [(width, start * width) for width in widths.tolist() for start in (_STARTS if width else (0.0,))]
    through = np.array([Play(width, output=float(angle[0]) + start).run(angle)[at] for width, start in cases])
    sums = _sums(through, curvature_per_m, weight, block, len(numbers))
    best, solved = _best(sums.sum(axis=0))
    draws = np.random.default_rng(0).multinomial(len(numbers), np.full(len(numbers), 1.0 / len(numbers)), _REPLICATES)
    found = [_best(np.einsum("b,bcs->cs", draw.astype(np.float64), sums)) for draw in draws]
    scatter = np.array([[*line, cases[k][0]] for k, line in found])
    play, play_std = (cases[best][0], float(scatter[:, 2].std())) if len(widths) > 1 else (nan, nan)
    gain, offset = float(solved[1]), float(solved[0])
    going = np.sign(np.diff(angle, prepend=angle[0]))
    last = np.maximum.accumulate(np.where(going != 0, np.arange(len(going)), 0))
    left = curvature_per_m - offset - gain * through[best]
    return KnobFit(
        gain, float(scatter[:, 1].std()), offset, math.hypot(float(scatter[:, 0].std()), common_std_per_m), play,
        math.hypot(play_std, _STEP_DEG / math.sqrt(12.0)), mean, spread, cases[best][1], low, high,
        float(np.sqrt(np.average(left**2, weights=weight))), len(told), told, curvature_per_m, going[last][at],
        through[best],
    )  # fmt: skip


def _turns(angle: FloatArray) -> IntArray:
    """Where the knob's way turns, and both ends."""
    going = np.sign(np.diff(angle))
    moving = np.flatnonzero(going)
    if not len(moving):
        return np.array([0, len(angle) - 1])
    changes = moving[1:][going[moving[1:]] != going[moving[:-1]]]
    return np.concatenate([[0], changes, [len(angle) - 1]])


def _sums(through: FloatArray, values: FloatArray, weight: FloatArray, block: IntArray, count: int) -> FloatArray:
    """(blocks, cases, 6): of the weighted regression of ``values`` on 1 and each row of ``through``."""
    rows = np.stack(
        [np.ones_like(through), through, through**2, np.broadcast_to(values, through.shape), through * values,
         np.broadcast_to(values**2, through.shape)], axis=-1,
    )  # fmt: skip
    rows = rows * weight[None, :, None]
    return np.array([rows[:, block == k].sum(axis=1) for k in range(count)])


def _best(sums: FloatArray) -> tuple[int, FloatArray]:
    """Of the cases (cases, 6) the one that leaves least, and its offset and slope (2,)."""
    one, x, xx, y, xy, yy = sums.T
    determinant = np.maximum(one * xx - x * x, 1e-12)
    slope = (one * xy - x * y) / determinant
    level = (y - slope * x) / np.maximum(one, 1e-12)
    left = yy - level * y - slope * xy
    best = int(np.argmin(left))
    return best, np.array([level[best], slope[best]])
