"""Facts of a fitted network, and the same in words."""

from typing import Self

from pydantic import Field

from ...training import TrainingFacts, duration_text
from .._facts import ModelFacts, ModelSummary, half_width_text, magnitude_intervals
from .._left_out import left_out_text


class NetworkTraining(TrainingFacts, frozen=True):
    """How a network was trained, and its inputs since then; kept with its state.

    Attributes:
        required_metadata: keys of the metadata that all training sessions stated, which are required of others.
        known_metadata: keys of the metadata that any of them stated.
        modalities: modalities of the training images.
        samples: number of samples that could be read.
        left_out: session -> samples that could not be read, and all samples of the session.
        parity_with_network_n: difference of the exported graph to the trained network, in newtons.
        bits: bits of the graph's numbers.
        error_growth_in_8_bits: relative growth of the error by the quantisation; None without one.
        fine_tuned_from: the network that it was fine-tuned from; None for one trained from random weights.
        trained_on: the training data in words, those of the models that it was fine-tuned from first.
    """

    required_metadata: tuple[str, ...]
    known_metadata: tuple[str, ...]
    modalities: tuple[str, ...] = ("camera",)
    samples: int | None = None
    left_out: dict[str, list[int]] = Field(default_factory=dict)
    parity_with_network_n: float = 0.0
    bits: int = 32
    error_growth_in_8_bits: float | None = None
    fine_tuned_from: str | None = None
    trained_on: tuple[str, ...] = ()

    def for_view(self, old: str, new: str) -> Self:
        """Returns the facts of the same network for another view.

        Args:
            old: name of the view in the keys of the metadata.
            new: its new name.
        """
        before, after = f"views.{old}.", f"views.{new}."

        def renamed(keys: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(after + key.removeprefix(before) if key.startswith(before) else key for key in keys)

        return self.model_copy(
            update={
                "required_metadata": renamed(self.required_metadata),
                "known_metadata": renamed(self.known_metadata),
            }
        )


class NetworkFacts(NetworkTraining, ModelFacts, frozen=True):
    """Facts of every network.

    Attributes:
        actuation: names of the drives among its inputs.
        input: the image input in a few words.
        uses_history: True where it uses the frame before, too.
        interval_half_width_n: typical half-widths of the 90 % intervals; None where one is unbounded.
        magnitude_interval_n: the magnitude's interval in newtons, by the estimate.
    """

    actuation: tuple[str, ...] = ()
    input: str = ""
    uses_history: bool = False
    interval_half_width_n: dict[str, float | None] = Field(default_factory=dict)
    magnitude_interval_n: dict[str, list[float]] = Field(default_factory=dict)

    def summary(self) -> ModelSummary:
        """Returns inputs, training and intervals in words, for the model card and for the person who trained it."""
        short = self.input + (f" and {', '.join(self.actuation)}" if self.actuation else "")
        inputs = f"{short[0].upper()}{short[1:]}: {self.network}."
        if self.required_metadata:
            inputs += f" It needs {', '.join(self.required_metadata)} of every session, as in training."
        if self.uses_history:
            inputs += (
                " A frame some 40 ms earlier shows the rate of the force, by which its viscous part is compensated."
            )
        earlier = self.trained_on[:-1]
        if earlier:
            inputs += f" It was fine-tuned from weights trained on {'; then '.join(earlier)}."
        if self.left_out:
            inputs += f" Samples that could not be read: {left_out_text(self.left_out)}."
        budget = (
            f"{self.epochs_run} of {self.max_epochs} epochs in {duration_text(self.seconds)} "
            f"({self.device}, {self.precision}): {self.stop_reason}"
        )
        kept = f"kept epoch {self.best_epoch}"
        if self.validation_error_n is not None:
            held_out = f"{self.validation_samples} validation samples ({self.validation})"
            kept += f": mean error {self.validation_error_n * 1e3:.1f} mN on {held_out}"
        else:
            kept += ", the last one: nothing was held out"
        half_widths = {name: half_width_text(half) for name, half in self.interval_half_width_n.items()}
        intervals = magnitude_intervals(self.magnitude_interval_n)
        performance = (
            "| estimate | 90 % interval |",
            "|---|---|",
            *(f"| {name} | {half} |" for name, half in half_widths.items()),
            *(f"\n{line[0].upper()}{line[1:]}." for line in intervals),
            "",
            f"Trained for {budget}; {kept}. `training.jsonl` has the figures of every epoch.",
        )
        training = [f"{self.network}, {self.parameters:,} weights"]
        if self.fine_tuned_from is not None:
            new = f", but for {', '.join(self.reinitialised_weights)}" if self.reinitialised_weights else ""
            training.append(f"fine-tuned from the weights of {self.fine_tuned_from}{new}, trained on {earlier[-1]}")
        training += [f"samples that could not be read: {left_out_text(self.left_out)}"] if self.left_out else []
        growth = self.error_growth_in_8_bits
        training += [
            f"trained {budget}",
            kept,
            *([f"quantised to 8 bits: error {growth:+.1%}"] if self.bits == 8 and growth is not None else []),
            "90 % interval: " + ", ".join(f"{name} {half}" for name, half in half_widths.items()),
            *intervals,
        ]
        return ModelSummary(inputs, short, performance, tuple(training))
