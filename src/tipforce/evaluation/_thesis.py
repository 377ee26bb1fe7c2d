"""A method under the thesis's protocol beside the thesis's own figures: the same quantities, and the differences."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._system.json_files import flat_values
from ..estimators import Estimator
from ._constant import Constant
from ._evaluate import Evaluation
from ._protocols import MethodResult

THESIS_MAE_N = 0.042
"""Table 4 of the thesis: mean absolute error of its own test samples, forces of 0.160-0.275 N."""

THESIS_FIGURES: Mapping[str, Any] = {
    "mae_n": THESIS_MAE_N,
    "force_min_n": 0.160,
    "force_max_n": 0.275,
    "force_mean_n": 0.218,
    "min_error_n": 0.0016,
    "max_error_n": 0.059,
    "by_direction": {
        "x": {"min_error_n": 0.0001, "max_error_n": 0.066, "rmse_n": 0.028},
        "y": {"min_error_n": 0.0003, "max_error_n": 0.068, "rmse_n": 0.023},
    },
    "safe_limit_n": 0.3,
}
"""Figures of the thesis: table 4 (method 1, 55 test samples), table 5 (method 2, 154), the safe limit of the force.
The alarm's limit of this program is 0.4 N by default."""

FORCE_TOLERANCE_N = 0.02
"""Measured forces may be outside the thesis's range by this: noise and steps of the sensor."""

_SAMPLES = {"svr": (165, 55), "dcfe": (461, 154)}
"""Training and test samples of the thesis."""

_NO_CONDITION = {"seed", "workers", "precision", "tuning_samples", "max_left_out", "minutes"}
"""Settings that are no condition of the thesis: they change how a method is computed or judged, not the method."""


def beside_thesis(evaluation: Evaluation) -> dict[str, Any]:
    """Returns each of the thesis's methods under its protocol beside the thesis's figures, by label.

    Returns:
        Of each method: ``text``, a sentence on each condition that is not the thesis's, and ``rows``, one for the
        method, one for the constant predictor and one for the thesis: force range, smallest, mean and largest error of
        the magnitude, and RMSE and largest error by direction, in newtons, as far as they are known. Empty where the
        protocol "thesis" was not run.
    """
    beside: dict[str, Any] = {}
    constant = evaluation.result(Constant.name, "thesis")
    for method in evaluation.methods:
        result = evaluation.result(method.label, "thesis")
        if result is None or constant is None or method.estimator.thesis_settings is None:
            continue
        bench, *others = _differences(evaluation, result, method.estimator)
        beside[method.label] = {
            "text": f"Not like for like: {bench}; {'; '.join(others)}."
            if others
            else f"Like for like but for the bench: this is {bench}.",
            "rows": {
                method.label: _row(result),
                "constant predictor": _row(constant),
                "the thesis, its own bench": _thesis_row(method.estimator.name),
            },
        }
    return beside


def _row(result: MethodResult) -> dict[str, Any]:
    """Returns a method's forces and errors under the names of `THESIS_FIGURES`."""
    quantities = result.metrics["quantities"]
    magnitude = quantities["magnitude"]
    return {
        "force_min_n": magnitude["reference_min_n"],
        "force_max_n": magnitude["reference_max_n"],
        "min_error_n": magnitude["min_n"],
        "mae_n": magnitude["mae_n"],
        "max_error_n": magnitude["max_n"],
        "by_direction": {
            axis: {"rmse_n": quantities[axis]["rmse_n"], "max_error_n": quantities[axis]["max_n"]}
            for axis in "xy"
            if axis in quantities
        },
    }


def _thesis_row(name: str) -> dict[str, Any]:
    """Returns table 4 for method 1, table 5 for method 2; the range of the forces is stated for method 1 alone."""
    if name == "svr":
        return {**THESIS_FIGURES, "by_direction": {}}
    return {"by_direction": THESIS_FIGURES["by_direction"]}


def _differences(evaluation: Evaluation, result: MethodResult, estimator: Estimator) -> list[str]:
    """Lists the conditions that differ from the thesis's: the bench first, then forces, samples and settings.

    Args:
        evaluation: the evaluation, with its dataset.
        result: figures of one method. Its first run counts: all runs have as many samples.
        estimator: the method, with its settings beside those of the thesis.
    """
    predictions, differences = result.predictions, list[str]()
    simulated = all(info.simulated for info in evaluation.dataset.session_info.values())
    differences.append("a simulated bench" if simulated else "another bench")
    low, high = float(predictions.reference_magnitude_n.min()), float(predictions.reference_magnitude_n.max())
    thesis_low, thesis_high = THESIS_FIGURES["force_min_n"], THESIS_FIGURES["force_max_n"]
    if low < thesis_low - FORCE_TOLERANCE_N or high > thesis_high + FORCE_TOLERANCE_N:
        differences.append(f"forces of {low:.3f} to {high:.3f} N (thesis: {thesis_low:.3f} to {thesis_high:.3f} N)")
    if free := np.count_nonzero(~predictions.contact):
        differences.append(f"{free} of {len(predictions)} test samples without contact (thesis: always in contact)")
    split = result.fits[0].split
    counts, thesis = (len(split.train), len(split.test)), _SAMPLES[estimator.name]
    if counts != thesis:
        differences.append(f"{counts[0]} training and {counts[1]} test samples (thesis: {thesis[0]} and {thesis[1]})")
    thesis_settings = type(estimator.settings).model_validate(estimator.thesis_settings).model_dump(mode="json")
    settings = estimator.settings.model_dump(mode="json")
    differences += [
        f"{key}={_text(_nested(settings, key))} (to the letter: {_text(value)})"
        for key, value in flat_values(thesis_settings).items()
        if key.split(".")[0] not in _NO_CONDITION and _nested(settings, key) != value
    ]
    return differences


def _nested(values: Any, key: str) -> Any:
    """Returns the value at a key with points, such as "detection.threshold"; None where it is missing."""
    for part in key.split("."):
        values = values.get(part) if isinstance(values, dict) else None
    return values


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "null" if value is None else str(value)
