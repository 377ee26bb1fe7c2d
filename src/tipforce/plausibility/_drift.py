"""Finds the drift of a sensor's zero: the contact-free level changes slowly in the session."""

import math

import numpy as np

from ..types import FloatArray
from ._zero_steps import resting

WINDOW_S = 5.0
_MIN_WINDOW_READINGS = 10
_MIN_REST_S = 0.3
"""Shortest total rest in a window from which a level is measured."""
MIN_STRETCH_S, MAX_LEVEL_DISTANCE_N = 0.15, 0.015
"""Shortest contact-free stretch, and largest distance of its readings from the level."""
_MIN_WINDOWS, _MIN_SPAN = 4, 0.5
"""Fewest levels, and smallest share of the log that they span."""
_MIN_DRIFT_N_PER_S, _MIN_TOTAL_N = 0.04 / 60.0, 0.025
"""Slower drift, or less in the whole log, is not reported. A sensor drifts by some 2 mN a minute. In 35 clean simulated
sessions at most 35 mN a minute are found, in one in which the tip never leaves the wall."""
MAX_RESIDUAL_N = 0.01
"""Largest RMS distance of the levels from the straight line; levels that change otherwise are no drift."""


def find_drift(seconds: FloatArray, force_n: FloatArray, start_s: float, end_s: float) -> FloatArray:
    """Measures the drift of the contact-free level by a straight line through its levels in windows of 5 s.

    The windows go from the tare to the end of the log, then from the tare back to its start. Each window's level is the
    median of its readings near the expected level, which follows the drift that was found up to then.

    Args:
        seconds: (n,) times of the readings.
        force_n: (n, 3) forces without tare and inertia, N; finite but for axes that the sensor lacks (NaN).
        start_s: start of the stretch of the tare.
        end_s: its end.

    Returns:
        (3,) drift, N/s; zeros where there is none, or where too few contact-free stretches measure it.
    """
    drift = np.zeros(3)
    axes = np.flatnonzero(~np.isnan(force_n).any(axis=0))
    values = force_n[:, axes]
    tare = (seconds >= start_s) & (seconds <= end_s)
    if not tare.any() or not len(axes):
        return drift
    middle = 0.5 * (start_s + end_s)
    levels: list[tuple[float, FloatArray]] = [(middle, np.median(values[tare], axis=0))]
    for window_starts_s in (
        np.arange(end_s, seconds[-1], WINDOW_S),
        np.arange(start_s - WINDOW_S, seconds[0] - WINDOW_S, -WINDOW_S),
    ):
        level, at_s, slope = levels[0][1], middle, np.zeros(len(axes))
        for window_s in window_starts_s.tolist():
            rows = slice(*np.searchsorted(seconds, (window_s, window_s + WINDOW_S)).tolist())
            if rows.stop - rows.start < _MIN_WINDOW_READINGS:
                continue
            now_s = window_s + 0.5 * WINDOW_S
            expected = level + slope * (now_s - at_s)
            near = resting(seconds[rows], values[rows] - expected, MIN_STRETCH_S, MAX_LEVEL_DISTANCE_N)
            if near.sum() * float(np.median(np.diff(seconds[rows]))) < _MIN_REST_S:
                continue
            level, at_s = np.median(values[rows][near], axis=0), now_s
            levels.append((at_s, level))
            slope = (level - levels[0][1]) / (at_s - middle)
    times = np.array([time for time, _ in levels])
    measured = np.array([level for _, level in levels])
    span = float(np.ptp(times))
    if len(times) < _MIN_WINDOWS or span < _MIN_SPAN * float(seconds[-1] - seconds[0]):
        return drift
    design = np.column_stack([np.ones(len(times)), times - middle])
    line = np.linalg.lstsq(design, measured, rcond=None)[0]  # (2, axes): level at the tare, N, and drift, N/s
    residual_n = float(np.sqrt(np.mean(np.sum((measured - design @ line) ** 2, axis=1))))
    speed = float(np.linalg.norm(line[1]))
    if residual_n > MAX_RESIDUAL_N or speed < _MIN_DRIFT_N_PER_S or speed * span < _MIN_TOTAL_N or math.isnan(speed):
        return drift
    drift[axes] = line[1]
    return drift
