"""What a method tells people of a fitted model."""

from dataclasses import dataclass

__all__ = ["Words", "count_of", "half_width_text"]


@dataclass(frozen=True, slots=True)
class Words:
    """``sees``: what it looks at, in a sentence or two; ``short``: the same in a few words.

    ``how_well``: lines of Markdown for the model card; ``told``: lines for whoever has just trained it.
    """

    sees: str = ""
    short: str = ""
    how_well: tuple[str, ...] = ()
    told: tuple[str, ...] = ()


def count_of(number: int, what: str) -> str:
    """A number of things.

    >>> count_of(1, "session"), count_of(2, "session")
    ('1 session', '2 sessions')
    """
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def half_width_text(value: float | None) -> str:
    """Half the width of an interval in newtons; None where it has no end.

    >>> half_width_text(0.05)
    '± 50.0 mN'
    """
    return "unbounded" if value is None else f"± {value * 1e3:.1f} mN"
