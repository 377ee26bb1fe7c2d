"""What every method reads from an observation, and the reason where it cannot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..datasets import Dataset
from ..errors import InputError
from ..types import FloatArray, Observation, Status, View

__all__ = ["Abstention", "actuation_names", "limits_of", "read_actuation", "read_view", "unlike_training"]


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


_MARGIN = 0.1


def limits_of(names: Sequence[str], dataset: Dataset) -> FloatArray:
    """(len(names), 2): smallest and largest value of each actuation that a model trained on ``dataset`` answers to.

    They are those of the data and a margin: a tenth of the range, of the largest absolute value or of one unit,
    whichever is largest, so that a drive that stood still in training may be read with some error.
    """
    limits = np.empty((len(names), 2))
    for row, name in enumerate(names):
        values = dataset.actuation[name]
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        margin = _MARGIN * max(high - low, abs(low), abs(high), 1.0)
        limits[row] = low - margin, high + margin
    return limits


def unlike_training(observation: Observation, names: Sequence[str], limits: FloatArray | None) -> Abstention | None:
    """Why there is no estimate for an actuation beyond its ``limits`` (len(names), 2); None where all lie within."""
    if limits is None:
        return None
    for name, (low, high) in zip(names, limits.tolist(), strict=True):
        value = observation.actuation[name]
        if not low <= value <= high:
            return Abstention(
                Status.OUT_OF_DISTRIBUTION,
                f"the actuation is unlike the training data ({name} {value:g}, the limits are {low:g} and {high:g})",
            )
    return None
