"""Readings of the sensor without contact: from a stretch that a person states, or from the quiet stretches."""

import math

import numpy as np

from ..errors import InputError
from ..io import Tare
from ..types import BoolArray, FloatArray, IntArray

_BIN_S = 0.05
_WINDOW_BINS = 10
"""Half a second, whose scatter shows whether the force is quiet."""
_MIN_RUN_S = 1.0
_EDGE_BINS = 4
"""Bins at the ends of a quiet stretch that may already belong to the onset of contact."""
_QUIET = 0.08
"""Largest scatter of a quiet half second, as a share of the force's range in the whole log."""
_AWAY, _MIN_AWAY_SHARE = 0.15, 0.02
"""A level is contact if forces are further from it than this share of the range, on both sides, for more than the
second share of the time."""
_BLOCK_S = 0.5
"""Readings within this time are not independent."""
_MIN_READINGS = 10


def stated_tare(stamps_ns: IntArray, force_n: FloatArray, start_s: float, end_s: float) -> Tare:
    """Returns the mean of the readings in a stretch of time.

    Args:
        stamps_ns: (n,) stamps of the readings.
        force_n: (n, 3) readings in N; NaN where there is no plausible reading.
        start_s: start of the stretch in seconds since the log's first row.
        end_s: its end.

    Raises:
        InputError: the stretch has fewer than ten readings, or its times are not finite.
    """
    if not (math.isfinite(start_s) and math.isfinite(end_s)):
        raise InputError(f"tare=({start_s:g}, {end_s:g}): expected a stretch of time in seconds, as in (0, 5)")
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    axes = ~np.isnan(force_n).all(axis=0)
    inside = (seconds >= start_s) & (seconds <= end_s) & np.isfinite(force_n[:, axes]).all(axis=1)
    if inside.sum() < _MIN_READINGS:
        raise InputError(
            f"tare=({start_s:g}, {end_s:g}): has only {int(inside.sum())} readings; the force log runs from 0 to "
            f"{seconds[-1]:.1f} s"
        )
    mean, stderr = _mean(seconds[inside], force_n[inside])
    return Tare(mean, stderr, ((start_s, end_s),), "stated")


def find_tare(stamps_ns: IntArray, force_n: FloatArray) -> Tare:
    """Finds the tare: the mean force of the stretches in which the force is quiet and nothing touches the tip.

    Quiet: a second or more in which every half second scatters by less than 8 % of the log's whole range. Of several
    quiet levels those with forces on all sides of them are contact, and the earliest of the others counts: a run
    starts without contact.

    Args:
        stamps_ns: (n,) stamps of the force log.
        force_n: (n, 3) readings in newtons; NaN where a reading is missing.

    Returns:
        The tare with its standard error in newtons and its stretches in seconds since the first reading;
        ``how="none"`` with the reason where no such stretch is found.
    """
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    axes = ~np.isnan(force_n).all(axis=0)
    usable = np.isfinite(force_n[:, axes]).all(axis=1)
    seconds, force_n = seconds[usable], force_n[usable]
    measured = force_n[:, axes]
    number = np.floor(seconds / _BIN_S).astype(np.int64)
    count = int(number[-1]) + 1 if len(number) else 0
    filled = np.bincount(number, minlength=count)
    if count < 2 * _WINDOW_BINS or not measured.shape[1]:
        return Tare(detail=f"the force log of {seconds[-1]:.1f} s is too short to look for a contact-free stretch")
    sums = np.stack([np.bincount(number, column, minlength=count) for column in measured.T], axis=1)
    bins = sums / np.maximum(filled, 1)[:, None]
    spread = np.linalg.norm(np.percentile(bins, 97.5, axis=0) - np.percentile(bins, 2.5, axis=0))
    if spread < 1e-9:
        return Tare(detail="the force never changes: contact cannot be distinguished from its absence")
    runs = _quiet_runs(bins, filled > 0, float(spread))
    if not runs:
        return Tare(detail="no second in which the force is quiet: state a contact-free stretch, as in tare=(0, 5)")
    levels = _levels(bins, runs, float(spread))
    contact_free = [level for level in levels if not _surrounded(bins, level, float(spread))] or levels
    chosen = min(contact_free, key=lambda level: level[0][0])
    inside = np.zeros(len(seconds), dtype=np.bool_)
    for first, last in chosen:
        inside |= (number >= first) & (number < last)
    mean, stderr = _mean(seconds[inside], force_n[inside])
    other_runs = [run for level in levels if level is not chosen for run in level]
    detail = ""
    if other_runs:
        places = ", ".join(f"{first * _BIN_S:.1f}-{last * _BIN_S:.1f} s" for first, last in other_runs[:3])
        detail = f"quiet at another level too ({places}), taken for held contact; state tare if that is wrong"
    return Tare(mean, stderr, tuple((first * _BIN_S, last * _BIN_S) for first, last in chosen), "detected", detail)


def _quiet_runs(bins: FloatArray, filled: BoolArray, spread: float) -> list[tuple[int, int]]:
    """Returns (first, end) bins of stretches that are quiet for at least a second.

    ``bins`` (n, k): mean force of each bin, N; ``filled`` (n,): whether it has readings; ``spread``: range of the force
    in the whole log, N.
    """
    windows = np.lib.stride_tricks.sliding_window_view(bins, _WINDOW_BINS, axis=0)
    scatter = np.sqrt(np.sum(np.var(windows, axis=-1), axis=-1))
    all_filled = np.lib.stride_tricks.sliding_window_view(filled, _WINDOW_BINS).all(axis=-1)
    quiet = np.zeros(len(bins) + 1, dtype=np.int64)
    for start in np.flatnonzero((scatter < _QUIET * spread) & all_filled).tolist():
        quiet[start : start + _WINDOW_BINS] = 1
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet])))
    runs: list[tuple[int, int]] = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=False):
        if (last - first) * _BIN_S >= _MIN_RUN_S:
            # at the log's own ends there is no onset
            runs.append((first + _EDGE_BINS * (first > 0), last - _EDGE_BINS * (last < len(bins))))
    return runs


def _levels(bins: FloatArray, runs: list[tuple[int, int]], spread: float) -> list[list[tuple[int, int]]]:
    """Returns the quiet ``runs`` (first, end bin) in groups, one for each level of the force.

    The median force of ``bins`` (n, k) in N differs within a group by less than 8 % of ``spread``, the force's range.
    """
    levels: list[tuple[FloatArray, list[tuple[int, int]]]] = []
    for first, last in runs:
        mean = np.median(bins[first:last], axis=0)
        for centre, members in levels:
            if np.linalg.norm(mean - centre) < _QUIET * spread:
                members.append((first, last))
                break
        else:
            levels.append((mean, [(first, last)]))
    return [members for _, members in levels]


def _surrounded(bins: FloatArray, level: list[tuple[int, int]], spread: float) -> bool:
    """Returns whether forces are on both sides of a level: contact only pushes, so it cannot be the free one.

    ``bins`` (n, k) are forces in N, ``level`` the runs (first, end bin) at this level; ``spread`` is the force's range.
    """
    centre = np.median(np.concatenate([bins[first:last] for first, last in level]), axis=0)
    difference = bins - centre
    _, axes = np.linalg.eigh(difference.T @ difference)
    along = difference @ axes[:, -1]  # in the direction in which the force varies most
    above, below = (along > _AWAY * spread).mean(), (along < -_AWAY * spread).mean()
    return bool(min(above, below) > _MIN_AWAY_SHARE)


def _mean(seconds: FloatArray, force_n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns mean and standard error (3,) of readings (n, 3) in N; 0 and NaN for an axis without readings.

    The standard error is by the scatter of half seconds, because readings within one are not independent.
    """
    mean, stderr = np.zeros(3), np.full(3, math.nan)
    block = np.floor((seconds - seconds[0]) / _BLOCK_S).astype(np.int64)
    for axis in range(3):
        values = force_n[:, axis]
        if np.isnan(values).all():
            continue
        mean[axis] = values.mean()
        means = np.array([values[block == number].mean() for number in np.unique(block)])
        scatter = means.std(ddof=1) / math.sqrt(len(means)) if len(means) > 2 else values.std() / math.sqrt(2)
        stderr[axis] = max(float(scatter), float(values.std()) / math.sqrt(len(values)))
    return mean, stderr
