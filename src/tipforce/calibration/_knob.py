"""Fits the map from the knob's angle to the curvature without load: gain, offset and hysteresis.

The curvature follows the knob through a play (`mechanics.Play`): it is constant until the knob has crossed the gap. For
every width of the gap on a grid, the curvature is fitted as a straight line over the angle behind the play; the width
with the smallest residual is taken. The drift of the curvature is correlated between frames, so the standard deviations
come from a bootstrap over blocks of time.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mechanics import Play
from ..types import FloatArray, IntArray

MIN_FRAMES = 8
MIN_RANGE_DEG = 3.0
"""Least range of the knob's angle; a smaller range does not determine the gain."""
MAX_PLAY_DEG, PLAY_STEP_DEG = 8.0, 0.1
START_SHARES = np.linspace(-0.5, 0.5, 9)
"""Initial positions of the knob in the gap, as a share of it."""
_BLOCK_S, _REPLICATES = 2.0, 60
"""Duration of a block of the bootstrap, over which the drift is correlated; number of its replicates."""
MIN_WAY_BACK_DEG = 2.0
"""Least way back of the knob that shows the gap, if there is one."""


@dataclass(frozen=True, slots=True, eq=False)
class KnobFit:
    """Curvature = ``offset_per_m`` + ``gain_per_m_deg`` x (the knob's angle behind a gap of ``play_deg``).

    Values that the data do not determine are NaN; for a constant angle only ``curvature_per_m`` is known.

    Attributes:
        gain_per_m_deg: gain, and ``gain_std`` its standard deviation.
        offset_per_m: offset, and ``offset_std`` its standard deviation.
        play_deg: width of the gap, and ``play_std`` its standard deviation.
        curvature_per_m: mean curvature, and ``curvature_std`` its standard deviation.
        start_deg: initial position of the knob in the gap.
        low_deg: smallest angle of the frames.
        high_deg: largest angle of the frames.
        residual_per_m: RMS of the residual.
        frames: number of frames.
        knob_deg: (n,) angles of the frames.
        measured_per_m: (n,) curvatures of the frames.
        turning: (n,) 1 if the last motion of the knob was upward, -1 downward, 0 before its first motion.
        transmitted_deg: (n,) angles behind the play.
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
    knob_deg: FloatArray
    measured_per_m: FloatArray
    turning: FloatArray
    transmitted_deg: FloatArray

    def through(self, series: tuple[IntArray, FloatArray], stamp_ns: IntArray) -> FloatArray:
        """Returns the (n,) angles behind the play.

        Args:
            series: stamps and angles in degrees of all readings of the knob.
            stamp_ns: (n,) times, each of them one of the stamps of ``series``.
        """
        stamps, angle = series
        known = np.isfinite(angle)
        stamps, angle = stamps[known], angle[known]
        if math.isfinite(self.play_deg):
            angle = Play(self.play_deg, output=float(angle[0]) + self.start_deg).run(angle)
        return angle[np.clip(np.searchsorted(stamps, stamp_ns), 0, len(stamps) - 1)]

    def curvature_at(self, transmitted_deg: FloatArray) -> FloatArray:
        """Returns the (n,) curvatures for angles behind the play."""
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
    """Fits the map of the knob.

    Args:
        series: stamps and angles in degrees of all readings of the knob, which move the play.
        stamp_ns: (n,) stamps of the frames, each of them one of the stamps of ``series``.
        curvature_per_m: (n,) curvatures of the frames without load.
        curvature_std: (n,) their standard deviations, without the common error.
        common_std_per_m: standard deviation of the common error.

    Returns:
        Gain, offset and play of the knob; NaN for the values that the frames do not determine.

    Raises:
        InputError: there is no knob, or there are too few frames.
    """
    stamps, angle = series
    known = np.isfinite(angle)
    if not known.any():
        raise InputError("no angle of the knob is recorded; state actuation.constant.knob_deg if it does not move")
    if len(stamp_ns) < MIN_FRAMES:
        raise InputError(f"{len(stamp_ns)} frames without much force, {MIN_FRAMES} are needed for the knob")
    stamps, angle = stamps[known], angle[known]
    reading = np.clip(np.searchsorted(stamps, stamp_ns), 0, len(stamps) - 1)
    weight = 1.0 / (curvature_std**2 + float(np.median(curvature_std)) ** 2)
    block = np.floor((stamp_ns - stamp_ns[0]) * 1e-9 / _BLOCK_S).astype(np.int64)
    block_numbers, block = np.unique(block, return_inverse=True)
    blocks = len(block_numbers)
    frame_deg = angle[reading]
    low, high = float(frame_deg.min()), float(frame_deg.max())
    nan = math.nan
    mean = float(np.average(curvature_per_m, weights=weight))
    block_means = np.array([np.average(curvature_per_m[block == k], weights=weight[block == k]) for k in range(blocks)])
    own_std = float(np.std(block_means, ddof=1)) / math.sqrt(blocks) if blocks > 2 else float(np.median(curvature_std))
    mean_std = math.hypot(own_std, common_std_per_m)
    if high - low < MIN_RANGE_DEG or blocks < 4:
        return KnobFit(
            nan, nan, nan, nan, nan, nan, mean, mean_std, 0.0, low, high,
            float(np.std(curvature_per_m - mean)), len(frame_deg), frame_deg, curvature_per_m, np.zeros(len(frame_deg)),
            frame_deg,
        )  # fmt: skip
    # a knob that was never turned back shows no gap: only the width 0 is tried
    turn_rows = _turns(angle)
    travel = np.abs(np.diff(angle[turn_rows]))
    widths = (
        np.arange(0.0, min(MAX_PLAY_DEG, high - low), PLAY_STEP_DEG)
        if (travel > MIN_WAY_BACK_DEG).sum() > 1
        else np.zeros(1)
    )
    cases = [(width, start * width) for width in widths.tolist() for start in (START_SHARES if width else (0.0,))]
    through = np.array([Play(width, output=float(angle[0]) + start).run(angle)[reading] for width, start in cases])
    sums = _sums(through, curvature_per_m, weight, block, blocks)
    best_case, best_line = _best(sums.sum(axis=0))
    # bootstrap: each replicate fits blocks of time that are drawn with replacement
    block_counts = np.random.default_rng(0).multinomial(blocks, np.full(blocks, 1.0 / blocks), _REPLICATES)
    replicates = [_best(np.einsum("b,bcs->cs", counts.astype(np.float64), sums)) for counts in block_counts]
    scatter = np.array([[*fitted_line, cases[k][0]] for k, fitted_line in replicates])
    play, play_std = (cases[best_case][0], float(scatter[:, 2].std())) if len(widths) > 1 else (nan, nan)
    gain, offset = float(best_line[1]), float(best_line[0])
    # direction of the knob's last motion at each reading, also while it rests
    direction = np.sign(np.diff(angle, prepend=angle[0]))
    last_moving = np.maximum.accumulate(np.where(direction != 0, np.arange(len(direction)), 0))
    residual = curvature_per_m - offset - gain * through[best_case]
    return KnobFit(
        gain, float(scatter[:, 1].std()), offset, math.hypot(float(scatter[:, 0].std()), common_std_per_m), play,
        math.hypot(play_std, PLAY_STEP_DEG / math.sqrt(12.0)), mean, mean_std, cases[best_case][1], low, high,
        float(np.sqrt(np.average(residual**2, weights=weight))), len(frame_deg), frame_deg, curvature_per_m,
        direction[last_moving][reading], through[best_case],
    )  # fmt: skip


def _turns(angle: FloatArray) -> IntArray:
    """Returns the positions at which the knob's direction changes, and both ends."""
    direction = np.sign(np.diff(angle))
    moving_rows = np.flatnonzero(direction)
    if not len(moving_rows):
        return np.array([0, len(angle) - 1])
    changes = moving_rows[1:][direction[moving_rows[1:]] != direction[moving_rows[:-1]]]
    return np.concatenate([[0], changes, [len(angle) - 1]])


def _sums(through: FloatArray, values: FloatArray, weight: FloatArray, block: IntArray, count: int) -> FloatArray:
    """Returns the sums from which `_best` solves the regressions; a bootstrap adds those of the blocks it drew.

    Args:
        through: (cases, n) angles behind the play, x.
        values: (n,) curvatures, y.
        weight: (n,) weights of the frames.
        block: (n,) number of each frame's block of time.
        count: number of blocks.

    Returns:
        (blocks, cases, 6) weighted sums of 1, x, x^2, y, x y and y^2.
    """
    rows = np.stack(
        [np.ones_like(through), through, through**2, np.broadcast_to(values, through.shape), through * values,
         np.broadcast_to(values**2, through.shape)], axis=-1,
    )  # fmt: skip
    rows = rows * weight[None, :, None]
    return np.array([rows[:, block == k].sum(axis=1) for k in range(count)])


def _best(sums: FloatArray) -> tuple[int, FloatArray]:
    """Solves the regression of each case and selects the one with the smallest residual.

    Args:
        sums: (cases, 6) weighted sums of 1, x, x^2, y, x y and y^2; x is the angle behind the play, y the curvature.

    Returns:
        The index of the case, and its (2,) offset (1/m) and slope (1/m/deg).
    """
    count, sum_x, sum_xx, sum_y, sum_xy, sum_yy = sums.T
    determinant = np.maximum(count * sum_xx - sum_x * sum_x, 1e-12)
    slope = (count * sum_xy - sum_x * sum_y) / determinant
    offset = (sum_y - slope * sum_x) / np.maximum(count, 1e-12)
    residual_squares = sum_yy - offset * sum_y - slope * sum_xy
    best = int(np.argmin(residual_squares))
    return best, np.array([offset[best], slope[best]])
