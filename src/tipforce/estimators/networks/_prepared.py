"""What a network is trained on, made once of a dataset and streamed from disk after that."""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.format import open_memmap

from ...datasets import Dataset
from ...errors import InputError
from ...types import Image, IntArray, Observation
from .._reading import Refusal

__all__ = ["PREPARED", "Form", "Forms", "Prepared", "Read", "prepare"]

Form = tuple[tuple[int, ...], str]
"""Shape of one sample and dtype, "uint8" or "float32"."""

Forms = Mapping[str, Form]

Read = Callable[[str, Observation, Image | None], "Mapping[str, npt.NDArray[Any]] | Refusal"]
"""Called with the session's name, an observation of it, and where the catheter is in its picture, if that is known."""

PREPARED = "prepared.json"
"""Tells what was prepared; it is written last."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """``arrays``: name -> (m, ...), read-only memory maps; ``kept`` (m,): their samples' places in the dataset.

    ``why_not``: the first sample that was left out, and why; empty where none was.
    """

    arrays: dict[str, npt.NDArray[Any]]
    kept: IntArray
    why_not: str


def prepare(
    dataset: Dataset,
    masks: Iterable[Image | None],
    forms: Forms,
    read: Read,
    folder: Path,
    key: str,
    names: npt.NDArray[np.str_],
    report: Callable[[float], None],
) -> Prepared:
    """``read`` of every sample of ``dataset`` in its order, kept in ``folder`` as one .npy file for each of ``forms``.

    One picture is in memory at a time. What ``folder`` already holds under the same ``key`` and of the same samples is
    not made again. ``names`` (n,): what a person calls each sample. Raises InputError where the disk has no room.
    """
    key = hashlib.sha256(
        "\n".join([key, repr(sorted(forms.items())), dataset.fingerprint(), dataset.title, *names.tolist()]).encode()
    ).hexdigest()
    note = folder / PREPARED
    if note.is_file() and (told := json.loads(note.read_text(encoding="utf-8")))["key"] == key:
        return _opened(folder, forms, np.array(told["kept"], np.int64), told["why_not"])
    note.unlink(missing_ok=True)
    count = len(dataset)
    needed = count * sum(int(np.prod(shape)) * np.dtype(kind).itemsize for shape, kind in forms.values())
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise InputError(
            f"{folder}: preparing the pictures of {dataset.title} needs {needed / 1e9:.1f} GB, {free / 1e9:.1f} GB are "
            "free; make room, or train on fewer samples with --samples"
        )
    files = {
        name: open_memmap(_path(folder, name), "w+", kind, (count, *shape)) for name, (shape, kind) in forms.items()
    }
    kept: list[int] = []
    why_not = ""
    for place, (observation, mask) in enumerate(zip(dataset.observations(), masks, strict=True)):
        found = read(dataset.session[place], observation, mask)
        if isinstance(found, Refusal):
            why_not = why_not or f"{names[place]}: {found.detail} ({found.status})"
        else:
            for name, file in files.items():
                file[len(kept)] = found[name]
            kept.append(place)
        report((place + 1) / count)
    for file in files.values():
        file.flush()
    del files
    part = folder / f"{PREPARED}.part"
    part.write_text(json.dumps({"key": key, "kept": kept, "why_not": why_not}), encoding="utf-8")
    part.replace(note)
    return _opened(folder, forms, np.array(kept, np.int64), why_not)


def _opened(folder: Path, forms: Forms, kept: IntArray, why_not: str) -> Prepared:
    arrays = {name: open_memmap(_path(folder, name), "r")[: len(kept)] for name in forms}
    return Prepared(arrays, kept, why_not)


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.npy"
