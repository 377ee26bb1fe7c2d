"""Error metrics in newtons, grams and percent: over all samples, by component, session, force and contact."""

import math
from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from ..clinical import CONTACT_N
from ..types import BoolArray, FloatArray
from ..units import newtons_to_grams
from ._predictions import Predictions
from ._statistics import (
    CONTACT_ANGLE_BINS_DEG,
    COVERAGE_FORCE_BINS_N,
    bland_altman,
    bootstrap_mean,
    coverage_by_stratum,
)
from ._trust import trust_metrics

FORCE_BINS_N = (0.0, 0.1, 0.3, 0.6, 1.0, math.inf)
"""Edges of the bins of the reference magnitude in newtons, for errors by force."""

_BRIEF = {"n", "mae_n", "mae_g", "rmse_n", "max_n", "bias_n", "r2", "mean_percent_of_true", "coverage", "width_n"}
"""Metrics that are given for each session, force bin and contact state."""

_NEWTON_METRICS = ("mae", "rmse", "max", "min", "bias")
"""Metrics in newtons, which are also given in grams."""


def percent_of_true(reference_n: FloatArray, estimate_n: FloatArray) -> FloatArray:
    """Computes the signed error in percent of the true value (thesis fig. 23a).

    Args:
        reference_n: (n,) in newtons.
        estimate_n: (n,) in newtons.

    Returns:
        (n,), positive where the force is over-estimated, also for a negative component; NaN where the reference is
        below 10 mN, since a percentage means nothing there.

    >>> percent_of_true(np.array([0.2, -0.2, 0.001]), np.array([0.21, -0.21, 0.002])).round(6)
    array([ 5.,  5., nan])
    """
    divisor = np.where(np.abs(reference_n) > CONTACT_N, reference_n, np.nan)
    return 100.0 * (estimate_n - reference_n) / divisor


def error_metrics(reference_n: FloatArray, estimate_n: FloatArray) -> dict[str, float | int]:
    """Computes the errors of the samples whose estimate is a number.

    Args:
        reference_n: (n,) in newtons.
        estimate_n: (n,) in newtons; NaN where the method abstained.

    Returns:
        ``n``, the number of samples that count; ``mae``, ``rmse``, ``max``, ``min`` (of the absolute error) and
        ``bias`` (mean signed error), each with ``_n`` and ``_g``; ``mse_n2``; ``r2`` = 1 - MSE / variance of the
        reference, NaN where that is constant; ``mean_percent_of_true`` and ``max_percent_of_true`` (absolute,
        references above 10 mN); ``mae_percent_of_range`` (of the references' range). All NaN where n = 0.
    """
    use = np.isfinite(estimate_n) & np.isfinite(reference_n)
    reference, estimate = reference_n[use], estimate_n[use]
    error = estimate - reference
    count = len(error)
    metrics: dict[str, float | int] = {"n": count}
    newtons = dict.fromkeys(_NEWTON_METRICS, math.nan)
    mse = r2 = of_range = math.nan
    if count:
        absolute = np.abs(error)
        mse = float(np.mean(error**2))
        extremes = {"max": float(absolute.max()), "min": float(absolute.min())}
        newtons = {"mae": float(absolute.mean()), "rmse": math.sqrt(mse), **extremes, "bias": float(error.mean())}
        variance, spread = float(np.var(reference)), float(np.ptp(reference))
        r2 = 1.0 - mse / variance if variance > 0 else math.nan
        of_range = 100.0 * newtons["mae"] / spread if spread > 0 else math.nan
    for name, value in newtons.items():
        metrics[f"{name}_n"], metrics[f"{name}_g"] = value, newtons_to_grams(value)
    percent = np.abs(percent_of_true(reference, estimate))
    percent = percent[np.isfinite(percent)]
    return {
        **metrics,
        "mse_n2": mse,
        "r2": r2,
        "mean_percent_of_true": float(percent.mean()) if len(percent) else math.nan,
        "max_percent_of_true": float(percent.max()) if len(percent) else math.nan,
        "mae_percent_of_range": of_range,
    }


def interval_metrics(reference_n: FloatArray, interval_n: FloatArray) -> dict[str, float | int]:
    """Measures how well the 90 % intervals hold.

    Args:
        reference_n: (n,) in newtons.
        interval_n: (n, 2) lower and upper end in newtons; NaN without an interval, infinite where unbounded.

    Returns:
        ``coverage``: share of the references inside their interval; ``width_n`` and ``width_g``: mean width of the
        bounded intervals; ``unbounded_share``: share of those that exclude nothing. All NaN without any interval.
    """
    use = ~np.isnan(interval_n).any(axis=1) & np.isfinite(reference_n)
    if not use.any():
        return {"coverage": math.nan, "width_n": math.nan, "width_g": math.nan, "unbounded_share": math.nan}
    low, high = interval_n[use].T
    inside = (reference_n[use] >= low) & (reference_n[use] <= high)
    bounded = np.isfinite(low) & np.isfinite(high)
    width = float(np.mean((high - low)[bounded])) if bounded.any() else math.inf
    return {
        "coverage": float(inside.mean()),
        "width_n": width,
        "width_g": newtons_to_grams(width),
        "unbounded_share": float(np.mean(~bounded)),
    }


def score(
    predictions: Predictions,
    fallback_n: FloatArray | None = None,
    *,
    contact_angle_deg: FloatArray | None = None,
    groups: Mapping[str, str] | None = None,
    base_frame: bool = True,
    seed: int = 0,
) -> dict[str, Any]:
    """Computes all metrics of the predictions of one method under one protocol.

    Args:
        predictions: n samples with estimates and references.
        fallback_n: (n,) magnitudes of the constant predictor on the same samples, in newtons.
        contact_angle_deg: (n,) angle between the tip's axis and the direction into the tissue; NaN where not known.
        groups: Session -> its group, see `session_groups`.
        base_frame: Whether the forces are in the base frame.
        seed: Seed of the bootstrap.

    Returns:
        Nested dicts of numbers. ``samples``, ``valid``, ``abstained_share``, ``abstained`` (reason -> count);
        ``quantities``: for the magnitude and each component `error_metrics`, `interval_metrics`, the range of the
        references, ``mae_ci95_n`` [low, high] with ``mae_ci95_sessions`` (see `bootstrap_mean`) and ``bland_altman``;
        ``by_session``, ``by_force`` and, where there are both, ``by_contact``: the main metrics of each group;
        ``coverage_by_force`` and, with ``contact_angle_deg``, ``coverage_by_contact_angle`` of the samples in contact
        (see `coverage_by_stratum`); ``trust``: see `trust_metrics`. With ``fallback_n`` also ``mae_filled_n`` and
        ``mae_filled_g``: the error if the constant predictor estimated where the method abstained, so that abstaining
        from hard frames cannot lower it.
    """
    count, valid = len(predictions), predictions.valid
    reasons = Counter(predictions.status[~valid].tolist())
    sessions = dict.fromkeys(predictions.session.tolist())
    size = predictions.reference_magnitude_n
    metrics: dict[str, Any] = {
        "samples": count,
        "valid": int(valid.sum()),
        "abstained_share": float(np.mean(~valid)) if count else math.nan,
        "abstained": dict(reasons.most_common()),
        "quantities": {name: _quantity(predictions, name, seed) for name in predictions.quantities},
        "by_session": {name: _group_metrics(predictions, predictions.session == name) for name in sessions},
        "by_force": _by_force(predictions),
        "coverage_by_force": coverage_by_stratum(predictions, size, COVERAGE_FORCE_BINS_N, "n", seed=seed),
        "trust": trust_metrics(predictions, groups, base_frame=base_frame, seed=seed),
    }
    if 0 < predictions.contact.sum() < count:
        metrics["by_contact"] = {
            "contact": _group_metrics(predictions, predictions.contact),
            "no_contact": _group_metrics(predictions, ~predictions.contact),
        }
    if contact_angle_deg is not None:
        angle = np.where(predictions.contact, contact_angle_deg, np.nan)
        strata = coverage_by_stratum(predictions, angle, CONTACT_ANGLE_BINS_DEG, "deg", seed=seed)
        metrics["coverage_by_contact_angle"] = strata
    if fallback_n is not None:
        filled = np.where(valid, predictions.magnitude_n, fallback_n)
        mae = float(np.mean(np.abs(filled - size))) if count else math.nan
        metrics["mae_filled_n"], metrics["mae_filled_g"] = mae, newtons_to_grams(mae)
    return metrics


def _quantity(predictions: Predictions, name: str, seed: int) -> dict[str, Any]:
    """Returns the metrics of the magnitude or of the component ``name`` over all samples; see `score`."""
    reference, estimate, interval = predictions.column(name)
    ranged = bootstrap_mean(np.abs(estimate - reference), predictions.session, seed=seed)
    return {
        **error_metrics(reference, estimate),
        **interval_metrics(reference, interval),
        "reference_min_n": float(reference.min()),
        "reference_max_n": float(reference.max()),
        "reference_mean_n": float(reference.mean()),
        "mae_ci95_n": [ranged["low"], ranged["high"]],
        "mae_ci95_sessions": ranged["sessions"],
        "bland_altman": bland_altman(reference, estimate, predictions.session, seed=seed),
    }


def _group_metrics(predictions: Predictions, chosen: BoolArray) -> dict[str, Any]:
    """Returns the main metrics of one group of samples, by quantity."""
    part = predictions.where(chosen)
    columns = {name: part.column(name) for name in predictions.quantities}
    return {
        "samples": len(part),
        "abstained_share": float(np.mean(~part.valid)) if len(part) else math.nan,
        "quantities": {
            name: {
                key: value
                for key, value in (error_metrics(reference, estimate) | interval_metrics(reference, interval)).items()
                if key in _BRIEF
            }
            for name, (reference, estimate, interval) in columns.items()
        },
    }


def _by_force(predictions: Predictions) -> list[dict[str, Any]]:
    bins: list[dict[str, Any]] = []
    for low, high in pairwise(FORCE_BINS_N):
        chosen = (predictions.reference_magnitude_n >= low) & (predictions.reference_magnitude_n < high)
        if chosen.any():
            bins.append({"from_n": low, "below_n": high, **_group_metrics(predictions, chosen)})
    return bins


def json_ready(value: Any) -> Any:
    """Returns ``value`` fit for JSON: NaN and infinity become None, numpy values plain numbers, tuples lists.

    >>> json_ready({"a": np.float64("nan"), "b": (np.int64(3), 0.5)})
    {'a': None, 'b': [3, 0.5]}
    """
    if isinstance(value, dict):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_ready(item) for item in value]
    if isinstance(value, np.ndarray):
        return json_ready(value.tolist())
    if isinstance(value, np.generic):
        return json_ready(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
