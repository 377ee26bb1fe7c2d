"""How far the answers of a method can be trusted: wrong ones, strata of force and direction, error over abstention."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..datasets import Dataset
from ..types import FloatArray
from ._predictions import Predictions
from ._statistics import FEW_SAMPLES, WRONG_N, coverage_by_stratum, stratum_metrics, wrong_share

TRUST_FORCE_BINS_N = (0.0, 0.1, 0.2, 0.3, math.inf)
"""Edges of the strata of the reference magnitude, in newtons."""

AXIS_ANGLE_BINS_DEG = (0.0, 15.0, 30.0, 60.0, 180.0)
"""Edges of the strata of the force's angle to the shaft's axis: a push along a straight shaft bends it least."""

_KEPT = np.linspace(1.0, 0.05, 20)
"""Shares of the answered samples that are kept along the curve of error over abstention."""


def axis_angle_deg(force_n: FloatArray) -> FloatArray:
    """Computes the angle between each force and the shaft's axis at its base; 0 degrees push the tip straight back.

    Args:
        force_n: (n, 3) in newtons, base frame; components that were not measured are NaN.

    Returns:
        (n,) degrees; NaN without a force or without its x component.

    >>> axis_angle_deg(np.array([[-1.0, 0.0, np.nan], [0.0, -0.2, np.nan]]))
    array([ 0., 90.])
    """
    size = np.sqrt(np.nansum(force_n**2, axis=1))
    cosine = -force_n[:, 0] / np.where(size > 0.0, size, np.nan)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def session_groups(dataset: Dataset) -> dict[str, str]:
    """Returns the group of each session: the preset it was simulated by, else the name of its catheter."""
    return {name: info.preset or info.catheter.name for name, info in dataset.session_info.items()}


def retention(error_n: FloatArray, uncertainty_n: FloatArray, answered_share: float = 1.0) -> dict[str, Any]:
    """Computes the mean error of the kept estimates when the least certain are left out (risk-coverage curve).

    Answers of one uncertainty are left out in random order, of which this is the mean: a method whose uncertainty is
    always the same has a flat line.

    Args:
        error_n: (n,) absolute errors of the answers.
        uncertainty_n: (n,) as the method states it, such as the width of its interval.
        answered_share: Share of the samples that were answered: the curve begins at the others.

    Returns:
        ``abstained_share`` and ``mae_n`` along the curve; ``area_n``, the mean of the error over all shares left out
        of the answers, and ``best_area_n``, had they been sorted by the error itself. NaN and empty without answers.
    """
    if not len(error_n):
        return {"abstained_share": [], "mae_n": [], "area_n": math.nan, "best_area_n": math.nan}
    # estimates of equal uncertainty have the mean error of all of these, which is the mean over their random orders
    _, tie_index, tie_sizes = np.unique(uncertainty_n, return_inverse=True, return_counts=True)
    tie_mean = np.bincount(tie_index, weights=error_n) / tie_sizes
    kept_counts = np.arange(1, len(error_n) + 1)  # 1: only the most certain one is kept
    kept_mae = np.cumsum(np.repeat(tie_mean, tie_sizes)) / kept_counts
    shown = np.maximum(1, np.round(_KEPT * len(error_n))).astype(np.int64)
    return {
        "abstained_share": (1.0 - answered_share * shown / len(error_n)).tolist(),
        "mae_n": kept_mae[shown - 1].tolist(),
        "area_n": float(kept_mae.mean()),
        "best_area_n": float(np.mean(np.cumsum(np.sort(error_n)) / kept_counts)),
    }


def trust_metrics(
    predictions: Predictions, groups: Mapping[str, str] | None = None, *, base_frame: bool = True, seed: int = 0
) -> dict[str, Any]:
    """Measures how far the estimates can be trusted.

    Args:
        predictions: n samples with estimates and references.
        groups: Session -> its group, see `session_groups`; None: all are one.
        base_frame: Whether the forces are in the base frame; else nothing is known of their angle to the shaft.
        seed: Seed of the bootstrap.

    Returns:
        ``wrong_beyond_n`` (`WRONG_N`) and ``wrong_share`` of the estimates; ``by_force``, ``by_axis_angle`` (samples in
        contact, see `axis_angle_deg`) and ``by_group``: `stratum_metrics` of each stratum; ``worst_coverage`` of a
        stratum with at least `FEW_SAMPLES` samples, and ``worst_stratum``, which one; ``retention``.
    """
    valid, (low, high) = predictions.valid, predictions.magnitude_interval_n.T
    error = np.abs(predictions.magnitude_n - predictions.reference_magnitude_n)[valid]
    by_force = coverage_by_stratum(predictions, predictions.reference_magnitude_n, TRUST_FORCE_BINS_N, "n", seed=seed)
    by_angle: list[dict[str, Any]] = []
    if base_frame:
        angle = np.where(predictions.contact, axis_angle_deg(predictions.reference_n), np.nan)
        by_angle = coverage_by_stratum(predictions, angle, AXIS_ANGLE_BINS_DEG, "deg", seed=seed)
    by_group = _by_group(predictions, groups or {}, seed)
    strata = (*by_force, *by_angle, *(by_group if len(by_group) > 1 else ()))
    coverages = {_name(each): each["coverage"] for each in strata if not each["few"]}
    coverages = {name: coverage for name, coverage in coverages.items() if not math.isnan(coverage)}
    worst = min(coverages, key=lambda name: coverages[name], default="")
    return {
        "wrong_beyond_n": WRONG_N,
        "wrong_share": wrong_share(error),
        "few_samples": FEW_SAMPLES,
        "by_force": by_force,
        "by_axis_angle": by_angle,
        "by_group": by_group,
        "worst_coverage": coverages.get(worst, math.nan),
        "worst_stratum": worst,
        "retention": retention(error, (high - low)[valid], float(valid.mean()) if len(valid) else math.nan),
    }


def _by_group(predictions: Predictions, groups: Mapping[str, str], seed: int) -> Sequence[dict[str, Any]]:
    """Returns the metrics of each group of sessions; see `trust_metrics` for the arguments."""
    group: npt.NDArray[np.str_] = np.array([groups.get(name, "") for name in predictions.session.tolist()], np.str_)
    return [
        {"group": name} | stratum_metrics(predictions.where(group == name), seed=seed)
        for name in dict.fromkeys(group.tolist())
    ]


def _name(stratum: Mapping[str, Any]) -> str:
    """Returns the name of a stratum, as ``0.1 to 0.2 N``."""
    if "group" in stratum:
        return str(stratum["group"])
    unit, text = ("n", "N") if "from_n" in stratum else ("deg", "degrees")
    low, high = stratum[f"from_{unit}"], stratum[f"below_{unit}"]
    return f"{low:g} {text} and more" if math.isinf(high) else f"{low:g} to {high:g} {text}"
