"""Coarse search: which rate and offset bring deflection and force together, over all that a bench may show.

The bend, without slow changes, is correlated with both components of the force at all lags together (by FFT),
for rates on a logarithmic grid. The free regression on two components is late or early by some milliseconds, because
friction follows the wall's velocity; the shape-force law of `Fit` refines this result.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from ..types import FloatArray

_NEAR_RATE = 1.5
"""Rates from its inverse to it are searched first."""
SUFFICIENT_SCORE = 0.6
"""Share of the bend's energy from which on no other rates are searched: over 8 simulated sessions wrong rates reached
at most half of that of the right one."""
_MAX_RATE = 10.0
"""Rates from its inverse to it are searched: slow motion by a factor of 8 is recognised."""
_STEP_S = 0.04
"""Step of the grid on which bend and force are compared: a beat has 20 of them."""
_SLOW_S = 3.0
"""Length of the moving mean, taken twice, that is left out: the shaft's drift, about 0.2 Hz."""
_MISMATCH_S = 0.1
"""Neighbouring rates differ by no more at both ends of the overlap: a seventh of the fastest beat's period."""
_MIN_OVERLAP_S = 3.0
_NEAR_BEST = 0.5
"""Maxima at a rate that reach less than this share of its best are dropped."""
_APART_S = 0.12
"""Two maxima that differ by less at both ends of the images are one."""


Spectrum = npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Coarse:
    """A candidate: force time = camera time / ``rate`` - ``lag_s``.

    Attributes:
        rate: rate of the camera's clock against the force log's.
        lag_s: lag.
        score: share of the bend's energy explained.
    """

    rate: float
    lag_s: float
    score: float


def search_clock(
    time_s: FloatArray,
    bend: FloatArray,
    force_s: FloatArray,
    force_n: FloatArray,
    levers: FloatArray,
    count: int,
    rate: float | None = None,
) -> list[Coarse]:
    """Finds candidates of the clock map: the best by a free regression, and as many by the usual levers.

    Friction makes the free regression late or early by up to two tenths of a second; the levers serve only where the
    sensor's angle is right.

    Args:
        time_s: (n,) times of the images, increasing.
        bend: (n,) integral of the deflection in rad.
        force_s: (m,) times of the readings on their own clock, increasing.
        force_n: (m, 2) readings in N; NaN where a reading is not plausible.
        levers: (2,) usual factors of the force's x and y in the moment.
        count: number of candidates of each kind.
        rate: the only rate that is tried; None: a range of rates.

    Returns:
        Up to 2 ``count`` candidates.
    """
    plausible = np.isfinite(force_n).all(axis=1)
    log_start = float(force_s[0])
    grid = np.arange(0.0, force_s[-1] - log_start + _STEP_S, _STEP_S)
    force, covered = _resampled(force_s[plausible] - log_start, force_n[plausible], grid)
    force = _without_slow(force, covered)
    span = float(time_s[-1] - time_s[0])
    spectra: dict[int, list[Spectrum]] = {}
    candidates: tuple[list[Coarse], list[Coarse]] = ([], [])  # by the free regression, by the usual levers
    rates = _rates(span, float(grid[-1])) if rate is None else [rate]
    near_one = [trial for trial in rates if 1.0 / _NEAR_RATE <= trial <= _NEAR_RATE] if rate is None else rates
    for trial in [*near_one, *(trial for trial in rates if trial not in near_one)]:
        if trial not in near_one and max(each.score for kind in candidates for each in kind) > SUFFICIENT_SCORE:
            break  # a fit as good as this has the right rate
        seconds = (time_s - time_s[0]) / trial
        bend_grid = np.arange(0.0, seconds[-1] + _STEP_S, _STEP_S)
        values, detected = _resampled(seconds, bend[:, None], bend_grid)
        values = _without_slow(values, detected)[:, 0]
        size = 1 << (len(grid) + len(bend_grid) - 1).bit_length()  # a power of two that holds all lags
        if size not in spectra:
            spectra[size] = _spectra(force, size)
        lags = np.arange(size)
        lags = np.where(lags >= len(grid), lags - size, lags) * _STEP_S  # the circular ones at the end are negative
        for kind, scores in zip(candidates, _scores(spectra[size], values, detected, levers, size), strict=True):
            high = scores > _NEAR_BEST * scores.max()
            tops = np.flatnonzero(high & (scores >= np.roll(scores, 1)) & (scores >= np.roll(scores, -1)))
            # the first sample of the bend is at lag on the force's grid
            lag_s = time_s[0] / trial - lags[tops] - log_start
            kind.extend(Coarse(trial, *pair) for pair in zip(lag_s.tolist(), scores[tops].tolist(), strict=True))
    ends = (float(time_s[0]), float(time_s[-1]))
    return [each for kind in candidates for each in _distinct(kind, *ends, count)]


def _rates(span_s: float, log_s: float) -> list[float]:
    """Returns rates about 1 for images of ``span_s`` and a log of ``log_s``.

    They are so dense that the best of them fits everywhere to half of `_MISMATCH_S`.
    """
    rates = [1.0]
    for direction in (1.0, -1.0):
        rate = 1.0
        while True:
            overlap = max(min(span_s / rate, log_s), _MIN_OVERLAP_S)
            rate *= math.exp(direction * 2.0 * _MISMATCH_S / overlap)
            if not 1.0 / _MAX_RATE <= rate <= _MAX_RATE or span_s / rate < _MIN_OVERLAP_S:
                break
            rates.append(rate)
    return rates


def _resampled(at_s: FloatArray, values: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Averages ``values`` (n, k) at the increasing times ``at_s`` (n,) about each instant of ``grid`` (m,).

    Returns (m, k) means, interpolated where there is no value; and (m,) 1.0 where there is one within two steps of the
    grid, else 0.0.
    """
    edges = np.append(grid - 0.5 * _STEP_S, grid[-1] + 0.5 * _STEP_S)
    bin_of = np.clip(np.searchsorted(edges, at_s, side="right") - 1, 0, len(grid) - 1)
    counts = np.bincount(bin_of, minlength=len(grid))
    sums = np.stack([np.bincount(bin_of, column, minlength=len(grid)) for column in values.T], axis=1)
    filled = np.flatnonzero(counts)
    means = sums[filled] / counts[filled, None]
    even = np.stack([np.interp(grid, grid[filled], column) for column in means.T], axis=1)
    after = np.searchsorted(at_s, grid)
    to_next, to_last = (np.abs(grid - at_s[np.clip(index, 0, len(at_s) - 1)]) for index in (after, after - 1))
    return even, (np.minimum(to_next, to_last) <= 2.0 * _STEP_S).astype(np.float64)


def _without_slow(values: FloatArray, detected: FloatArray) -> FloatArray:
    """Returns ``values`` (n, k) without slow changes; 0 where nothing was ``detected`` (n,), 1.0 or 0.0."""

    def mean(column: FloatArray) -> FloatArray:
        size = round(_SLOW_S / _STEP_S)
        once: FloatArray = uniform_filter1d(column, size, axis=0, mode="constant")
        return uniform_filter1d(once, size, axis=0, mode="constant")

    # the mean over the detected values only
    slow = mean(values * detected[:, None]) / np.maximum(mean(detected), 1e-9)[:, None]
    return (values - slow) * detected[:, None]


def _spectra(force: FloatArray, size: int) -> list[Spectrum]:
    """Returns the spectra of x, y, x^2, x y and y^2 of the force (n, 2), padded to ``size``."""
    x, y = force.T
    return [np.fft.rfft(column, size) for column in (x, y, x * x, x * y, y * y)]


def _scores(
    spectra: list[Spectrum], bend: FloatArray, detected: FloatArray, levers: FloatArray, size: int
) -> tuple[FloatArray, FloatArray]:
    """Returns two shares (size,) of the bend's energy that the force explains, for every circular lag.

    First by both of its components as they fit best, then by the moment with the usual ``levers``. The sums of a
    regression (bend times x, x times x, ...) over the detected images are correlations, for all lags by one FFT.
    ``bend`` (n,) is on the grid, without slow changes; ``detected`` (n,) is 1.0 where there is one, else 0.0.
    """
    bend_spectrum, mask_spectrum = np.conj(np.fft.rfft(bend, size)), np.conj(np.fft.rfft(detected, size))
    bx, by = (np.fft.irfft(spectrum * bend_spectrum, size) for spectrum in spectra[:2])
    xx, xy, yy = (np.fft.irfft(spectrum * mask_spectrum, size) for spectrum in spectra[2:])
    floor = 1e-3 * float(max(xx.max(), yy.max(), 1e-30))
    xx, yy = np.maximum(xx, 0.0) + floor, np.maximum(yy, 0.0) + floor
    determinant = np.maximum(xx * yy - xy**2, 1e-6 * xx * yy)
    free = (yy * bx**2 - 2.0 * xy * bx * by + xx * by**2) / determinant
    across, along = levers / max(float(np.linalg.norm(levers)), 1e-30)
    moment = np.maximum(across * bx + along * by, 0.0)
    square = across**2 * xx + 2.0 * across * along * xy + along**2 * yy
    energy = max(float(bend @ bend), 1e-30)
    return free / energy, moment**2 / np.maximum(square, floor) / energy


def _distinct(found: list[Coarse], first_s: float, last_s: float, count: int) -> list[Coarse]:
    """Returns the best ``count`` candidates that differ at the first or the last image, whose times are given."""
    chosen: list[Coarse] = []

    def force_s(candidate: Coarse) -> FloatArray:
        return np.array([first_s, last_s]) / candidate.rate - candidate.lag_s

    for candidate in sorted(found, key=lambda candidate: -candidate.score):
        if all(np.abs(force_s(candidate) - force_s(better)).max() > _APART_S for better in chosen):
            chosen.append(candidate)
        if len(chosen) == count:
            break
    return chosen
