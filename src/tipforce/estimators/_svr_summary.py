"""Summary of a fitted svr in words."""

from collections.abc import Mapping
from typing import Any

from ._summary import ModelSummary, count_of, half_width_text

__all__ = ["svr_summary"]


def svr_summary(facts: Mapping[str, Any]) -> ModelSummary:
    """Returns the summary of the facts that `Svr.describe` gives."""
    numbers = f"{count_of(len(facts['features']), 'number')} a frame"
    left_out = facts.get("samples_without_shape")
    inputs = f"{numbers}: {', '.join(facts['features'])}."
    if left_out:
        inputs += f" In {left_out} of the samples no shape was found; they were left out."
    performance = [
        "| estimate | C | epsilon | sigma | support vectors | error over folds (RMSE) | 90 % interval |",
        "|---|---|---|---|---|---|---|",
    ]
    training = [f"in {left_out} of them no shape was found: left out"] if left_out else []
    for name, each in facts["targets"].items():
        rmse, half = f"{each['cv_rmse_n'] * 1e3:.1f} mN", half_width_text(each["interval_half_width_n"])
        performance.append(
            f"| {name} | {each['c']:.4g} | {each['epsilon']:g} | {each['sigma']:g} | {each['support_vectors']} "
            f"| {rmse} | {half} |"
        )
        training.append(
            f"{name}: C {each['c']:.4g}, epsilon {each['epsilon']:g}, sigma {each['sigma']:g}; "
            f"{each['support_vectors']} support vectors; error over folds {rmse}; 90 % interval {half}"
        )
    performance += [
        "",
        "The errors are those on samples left out while the constants were chosen, within the training data.",
    ]
    return ModelSummary(inputs, numbers, tuple(performance), tuple(training))
