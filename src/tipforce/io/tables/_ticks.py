"""Determines the times of the rows of a log whose clock is coarser than its rows, or that has no clock."""

from dataclasses import dataclass

import numpy as np

from ...types import IntArray

MIN_TICKS = 5
"""Fewest different stamps from which a rate is determined."""
MAX_RESIDUAL_TICKS = 0.75
"""Largest distance from the middle of a tick in ticks: 0.5 for regular rows, the rest for the jitter of arrival."""
MAX_RESIDUAL_S = 0.05
"""Largest distance of the stamps from rows at a stated rate, if their tick is shorter than that."""


class UnevenRows(ValueError):
    """The rows do not come at a constant rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Times of rows at a constant rate.

    Attributes:
        stamp_ns: (n,) stamps.
        rate_hz: rows per second.
        rate_stderr_hz: one standard error of it.
        tick_ns: step of the clock.
        gaps: number of pauses longer than a tick.
    """

    stamp_ns: IntArray
    rate_hz: float
    rate_stderr_hz: float
    tick_ns: int
    gaps: int


def spread_within_ticks(stamp_ns: IntArray) -> Spread:
    """Spreads the stamps of rows that come at a constant rate and have a coarse clock.

    The rate is the slope of a straight line (least squares) through the middles of the ticks; a pause of more than a
    tick begins a new line with the same slope. The standard error of the rate is that of one rounding per tick.

    Args:
        stamp_ns: (n,) rising stamps, many of which are equal.

    Returns:
        The spread stamps, strictly rising.

    Raises:
        UnevenRows: the stamps are too few, or not those of rows at a constant rate.
    """
    ticks = np.unique(stamp_ns)
    if len(ticks) < MIN_TICKS:
        raise UnevenRows
    tick_ns = int(np.median(np.diff(ticks)))
    # a segment is a run of rows without a pause: each has a line of its own
    starts = np.flatnonzero(np.diff(stamp_ns, prepend=stamp_ns[0]) > 1.5 * tick_ns)
    segments = np.searchsorted(starts, np.arange(len(stamp_ns)), side="right")
    rows = np.arange(len(stamp_ns), dtype=np.float64)
    middles = (stamp_ns - stamp_ns[0]).astype(np.float64) + 0.5 * tick_ns
    centred_rows, centred_middles = (values - _means(values, segments) for values in (rows, middles))
    row_variation = float(centred_rows @ centred_rows)
    if not row_variation:
        raise UnevenRows
    step_ns = float(centred_rows @ centred_middles) / row_variation  # slope: ns per row
    times = _means(middles, segments) + step_ns * centred_rows
    if np.abs(middles - times).max() > MAX_RESIDUAL_TICKS * tick_ns or step_ns <= 0:
        raise UnevenRows
    spread_ns = np.rint(times).astype(np.int64) + stamp_ns[0]
    if np.any(np.diff(spread_ns) <= 0):
        raise UnevenRows
    rate_hz = 1e9 / step_ns
    relative_stderr = tick_ns / (step_ns * len(stamp_ns) * np.sqrt(len(ticks)))
    return Spread(spread_ns, rate_hz, rate_hz * float(relative_stderr), tick_ns, len(starts))


def at_rate(stamp_ns: IntArray, rows: IntArray, rate_hz: float) -> IntArray:
    """Returns the times of the rows of a log at a constant rate.

    Args:
        stamp_ns: (n,) stamps of the log's own clock.
        rows: (n,) number of each row, from any start; a missing number is a row that was lost.
        rate_hz: rows per second.

    Returns:
        (n,) times: rows / rate_hz, shifted to the mean of the stamps.

    Raises:
        UnevenRows: the stamps are not those of rows at this rate.
    """
    ticks = np.unique(stamp_ns)
    tick_ns = float(np.median(np.diff(ticks))) if len(ticks) > 1 else 0.0
    times = rows * (1e9 / rate_hz)
    # where several rows share a stamp, the stamp is the start of their tick; its middle is half a tick later
    middles = (stamp_ns - stamp_ns[0]) + (0.5 * tick_ns if len(ticks) < len(stamp_ns) else 0.0)
    shifted = times + float(np.mean(middles - times))
    if len(ticks) > 1 and np.abs(middles - shifted).max() > max(2 * tick_ns, MAX_RESIDUAL_S * 1e9):
        raise UnevenRows
    return np.rint(shifted).astype(np.int64) + stamp_ns[0]


def _means(values: "np.ndarray", segments: IntArray) -> "np.ndarray":  # type: ignore[type-arg]
    """Returns the (n,) means of the segment of each row."""
    counts = np.bincount(segments)
    return (np.bincount(segments, weights=values) / np.maximum(counts, 1))[segments]
