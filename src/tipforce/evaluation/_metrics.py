"""Figures of merit: every error in newtons, grams and percent, by component, force, session and contact."""

import math
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np

from ..types import BoolArray, FloatArray
from ..units import newtons_to_grams
from ._outcome import CONTACT_N, Outcome

__all__ = ["FORCE_BINS_N", "error_figures", "interval_figures", "percent_of_true", "plain", "score"]

FORCE_BINS_N = (0.0, 0.1, 0.3, 0.6, 1.0, math.inf)
"""Edges of the bins of the reference magnitude; the clinic's window of 0.1-0.3 N is the second."""

_BRIEF = {"n", "mae_n", "mae_g", "rmse_n", "max_n", "bias_n", "r2", "mean_percent_of_true", "coverage", "width_n"}
"""What is told of every session, force bin and contact state."""

_LENGTHS = ("mae", "rmse", "max", "min", "bias")


def percent_of_true(reference_n: FloatArray, estimate_n: FloatArray) -> FloatArray:
    """(n,): signed error in percent of the true value (thesis fig. 23a), NaN below 10 mN, where it means nothing.

    Positive where the force is over-estimated, also for a negative component.

    >>> percent_of_true(np.array([0.2, -0.2, 0.001]), np.array([0.21, -0.21, 0.002])).round(6)
    array([ 5.,  5., nan])
    """
    sure = np.abs(reference_n) > CONTACT_N
    divisor = np.where(sure, reference_n, np.nan)
    return 100.0 * (estimate_n - reference_n) / divisor


def error_figures(reference_n: FloatArray, estimate_n: FloatArray) -> dict[str, float | int]:
    """Errors of ``estimate_n`` (n,) where it is a number; n = 0 gives NaN figures.

    Keys: ``n``, ``mae``, ``rmse``, ``max``, ``min`` (of the absolute error) and ``bias`` (mean signed error), each
    with ``_n`` and ``_g``; ``mse_n2``; ``r2`` = 1 - MSE / variance of the reference, NaN where that is constant;
    ``mean_percent_of_true`` and ``max_percent_of_true`` (absolute, references above 10 mN);
    ``mae_percent_of_range`` (of the references' range).
    """
    use = np.isfinite(estimate_n) & np.isfinite(reference_n)
    reference, estimate = reference_n[use], estimate_n[use]
    error = estimate - reference
    count = len(error)
    figures: dict[str, float | int] = {"n": count}
    newtons = dict.fromkeys(_LENGTHS, math.nan)
    mse = r2 = of_range = math.nan
    if count:
        size = np.abs(error)
        mse = float(np.mean(error**2))
        newtons = {
            "mae": float(size.mean()),
            "rmse": math.sqrt(mse),
            "max": float(size.max()),
            "min": float(size.min()),
            "bias": float(error.mean()),
        }
        variance, spread = float(np.var(reference)), float(np.ptp(reference))
        r2 = 1.0 - mse / variance if variance > 0 else math.nan
        of_range = 100.0 * newtons["mae"] / spread if spread > 0 else math.nan
    for name, value in newtons.items():
        figures[f"{name}_n"], figures[f"{name}_g"] = value, newtons_to_grams(value)
    percent = np.abs(percent_of_true(reference, estimate))
    percent = percent[np.isfinite(percent)]
    return {
        **figures,
        "mse_n2": mse,
        "r2": r2,
        "mean_percent_of_true": float(percent.mean()) if len(percent) else math.nan,
        "max_percent_of_true": float(percent.max()) if len(percent) else math.nan,
        "mae_percent_of_range": of_range,
    }


def interval_figures(reference_n: FloatArray, interval_n: FloatArray) -> dict[str, float | int]:
    """``coverage``: share of the references (n,) inside their interval (n, 2), where there is one (NaN: none).

    ``width_n``, ``width_g``: mean width of the bounded ones; ``unbounded_share``: of those that exclude nothing.
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


def score(outcome: Outcome, fallback_n: FloatArray | None = None) -> dict[str, Any]:
    """All figures of one outcome, as nested dicts of numbers.

    ``fallback_n`` (n,): the constant predictor's magnitudes on the same samples. With it ``mae_filled_n`` says what
    the error would be had the constant answered where the method refused: refusing the hard frames cannot lower it.
    """
    count, answered = len(outcome), outcome.answered
    reasons = Counter(outcome.status[~answered].tolist())
    sessions = dict.fromkeys(outcome.session.tolist())
    figures: dict[str, Any] = {
        "samples": count,
        "answered": int(answered.sum()),
        "refused_share": float(np.mean(~answered)) if count else math.nan,
        "refused": dict(reasons.most_common()),
        "quantities": {name: _quantity(outcome, name) for name in outcome.quantities},
        "by_session": {name: _brief(outcome, outcome.session == name) for name in sessions},
        "by_force": _by_force(outcome),
    }
    if 0 < outcome.contact.sum() < count:
        figures["by_contact"] = {
            "contact": _brief(outcome, outcome.contact),
            "no_contact": _brief(outcome, ~outcome.contact),
        }
    if fallback_n is not None:
        filled = np.where(answered, outcome.magnitude_n, fallback_n)
        mae = float(np.mean(np.abs(filled - outcome.reference_magnitude_n))) if count else math.nan
        figures["mae_filled_n"], figures["mae_filled_g"] = mae, newtons_to_grams(mae)
    return figures


def _quantity(outcome: Outcome, name: str) -> dict[str, float | int]:
    reference, estimate, interval = outcome.column(name)
    return {
        **error_figures(reference, estimate),
        **interval_figures(reference, interval),
        "reference_min_n": float(reference.min()),
        "reference_max_n": float(reference.max()),
        "reference_mean_n": float(reference.mean()),
    }


def _brief(outcome: Outcome, chosen: BoolArray) -> dict[str, Any]:
    """The figures of one group of samples, by quantity."""
    part = outcome.where(chosen)
    columns = {name: part.column(name) for name in outcome.quantities}
    return {
        "samples": len(part),
        "refused_share": float(np.mean(~part.answered)) if len(part) else math.nan,
        "quantities": {
            name: {
                key: value
                for key, value in (error_figures(reference, estimate) | interval_figures(reference, interval)).items()
                if key in _BRIEF
            }
            for name, (reference, estimate, interval) in columns.items()
        },
    }


def _by_force(outcome: Outcome) -> list[dict[str, Any]]:
    bins: list[dict[str, Any]] = []
    for low, high in pairwise(FORCE_BINS_N):
        chosen = (outcome.reference_magnitude_n >= low) & (outcome.reference_magnitude_n < high)
        if chosen.any():
            bins.append({"from_n": low, "below_n": high, **_brief(outcome, chosen)})
    return bins


def plain(value: Any) -> Any:
    """``value`` fit for JSON: NaN and infinity become None, numpy scalars plain numbers, tuples lists.

    >>> plain({"a": np.float64("nan"), "b": (np.int64(3), 0.5)})
    {'a': None, 'b': [3, 0.5]}
    """
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
