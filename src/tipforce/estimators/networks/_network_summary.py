"""Summary of a fitted network in words."""

from collections.abc import Mapping
from typing import Any

from ...training import duration_text
from .._summary import ModelSummary, half_width_text, left_out_text, magnitude_intervals


def network_summary(facts: Mapping[str, Any]) -> ModelSummary:
    """Returns the summary of the facts that `NetworkEstimator.describe` gives."""
    actuation = facts["actuation"]
    short = facts["input"] + (f" and {', '.join(actuation)}" if actuation else "")
    left_out = facts["left_out"]
    inputs = f"{short[0].upper()}{short[1:]}: {facts['network']}."
    if facts["required_metadata"]:
        inputs += f" It needs {', '.join(facts['required_metadata'])} of every session, as in training."
    if facts["uses_history"]:
        inputs += " A frame some 40 ms earlier tells the rate of the force, by which its viscous part is compensated."
    *earlier, _ = facts["trained_on"]
    if earlier:
        inputs += f" It was fine-tuned from weights trained on {'; then '.join(earlier)}."
    if left_out:
        inputs += f" Samples that could not be read: {left_out_text(left_out)}."
    budget = (
        f"{facts['epochs_run']} of {facts['max_epochs']} epochs in {duration_text(facts['seconds'])} "
        f"({facts['device']}, {facts['precision']}): {facts['stop_reason']}"
    )
    kept = f"kept epoch {facts['best_epoch']}"
    if facts["validation_samples"]:
        held_out = f"{facts['validation_samples']} validation samples ({facts['validation']})"
        kept += f": mean error {facts['validation_error_n'] * 1e3:.1f} mN on {held_out}"
    else:
        kept += ", the last one: nothing was held out"
    half_widths = {name: half_width_text(half) for name, half in facts["interval_half_width_n"].items()}
    performance = (
        "| estimate | 90 % interval |",
        "|---|---|",
        *(f"| {name} | {half} |" for name, half in half_widths.items()),
        *(f"\n{line[0].upper()}{line[1:]}." for line in magnitude_intervals(facts)),
        "",
        (f"Trained for {budget}; {kept}. `training.jsonl` has the figures of every epoch."),
    )
    training = [f"{facts['network']}, {facts['parameters']:,} weights"]
    if facts["fine_tuned_from"] is not None:
        new = f", but for {', '.join(facts['reinitialised_weights'])}" if facts["reinitialised_weights"] else ""
        training.append(f"fine-tuned from the weights of {facts['fine_tuned_from']}{new}, trained on {earlier[-1]}")
    training += [f"samples that could not be read: {left_out_text(left_out)}"] if left_out else []
    training += [
        f"trained {budget}",
        kept,
        *([f"quantised to 8 bits: error {facts['error_growth_in_8_bits']:+.1%}"] if facts["bits"] == 8 else []),
        "90 % interval: " + ", ".join(f"{name} {half}" for name, half in half_widths.items()),
        *magnitude_intervals(facts),
    ]
    return ModelSummary(inputs, short, performance, tuple(training))
