"""Outputs of a trained graph on training and validation samples: for the uncertainty, and for quantisation."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._system.rows import evenly_spread
from ...training import MAX_ERROR_GROWTH, Task, TrainingSamples, TrainValSplit, error_growth, quantise
from ...types import FloatArray, IntArray
from ._graph import Graph
from ._preparation import Arrays

Outputs = Mapping[str, npt.NDArray[Any]]
"""Outputs of a graph by name, (n, ...) each."""

_CALIBRATION_SAMPLES = 4000
"""Samples that the uncertainty of a network is fitted on."""
_BATCH = 50
_RANGE_SAMPLES, _COMPARED_SAMPLES = 300, 2000
"""Samples for the activation ranges of quantisation, and for the comparison of the errors."""


@dataclass(frozen=True, eq=False)
class CalibrationBatch:
    """A trained graph and the samples of its training, on which its uncertainty is fitted.

    Attributes:
        graph: the trained network.
        task: makes batches of the samples.
        samples: all samples.
        split: indices of the training and the validation samples.
        stamp_ns: (n,) stamps of the samples.
    """

    graph: Graph
    task: Task
    samples: TrainingSamples
    split: TrainValSplit
    stamp_ns: IntArray

    @property
    def held_out(self) -> IntArray:
        """The samples whose outputs are those of the validation split, see `outputs`."""
        return spread_evenly(self.split.val, _CALIBRATION_SAMPLES)

    def outputs(self, *, held_out: bool, augmented: bool) -> Arrays:
        """Returns the outputs for samples spread evenly over the validation split (``held_out``) or the training one.

        Args:
            held_out: whether the validation split is used; else the training split.
            augmented: whether the images are augmented as in training.
        """
        index = self.held_out if held_out else spread_evenly(self.split.train, _CALIBRATION_SAMPLES)
        return self.at(index, augmented=augmented)

    def at(self, index: IntArray, *, augmented: bool = False, names: Sequence[str] | None = None) -> Arrays:
        """Returns the outputs (samples, ...) of the graph by name, computed in batches.

        Args:
            index: indices of the samples.
            augmented: whether the images are augmented as in training.
            names: names of the outputs; None: all.
        """
        batches: list[Arrays] = []
        for first in range(0, len(index), _BATCH):
            rows = index[first : first + _BATCH]
            # the sample's index is the seed: its augmentation is the same in every call
            rngs = [np.random.default_rng(sample) for sample in rows.tolist()] if augmented else None
            batch = self.task.batch(self.samples, rows, rngs)
            outputs = self.graph(**{name: batch[name] for name in self.task.inputs})
            batches.append({name: outputs[name] for name in names or outputs})
        return {name: np.concatenate([batch[name] for batch in batches]) for name in batches[0]}


def spread_evenly(index: IntArray, count: int) -> IntArray:
    """Returns some indices, spread evenly over all.

    Args:
        index: (n,) indices.
        count: largest number of indices to return.
    """
    return index[evenly_spread(len(index), count)]


def quantise_checked(
    data: bytes, task: Task, samples: TrainingSamples, split: TrainValSplit
) -> tuple[bytes | None, float]:
    """Quantises a graph to 8 bits, if its error on validation samples grows by less than `MAX_ERROR_GROWTH`.

    Args:
        data: the graph.
        task: makes batches of the samples.
        samples: all samples.
        split: its training samples give the typical inputs, its validation samples the error.

    Returns:
        The quantised graph and the relative growth of its error. None, with a warning, in place of the graph where the
        error grows by `MAX_ERROR_GROWTH` or more.
    """
    typical = _batches(task, samples, spread_evenly(split.train, _RANGE_SAMPLES))
    quantised = quantise(data, (inputs for inputs, _ in typical))
    growth = error_growth(data, quantised, _batches(task, samples, spread_evenly(split.val, _COMPARED_SAMPLES)))
    if growth < MAX_ERROR_GROWTH:
        return quantised, growth
    warnings.warn(
        f"in 8 bits the error would be {growth:.0%} larger, {MAX_ERROR_GROWTH:.0%} is the limit: the model runs in 32 "
        "bits",
        stacklevel=3,
    )
    return None, growth


def _batches(task: Task, samples: TrainingSamples, index: IntArray) -> Iterator[tuple[Arrays, FloatArray]]:
    for first in range(0, len(index), _BATCH):
        batch = task.batch(samples, index[first : first + _BATCH], None)
        yield {name: batch[name] for name in task.inputs}, batch["force_n"].astype(np.float64)
