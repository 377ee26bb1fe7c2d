"""What a fitted network tells people."""

from collections.abc import Mapping
from typing import Any

from ...training import duration
from .._words import Words, half_width_text

__all__ = ["network_words"]


def network_words(facts: Mapping[str, Any]) -> Words:
    """From the facts that `NetworkEstimator.describe` gives."""
    actuation, looked_at = facts["actuation"], facts["looks_at"]
    short = looked_at + (f" and {', '.join(actuation)}" if actuation else "")
    left_out = facts["samples_left_out"]
    sees = f"{short[0].upper()}{short[1:]}: {facts['network']}."
    if facts["told"]:
        sees += f" It was told {', '.join(facts['told'])} of every session, and must be told them again."
    if facts["remembers"]:
        sees += " The frame some 40 ms before tells how fast the force changes, which leads it."
    *earlier, _ = facts["learnt_from"]
    if earlier:
        sees += f" It began with weights that had learnt from {'; then '.join(earlier)}."
    if left_out:
        sees += f" {left_out} of the samples could not be read; they were left out."
    budget = (
        f"{facts['epochs_run']} of {facts['epochs_wanted']} epochs in {duration(facts['seconds'])} "
        f"({facts['machine']}, {facts['precision']}): {facts['ended']}"
    )
    kept = f"{facts['validation_samples']} samples kept back ({facts['validation']})"
    error = f"{facts['validation_error_n'] * 1e3:.1f} mN"
    halves = {name: half_width_text(half) for name, half in facts["interval_half_width_n"].items()}
    how_well = (
        "| answers | 90 % interval |",
        "|---|---|",
        *(f"| {name} | {half} |" for name, half in halves.items()),
        "",
        (
            f"Trained for {budget}. The best epoch was number {facts['best_epoch']}, with a mean error of {error} on "
            f"{kept}; the course of every epoch is in `training.jsonl`."
        ),
    )
    told = [f"{facts['network']}, {facts['parameters']:,} weights"]
    if facts["started_from"] is not None:
        new = f", but for {', '.join(facts['new_weights'])}" if facts["new_weights"] else ""
        told.append(f"began with the weights of {facts['started_from']}{new}; they had learnt from {earlier[-1]}")
    told += [f"{left_out} samples could not be read: left out"] if left_out else []
    told += [
        f"trained {budget}",
        f"kept epoch {facts['best_epoch']}: mean error {error} on {kept}",
        *([f"answers in 8 bits: error {facts['error_growth_in_8_bits']:+.1%}"] if facts["bits"] == 8 else []),
        "90 % interval: " + ", ".join(f"{name} {half}" for name, half in halves.items()),
    ]
    return Words(sees, short, how_well, tuple(told))
