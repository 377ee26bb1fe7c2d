"""What is kept from training, to say when to stop."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..types import IntArray
from ._recipe import TrainConfig

__all__ = ["Part", "train_val_split"]


@dataclass(frozen=True, eq=False)
class Part:
    """Ascending places of the samples that train and of those that validate; ``sessions``: whole ones were kept."""

    train: IntArray
    validate: IntArray
    sessions: bool


def train_val_split(session: npt.NDArray[np.str_], recipe: TrainConfig) -> Part:
    """Keep ``recipe.validation`` of the samples of ``session`` (n,) back, as ``recipe.hold_out`` says.

    Raises InputError where too few sessions or samples are there.

    >>> part = train_val_split(np.repeat([f"s{k}" for k in range(10)], 3), TrainConfig())
    >>> len(part.train), len(part.validate), part.sessions
    (27, 3, True)
    """
    names = list(dict.fromkeys(session.tolist()))
    draw = np.random.default_rng((recipe.seed, 0))
    count = int(recipe.validation * len(names) + 1e-9)
    by_session = recipe.hold_out == "session" or (recipe.hold_out == "auto" and count >= 1)
    if by_session:
        count = max(1, count)
        if len(names) < 2:
            raise InputError("hold_out=session needs at least two sessions to train on, got one; leave it at auto")
        held = np.isin(session, [names[place] for place in draw.permutation(len(names))[:count]])
    else:
        held = np.zeros(len(session), np.bool_)
        held[draw.permutation(len(session))[: max(1, round(recipe.validation * len(session)))]] = True
    if np.count_nonzero(~held) < 2:
        raise InputError(f"{len(session)} samples are too few to train on and to keep some back for validation")
    return Part(np.flatnonzero(~held), np.flatnonzero(held), by_session)
