"""Stores of a dataset's observations. Images are read only when they are used."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..alignment import nearest_frames
from ..io import RecordingReader, StreamDepth, read_image
from ..types import FloatArray, Image, IntArray, Observation, ShapeFeatures, View
from ._checks import check_image


@dataclass(frozen=True, eq=False)
class Table:
    """Stamps and readings of n rows.

    Attributes:
        stamp_ns: (n,) stamps.
        actuation: name -> (n,) readings, NaN without a reading.
    """

    stamp_ns: IntArray
    actuation: Mapping[str, FloatArray]

    def _observation(self, row: int, views: Mapping[str, View]) -> Observation:
        actuation = {name: float(values[row]) for name, values in self.actuation.items() if not np.isnan(values[row])}
        return Observation(int(self.stamp_ns[row]), views, actuation)


@dataclass(frozen=True, eq=False)
class _RowByRow(Table, ABC):
    """A store that reads the views of each row alone, in any order."""

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """Yields the observations of ``rows``, in the given order."""
        for row in rows.tolist():
            yield self._observation(row, self._views(row))

    @abstractmethod
    def _views(self, row: int) -> Mapping[str, View]:
        """Returns the images of one row by view, or the shape numbers."""


@dataclass(frozen=True, eq=False)
class ImageFiles(_RowByRow):
    """Images in files.

    Attributes:
        paths: view -> (n,) paths of the images.
        mask_paths: view -> (n,) paths of the masks of the catheter; empty without masks.
        checksums: view -> (n,) checksums as `crc_text` writes them; "" if none is stated.
    """

    paths: Mapping[str, tuple[Path, ...]]
    mask_paths: Mapping[str, tuple[Path, ...]] = field(default_factory=dict[str, tuple[Path, ...]])
    checksums: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])

    @property
    def view_names(self) -> Iterable[str]:
        """Names of the views."""
        return self.paths

    def has_masks(self, rows: IntArray, view: str) -> bool:
        """Returns whether each row has a mask file; see `HasMasks.has_masks`."""
        paths = self.mask_paths.get(view)
        return paths is not None and all(paths[row].is_file() for row in rows.tolist())

    def masks(self, rows: IntArray, view: str) -> Iterator[Image | None]:
        """Yields the mask of each row, None where it has no mask file; see `HasMasks.masks`."""
        paths = self.mask_paths.get(view)
        for row in rows.tolist():
            yield None if paths is None or not paths[row].is_file() else read_image(paths[row])

    def _views(self, row: int) -> Mapping[str, View]:
        for view, stated in self.checksums.items():
            check_image(self.paths[view][row], stated[row])
        return {view: read_image(paths[row], self._depths[view]) for view, paths in self.paths.items()}

    @cached_property
    def _depths(self) -> dict[str, StreamDepth]:
        return {view: StreamDepth.of_files(paths) for view, paths in self.paths.items()}


@dataclass(frozen=True, eq=False)
class ImageArrays(_RowByRow):
    """Images in memory.

    Attributes:
        images: view -> (n, h, w) uint8.
    """

    images: Mapping[str, Image]

    def _views(self, row: int) -> Mapping[str, View]:
        return {view: images[row] for view, images in self.images.items()}


@dataclass(frozen=True, eq=False)
class ShapeTable(_RowByRow):
    """Shape numbers in place of images.

    Attributes:
        names: (k,) names of the numbers.
        values: (n, k) numbers.
        view: name of the view.
    """

    names: tuple[str, ...]
    values: FloatArray
    view: str = "camera"

    def _views(self, row: int) -> Mapping[str, View]:
        return {self.view: ShapeFeatures(self.names, self.values[row])}


@dataclass(frozen=True, eq=False)
class Recordings(Table):
    """Frames in recordings.

    Attributes:
        paths: paths of the recordings.
        recording: (n,) index into ``paths``.
        frame: (n,) index of the frame in its recording.
        view: view of the frames.
        others: views whose image of the same instant is added; absent if it was dropped.
    """

    paths: tuple[Path, ...]
    recording: npt.NDArray[np.int64]
    frame: IntArray
    view: str = "camera"
    others: tuple[str, ...] = ()

    @property
    def view_names(self) -> Iterable[str]:
        """Names of the views."""
        return (self.view, *self.others)

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """Yields the observations of ``rows``, in the given order; one recording is open at a time."""
        reader, current = None, -1
        try:
            for row in rows.tolist():
                index = int(self.recording[row])
                if reader is None or index != current:
                    if reader is not None:
                        reader.close()
                    reader, current = RecordingReader(self.paths[index]), index
                image = reader.frame_at(int(self.frame[row]), self.view)
                yield self._observation(row, {self.view: image.image, **self._other_views(reader, row)})
        finally:
            if reader is not None:
                reader.close()

    def _other_views(self, reader: RecordingReader, row: int) -> dict[str, View]:
        """Returns view -> image of the same instant, for those of ``others`` that have one."""
        images: dict[str, View] = {}
        for view in self.others:
            index = int(nearest_frames(self.stamp_ns[row : row + 1], reader.stamps(view))[0])
            if index >= 0:
                images[view] = reader.frame_at(index, view).image
        return images
