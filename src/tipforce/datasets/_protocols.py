"""The ways of holding out that have a name: three splits side by side, the yardstick's two, catheter by catheter."""

from typing import Literal

import numpy as np

from ..errors import InputError
from ..types import Catheter
from ._dataset import Dataset
from ._splits import Split, blocked_folds, blocked_split, random_folds, random_split, session_folds
from ._subsets import random_subset

__all__ = ["THESIS_SESSIONS", "Protocol", "catheter_splits", "splits", "standard_split", "thesis_split"]

Protocol = Literal["random", "blocked", "session", "thesis", "standard", "catheter"]

THESIS_SESSIONS = 8
"""The thesis protocol draws its samples from so many sessions."""


def thesis_split(dataset: Dataset, samples: int, seed: int = 0) -> Split:
    """``samples`` frames drawn from the first eight sessions, split at random 75/25: the thesis's protocol.

    The thesis has 220 frames for method 1 and 615 for method 2. Raises InputError where there are fewer frames.
    """
    first = np.flatnonzero(np.isin(dataset.session, dataset.sessions[:THESIS_SESSIONS]))
    if len(first) < samples:
        raise InputError(
            f"{dataset.title}: the thesis protocol draws {samples} samples, and the first "
            f'{min(THESIS_SESSIONS, len(dataset.sessions))} sessions have {len(first)}; use protocol="random"'
        )
    part = random_subset(dataset.subset(first), samples, seed)
    split = random_split(part, 0.25, seed)
    place = {row: position for position, row in enumerate(dataset.rows.tolist())}
    rows = np.array([place[row] for row in part.rows.tolist()], dtype=np.int64)
    return Split(f"{len(split.train)} / {len(split.test)} of {samples}", rows[split.train], rows[split.test])


def standard_split(dataset: Dataset) -> Split:
    """Whole sessions in their order: the first quarter trains, the second calibrates intervals, the other half tests.

    The yardstick is 80 sessions: 0-19, 20-39 and 40-79. Raises InputError below four sessions.
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
    """For every catheter: its first session trains, its others test.

    So a method is judged that starts from what it learnt elsewhere and gets one session to know a catheter by. Sessions
    have the same catheter where its name and nominal values are the same; one with a single session is left out. Raises
    InputError where all have a single one.
    """
    groups: dict[Catheter, list[str]] = {}
    for name in dataset.sessions:
        groups.setdefault(dataset.session_info[name].catheter, []).append(name)
    found = [
        Split(
            f"{catheter.name}, trained on {first}",
            np.flatnonzero(dataset.session == first),
            np.flatnonzero(np.isin(dataset.session, others)),
        )
        for catheter, (first, *others) in groups.items()
        if others
    ]
    if not found:
        raise InputError(
            f"{dataset.title}: the catheter protocol trains on the first session of a catheter and tests on its "
            f'others, but each of the {len(groups)} catheters has a single one; record more, or use protocol="random"'
        )
    return found


def splits(
    protocol: Protocol,
    dataset: Dataset,
    *,
    folds: int | None = None,
    test_share: float = 0.25,
    seed: int = 0,
    thesis_samples: int = 220,
) -> list[Split]:
    """The splits of one protocol: a single one for "random" and "blocked" without ``folds``, else a cross-validation.

    "session" holds every session out once whatever ``folds`` is; ``folds`` only groups them. "thesis" and "standard"
    are one split each; see `thesis_split`, of ``thesis_samples``, and `standard_split`. "catheter" is one a catheter:
    `catheter_splits`.
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
