"""Summary of a fitted model in words, for its card and for whoever trained it."""

from dataclasses import dataclass

__all__ = ["ModelSummary", "count_of", "half_width_text"]


@dataclass(frozen=True, slots=True)
class ModelSummary:
    """A fitted model in words.

    Attributes:
        inputs: its inputs, in a sentence or two.
        short_inputs: the same in a few words.
        performance: lines of Markdown for the model card.
        training: lines for whoever has just trained it.
    """

    inputs: str = ""
    short_inputs: str = ""
    performance: tuple[str, ...] = ()
    training: tuple[str, ...] = ()


def count_of(number: int, what: str) -> str:
    """Returns a number of things in words.

    >>> count_of(1, "session"), count_of(2, "session")
    ('1 session', '2 sessions')
    """
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def half_width_text(value: float | None) -> str:
    """Returns half the width of an interval (in newtons, None where it is unbounded) in words.

    >>> half_width_text(0.05)
    '± 50.0 mN'
    """
    return "unbounded" if value is None else f"± {value * 1e3:.1f} mN"
