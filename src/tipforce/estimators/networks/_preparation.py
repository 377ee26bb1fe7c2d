"""The inputs of a network: read from an observation, or prepared once from a dataset and streamed from disk."""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from numpy.lib.format import open_memmap

from ..._system.json_files import read_json
from ...datasets import Dataset
from ...errors import FileFormatError, InputError
from ...training import TrainingSamples
from ...types import BoolArray, Image, IntArray, Observation
from .._reading import Abstention, read_actuation

PREPARED_FILE = "prepared.json"
_MAX_NOTE_BYTES = 256 << 20
"""Longest `PREPARED_FILE`: some 9 bytes a sample."""
"""Describes the prepared arrays; it is written last."""

Arrays = dict[str, npt.NDArray[Any]]

Spec = tuple[tuple[int, ...], str]
"""Shape of one sample and dtype, "uint8" or "float32"."""

Specs = Mapping[str, Spec]
"""Name of an input -> its shape and dtype."""

Masks = tuple[Image, ...]
"""Masks (h, w) of the catheter, one for each view."""

ReadSample = Callable[[str, Observation, Masks | None], "Mapping[str, npt.NDArray[Any]] | Abstention"]
"""Called with the name of a session, an observation of it, and the catheter's masks in its images, if there are any."""


class InputReader(Protocol):
    """Reads the network's inputs, all but the actuation, from the observations of one session."""

    def __call__(self, observation: Observation, masks: Masks | None = None) -> Arrays | Abstention:
        """Returns the inputs of one sample; with ``masks`` also its "heatmap", see `TrainingSamples`."""
        ...


def read_inputs(
    reader: InputReader, actuation: tuple[str, ...], observation: Observation, masks: Masks | None = None
) -> Arrays | Abstention:
    """Returns the inputs of one sample with its actuation values, or why they cannot be read.

    Args:
        reader: reads the inputs without actuation.
        actuation: names of the actuation values.
        observation: the sample.
        masks: masks of the catheter, for training; None: unknown.
    """
    row = reader(observation, masks)
    if isinstance(row, Abstention) or not actuation:
        return row
    values = read_actuation(observation, actuation)
    return values if isinstance(values, Abstention) else {**row, "actuation": values.astype(np.float32)}


def actuation_spec(names: tuple[str, ...]) -> Specs:
    """Returns the spec of the input "actuation", none without actuation."""
    return {"actuation": ((len(names),), "float32")} if names else {}


def training_components(dataset: Dataset, wanted: str, method: str) -> BoolArray:
    """Returns the force components that are estimated.

    Args:
        dataset: the training data.
        wanted: "xy": those of the plane alone; otherwise all that the data have.
        method: name of the method, for messages.

    Returns:
        (3,), True for x, y, z that are estimated.

    Raises:
        InputError: there is no sample, or some samples have no force.
    """
    known = np.asarray(dataset.known) & (np.array([True, True, False]) if wanted == "xy" else True)
    if not known.any():
        raise InputError(f"{dataset.title}: has no force components to learn; {method} needs at least fx_n or fy_n")
    if not np.isfinite(dataset.force_n[:, known]).all():
        raise InputError(f"{dataset.title}: some samples have no force; leave them out")
    return known


def training_samples(dataset: Dataset, prepared: "PreparedData", known: BoolArray) -> TrainingSamples:
    """Returns the prepared inputs with their labels.

    Args:
        dataset: the training data.
        prepared: inputs of some of its samples.
        known: (3,) the estimated components.
    """
    arrays = dict(prepared.arrays)
    return TrainingSamples(
        images=arrays.pop("image"),
        heatmap=arrays.pop("heatmap", None),
        inputs=arrays,
        force_n=dataset.force_n[prepared.index][:, known].astype(np.float32),
        session=dataset.session[prepared.index],
    )


def standardisation(values: npt.NDArray[np.float32] | None) -> tuple[tuple[float, float], ...]:
    """Returns mean and standard deviation of each column; 1 for the deviation of a constant one."""
    if values is None:
        return ()
    deviation = values.std(axis=0, dtype=np.float64)
    mean = values.mean(axis=0, dtype=np.float64)
    return tuple(zip(mean.tolist(), np.where(deviation > 0, deviation, 1.0).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class PreparedData:
    """Prepared inputs of a dataset.

    Attributes:
        arrays: name -> (m, ...), read-only memory maps.
        index: (m,) indices of their samples in the dataset.
        first_skipped: the first sample that could not be read, and why; empty where all could.
    """

    arrays: Arrays
    index: IntArray
    first_skipped: str


def prepare(
    dataset: Dataset,
    masks: Iterable[Masks | None],
    specs: Specs,
    read: ReadSample,
    folder: Path,
    key: str,
    names: npt.NDArray[np.str_],
    report: Callable[[float], None],
) -> PreparedData:
    """Reads the inputs of all samples, in the dataset's order, and keeps them as .npy files.

    Args:
        dataset: the samples.
        masks: the catheter's masks in each sample's images, or None.
        specs: the arrays to keep, one file each.
        read: reads one sample.
        folder: folder of the files.
        key: everything that ``read`` depends on.
        names: (n,) name of each sample in messages.
        report: called with the finished share.

    Raises:
        InputError: there is not enough disk space.
    """
    key = hashlib.sha256(
        "\n".join([key, repr(sorted(specs.items())), dataset.fingerprint(), dataset.title, *names.tolist()]).encode()
    ).hexdigest()
    note = folder / PREPARED_FILE
    if note.is_file() and (kept := _kept(note, key, len(dataset))) is not None:
        return _opened(folder, specs, *kept)
    note.unlink(missing_ok=True)
    count = len(dataset)
    needed = count * sum(int(np.prod(shape)) * np.dtype(kind).itemsize for shape, kind in specs.values())
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise InputError(
            f"{folder}: preparing the images of {dataset.title} needs {needed / 1e9:.1f} GB, {free / 1e9:.1f} GB are "
            "free; make room, or train on fewer samples"
        )
    files = {
        name: open_memmap(_path(folder, name), "w+", kind, (count, *shape)) for name, (shape, kind) in specs.items()
    }
    index: list[int] = []
    first_skipped = ""
    for sample, (observation, shown) in enumerate(zip(dataset.observations(), masks, strict=True)):
        found = read(dataset.session[sample], observation, shown)
        if isinstance(found, Abstention):
            first_skipped = first_skipped or f"{names[sample]}: {found.detail} ({found.status})"
        else:
            for name, file in files.items():
                file[len(index)] = found[name]
            index.append(sample)
        report((sample + 1) / count)
    for file in files.values():
        file.flush()
    del files
    part = folder / f"{PREPARED_FILE}.part"
    part.write_text(json.dumps({"key": key, "index": index, "first_skipped": first_skipped}), encoding="utf-8")
    part.replace(note)
    return _opened(folder, specs, np.array(index, np.int64), first_skipped)


def _kept(note: Path, key: str, count: int) -> tuple[IntArray, str] | None:
    """Returns the samples of prepared files, and the first that was skipped; None where they are of another key.

    Raises:
        FileFormatError: the note beside the files is damaged.
    """
    remedy = f"remove {note} and run the command again, which prepares the images anew"
    noted = read_json(note, max_bytes=_MAX_NOTE_BYTES, remedy=remedy)
    try:
        if noted["key"] != key:
            return None
        index, skipped = np.array(noted["index"], np.int64), str(noted["first_skipped"])
        if index.ndim == 1 and np.all(np.diff(index) > 0) and np.all((index >= 0) & (index < count)):
            return index, skipped
    except (KeyError, TypeError, ValueError, OverflowError):
        pass  # refused below
    raise FileFormatError(f"{note}: does not say which images were prepared; {remedy}")


def _opened(folder: Path, specs: Specs, index: IntArray, first_skipped: str) -> PreparedData:
    arrays = {name: open_memmap(_path(folder, name), "r")[: len(index)] for name in specs}
    return PreparedData(arrays, index, first_skipped)


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.npy"


def joint_masks(dataset: Dataset, views: Sequence[str]) -> Iterator[Masks | None]:
    """Yields the masks of each sample in all ``views``; None where one has no mask."""
    for masks in zip(*(dataset.masks(view) for view in views), strict=True):
        known = tuple(mask for mask in masks if mask is not None)
        yield known if len(known) == len(views) else None
