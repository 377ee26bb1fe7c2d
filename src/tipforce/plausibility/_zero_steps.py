"""Finds steps of a sensor's zero: in mid-session its zero was set by a person, or it was connected again.

A step of the zero is a jump from one reading to the next, in all axes at the same time. After it the readings have the
same distribution as before, shifted by the jump. A contact that begins or ends, and a sudden motion of the stage, also
give a jump, but the readings after them have another distribution, or the old one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from ..types import BoolArray, FloatArray, IntArray
from ._noise import axis_noise

_MIN_READINGS, _MIN_SPAN_READINGS = 100, 10
_MIN_PERIOD_S = 1e-6
"""Smallest period that is divided by, for stamps that are almost equal."""
FIT_S, _FIT_READINGS = 8e-3, (3, 20)
"""Duration, and range of the number of readings, of the straight lines before and after a jump, which are continued to
the middle between them."""
_MIN_NOISES = 10.0
_MIN_STEP_N = 0.015
_MAX_CANDIDATES = 200
_SPANS_S = (1.0, 2.0, 4.0, 8.0)
"""Stretches before and after a jump whose distributions are compared; in the longer ones the contact may change."""
MAX_COMPARED_READINGS = 400
"""Largest number of readings of a stretch that are compared."""
_QUANTILES = np.linspace(0.02, 0.98, 49)
MAX_REMAINING_SHARE = 0.35
"""Largest share of the distance between the two distributions that remains after the jump is subtracted."""
_MAX_STEPS = 8
_MIN_SPANS = 3
"""Fewest spans in which a step must explain the difference, if no contact-free stretch follows it."""
MIN_FREE_RATIO = 2.0
"""Smallest ratio of the rest at the new level to the rest at the old level after a step."""
_MIN_FREE_S, _REST_S, _SMOOTH_S = 0.2, 0.03, 0.01
"""Shortest total time at a contact-free level, shortest stretch in it, and duration of the mean that is compared with
the level."""
MAX_LEVEL_DISTANCE_N = 0.02
"""Largest distance of a reading from its level: residuals of the stage motion reach 15 mN on the simulated bench."""
MIN_DISTANCE_RATIO = 0.6
"""Smallest distance of the two distributions as a share of the jump."""


@dataclass(frozen=True, slots=True, eq=False)
class ZeroStep:
    """A step of the zero before a reading.

    Attributes:
        row: the reading after the step.
        step_n: (3,) step, N; 0 for axes that the sensor lacks.
        free_s: time after it at the new contact-free level, which measures the step, s; 0 where there is none.
    """

    row: int
    step_n: FloatArray
    free_s: float


def find_zero_steps(stamps_ns: IntArray, force_n: FloatArray, level_n: FloatArray | None = None) -> list[ZeroStep]:
    """Finds the steps of the zero in a force log.

    Args:
        stamps_ns: (n,) stamps of usable readings, rising.
        force_n: (n, 3) forces, N, finite but for axes that the sensor lacks (NaN); best without inertia.
        level_n: (3,) readings without contact at the start, N, where they are known: a jump after which the readings
            return to this level is no step of the zero.

    Returns:
        The steps, in the order of time.
    """
    axes = np.flatnonzero(~np.isnan(force_n).any(axis=0))
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    if not len(axes) or len(seconds) < _MIN_READINGS:
        return []
    values = force_n[:, axes].copy()
    level = None if level_n is None else level_n[axes]
    steps: list[ZeroStep] = []
    for _ in range(_MAX_STEPS):
        best = _best_step(seconds, values, level)
        if best is None:
            break
        row, jump, free_s = best
        step = np.zeros(3)
        step[axes] = jump
        steps.append(ZeroStep(row, step, free_s))
        values[row:] -= jump  # smaller steps are searched in the corrected readings
    return sorted(steps, key=lambda each: each.row)


def _best_step(
    seconds: FloatArray, values: FloatArray, level: FloatArray | None
) -> tuple[int, FloatArray, float] | None:
    """Finds the jump that explains most of the change of the readings around it.

    Args:
        seconds: (n,) times of the readings, s.
        values: (n, axes) readings, N.
        level: (axes,) contact-free readings at the start, N, or None.

    Returns:
        The row after the step, the step (axes,), N, and the time at the new level, s; None without a step.
    """
    jumps, noise_n = _jumps(seconds, values)
    size = np.linalg.norm(jumps, axis=1)
    size[(seconds < _SPANS_S[0]) | (seconds > seconds[-1] - _SPANS_S[0])] = 0.0
    least = max(_MIN_NOISES * noise_n, _MIN_STEP_N)
    rows = np.flatnonzero(size > least)
    rows = rows[np.argsort(size[rows])[::-1]]
    best, best_gain = None, 0.0
    candidates: list[int] = []
    for row in rows.tolist():  # the largest jump first
        # a step gives a jump in all rows within the fitted lines; only its largest one is a candidate
        if any(abs(row - candidate) < _FIT_READINGS[1] for candidate in candidates):
            continue
        candidates.append(row)
        if len(candidates) > _MAX_CANDIDATES:
            break
        gain, spans = _explained(seconds, values, row, jumps[row])
        if gain <= best_gain:
            continue
        jump, free_s = jumps[row], 0.0
        if level is not None:
            jump, free_s, old_s = _at_levels(seconds[row:], values[row:], level, jump)
            if free_s < MIN_FREE_RATIO * old_s:
                continue
        if free_s or spans >= _MIN_SPANS:
            best, best_gain = (row, jump, free_s), gain
    return best


def _at_levels(
    seconds: FloatArray, values: FloatArray, level: FloatArray, jump: FloatArray
) -> tuple[FloatArray, float, float]:
    """Measures a step again by the contact-free stretches after it.

    Args:
        seconds: (n,) times of the readings after the jump, s.
        values: (n, axes) these readings, N.
        level: (axes,) contact-free readings before the jump, N.
        jump: (axes,) the step by the readings next to it, N.

    Returns:
        The step (axes,), N, the time at the new contact-free level, and the time at the old one, s.
    """
    at_old = resting(seconds, values - level)
    at_new = resting(seconds, values - level - jump)
    period = max(float(np.median(np.diff(seconds))), _MIN_PERIOD_S)
    free_s, old_s = float(at_new.sum() * period), float(at_old.sum() * period)
    if free_s < _MIN_FREE_S:
        return jump, 0.0, old_s
    measured = np.median(values[at_new], axis=0) - level
    return (measured if np.linalg.norm(measured - jump) < MAX_LEVEL_DISTANCE_N else jump), free_s, old_s


def resting(
    seconds: FloatArray, values: FloatArray, least_s: float = _REST_S, near_n: float = MAX_LEVEL_DISTANCE_N
) -> BoolArray:
    """Finds contact-free stretches.

    Args:
        seconds: (n,) times of the readings, s.
        values: (n, axes) readings minus the contact-free level, N.
        least_s: shortest stretch, s.
        near_n: largest distance of the smoothed readings from 0, N.

    Returns:
        (n,) whether each reading is in a stretch.
    """
    period = max(float(np.median(np.diff(seconds))), _MIN_PERIOD_S) if len(seconds) > 1 else 1.0
    width = max(1, round(_SMOOTH_S / period))
    smooth = uniform_filter1d(values, width, axis=0, mode="nearest")
    near = np.linalg.norm(smooth, axis=1) < near_n
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(np.int8), [0]])))  # first row, end, first row, ...
    at_rest = np.zeros(len(values), np.bool_)
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        at_rest[first:end] = (end - first) * period >= least_s
    return at_rest


def _jumps(seconds: FloatArray, values: FloatArray) -> tuple[FloatArray, float]:
    """Returns the (n, axes) jump before each row, N, and the standard deviation of a jump by noise alone.

    A jump is the difference, in the middle between two rows, of the straight lines through the readings after and
    before it; a steady change of the force gives none. The difference is linear in the readings: a correlation.
    """
    period = max(float(np.median(np.diff(seconds))), _MIN_PERIOD_S)
    count = int(np.clip(round(FIT_S / period), *_FIT_READINGS))
    offset = np.arange(count) - (count - 1) / 2
    # weights that continue the straight line through `count` readings half a reading beyond the last of them
    weights = 1.0 / count + offset * (count / 2) / np.sum(offset**2)
    kernel = np.concatenate([-weights, weights[::-1]])
    jumps = np.zeros_like(values)
    for axis in range(values.shape[1]):
        jumps[count : len(values) - count + 1, axis] = np.correlate(values[:, axis], kernel, mode="valid")
    noise = np.array([axis_noise(column).std_n for column in values.T])
    return jumps, float(np.linalg.norm(noise) * np.linalg.norm(kernel))


def _explained(seconds: FloatArray, values: FloatArray, row: int, jump: FloatArray) -> tuple[float, int]:
    """Compares ``values`` (n, axes), N, before ``row`` with those after it, with and without the jump (axes,).

    Returns:
        The largest reduction of the distance of both distributions by the jump, N, and the number of spans with one.
    """
    size, gains = float(np.linalg.norm(jump)), [0.0]
    for span in _SPANS_S:
        first, end = np.searchsorted(seconds, (seconds[row] - span, seconds[row] + span)).tolist()
        if min(row - first, end - row) < _MIN_SPAN_READINGS:
            continue
        after, before = (
            np.quantile(part[:: 1 + len(part) // MAX_COMPARED_READINGS], _QUANTILES, axis=0)
            for part in (values[row:end], values[first:row])
        )
        shift = after - before  # (quantiles, axes)
        distance_n, remaining_n = _distance(shift), _distance(shift - jump)
        if distance_n > MIN_DISTANCE_RATIO * size and remaining_n < MAX_REMAINING_SHARE * distance_n:
            gains.append(distance_n - remaining_n)
    return max(gains), len(gains) - 1


def _distance(shift: FloatArray) -> float:
    """Returns the root of the squared sum over the axes of mean distances between quantiles (k, axes), N."""
    return float(np.linalg.norm(np.abs(shift).mean(axis=0)))
