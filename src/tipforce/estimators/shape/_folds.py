"""Folds of a cross-validation, and samples drawn at random."""

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...types import IntArray
from ._settings import ShapeRegressorSettings

MIN_SESSIONS = 3
"""Smallest number of sessions at which whole sessions are held out instead of shuffled samples."""

MAX_GROUPS = 10
"""Largest number of groups of sessions; with more sessions a group has several."""

Fold = tuple[IntArray, IntArray]
"""Positions of the samples that train, and of those that test."""


def make_folds(session: npt.NDArray[np.str_], settings: ShapeRegressorSettings) -> tuple[list[Fold], bool]:
    """Divides samples into the folds of a cross-validation.

    Args:
        session: (n,) name of each sample's session.
        settings: number of folds, and whether they hold out sessions or samples.

    Returns:
        The positions that train and that test for each fold, and whether whole sessions are held out.

    Raises:
        InputError: whole sessions must be held out, and there is only one.
    """
    folds, seed = settings.folds, settings.seed
    draw = np.random.default_rng(seed)
    names = list(dict.fromkeys(session.tolist()))
    by_session = settings.hold_out == "session" or (settings.hold_out == "auto" and len(names) >= MIN_SESSIONS)
    if by_session and len(names) < 2:
        raise InputError("hold_out=session needs at least two sessions; there is one")
    if by_session:
        order = draw.permutation(len(names)) if len(names) > MAX_GROUPS else np.arange(len(names))
        parts = np.array_split(order, min(len(names), MAX_GROUPS))
        held = [np.isin(session, [names[i] for i in part]) for part in parts]
        return [(np.flatnonzero(~test), np.flatnonzero(test)) for test in held], True
    order = draw.permutation(len(session))
    tests = [np.sort(part) for part in np.array_split(order, min(folds, len(order)))]
    everything = np.arange(len(session))
    return [(np.setdiff1d(everything, test, assume_unique=True), test) for test in tests], False


def draw_samples(count: int, most: int | None, seed: int) -> IntArray:
    """Returns the positions, in order, of samples drawn at random.

    Args:
        count: number of samples.
        most: largest number to draw; None: all.
        seed: seed of the draw.
    """
    if most is None or count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))
