"""The labelled samples of one or many sessions, whatever they are stored in."""

import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from ..types import BoolArray, FloatArray, Image, IntArray, Observation, SessionInfo

T = TypeVar("T")


class RowStore(Protocol):
    """Where observations come from: image files, a recording, a table of coefficients."""

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """The observations of ``rows`` (m,), in the order given."""
        ...


@runtime_checkable
class HasMasks(Protocol):
    """A store that also knows where the catheter is in its images."""

    def has_masks(self, rows: IntArray, view: str) -> bool:
        """Whether there is one of every one of ``rows``."""
        ...

    def masks(self, rows: IntArray, view: str) -> Iterator[Image | None]:
        """(h, w), not 0 on the catheter, of each of ``rows``; None where nobody drew it."""
        ...


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples in the order of their sessions and stamps.

    ``session`` (n,) names, ``stamp_ns`` (n,), ``actuation``: name -> (n,); ``force_n`` (n, 3): what the tissue does to
    the tip, base frame, NaN where ``known`` (3,) is False; ``names`` (n,): what a person calls each sample (its file,
    of several views the first's); ``view_names``: view -> (n,) what its images are called where that is another name.
    ``session_info``: session -> public facts; ``rows`` (n,): the samples' places in ``store``.
    """

    store: RowStore
    session: npt.NDArray[np.str_]
    stamp_ns: IntArray
    actuation: Mapping[str, FloatArray]
    force_n: FloatArray
    known: BoolArray
    names: npt.NDArray[np.str_]
    session_info: Mapping[str, SessionInfo]
    rows: IntArray
    title: str = ""
    view_names: Mapping[str, npt.NDArray[np.str_]] = field(default_factory=dict[str, npt.NDArray[np.str_]])
    remarks: tuple[str, ...] = ()
    """What a person should know of how the samples were gathered: what was left out, lacks or was renamed."""
    whole: "Dataset | None" = field(default=None, repr=False)
    """The dataset that this is a part of: a method with memory sees the frames before a sample, not their labels."""
    _memo: dict[tuple[str, int], object] = field(default_factory=dict, repr=False)
    _fingerprints: Mapping[str, str] | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def sessions(self) -> tuple[str, ...]:
        """Names of the sessions, in order of appearance."""
        return tuple(dict.fromkeys(self.session.tolist()))

    @property
    def session_fingerprints(self) -> Mapping[str, str]:
        """Session -> 16 hexadecimal digits of a hash of its content, whatever it is called and stored in.

        The content is stamps and labels (to a micronewton) of all samples that the session had when it was opened: a
        subset has the fingerprints of what it is a part of, and so has a recording that became a dataset folder.
        """
        known, sessions = self._fingerprints or {}, self.sessions
        if not set(sessions) <= known.keys():
            known = _fingerprints(self.session, self.stamp_ns, self.force_n)
            object.__setattr__(self, "_fingerprints", known)
        return {name: known[name] for name in sessions}

    def sessions_among(self, known: Collection[str]) -> tuple[str, ...]:
        """The sessions whose fingerprint is in ``known``, or whose name is, where nobody kept a fingerprint."""
        found = self.session_fingerprints.items()
        return tuple(name for name, fingerprint in found if fingerprint in known or name in known)

    @property
    def force_frames(self) -> set[str]:
        """Frames that the sessions' forces are in: "base" as far as nothing else is noted."""
        return {info.force_frame for info in self.session_info.values()}

    @property
    def magnitude_n(self) -> FloatArray:
        """(n,): magnitude of the known components."""
        return np.sqrt(np.sum(self.force_n[:, self.known] ** 2, axis=1))

    def names_of(self, view: str) -> npt.NDArray[np.str_]:
        """(n,): what a person calls each sample's image of ``view``."""
        return self.view_names.get(view, self.names)

    def subset(self, index: IntArray | BoolArray) -> "Dataset":
        """The samples at ``index`` (positions or a mask), sharing the store and everything derived so far."""
        session = self.session[index]
        left = set(session.tolist())
        return replace(
            self,
            session=session,
            session_info={name: info for name, info in self.session_info.items() if name in left},
            stamp_ns=self.stamp_ns[index],
            actuation={name: values[index] for name, values in self.actuation.items()},
            force_n=self.force_n[index],
            names=self.names[index],
            view_names={view: names[index] for view, names in self.view_names.items()},
            rows=self.rows[index],
            whole=self.whole or self,
            _fingerprints=self.session_fingerprints,
        )

    def observations(self) -> Iterator[Observation]:
        """The observations, one a sample, read as they are asked for."""
        return self.store.read(self.rows)

    def has_masks(self, view: str) -> bool:
        """Whether somebody drew where the catheter is in the samples' images of ``view``.

        In all of them; of several datasets that were joined, in all of those of one.
        """
        return isinstance(self.store, HasMasks) and self.store.has_masks(self.rows, view)

    def masks(self, view: str) -> Iterator[Image | None]:
        """Where the catheter is in each sample's image of ``view``: (h, w), not 0 on it; None where nobody drew it.

        To train on only: no observation holds it.
        """
        return self.store.masks(self.rows, view) if isinstance(self.store, HasMasks) else repeat(None, len(self))

    def derive(self, key: str, compute: Callable[[Observation], T]) -> list[T]:
        """``compute`` of every observation; what was derived under ``key`` before is not derived again."""
        missing = np.array([row for row in self.rows.tolist() if (key, row) not in self._memo], dtype=np.int64)
        for row, observation in zip(missing.tolist(), self.store.read(missing), strict=True):
            self._memo[key, row] = compute(observation)
        return [self._memo[key, row] for row in self.rows.tolist()]  # type: ignore[misc]

    def fingerprint(self) -> str:
        """SHA-256 of the labels, stamps and actuation: two datasets with the same samples have the same."""
        digest = hashlib.sha256()
        for array in (self.stamp_ns, self.force_n, *(self.actuation[name] for name in sorted(self.actuation))):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update("\n".join(self.session.tolist()).encode())
        return digest.hexdigest()


def _fingerprints(session: npt.NDArray[np.str_], stamp_ns: IntArray, force_n: FloatArray) -> dict[str, str]:
    """Session -> fingerprint, of samples in any order."""
    names, number = np.unique(session, return_inverse=True)
    order = np.lexsort((stamp_ns, number))
    parts = np.split(order, np.searchsorted(number[order], np.arange(1, len(names))))
    micronewtons = np.where(np.isnan(force_n), np.iinfo(np.int64).min, np.rint(np.nan_to_num(force_n) * 1e6))
    labels = micronewtons.astype("<i8")
    found: dict[str, str] = {}
    for name, rows in zip(names.tolist(), parts, strict=True):
        digest = hashlib.sha256(stamp_ns[rows].astype("<i8").tobytes())
        digest.update(labels[rows].tobytes())
        found[name] = digest.hexdigest()[:16]
    return found
