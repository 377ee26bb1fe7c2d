"""Facts of a fitted model, and the same in words for its card and for the person who trained it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from ._left_out import left_out_text


@dataclass(frozen=True, slots=True)
class ModelSummary:
    """A fitted model in words.

    Attributes:
        inputs: its inputs, in a sentence or two.
        short_inputs: the same in a few words.
        performance: lines of Markdown for the model card.
        training: lines for the person who has just trained it.
    """

    inputs: str = ""
    short_inputs: str = ""
    performance: tuple[str, ...] = ()
    training: tuple[str, ...] = ()


class ModelFacts(BaseModel, frozen=True):
    """Facts of a fitted model: for its card, ``model.json`` and reports.

    Each has a default, so that a method states some and leaves out the rest. A method with more facts derives its own
    class, and describes them in `summary`.

    Attributes:
        interval_basis: the samples that the 90 % intervals rest on, in words; empty for a method without intervals.
        samples: number of samples that it learnt from.
        left_out: session -> samples that it could not learn from, and all samples of the session.
    """

    model_config = ConfigDict(extra="forbid")

    interval_basis: str = ""
    samples: int | None = None
    left_out: dict[str, list[int]] = {}

    def summary(self) -> ModelSummary:
        """Returns the facts in words."""
        lost = (f"samples that could not be used: {left_out_text(self.left_out)}",) if self.left_out else ()
        return ModelSummary(training=lost)


def count_of(number: int, noun: str) -> str:
    """Returns a number of things in words.

    Args:
        number: the number.
        noun: singular of the thing; its plural ends in s.

    >>> count_of(1, "session"), count_of(2, "session")
    ('1 session', '2 sessions')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def half_width_text(value: float | None) -> str:
    """Returns half the width of an interval (in newtons, None where it is unbounded) in words.

    >>> half_width_text(0.05)
    '± 50.0 mN'
    """
    return "unbounded" if value is None else f"± {value * 1e3:.1f} mN"


def magnitude_intervals(examples: Mapping[str, Sequence[float]]) -> list[str]:
    """Returns a line on the interval of the magnitude at small and large estimates; no line without ``examples``.

    >>> magnitude_intervals({"0.05": (0.0, 0.08), "0.15": (0.1, 0.25)})
    ['90 % interval of the magnitude by the estimate: 50 mN: 0 to 80, 150 mN: 100 to 250 mN']
    """
    parts = [f"{1e3 * float(at):.3g} mN: {1e3 * low:.0f} to {1e3 * high:.0f}" for at, (low, high) in examples.items()]
    return [f"90 % interval of the magnitude by the estimate: {', '.join(parts)} mN"] if parts else []
