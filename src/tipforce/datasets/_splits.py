"""Splits into training and test samples, and the named protocols."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..errors import InputError
from ..types import Catheter, IntArray
from ._dataset import Dataset
from ._join import random_subset

LEAVE_ONE_OUT_SESSIONS = 10
"""Up to this number of sessions each is held out alone; more sessions are held out in this number of groups."""


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """One division of a dataset; each part is an array of ascending positions, and rows in a gap are in none.

    Attributes:
        name: name of the split.
        train: positions of the training samples.
        test: positions of the test samples.
        calibrate: positions of the samples on which intervals are calibrated; empty: the training part is used.
    """

    name: str
    train: IntArray
    test: IntArray
    calibrate: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))


def random_split(dataset: Dataset, test_share: float = 0.25, seed: int = 0) -> Split:
    """Holds out rows that are drawn at random (in the thesis 25 %).

    Neighbouring frames of one recording are then in both parts, so the errors are too small.

    Args:
        dataset: the dataset.
        test_share: share of the rows that is held out.
        seed: seed of the draw.

    Returns:
        Sorted indices of the rows of both parts.

    Raises:
        InputError: a part would be empty.
    """
    _check_share(test_share)
    count = len(dataset)
    held = round(count * test_share)
    if held < 1 or held >= count:
        raise InputError(f"{dataset.title}: {count} samples cannot be split with {test_share:g} of them held out")
    order = np.random.default_rng(seed).permutation(count)
    return Split("random", np.sort(order[held:]), np.sort(order[:held]))


def random_folds(dataset: Dataset, k: int = 4, seed: int = 0) -> list[Split]:
    """Holds out every row once, in random folds.

    Args:
        dataset: the dataset.
        k: number of folds.
        seed: seed of the shuffle.

    Raises:
        InputError: there are fewer rows than folds.
    """
    _check_folds(k)
    if len(dataset) < k:
        raise InputError(f"{dataset.title}: {len(dataset)} samples are too few for {k} folds")
    order = np.random.default_rng(seed).permutation(len(dataset))
    return _folds("random", len(dataset), [np.sort(part) for part in np.array_split(order, k)])


def blocked_folds(dataset: Dataset, k: int = 4, gap_s: float = 1.0) -> list[Split]:
    """Cuts every session into blocks of equal count; fold i holds out the i-th block of each session.

    Args:
        dataset: the dataset.
        k: number of blocks and folds.
        gap_s: training rows nearer than this to the held-out block of their session are left out.

    Raises:
        InputError: a session has fewer rows than ``k``, or the gaps leave no training rows.
    """
    _check_folds(k)
    cuts = [(rows, np.array_split(rows, k)) for rows in _rows_by_session(dataset)]
    for rows, _ in cuts:
        if len(rows) < k:
            name = dataset.session[rows[0]]
            raise InputError(f"{dataset.title}: session {name} has {len(rows)} samples, too few for {k} blocks")
    return [_blocked(dataset, f"block {i + 1}", [(rows, parts[i]) for rows, parts in cuts], gap_s) for i in range(k)]


def blocked_split(dataset: Dataset, test_share: float = 0.25, gap_s: float = 1.0, seed: int = 0) -> Split:
    """Holds out one contiguous block of each session.

    Args:
        dataset: the dataset.
        test_share: share of each session that is held out.
        gap_s: training rows nearer than this to the held-out block of their session are left out.
        seed: seed of the position of the blocks.

    Returns:
        Sorted indices of the rows of both parts.

    Raises:
        InputError: a session has too few rows, or the gaps leave no training rows.
    """
    _check_share(test_share)
    draw = np.random.default_rng(seed)
    held: list[tuple[IntArray, IntArray]] = []
    for rows in _rows_by_session(dataset):
        count = max(1, round(len(rows) * test_share))
        if count >= len(rows):
            name = dataset.session[rows[0]]
            raise InputError(f"{dataset.title}: session {name} has {len(rows)} samples, too few to hold a block out")
        start = int(draw.integers(0, len(rows) - count + 1))
        held.append((rows, rows[start : start + count]))
    return _blocked(dataset, "block", held, gap_s)


def session_folds(dataset: Dataset, k: int | None = None, seed: int = 0) -> list[Split]:
    """Holds out every session once: alone up to `LEAVE_ONE_OUT_SESSIONS` sessions, otherwise in random groups.

    Args:
        dataset: the dataset.
        k: number of folds; None: by the rule above.
        seed: seed of the groups.

    Returns:
        One split for each fold; its name lists the sessions that it holds out.

    Raises:
        InputError: there are fewer than two sessions, or fewer sessions than folds.
    """
    names = _sessions(dataset)
    count = min(len(names), LEAVE_ONE_OUT_SESSIONS) if k is None else k
    _check_folds(count)
    if count > len(names):
        raise InputError(f"{dataset.title}: {len(names)} sessions are too few for {count} folds")
    if count == len(names):
        groups: list[Sequence[str]] = [[name] for name in names]
    else:
        order = np.random.default_rng(seed).permutation(len(names))
        groups = [[names[i] for i in sorted(part)] for part in np.array_split(order, count)]
    folds: list[Split] = []
    for group in groups:
        held = np.isin(dataset.session, list(group))
        folds.append(Split("without " + ", ".join(group), np.flatnonzero(~held), np.flatnonzero(held)))
    return folds


def _folds(name: str, count: int, held: list[IntArray]) -> list[Split]:
    """Returns a split for each held-out part of ``count`` rows; the other rows train."""
    rest = [np.setdiff1d(np.arange(count), test, assume_unique=True) for test in held]
    return [Split(f"{name} {i + 1}", train, test) for i, (train, test) in enumerate(zip(rest, held, strict=True))]


def _blocked(dataset: Dataset, name: str, held: list[tuple[IntArray, IntArray]], gap_s: float) -> Split:
    """Returns the split that holds one block of each session out.

    ``held`` has for each session its rows and those of its block, by time. Rows within ``gap_s`` before or after a
    block are neither trained on nor tested. Raises InputError where none is left to train on.
    """
    train: list[IntArray] = []
    for rows, test in held:
        stamps = dataset.stamp_ns[rows]
        first, last = dataset.stamp_ns[test[0]], dataset.stamp_ns[test[-1]]
        distance_ns = np.maximum(first - stamps, stamps - last)
        train.append(rows[(distance_ns > gap_s * 1e9) & ~np.isin(rows, test)])
    train_rows = np.concatenate(train)
    if not len(train_rows):
        raise InputError(
            f"{dataset.title}: its {len(dataset)} samples leave none to train on once blocks are held out with a "
            f'gap of {gap_s:g} s; record longer sessions, or use protocol="random"'
        )
    return Split(name, np.sort(train_rows), np.sort(np.concatenate([test for _, test in held])))


def _rows_by_session(dataset: Dataset) -> list[IntArray]:
    """Returns the rows of each session in the order of time."""
    rows = [np.flatnonzero(dataset.session == name) for name in dataset.sessions]
    return [part[np.argsort(dataset.stamp_ns[part], kind="stable")] for part in rows]


def _sessions(dataset: Dataset) -> tuple[str, ...]:
    names = dataset.sessions
    if len(names) < 2:
        raise InputError(f"{dataset.title}: holding sessions out needs at least two sessions, got {len(names)}")
    return names


def _check_share(test_share: float) -> None:
    if not 0 < test_share < 1:
        raise InputError(f"the held-out share must be between 0 and 1, got {test_share:g}")


def _check_folds(k: int) -> None:
    if k < 2:
        raise InputError(f"cross-validation needs at least 2 folds, got {k}")


Protocol = Literal["random", "blocked", "session", "thesis", "standard", "catheter"]

THESIS_SESSIONS = 8
"""Number of sessions from which the thesis protocol draws its samples."""


def thesis_split(dataset: Dataset, samples: int, seed: int = 0) -> Split:
    """Draws samples from the first eight sessions, and splits them at random 75/25: the thesis's protocol.

    Args:
        dataset: the dataset.
        samples: number of frames; the thesis has 220 for method 1 and 615 for method 2.
        seed: seed of both draws.

    Returns:
        Indices of the drawn rows of both parts.

    Raises:
        InputError: there are fewer frames.
    """
    first = np.flatnonzero(np.isin(dataset.session, dataset.sessions[:THESIS_SESSIONS]))
    if len(first) < samples:
        raise InputError(
            f"{dataset.title}: the thesis protocol draws {samples} samples, and the first "
            f'{min(THESIS_SESSIONS, len(dataset.sessions))} sessions have {len(first)}; use protocol="random"'
        )
    part = random_subset(dataset.subset(first), samples, seed)
    split = random_split(part, 0.25, seed)
    position = {row: index for index, row in enumerate(dataset.rows.tolist())}
    rows = np.array([position[row] for row in part.rows.tolist()], dtype=np.int64)
    return Split(f"{len(split.train)} / {len(split.test)} of {samples}", rows[split.train], rows[split.test])


def standard_split(dataset: Dataset) -> Split:
    """Splits by sessions in order: the first quarter trains, the second calibrates intervals, the other half tests.

    The standard protocol has 80 sessions: 0-19, 20-39 and 40-79. Raises InputError below four sessions.
    """
    names = sorted(dataset.sessions)
    if len(names) < 4:
        raise InputError(
            f"{dataset.title}: the standard protocol needs at least four sessions to train, calibrate and test, got "
            f"{len(names)}; the benchmark protocol has 80"
        )
    train, calibrate = len(names) // 4, len(names) // 2
    parts = (names[:train], names[train:calibrate], names[calibrate:])
    rows = [np.flatnonzero(np.isin(dataset.session, part)) for part in parts]
    label = f"{len(parts[0])} train, {len(parts[1])} calibrate, {len(parts[2])} test"
    return Split(label, rows[0], rows[2], rows[1])


def catheter_splits(dataset: Dataset) -> list[Split]:
    """Splits by catheter: the first session of each catheter trains, its other sessions test.

    This judges a method that was trained elsewhere and gets one session of a new catheter. Sessions have the same
    catheter if its name and nominal values are the same; a catheter with a single session is left out. Raises
    InputError if every catheter has a single session.
    """
    groups: dict[Catheter, list[str]] = {}
    for name in dataset.sessions:
        groups.setdefault(dataset.session_info[name].catheter, []).append(name)
    per_catheter = [
        Split(
            f"{catheter.name}, trained on {first}",
            np.flatnonzero(dataset.session == first),
            np.flatnonzero(np.isin(dataset.session, others)),
        )
        for catheter, (first, *others) in groups.items()
        if others
    ]
    if not per_catheter:
        raise InputError(
            f"{dataset.title}: the catheter protocol trains on the first session of a catheter and tests on its "
            f'others, but each of the {len(groups)} catheters has a single one; record more, or use protocol="random"'
        )
    return per_catheter


def splits(
    protocol: Protocol,
    dataset: Dataset,
    *,
    folds: int | None = None,
    test_share: float = 0.25,
    seed: int = 0,
    thesis_samples: int = 220,
) -> list[Split]:
    """Returns the splits of one protocol.

    Args:
        protocol: "random" and "blocked" are one split, or a cross-validation with ``folds``. "session" holds out every
            session once. "thesis" (`thesis_split`) and "standard" (`standard_split`) are one split. "catheter"
            (`catheter_splits`) is one split per catheter.
        dataset: the dataset.
        folds: number of folds; for "session", the number of groups of sessions.
        test_share: share that "random" and "blocked" hold out.
        seed: seed of all draws.
        thesis_samples: number of samples of "thesis".
    """
    match protocol:
        case "session":
            return session_folds(dataset, folds, seed)
        case "random":
            return [random_split(dataset, test_share, seed)] if folds is None else random_folds(dataset, folds, seed)
        case "blocked":
            return [blocked_split(dataset, test_share, seed=seed)] if folds is None else blocked_folds(dataset, folds)
        case "thesis":
            return [thesis_split(dataset, thesis_samples, seed)]
        case "standard":
            return [standard_split(dataset)]
        case "catheter":
            return catheter_splits(dataset)
