"""The labelled samples of one or many sessions, independent of their storage."""

import hashlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from ..types import BoolArray, FloatArray, Image, IntArray, Observation, SessionInfo, ordered_views

T = TypeVar("T")


class RowStore(Protocol):
    """Source of observations: image files, a recording, a table of coefficients."""

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """Yields the observations of ``rows`` (m,), in the given order."""
        ...


@runtime_checkable
class HasViews(Protocol):
    """A store that knows the views of its observations without reading them."""

    @property
    def view_names(self) -> Iterable[str]:
        """Names of the views; an image of one may be absent in some rows."""
        ...


@runtime_checkable
class HasMasks(Protocol):
    """A store that also has masks of the catheter for its images."""

    def has_masks(self, rows: IntArray, view: str) -> bool:
        """Returns whether there is a mask for each row.

        Args:
            rows: (n,) indices of the rows.
            view: name of the view.
        """
        ...

    def masks(self, rows: IntArray, view: str) -> Iterator[Image | None]:
        """Yields the mask (h, w) of each row, not 0 on the catheter; None for an image without a mask.

        Args:
            rows: (n,) indices of the rows.
            view: name of the view.
        """
        ...


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples in the order of their sessions and stamps.

    Attributes:
        store: source of the observations.
        session: (n,) name of the session of each sample.
        stamp_ns: (n,) stamps.
        actuation: name -> (n,) readings.
        force_n: (n, 3) force of the tissue on the tip, base frame; NaN where ``known`` is False.
        known: (3,) the components of the force that are known.
        names: (n,) name of each sample for people: its file; with several views, that of the first.
        session_info: session -> public metadata.
        rows: (n,) row of each sample in ``store``.
        title: name of the dataset.
        view_names: view -> (n,) names of its images, where they differ from ``names``.
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
    """Remarks for people on the origin of the samples: parts that were left out, are missing or were renamed."""
    whole: "Dataset | None" = field(default=None, repr=False)
    """The dataset of which this is a part: methods with memory get the frames before a sample, not their labels."""
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
        """Session -> 16 hexadecimal digits of a hash of its content, independent of its name and storage.

        The content is stamps and labels (to a micronewton) of all samples that the session had when it was opened. So a
        subset has the fingerprints of its whole, and a dataset folder has those of the recording that it was made from.
        """
        known, sessions = self._fingerprints or {}, self.sessions
        if not set(sessions) <= known.keys():
            known = _fingerprints(self.session, self.stamp_ns, self.force_n)
            object.__setattr__(self, "_fingerprints", known)
        return {name: known[name] for name in sessions}

    def sessions_among(self, known: Collection[str]) -> tuple[str, ...]:
        """Returns the sessions whose fingerprint is in ``known``, or whose name is if no fingerprint was stored."""
        items = self.session_fingerprints.items()
        return tuple(name for name, fingerprint in items if fingerprint in known or name in known)

    @property
    def force_frames(self) -> set[str]:
        """Reference frames of the sessions' forces; "base" unless the metadata state another one."""
        return {info.force_frame for info in self.session_info.values()}

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the samples' views, the first one first."""
        if isinstance(self.store, HasViews):
            return ordered_views(self.store.view_names)
        first = next(self.store.read(self.rows[:1]), None)
        return () if first is None else ordered_views(first.views)

    @property
    def magnitude_n(self) -> FloatArray:
        """(n,) magnitude of the known components."""
        return np.sqrt(np.sum(self.force_n[:, self.known] ** 2, axis=1))

    def names_of(self, view: str) -> npt.NDArray[np.str_]:
        """Returns the (n,) names of the images of ``view``, for people."""
        return self.view_names.get(view, self.names)

    def subset(self, index: IntArray | BoolArray) -> "Dataset":
        """Returns the samples at ``index`` (positions or a mask); the part shares the store and all derived values."""
        session = self.session[index]
        session_names = set(session.tolist())
        return replace(
            self,
            session=session,
            session_info={name: info for name, info in self.session_info.items() if name in session_names},
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
        """Yields one observation per sample; each is read when it is used."""
        return self.store.read(self.rows)

    def has_masks(self, view: str) -> bool:
        """Returns whether the samples' images of ``view`` have masks of the catheter.

        True if all images have one; for datasets that were joined, if all images of one of them have one.
        """
        return isinstance(self.store, HasMasks) and self.store.has_masks(self.rows, view)

    def masks(self, view: str) -> Iterator[Image | None]:
        """Yields the mask (h, w) of each image of ``view``, not 0 on the catheter; None for an image without a mask.

        For training only: no observation contains masks.
        """
        return self.store.masks(self.rows, view) if isinstance(self.store, HasMasks) else repeat(None, len(self))

    def derive(self, key: str, compute: Callable[[Observation], T]) -> list[T]:
        """Returns ``compute`` of every observation; values are kept, and not computed again for the same ``key``.

        Args:
            key: name under which the values are kept.
            compute: function of one observation.
        """
        missing = np.array([row for row in self.rows.tolist() if (key, row) not in self._memo], dtype=np.int64)
        for row, observation in zip(missing.tolist(), self.store.read(missing), strict=True):
            self._memo[key, row] = compute(observation)
        return [self._memo[key, row] for row in self.rows.tolist()]  # type: ignore[misc]

    def fingerprint(self) -> str:
        """Returns the SHA-256 of labels, stamps and actuation: the same for two datasets with the same samples."""
        digest = hashlib.sha256()
        for array in (self.stamp_ns, self.force_n, *(self.actuation[name] for name in sorted(self.actuation))):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update("\n".join(self.session.tolist()).encode())
        return digest.hexdigest()


def _fingerprints(session: npt.NDArray[np.str_], stamp_ns: IntArray, force_n: FloatArray) -> dict[str, str]:
    """Returns session -> fingerprint, for n samples in any order; see `Dataset.session_fingerprints`."""
    names, session_index = np.unique(session, return_inverse=True)
    order = np.lexsort((stamp_ns, session_index))  # by session, then by stamp
    rows_of = np.split(order, np.searchsorted(session_index[order], np.arange(1, len(names))))
    # an unknown component becomes the smallest integer
    micronewtons = np.where(np.isnan(force_n), np.iinfo(np.int64).min, np.rint(np.nan_to_num(force_n) * 1e6))
    labels = micronewtons.astype("<i8")
    fingerprints: dict[str, str] = {}
    for name, rows in zip(names.tolist(), rows_of, strict=True):
        digest = hashlib.sha256(stamp_ns[rows].astype("<i8").tobytes())
        digest.update(labels[rows].tobytes())
        fingerprints[name] = digest.hexdigest()[:16]
    return fingerprints
