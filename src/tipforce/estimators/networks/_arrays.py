"""Between a dataset's samples and a network's arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import InputError
from ...training import Part, Samples, Task
from ...types import BoolArray, Image, IntArray, Observation
from .._reading import Refusal, read_actuation
from ._graph import Graph
from ._prepared import Forms, Prepared

__all__ = [
    "TOGETHER",
    "Arrays",
    "Looked",
    "Outputs",
    "Reader",
    "actuation_form",
    "components_of",
    "read_one",
    "samples_of",
    "spread_of",
    "spread_over",
]

LOOKED_AT, TOGETHER = 4000, 50
"""Samples that tell a method what its network usually returns; so many at once."""

Arrays = dict[str, npt.NDArray[Any]]
Outputs = Mapping[str, npt.NDArray[Any]]
"""What a graph returned, by name, (n, ...) each."""


class Reader(Protocol):
    """Makes the network's inputs, all but the actuation, of the observations of one session."""

    def __call__(self, observation: Observation, mask: Image | None = None) -> Arrays | Refusal:
        """With a ``mask``, "heat" too: see `Samples`."""
        ...


def read_one(
    reader: Reader, names: tuple[str, ...], observation: Observation, mask: Image | None = None
) -> Arrays | Refusal:
    row = reader(observation, mask)
    if isinstance(row, Refusal) or not names:
        return row
    drives = read_actuation(observation, names)
    return drives if isinstance(drives, Refusal) else {**row, "actuation": drives.astype(np.float32)}


@dataclass(frozen=True, eq=False)
class Looked:
    """What a trained ``graph`` returns for its ``samples``, of which a ``part`` was kept from training."""

    graph: Graph
    task: Task
    samples: Samples
    part: Part
    stamp_ns: IntArray
    """(n,): when the samples were taken."""

    def outputs(self, *, kept: bool, altered: bool) -> Arrays:
        """For samples spread over those it was trained on, or those ``kept`` from it.

        They are shown as they are, or ``altered`` at random as in training.
        """
        return self.at(spread_over(self.part.validate if kept else self.part.train, LOOKED_AT), altered=altered)

    def at(self, index: IntArray, *, altered: bool = False, names: Sequence[str] | None = None) -> Arrays:
        """For the samples at ``index``: all that it returns, or what ``names`` say."""
        parts: list[Arrays] = []
        for first in range(0, len(index), TOGETHER):
            now = index[first : first + TOGETHER]
            draws = [np.random.default_rng(k) for k in now.tolist()] if altered else None
            batch = self.task.batch(self.samples, now, draws)
            found = self.graph(**{name: batch[name] for name in self.task.inputs})
            parts.append({name: found[name] for name in names or found})
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def spread_over(index: IntArray, most: int) -> IntArray:
    """At most so many of ``index``, evenly over it."""
    return index[np.unique(np.linspace(0, len(index) - 1, min(len(index), most)).astype(np.int64))]


def actuation_form(names: tuple[str, ...]) -> Forms:
    return {"actuation": ((len(names),), "float32")} if names else {}


def components_of(dataset: Dataset, wanted: str, method: str) -> BoolArray:
    """(3,): what is learnt."""
    known = np.asarray(dataset.known) & (np.array([True, True, False]) if wanted == "xy" else True)
    if not known.any():
        raise InputError(f"{dataset.title}: has no force components to learn; {method} needs at least fx_n or fy_n")
    if not np.isfinite(dataset.force_n[:, known]).all():
        raise InputError(f"{dataset.title}: some samples have no force; leave them out")
    return known


def samples_of(dataset: Dataset, prepared: Prepared, known: BoolArray) -> Samples:
    arrays = dict(prepared.arrays)
    return Samples(
        pictures=arrays.pop("picture"),
        heat=arrays.pop("heat", None),
        inputs=arrays,
        force_n=dataset.force_n[prepared.kept][:, known].astype(np.float32),
        session=dataset.session[prepared.kept],
    )


def spread_of(drives: npt.NDArray[np.float32] | None) -> tuple[tuple[float, float], ...]:
    """Mean and deviation of each actuation value; 1 for one that never changes."""
    if drives is None:
        return ()
    deviation = drives.std(axis=0, dtype=np.float64)
    mean = drives.mean(axis=0, dtype=np.float64)
    return tuple(zip(mean.tolist(), np.where(deviation > 0, deviation, 1.0).tolist(), strict=True))
