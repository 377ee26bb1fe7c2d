"""Samples that a training could not use: counts by session, in words, and the check against a limit."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..types import BoolArray


def left_out_by_session(session: npt.NDArray[np.str_], kept: BoolArray) -> dict[str, list[int]]:
    """Counts the samples that could not be used.

    Args:
        session: (n,) name of each sample's session.
        kept: (n,) True where the sample was used.

    Returns:
        Session -> number of samples left out, and of all its samples; sessions without a left-out sample are not in it.
    """
    rows_of = {name: session == name for name in dict.fromkeys(session.tolist())}
    return {name: [int(np.sum(~kept[rows])), int(rows.sum())] for name, rows in rows_of.items() if not kept[rows].all()}


def left_out_text(left_out: Mapping[str, Sequence[int]], shown: int = 8) -> str:
    """Returns the counts of `left_out_by_session` in words; sessions that are wholly missing come first.

    Args:
        left_out: the counts.
        shown: largest number of sessions that are named.

    >>> left_out_text({"a": [3, 10], "b": [5, 5]})
    '8 left out: all 5 of b, 3 of 10 of a'
    """
    worst = sorted(left_out.items(), key=lambda item: -item[1][0] / item[1][1])
    parts = [f"all {n} of {name}" if lost == n else f"{lost} of {n} of {name}" for name, (lost, n) in worst[:shown]]
    more = f" and some of {len(worst) - shown} more sessions" if len(worst) > shown else ""
    return f"{sum(lost for lost, _ in left_out.values())} left out: {', '.join(parts)}{more}"


def refuse_left_out(title: str, left_out: Mapping[str, Sequence[int]], samples: int, max_left_out: float) -> None:
    """Stops a training that would use too small a part of the data it was given.

    Args:
        title: title of the dataset.
        left_out: see `left_out_by_session`.
        samples: number of samples of the dataset.
        max_left_out: share of them that may be left out; unless it is 1, no whole session may be.

    Raises:
        InputError: more samples would be left out.
    """
    lost = sum(count for count, _ in left_out.values())
    whole = any(count == of for count, of in left_out.values())
    if max_left_out < 1.0 and (whole or lost > max_left_out * samples):
        raise InputError(
            f"{title}: of {samples} samples training would leave out {left_out_text(left_out).replace(' left out', '')}"
            "; look at them with `tipforce inspect`, leave sessions out (without=NAME), or train on the rest "
            "with max_left_out=1"
        )
