"""What every method reads from an observation, and the reason where it cannot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..datasets import Dataset
from ..errors import InputError
from ..types import FloatArray, Observation, Status, View

__all__ = ["Abstention", "actuation_names", "read_actuation", "read_view"]


@dataclass(frozen=True, slots=True)
class Abstention:
    """Why an observation yields no numbers."""

    status: Status
    detail: str


def read_view(observation: Observation, view: str, setting: str) -> View | Abstention:
    """The image of ``view``, which ``setting`` names."""
    found = observation.views.get(view)
    if found is None:
        there = ", ".join(observation.views) or "none"
        return Abstention(Status.MISSING_INPUT, f"there is no view {view!r}, as {setting} says; there is {there}")
    return found


def read_actuation(observation: Observation, names: Sequence[str]) -> FloatArray | Abstention:
    """(len(names),): the actuation values that a model was trained with."""
    row = np.empty(len(names))
    for place, name in enumerate(names):
        value = observation.actuation.get(name)
        if value is None or value != value:
            return Abstention(Status.MISSING_INPUT, f"{name}, which this model was trained with, is absent; state it")
        row[place] = value
    return row


def actuation_names(wanted: Sequence[str] | None, dataset: Dataset) -> tuple[str, ...]:
    """The actuation to train with: ``wanted``, or all of ``dataset`` for None. Raises InputError for one it lacks."""
    names = tuple(dataset.actuation) if wanted is None else tuple(wanted)
    for name in names:
        if name not in dataset.actuation:
            there = ", ".join(dataset.actuation) or "none"
            raise InputError(f"{dataset.title}: has no actuation {name!r}; it has {there}")
    return names
