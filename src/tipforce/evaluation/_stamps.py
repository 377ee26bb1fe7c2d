"""From values with stamps to the samples of a dataset."""

from collections.abc import Mapping

import numpy as np

from ..datasets import Dataset
from ..errors import InputError
from ..types import FloatArray, IntArray

__all__ = ["values_at"]

_NEAR_NS = 5_000_000
"""A truth belongs to a sample when their stamps differ by no more: a quarter of a frame at 50 Hz."""
_OWN_NS = 500_000
"""A session's own truth has the samples' stamps, but for a video's rounding; frames of two sessions jitter apart."""


def values_at(
    dataset: Dataset, values: Mapping[str, tuple[IntArray, FloatArray]], what: str, remedy: str
) -> FloatArray:
    """(n, k): of every sample, what ``values`` (session -> stamps (m,), rows (m, k)) hold at its stamp.

    NaN where they hold nothing within 5 ms. Raises InputError, which calls them ``what``, where no sample has any, and
    where a session's stamps are another recording's: half of those found more than 0.5 ms off.
    """
    columns = next((rows.shape[1] for _, rows in values.values()), 3)
    found = np.full((len(dataset), columns), np.nan)
    for session, (stamps, rows_there) in values.items():
        rows = np.flatnonzero(dataset.session == session)
        if not len(rows) or not len(stamps):
            continue
        after = np.clip(np.searchsorted(stamps, dataset.stamp_ns[rows]), 1, max(1, len(stamps) - 1))
        before = after - 1
        after = np.minimum(after, len(stamps) - 1)
        wanted = dataset.stamp_ns[rows]
        nearest = np.where(np.abs(stamps[before] - wanted) <= np.abs(stamps[after] - wanted), before, after)
        apart = np.abs(stamps[nearest] - wanted)
        near = apart <= _NEAR_NS
        if near.any() and np.median(apart[near]) > _OWN_NS:
            raise InputError(
                f"the {what} of {session} belongs to another recording than that of {dataset.title}: its stamps lie "
                f"{1e-6 * np.median(apart[near]):.1f} ms beside the samples'; {remedy}"
            )
        found[rows[near]] = rows_there[nearest[near]]
    if np.isnan(found).all():
        ours, theirs = ", ".join(dataset.sessions[:5]), ", ".join(list(values)[:5]) or "none"
        raise InputError(
            f"no sample of {dataset.title} has a {what}: its sessions are {ours}, the {what} is of {theirs}; {remedy}"
        )
    return found
