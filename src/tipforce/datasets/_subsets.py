"""A random part of a dataset."""

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ._dataset import Dataset

__all__ = ["every_nth", "random_subset", "without_sessions"]


def random_subset(dataset: Dataset, samples: int, seed: int = 0) -> Dataset:
    """``samples`` rows drawn at random without replacement, kept in order (the thesis has 220).

    All rows where there are fewer. Raises InputError for a number below 1.
    """
    if samples < 1:
        raise InputError(f"the number of samples must be at least 1, got {samples}")
    if samples >= len(dataset):
        return dataset
    rows = np.random.default_rng(seed).choice(len(dataset), samples, replace=False)
    return dataset.subset(np.sort(rows))


def every_nth(dataset: Dataset, every: int) -> Dataset:
    """Each session's first sample and every ``every``-th after it. Raises InputError for a number below 1."""
    if every < 1:
        raise InputError(f"every so many frames: expected at least 1, got {every}")
    rows = [np.flatnonzero(dataset.session == name)[::every] for name in dataset.sessions]
    return dataset.subset(np.sort(np.concatenate(rows)))


def without_sessions(dataset: Dataset, sessions: Sequence[str]) -> Dataset:
    """``dataset`` without ``sessions``, which are kept for judging.

    Raises InputError where a name is none of the dataset's, or nothing would be left.
    """
    unknown = [name for name in sessions if name not in dataset.sessions]
    if unknown:
        raise InputError(f"there is no session {unknown[0]}; there are {', '.join(dataset.sessions)}")
    if not sessions:
        return dataset
    keep = ~np.isin(dataset.session, list(sessions))
    if not keep.any():
        raise InputError("every session is left out; nothing remains to train on")
    return dataset.subset(keep)
