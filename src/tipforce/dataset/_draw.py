"""A random part of a dataset."""

import numpy as np

from ..errors import InputError
from ._dataset import Dataset

__all__ = ["draw"]


def draw(dataset: Dataset, samples: int, seed: int = 0) -> Dataset:
    """``samples`` rows drawn at random without replacement, kept in order (the thesis has 220).

    All rows where there are fewer. Raises InputError for a number below 1.
    """
    if samples < 1:
        raise InputError(f"the number of samples must be at least 1, got {samples}")
    if samples >= len(dataset):
        return dataset
    rows = np.random.default_rng(seed).choice(len(dataset), samples, replace=False)
    return dataset.subset(np.sort(rows))
