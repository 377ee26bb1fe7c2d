"""Where a training stands, in one file that is whole or not there."""

import hashlib
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ._recipe import TrainConfig
from ._samples import Samples
from ._task import Task
from ._weights import Weights

__all__ = ["CHECKPOINT", "identity_of", "read_checkpoint", "write_checkpoint"]

CHECKPOINT = "checkpoint.pt"

FREE = {"minutes", "patience", "workers"}
"""Settings that may change between a training and what goes on from it."""


def identity_of(
    task: Task, samples: Samples, recipe: TrainConfig, precision: str, start: Weights | None
) -> dict[str, str]:
    """What must be the same for a checkpoint to be gone on from, in words that a person may read."""
    free = FREE if recipe.schedule == "cosine" else FREE | {"epochs"}
    settings = {**recipe.model_dump(mode="json"), "precision": precision}
    return {
        "the network": task.name,
        "the settings": ", ".join(f"{name}={settings[name]}" for name in sorted(settings) if name not in free),
        "the data": samples.fingerprint(),
        "the weights it began with": "none" if start is None else _sha256_of(start),
    }


def _sha256_of(weights: Weights) -> str:
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(name.encode() + np.ascontiguousarray(weights[name]).tobytes())
    return digest.hexdigest()


def write_checkpoint(folder: Path, state: Mapping[str, Any]) -> None:
    """Write ``state`` (tensors, numbers, text) beside `CHECKPOINT` in ``folder`` and rename it."""
    import torch

    part = folder / f"{CHECKPOINT}.part"
    with part.open("wb") as stream:
        torch.save(dict(state), stream)
    part.replace(folder / CHECKPOINT)


def read_checkpoint(folder: Path, identity: Mapping[str, str]) -> dict[str, Any] | None:
    """What `write_checkpoint` wrote, None where there is nothing.

    Raises InputError where it is damaged, or belongs to another training than ``identity``.
    """
    import torch

    path = folder / CHECKPOINT
    if not path.is_file():
        return None
    try:
        # weights_only: a file from elsewhere must not run code
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        found: dict[str, str] = state["identity"]
    except (RuntimeError, EOFError, KeyError, OSError, pickle.UnpicklingError):
        raise InputError(f"{path}: is damaged; remove the folder {folder} and train anew without --resume") from None
    for what, wanted in identity.items():
        if found.get(what) != wanted:
            raise InputError(
                f"{path}: is of another training, {what} differ{_detail(found.get(what, ''), wanted)}; go on with what "
                f"was stated then, or remove the folder {folder} and train anew without --resume"
            )
    return state


def _detail(found: str, wanted: str) -> str:
    """The parts of two lists that differ, where they are lists."""
    before, now = found.split(", "), wanted.split(", ")
    if len(before) != len(now) or len(now) == 1:
        return "" if len(now) == 1 else f" ({found}; now {wanted})"
    pairs = [f"{a}, now {b}" for a, b in zip(before, now, strict=True) if a != b]
    return f" ({'; '.join(pairs)})"
