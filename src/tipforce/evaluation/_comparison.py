"""Thesis table 2, measured: methods side by side over the load, beside the figures of sensors in the tip."""

from itertools import pairwise
from typing import Any

import numpy as np

from ..types import FloatArray
from ..units import grams_to_newtons
from ._constant import Constant
from ._evaluate import Evaluation

LOAD_BINS_N = (0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6)
"""Edges of the bins of the measured magnitude in which errors are drawn over the load."""

_MIN_SAMPLES = 10
"""A bin with fewer samples is left out: its mean error is too uncertain."""

SENSOR_MAE_N = {
    name: grams_to_newtons(grams)
    for name, grams in {"Stablepoint": 1.02, "TactiCath": 1.19, "SmartTouch": 1.52, "AcQBlate": 2.86}.items()
}
"""Mean absolute error of catheters with a force sensor in the tip, at 10 to 40 g."""
SENSOR_SOURCE = "Kueffer et al.: 12 catheters, 6,685 measurements at 10 to 40 g"


def comparison(evaluation: Evaluation) -> dict[str, Any]:
    """Compares the methods under the strictest protocol, against the force sensor.

    Returns:
        ``protocol``; ``rows``, a method each with the constant predictor last: ``method``, ``about`` (its description),
        ``breaks`` (its limits), errors of the magnitude ``mae_n``, ``rmse_n``, ``max_n``, ``bias_n``, ``r2``,
        ``coverage``, of the components ``x_mae_n`` and ``y_mae_n``, ``abstained_share``, ``update_us`` (median time of
        one frame with detection) and ``by_load``; ``sensors`` with the ``mae_n`` of each and ``sensor_source``.
    """
    rows: list[dict[str, Any]] = []
    kinds = {method.label: method.estimator for method in evaluation.methods}
    for result in evaluation.results:
        if result.protocol != evaluation.strictest:
            continue
        quantities = result.metrics["quantities"]
        magnitude, kind = quantities["magnitude"], kinds.get(result.method)
        reference, estimate, _ = result.predictions.column("magnitude")
        rows.append(
            {
                "method": result.method,
                "about": (type(kind).__doc__ or "").partition("\n")[0] if kind else "the mean of the training data",
                "breaks": kind.breaks if kind else "",
                **{name: magnitude[name] for name in ("mae_n", "rmse_n", "max_n", "bias_n", "r2", "coverage")},
                **{f"{axis}_mae_n": quantities.get(axis, {}).get("mae_n") for axis in ("x", "y")},
                "abstained_share": result.metrics["abstained_share"],
                "update_us": evaluation.timing[result.method]["p50_us"] if kind else None,
                "by_load": _by_load(reference, estimate),
            }
        )
    rows.sort(key=lambda row: row["method"] == Constant.name)
    return {"protocol": evaluation.strictest, "rows": rows, "sensors": SENSOR_MAE_N, "sensor_source": SENSOR_SOURCE}


def _by_load(reference: FloatArray, estimate: FloatArray) -> list[dict[str, Any]]:
    """Returns mean absolute error and bias in each of `LOAD_BINS_N` that has samples with an estimate."""
    bins: list[dict[str, Any]] = []
    for low, high in pairwise(LOAD_BINS_N):
        inside = (reference >= low) & (reference < high) & np.isfinite(estimate)
        if inside.sum() >= _MIN_SAMPLES:
            error = estimate[inside] - reference[inside]
            bins.append({
                "from_n": low, "below_n": high, "mean_n": float(reference[inside].mean()), "samples": int(inside.sum()),
                "mae_n": float(np.abs(error).mean()), "bias_n": float(error.mean()),
            })  # fmt: skip
    return bins
