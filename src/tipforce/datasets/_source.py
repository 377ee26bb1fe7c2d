"""A session of any kind of data as a `Source` of events, so that estimates use the same data as training."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from .._system.contexts import ClosedAtExit
from ..errors import FileFormatError, InputError
from ..io import FileSource
from ..io import open_source as open_file_source
from ..types import Actuation, Event, FloatArray, Frame, SessionInfo, ShapeFeatures, Source
from ._dataset import Dataset
from ._folder import METADATA
from ._open import holds_samples, open_dataset


class DatasetSource(ClosedAtExit):
    """One session of a dataset as a `Source`: its images and drives, never its labels.

    Args:
        dataset: samples of one session with images.
        path: path of the dataset, for messages.
        actuation: constant readings. Raises InputError if the samples have a column of that name.
        stated: metadata that replace those of the dataset; its constant readings are used for drives that the samples
            do not have.
    """

    def __init__(
        self,
        dataset: Dataset,
        path: Path,
        actuation: Mapping[str, float] | None = None,
        stated: SessionInfo | None = None,
    ) -> None:
        """Joins metadata and drives of the samples with the stated ones; see the class for the arguments."""
        stated = stated or SessionInfo()
        (name,) = dataset.sessions
        recorded = {drive for drive, values in dataset.actuation.items() if np.isfinite(values).any()}
        if clash := recorded & set(actuation or {}):
            raise InputError(f"{path}: has a column {min(clash)!r} already; do not state it a second time")
        self.path, self.frame_count, self._dataset, self._recorded = path, len(dataset), dataset, recorded
        self.views = dataset.views
        self.session_info = dataset.session_info[name].updated(stated)
        constant = self.session_info.actuation.constant.items()
        self._constant = {drive: value for drive, value in constant if drive not in recorded} | dict(actuation or {})

    def lacks(self, names: Iterable[str]) -> list[str]:
        """Returns those ``names`` of the actuation for which there is no reading."""
        return [name for name in names if name not in self._constant and name not in self._recorded]

    def readings(self, name: str) -> FloatArray:
        """Returns the (n,) readings of the drive ``name``."""
        stated = self._constant.get(name, ())
        values = np.asarray(self._dataset.actuation[name] if name in self._recorded else stated, np.float64).ravel()
        return values[np.isfinite(values)]

    def file_names(self, view: str) -> Mapping[int, str]:
        """Returns stamp in ns -> name of the image of ``view`` in the dataset."""
        names = self._dataset.names_of(view).tolist()
        return dict(zip(self._dataset.stamp_ns.tolist(), names, strict=True))

    def __iter__(self) -> Iterator[Event]:
        for number, observation in enumerate(self._dataset.observations()):
            values = {**(self._constant if number == 0 else {}), **observation.actuation}
            if values:
                yield Actuation(observation.stamp_ns, values)
            for view, image in observation.views.items():
                if isinstance(image, ShapeFeatures):
                    raise InputError(
                        f"{self.path}: holds ready-made shape numbers and no images, which this needs; they serve "
                        "`tipforce train` and `tipforce evaluate`"
                    )
                yield Frame(observation.stamp_ns, image, view)


def file_names(source: Source, view: str) -> Mapping[int, str]:
    """Returns stamp in ns -> name of the image file.

    Args:
        source: a source of images.
        view: view of the images.

    Returns:
        Empty if the images have no files, as in a video.
    """
    if isinstance(source, DatasetSource):
        return source.file_names(view)
    return source.file_names if isinstance(source, FileSource) else {}


def open_source(
    path: Path | str,
    *,
    session: str | None = None,
    actuation: Mapping[str, float] | None = None,
    stated: SessionInfo | None = None,
) -> Source:
    """Opens one session of any kind of data as a `Source`: a context manager that may be iterated again.

    Args:
        path: a recording, video, DICOM file, image or folder of images; a dataset folder, its table, Parquet shards, a
            folder of recordings or a published layout.
        session: name of the session, if ``path`` has several.
        actuation: constant readings of drives (``knob_deg``) that the data do not have.
        stated: metadata that replace those of the data.

    Returns:
        The source, not yet entered.

    Raises:
        FileFormatError: ``path`` cannot be read.
        InputError: ``session`` does not exist or must be stated, or ``actuation`` has a name that the data have
            already.
    """
    where = Path(path)
    recordings = sorted(where.glob("*.mcap")) if where.is_dir() and not (where / METADATA).is_file() else []
    if recordings:
        stem = _chosen(where, [recording.stem for recording in recordings], session)
        return open_file_source(where / f"{stem}.mcap", actuation=actuation, stated=stated)
    if not holds_samples(where):
        source = open_file_source(where, actuation=actuation, stated=stated)
        if session not in (None, source.session_info.name):
            raise InputError(f"{where}: is one session, {source.session_info.name}; there is no session {session}")
        return source
    dataset = open_dataset(where)
    name = _chosen(where, dataset.sessions, session)
    part = dataset.subset(np.flatnonzero(dataset.session == name))
    return DatasetSource(part, where, actuation, stated)


def _chosen(path: Path, sessions: Iterable[str], wanted: str | None) -> str:
    """Returns the session ``wanted``, or the only one. Raises FileFormatError without sessions, else InputError."""
    names = list(sessions)
    if not names:
        raise FileFormatError(f"{path}: holds no session")
    if wanted is None and len(names) == 1:
        return names[0]
    if wanted not in names:
        listed = ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")
        problem = f"holds {len(names)} sessions; state one of them" if wanted is None else f"has no session {wanted}"
        raise InputError(f"{path}: {problem}: {listed}")
    return wanted
