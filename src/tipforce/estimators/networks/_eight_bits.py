"""A network's graph in 8 bits, if it answers as well."""

import warnings
from collections.abc import Iterator

import numpy as np

from ...training import LARGEST_GROWTH, Part, Samples, Task, error_growth, quantise
from ...types import FloatArray, IntArray
from ._arrays import TOGETHER, Arrays, spread_over

__all__ = ["in_eight_bits"]

_MET, _COMPARED = 300, 2000
"""Samples that tell the ranges, and those that tell the errors."""


def in_eight_bits(data: bytes, task: Task, samples: Samples, part: Part) -> tuple[bytes | None, float]:
    """``data``, a graph, in 8 bits, and by which share its error on samples kept from training is larger.

    None, with a warning, where that is `LARGEST_GROWTH` or more.
    """
    met = _batches(task, samples, spread_over(part.train, _MET))
    small = quantise(data, (inputs for inputs, _ in met))
    growth = error_growth(data, small, _batches(task, samples, spread_over(part.validate, _COMPARED)))
    if growth < LARGEST_GROWTH:
        return small, growth
    warnings.warn(
        f"in 8 bits the error would be {growth:.0%} larger, {LARGEST_GROWTH:.0%} is the limit: the model answers in "
        "32 bits",
        stacklevel=3,
    )
    return None, growth


def _batches(task: Task, samples: Samples, index: IntArray) -> Iterator[tuple[Arrays, FloatArray]]:
    for first in range(0, len(index), TOGETHER):
        batch = task.batch(samples, index[first : first + TOGETHER], None)
        yield {name: batch[name] for name in task.inputs}, batch["force_n"].astype(np.float64)
