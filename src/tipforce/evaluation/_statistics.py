"""Statistics that respect sessions: bootstrap by session, Bland-Altman, coverage by stratum.

Frames of one session resemble each other, so they are no independent samples. Confidence intervals resample whole
sessions with replacement (cluster bootstrap); the limits of agreement take the variance between sessions apart from
that within them.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from ..clinical import LIMIT_N, WINDOW_N
from ..types import BoolArray, FloatArray
from ._predictions import Predictions

MIN_SESSIONS = 5
"""With fewer sessions no bootstrap interval is given: resampling so few says little of the spread between sessions."""

COVERAGE_FORCE_BINS_N = (0.0, 0.05, WINDOW_N[0], 0.2, 0.3, LIMIT_N, 0.6, 1.0, math.inf)
"""Edges of the strata of the reference magnitude, in newtons; the window's lower end and the limit are among them."""

CONTACT_ANGLE_BINS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Edges of the strata of the angle between the tip's axis and the direction into the tissue."""

WRONG_N = 0.05
"""An estimate that is off by more is wrong: half of the way from no force to the lower end of the force window."""

FEW_SAMPLES = 100
"""Figures of a stratum with fewer samples are marked."""

_RESAMPLES = 4000
LIMITS_OF_AGREEMENT_SIGMA = 1.96
"""95 % of a Gaussian are within this number of standard deviations."""


def bootstrap_mean(
    values: FloatArray, session: npt.NDArray[np.str_], *, seed: int = 0, resamples: int = _RESAMPLES
) -> dict[str, Any]:
    """Computes the 95 % confidence interval of a mean over all samples, from resampled sessions.

    Each resample draws as many sessions as there are, with replacement, and takes the mean over all of their samples.
    The interval is that of the 2.5 and 97.5 % quantiles of these means (percentile bootstrap).

    Args:
        values: (n,) one value a sample; NaN is left out, and with it sessions that have nothing else.
        session: (n,) name of each sample's session.
        seed: Seed of the resampling.
        resamples: Number of resamples.

    Returns:
        ``low`` and ``high``, NaN with fewer than `MIN_SESSIONS` sessions; ``sessions``: how many there are.
    """
    use = np.isfinite(values)
    _, session_index = np.unique(session[use], return_inverse=True)
    samples = np.bincount(session_index).astype(np.float64)
    interval: dict[str, Any] = {"low": math.nan, "high": math.nan, "sessions": len(samples)}
    if len(samples) < MIN_SESSIONS:
        return interval
    sums = np.bincount(session_index, weights=values[use])
    draws = np.random.default_rng(seed).multinomial(len(samples), np.full(len(samples), 1 / len(samples)), resamples)
    # a draw states how often each session was taken
    low, high = np.quantile((draws @ sums) / (draws @ samples), (0.025, 0.975))
    return interval | {"low": float(low), "high": float(high)}


def bland_altman(
    reference_n: FloatArray, estimate_n: FloatArray, session: npt.NDArray[np.str_], *, seed: int = 0
) -> dict[str, Any]:
    """Measures the agreement of two measurements of one force: differences (estimate - reference) over their mean.

    With several sessions the variance of the differences is the sum of that within and that between sessions, from a
    one-way analysis of variance with sessions of unequal length (Bland and Altman 2007, J. Biopharm. Stat. 17, 571,
    for a true value that varies). With one session it is the sample variance.

    Args:
        reference_n: (n,) in newtons.
        estimate_n: (n,) in newtons; NaN is left out.
        session: (n,) name of each sample's session.
        seed: Seed of the bootstrap of the bias.

    Returns:
        ``n``; ``bias_n``, the mean difference, with ``bias_ci95_n`` [low, high] (see `bootstrap_mean`); ``sd_n`` of the
        differences, ``within_sd_n`` and ``between_sd_n``; ``lower_n`` and ``upper_n``, the 95 % limits of agreement
        bias -+ 1.96 sd; ``inside_share`` of the differences; ``slope`` of the difference over the mean by least
        squares (negative: large forces are estimated too small). NaN where nothing is left.
    """
    use = np.isfinite(estimate_n) & np.isfinite(reference_n)
    difference, mean = (estimate_n - reference_n)[use], (0.5 * (estimate_n + reference_n))[use]
    count = len(difference)
    if count < 2:
        names = ("sd_n", "within_sd_n", "between_sd_n", "lower_n", "upper_n", "inside_share", "slope")
        bias = float(difference[0]) if count else math.nan
        return {"n": count, "bias_n": bias, "bias_ci95_n": [math.nan] * 2, **dict.fromkeys(names, math.nan)}
    bias = float(difference.mean())
    within, between = _variances(difference, session[use])
    sd = math.sqrt(within + between)
    lower, upper = bias - LIMITS_OF_AGREEMENT_SIGMA * sd, bias + LIMITS_OF_AGREEMENT_SIGMA * sd
    spread = float(np.var(mean))
    interval = bootstrap_mean(difference, session[use], seed=seed)
    return {
        "n": count,
        "bias_n": bias,
        "bias_ci95_n": [interval["low"], interval["high"]],
        "sd_n": sd,
        "within_sd_n": math.sqrt(within),
        "between_sd_n": math.sqrt(between),
        "lower_n": lower,
        "upper_n": upper,
        "inside_share": float(np.mean((difference >= lower) & (difference <= upper))),
        "slope": float(np.mean((mean - mean.mean()) * (difference - bias))) / spread if spread > 0 else math.nan,
    }


def _variances(difference: FloatArray, session: npt.NDArray[np.str_]) -> tuple[float, float]:
    """Returns the variance within and between sessions; with one session, or one sample each, the sample variance.

    One-way analysis of variance: the mean square between sessions is the variance within them plus
    ``effective_samples`` (the number of samples a session, for sessions of unequal length) times that between them.

    Args:
        difference: (n,) differences in newtons.
        session: (n,) name of each sample's session.
    """
    _, session_index = np.unique(session, return_inverse=True)
    samples = np.bincount(session_index).astype(np.float64)
    sessions, count = len(samples), len(difference)
    if sessions in (1, count):
        return float(np.var(difference, ddof=1)), 0.0
    session_means = np.bincount(session_index, weights=difference) / samples
    within = float(np.sum((difference - session_means[session_index]) ** 2)) / (count - sessions)
    between_square = float(np.sum(samples * (session_means - difference.mean()) ** 2)) / (sessions - 1)
    effective_samples = (count - float(np.sum(samples**2)) / count) / (sessions - 1)
    return within, max(0.0, (between_square - within) / effective_samples)


def coverage_by_stratum(
    predictions: Predictions, by: FloatArray, edges: tuple[float, ...], unit: str, *, seed: int = 0
) -> list[dict[str, Any]]:
    """Computes the coverage of the magnitude's 90 % interval by stratum, with the number of samples behind each figure.

    Args:
        predictions: Predictions of one method under one protocol, n samples.
        by: (n,) quantity that is cut into strata; NaN is in none.
        edges: Edges of the strata; a value on an edge is in the stratum above it, on the last one in the last stratum.
        unit: Unit of ``by``, ``n`` or ``deg``: part of the keys.
        seed: Seed of the bootstrap.

    Returns:
        One dict for each stratum that has samples: ``from_UNIT``, ``below_UNIT`` and `stratum_metrics`.
    """
    strata: list[dict[str, Any]] = []
    for low, high in pairwise(edges):
        chosen: BoolArray = (by >= low) & ((by < high) | ((by == high) & (high == edges[-1])))
        if chosen.any():
            limits = {f"from_{unit}": low, f"below_{unit}": high}
            strata.append(limits | stratum_metrics(predictions.where(chosen), seed=seed))
    return strata


def stratum_metrics(stratum: Predictions, *, seed: int = 0) -> dict[str, Any]:
    """Computes coverage and errors of the magnitude in one stratum.

    Args:
        stratum: Predictions of its samples, at least one.
        seed: Seed of the bootstrap.

    Returns:
        ``samples``, and ``few``: whether they are fewer than `FEW_SAMPLES`; ``intervals``, those with an interval;
        ``sessions`` that these are of; ``coverage`` and ``coverage_ci95`` [low, high] (see `bootstrap_mean`);
        ``width_n``, the mean width of the bounded intervals; ``mae_n`` and ``bias_n`` of the valid samples, and their
        ``wrong_share``; ``abstained_share``.
    """
    reference, estimate, interval = stratum.column("magnitude")
    low, high = interval.T
    given = ~np.isnan(interval).any(axis=1) & np.isfinite(reference)
    inside = np.where(given, (reference >= low) & (reference <= high), np.nan)
    bounded = given & np.isfinite(low) & np.isfinite(high)
    error = (estimate - reference)[stratum.valid]
    ranged = bootstrap_mean(inside, stratum.session, seed=seed)
    return {
        "samples": len(stratum),
        "few": len(stratum) < FEW_SAMPLES,
        "intervals": int(given.sum()),
        "sessions": ranged["sessions"],
        "coverage": float(inside[given].mean()) if given.any() else math.nan,
        "coverage_ci95": [ranged["low"], ranged["high"]],
        "width_n": float((high - low)[bounded].mean()) if bounded.any() else math.inf,
        "mae_n": float(np.abs(error).mean()) if len(error) else math.nan,
        "bias_n": float(error.mean()) if len(error) else math.nan,
        "wrong_share": wrong_share(error),
        "abstained_share": float(np.mean(~stratum.valid)),
    }


def wrong_share(error_n: FloatArray) -> float:
    """Returns the share of the errors (n,) beyond `WRONG_N`; NaN of none.

    >>> wrong_share(np.array([0.02, -0.06]))
    0.5
    """
    return float(np.mean(np.abs(error_n) > WRONG_N)) if len(error_n) else math.nan
