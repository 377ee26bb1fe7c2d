"""Takes parts of a dataset (random, every n-th, without sessions), and joins several datasets."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from ..errors import InputError
from ..types import Image, IntArray, Observation
from ._dataset import Dataset


def random_subset(dataset: Dataset, samples: int, seed: int = 0) -> Dataset:
    """Returns ``samples`` rows drawn at random without replacement, in their order (the thesis has 220).

    Args:
        dataset: the dataset.
        samples: number of rows; all rows are returned if there are fewer.
        seed: seed of the draw.

    Raises:
        InputError: ``samples`` is below 1.
    """
    if samples < 1:
        raise InputError(f"the number of samples must be at least 1, got {samples}")
    if samples >= len(dataset):
        return dataset
    rows = np.random.default_rng(seed).choice(len(dataset), samples, replace=False)
    return dataset.subset(np.sort(rows))


def every_nth(dataset: Dataset, every: int) -> Dataset:
    """Returns each session's first sample and every n-th after it.

    Args:
        dataset: the samples, in the order of time within each session.
        every: n, at least 1.

    Raises:
        InputError: ``every`` is below 1.
    """
    if every < 1:
        raise InputError(f"every n-th frame: expected n of at least 1, got {every}")
    rows = [np.flatnonzero(dataset.session == name)[::every] for name in dataset.sessions]
    return dataset.subset(np.sort(np.concatenate(rows)))


def without_sessions(dataset: Dataset, sessions: Sequence[str]) -> Dataset:
    """Returns ``dataset`` without ``sessions``, which are kept for testing.

    Args:
        dataset: the dataset.
        sessions: names of the sessions that are left out.

    Raises:
        InputError: a name does not exist in the dataset, or no session remains.
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


def join(datasets: Sequence[Dataset]) -> Dataset:
    """Returns the samples of all ``datasets``, one dataset after the other.

    If two sessions have the same name and different content, the later one gets a number behind its name. Actuation and
    views that a dataset does not have are absent in its samples; `Dataset.remarks` of the result states this. Raises
    InputError where two datasets know different components of the force, or have the same session.
    """
    if len(datasets) == 1:
        return datasets[0]
    first = datasets[0]
    for dataset in datasets:
        if not np.array_equal(dataset.known, first.known):
            raise InputError(
                f"{dataset.title}: knows other components of the force than {first.title}; train on each by itself"
            )
    datasets, renamed = _with_different_names(datasets)
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
        remarks=(*(remark for dataset in datasets for remark in dataset.remarks), *renamed, *_lacking(datasets)),
        _fingerprints={
            name: fingerprint for dataset in datasets for name, fingerprint in dataset.session_fingerprints.items()
        },
    )


def _with_different_names(datasets: Sequence[Dataset]) -> tuple[list[Dataset], list[str]]:
    """Returns ``datasets`` with different session names, and a sentence for each session that was renamed.

    Raises InputError where two datasets have a session of the same name and content.
    """
    owner: dict[str, tuple[str, str]] = {}  # session -> title of its dataset, fingerprint of its content
    separate: list[Dataset] = []
    remarks: list[str] = []
    used_names = {session for dataset in datasets for session in dataset.sessions}
    for dataset in datasets:
        names: dict[str, str] = {}
        for session, fingerprint in dataset.session_fingerprints.items():
            title, content = owner.get(session, ("", ""))
            if content == fingerprint:
                raise InputError(
                    f"{dataset.title}: has the session {session!r} that {title} has, with the same stamps and forces; "
                    "name it once"
                )
            if content:
                name = next(new for k in count(2) if (new := f"{session} ({k})") not in used_names)
                names[session] = name
                used_names.add(name)
                remarks.append(f"{session} of {dataset.title} is called {name}, because {title} has a {session} too")
            owner[names.get(session, session)] = dataset.title, fingerprint
        separate.append(_renamed(dataset, names) if names else dataset)
    return separate, remarks


def _renamed(dataset: Dataset, names: Mapping[str, str]) -> Dataset:
    """Returns ``dataset`` with the new ``names`` (old name -> new name) of its sessions."""
    infos = {
        names.get(name, name): replace(info, name=names.get(name, name)) for name, info in dataset.session_info.items()
    }
    return replace(
        dataset,
        session=np.array([names.get(name, name) for name in dataset.session.tolist()]),
        session_info=infos,
        whole=None,
        _fingerprints={names.get(name, name): value for name, value in dataset.session_fingerprints.items()},
    )


def _lacking(datasets: Sequence[Dataset]) -> Iterator[str]:
    """Yields a sentence for each dataset without a reading of a drive, or image of a view, that another dataset has."""
    drives = [{name for name, values in each.actuation.items() if np.isfinite(values).any()} for each in datasets]
    views = [set(each.views) for each in datasets]
    for dataset, own_drives, own_views in zip(datasets, drives, views, strict=True):
        missing = (("actuation", set().union(*drives) - own_drives), ("view", set().union(*views) - own_views))
        for kind, names in missing:
            if names:
                lacking = f"{kind} {', '.join(sorted(names))}"
                yield f"{dataset.title}: its {len(dataset)} samples lack the {lacking}, which others of the data have"


@dataclass(frozen=True, eq=False)
class _Several:
    """A store of several datasets: row k is sample ``position[k]`` of the dataset ``parts[part[k]]``."""

    parts: tuple[Dataset, ...]
    part: IntArray
    position: IntArray

    @property
    def view_names(self) -> Iterable[str]:
        """Names of the views of all datasets."""
        return (view for dataset in self.parts for view in dataset.views)

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """Yields the observations of ``rows``, in the given order."""
        for dataset in self._runs(rows):
            yield from dataset.observations()

    def has_masks(self, rows: IntArray, view: str) -> bool:
        """Returns whether any dataset of ``rows`` has masks: `masks` yields None for the samples of the others."""
        return any(dataset.has_masks(view) for dataset in self._runs(rows))

    def masks(self, rows: IntArray, view: str) -> Iterator[Image | None]:
        """Yields the masks of the datasets."""
        for dataset in self._runs(rows):
            yield from dataset.masks(view)

    def _runs(self, rows: IntArray) -> Iterator[Dataset]:
        """Yields ``rows`` in consecutive pieces, each of one dataset."""
        for piece in np.split(rows, np.flatnonzero(np.diff(self.part[rows])) + 1):
            if len(piece):
                yield self.parts[int(self.part[piece[0]])].subset(self.position[piece])
