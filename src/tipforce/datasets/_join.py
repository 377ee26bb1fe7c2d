"""Several datasets as one, to learn from all of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..types import Image, IntArray, Observation
from ._dataset import Dataset

__all__ = ["join"]


def join(datasets: Sequence[Dataset]) -> Dataset:
    """The samples of all ``datasets``, one after the other; actuation that one of them lacks is absent there.

    Raises InputError where two have a session of the same name, or know other components of the force.
    """
    if len(datasets) == 1:
        return datasets[0]
    first, owner = datasets[0], dict[str, str]()
    for dataset in datasets:
        if not np.array_equal(dataset.known, first.known):
            raise InputError(
                f"{dataset.title}: knows other components of the force than {first.title}; train on each by itself"
            )
        for session in dataset.sessions:
            if session in owner:
                raise InputError(
                    f"{dataset.title}: has a session {session!r}, as {owner[session]} has; rename one, so that they "
                    "can be told apart"
                )
            owner[session] = dataset.title
    counts = [len(dataset) for dataset in datasets]
    names = dict.fromkeys(name for dataset in datasets for name in dataset.actuation)
    views = dict.fromkeys(view for dataset in datasets for view in dataset.view_names)
    return Dataset(
        store=_Several(
            tuple(datasets), np.repeat(np.arange(len(datasets)), counts), np.concatenate([np.arange(n) for n in counts])
        ),
        session=np.concatenate([dataset.session for dataset in datasets]),
        stamp_ns=np.concatenate([dataset.stamp_ns for dataset in datasets]),
        actuation={
            name: np.concatenate([dataset.actuation.get(name, np.full(len(dataset), np.nan)) for dataset in datasets])
            for name in names
        },
        force_n=np.concatenate([dataset.force_n for dataset in datasets]),
        known=first.known,
        names=np.concatenate([dataset.names for dataset in datasets]),
        view_names={view: np.concatenate([dataset.names_of(view) for dataset in datasets]) for view in views},
        session_info={name: info for dataset in datasets for name, info in dataset.session_info.items()},
        rows=np.arange(sum(counts)),
        title=" and ".join(dataset.title for dataset in datasets),
    )


@dataclass(frozen=True, eq=False)
class _Several:
    """A store over ``parts``: row k is sample ``place[k]`` of part ``part[k]``."""

    parts: tuple[Dataset, ...]
    part: IntArray
    place: IntArray

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """The observations of ``rows``, in the order given."""
        for dataset in self._runs(rows):
            yield from dataset.observations()

    def has_masks(self, rows: IntArray, view: str) -> bool:
        """Whether any part of ``rows`` has them: `masks` is None for the samples of the others."""
        return any(dataset.has_masks(view) for dataset in self._runs(rows))

    def masks(self, rows: IntArray, view: str) -> Iterator[Image | None]:
        """Each part's own."""
        for dataset in self._runs(rows):
            yield from dataset.masks(view)

    def _runs(self, rows: IntArray) -> Iterator[Dataset]:
        """``rows`` in pieces that lie in one part each."""
        for piece in np.split(rows, np.flatnonzero(np.diff(self.part[rows])) + 1):
            if len(piece):
                yield self.parts[int(self.part[piece[0]])].subset(self.place[piece])
