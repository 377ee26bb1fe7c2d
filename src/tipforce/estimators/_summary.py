"""Summary of a fitted model in words, for its card and for whoever trained it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..types import BoolArray


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


def left_out_by_session(session: npt.NDArray[np.str_], kept: BoolArray) -> dict[str, list[int]]:
    """Counts samples that could not be learnt from.

    Args:
        session: (n,) name of each sample's session.
        kept: (n,) True where it was learnt from.

    Returns:
        Session -> samples left out, and all of its samples; sessions of which none was left out are not in it.
    """
    found = {name: session == name for name in dict.fromkeys(session.tolist())}
    return {name: [int(np.sum(~kept[own])), int(own.sum())] for name, own in found.items() if not kept[own].all()}


def left_out_text(left_out: Mapping[str, Sequence[int]], shown: int = 8) -> str:
    """Returns the counts of `left_out_by_session` in words, sessions that are wholly missing first.

    >>> left_out_text({"a": [3, 10], "b": [5, 5]})
    '8 left out: all 5 of b, 3 of 10 of a'
    """
    worst = sorted(left_out.items(), key=lambda each: -each[1][0] / each[1][1])
    parts = [f"all {n} of {name}" if lost == n else f"{lost} of {n} of {name}" for name, (lost, n) in worst[:shown]]
    more = f" and some of {len(worst) - shown} more sessions" if len(worst) > shown else ""
    return f"{sum(lost for lost, _ in left_out.values())} left out: {', '.join(parts)}{more}"


def refuse_left_out(title: str, left_out: Mapping[str, Sequence[int]], samples: int, max_left_out: float) -> None:
    """Stops a training that would learn from another bench than the one it was given.

    Args:
        title: of the dataset.
        left_out: see `left_out_by_session`.
        samples: of the dataset.
        max_left_out: share of them that may be left out, and no whole session; 1: any.

    Raises:
        InputError: more would be.
    """
    lost = sum(count for count, _ in left_out.values())
    whole = any(count == of for count, of in left_out.values())
    if max_left_out < 1.0 and (whole or lost > max_left_out * samples):
        raise InputError(
            f"{title}: of {samples} samples training would leave out {left_out_text(left_out).replace(' left out', '')}"
            "; look at them with `tipforce inspect`, leave sessions out (without=NAME), or train on the rest "
            "with max_left_out=1"
        )


def half_width_text(value: float | None) -> str:
    """Returns half the width of an interval (in newtons, None where it is unbounded) in words.

    >>> half_width_text(0.05)
    '± 50.0 mN'
    """
    return "unbounded" if value is None else f"± {value * 1e3:.1f} mN"


def magnitude_intervals(facts: Mapping[str, Any]) -> list[str]:
    """A line on the magnitude's interval at small and large estimates; none for a model that has one for all.

    >>> magnitude_intervals({"magnitude_interval_n": {"0.05": (0.0, 0.08), "0.15": (0.1, 0.25)}})
    ['90 % interval of the magnitude by the estimate: 50 mN: 0 to 80, 150 mN: 100 to 250 mN']
    """
    parts = [
        f"{1e3 * float(at):.3g} mN: {1e3 * low:.0f} to {1e3 * high:.0f}"
        for at, (low, high) in facts.get("magnitude_interval_n", {}).items()
    ]
    return [f"90 % interval of the magnitude by the estimate: {', '.join(parts)} mN"] if parts else []
