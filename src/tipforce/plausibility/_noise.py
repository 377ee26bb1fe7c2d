"""Measures noise and resolution of a force sensor from its own readings."""

import math
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, IntArray

WINDOW_READINGS = 51
"""Number of readings in a window for the measurement of noise."""
_MIN_WINDOWS = 20
_MAX_EQUAL_SHARE = 0.9
"""Noise that leaves more than this share of readings at rest equal does not show whether an axis is alive."""
MAX_FALSE_ALARM_PROBABILITY = 1e-6
"""Probability, for a whole log, that noise gives a run of equal readings as long as `AxisNoise.longest_run`."""


@dataclass(frozen=True, slots=True)
class AxisNoise:
    """Noise of one axis.

    Attributes:
        std_n: standard deviation, N, at least that of the quantisation.
        step_n: quantisation step, N.
        longest_run: longest run of equal readings that noise explains; 0 where the noise is too small to determine it.
    """

    std_n: float
    step_n: float
    longest_run: int


def axis_noise(values: FloatArray) -> AxisNoise:
    """Measures the noise of the readings (n,) of one axis, N, all of them finite."""
    changes = np.abs(np.diff(values))
    changes = changes[changes > 0.0]
    # most changes are whole steps; some smaller ones come from readings that were computed
    step = float(np.percentile(changes, 10.0)) if len(changes) else 0.0
    # third differences of neighbouring readings contain almost no force, and 20 times the variance of the noise; 1.4826
    # times the median of absolute values is the standard deviation of a normal distribution
    moving = np.lib.stride_tricks.sliding_window_view(np.diff(values), 3).any(axis=1)  # a stuck axis shows no noise
    rough = np.abs(np.diff(values, 3))[moving]
    std = max(1.4826 * float(np.median(rough)) / math.sqrt(20.0) if len(rough) else 0.0, step / math.sqrt(12.0))
    return AxisNoise(std, step, _longest_run(values, step))


def _longest_run(values: FloatArray, step_n: float) -> int:
    """Determines the longest run of equal readings that the noise explains.

    The noise is that of the quieter half of the windows in which the axis changes. Neighbouring readings are equal with
    the highest probability where the true level is in the middle of a quantisation interval.

    Args:
        values: (n,) readings of one axis, N.
        step_n: quantisation step, N.

    Returns:
        The number of readings; 0 where the noise is too small to determine it.
    """
    count = len(values) // WINDOW_READINGS
    windows = values[: count * WINDOW_READINGS].reshape(count, WINDOW_READINGS)
    span = np.ptp(windows, axis=1)
    windows, span = windows[span > 0.0], span[span > 0.0]
    if len(windows) < _MIN_WINDOWS:
        return 0
    quiet = windows[span <= np.median(span)]
    # twice the variance of the quantisation is subtracted: for a slow motion its error is no white noise
    variance = float(np.mean(np.diff(quiet, 3, axis=1) ** 2)) / 20.0 - step_n**2 / 6.0
    equal = math.erf(0.5 * step_n / math.sqrt(2.0 * variance)) if variance > 0.0 else 1.0
    if equal > _MAX_EQUAL_SHARE:
        return 0
    # a run of k readings from one of n rows has a probability of at most n * equal**k
    return math.ceil(math.log(MAX_FALSE_ALARM_PROBABILITY / len(values)) / math.log(max(equal, 0.05)))


def run_lengths(values: FloatArray) -> tuple[IntArray, IntArray]:
    """Returns first rows (m,) and lengths (m,) of the runs of equal readings in ``values`` (n,)."""
    first = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1]).astype(np.int64)
    return first, np.diff(np.append(first, len(values)))
