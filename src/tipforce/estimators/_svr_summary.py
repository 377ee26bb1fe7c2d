"""Summary of a fitted svr in words."""

from collections.abc import Mapping
from typing import Any

from ._summary import ModelSummary, count_of, half_width_text, left_out_text, magnitude_intervals


def svr_summary(facts: Mapping[str, Any]) -> ModelSummary:
    """Returns the summary of the facts that `Svr.describe` gives."""
    numbers = f"{count_of(len(facts['features']), 'number')} a frame"
    inputs = f"{numbers}: {', '.join(facts['features'])}."
    training: list[str] = []
    if facts.get("detection"):  # models of earlier versions do not state it
        thesis = "the thesis's algorithm 1" if facts["detection"] == "classic" else "not the thesis's algorithm 1"
        inputs += f" The centreline is found by `{facts['detection']}`, {thesis}."
    if left_out := facts["left_out"]:
        training.append(f"samples in which no shape was found: {left_out_text(left_out)}")
        inputs += f" Samples in which no shape was found: {left_out_text(left_out)}."
    performance = [
        "| estimate | C | epsilon | sigma | support vectors | error over folds (RMSE) | 90 % interval |",
        "|---|---|---|---|---|---|---|",
    ]
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
    training += magnitude_intervals(facts)
    performance += [
        *(f"\n{line[0].upper()}{line[1:]}." for line in magnitude_intervals(facts)),
        "",
        "The errors are those on samples left out while the constants were chosen, within the training data.",
    ]
    return ModelSummary(inputs, numbers, tuple(performance), tuple(training))
