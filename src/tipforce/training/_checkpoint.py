"""Files of a training run: a checkpoint after every epoch, and a log of all epochs."""

import hashlib
import json
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._system.json_files import parse_json_lines, read_small_text
from ..errors import InputError
from ._config import TrainConfig
from ._data import TrainingSamples
from ._task import Task, Weights

CHECKPOINT_FILE = "checkpoint.pt"
LOG_FILE = "training.jsonl"

_MAY_CHANGE = {"minutes", "patience", "workers"}
"""Settings that may differ between a training and its resumption."""


def run_identity(
    task: Task, samples: TrainingSamples, config: TrainConfig, precision: str, init_from: Weights | None
) -> dict[str, str]:
    """Returns the properties that must be the same where training is resumed from a checkpoint, in readable form.

    Args:
        task: the network and its loss.
        samples: all samples.
        config: settings of the training; those that may change on resuming are left out.
        precision: precision of the arithmetic on the device, such as "fp32".
        init_from: initial weights; None: random ones.
    """
    may_change = _MAY_CHANGE if config.schedule == "cosine" else _MAY_CHANGE | {"epochs"}
    settings = {**config.model_dump(mode="json"), "precision": precision}
    return {
        "the network": task.name,
        "the settings": ", ".join(f"{name}={settings[name]}" for name in sorted(settings) if name not in may_change),
        "the data": samples.fingerprint(),
        "the initial weights": "random" if init_from is None else _sha256(init_from),
    }


def _sha256(weights: Weights) -> str:
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(name.encode() + np.ascontiguousarray(weights[name]).tobytes())
    return digest.hexdigest()


def write_checkpoint(folder: Path, state: Mapping[str, Any]) -> None:
    """Writes a checkpoint, completely or not at all.

    Args:
        folder: an existing folder; the file in it is `CHECKPOINT_FILE`.
        state: tensors, numbers and text by name.
    """
    import torch

    part = folder / f"{CHECKPOINT_FILE}.part"
    with part.open("wb") as stream:
        torch.save(dict(state), stream)
    part.replace(folder / CHECKPOINT_FILE)


def read_checkpoint(folder: Path, identity: Mapping[str, str]) -> dict[str, Any] | None:
    """Returns the state that `write_checkpoint` wrote, None where there is no checkpoint.

    Args:
        folder: the folder of the checkpoint.
        identity: `run_identity` of the training that is to be resumed.

    Raises:
        InputError: the checkpoint is damaged, or belongs to another training.
    """
    import torch

    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    try:
        # weights_only: a file from elsewhere must not run code
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        found: dict[str, str] = state["identity"]
    except (RuntimeError, EOFError, KeyError, OSError, pickle.UnpicklingError):
        raise InputError(f"{path}: is damaged; remove the folder {folder} and train anew without resume=True") from None
    for quantity, expected in identity.items():
        if found.get(quantity) != expected:
            difference = _difference(found.get(quantity, ""), expected)
            raise InputError(
                f"{path}: belongs to another training, {quantity} differ{difference}; "
                f"resume with the same options, or remove the folder {folder} and train anew without resume=True"
            )
    return state


def _difference(found: str, expected: str) -> str:
    """Returns the entries of two comma-separated lists that differ."""
    before, now = found.split(", "), expected.split(", ")
    if len(before) != len(now) or len(now) == 1:
        return "" if len(now) == 1 else f" ({found}; now {expected})"
    pairs = [f"{a}, now {b}" for a, b in zip(before, now, strict=True) if a != b]
    return f" ({'; '.join(pairs)})"


class TrainingLog:
    """One row of figures an epoch, in memory and in `LOG_FILE`.

    Args:
        folder: folder of the file; None: no file.
        epochs: number of epochs that are kept where training is resumed. Later lines, of an epoch that was not
            finished, are dropped.
    """

    def __init__(self, folder: Path | None, epochs: int = 0) -> None:
        self._path = None if folder is None else folder / LOG_FILE
        self.rows: list[dict[str, Any]] = []
        if self._path is None:
            return
        if epochs:
            remedy = f"remove the folder {folder} and train anew without resume=True"
            text = read_small_text(self._path, remedy=remedy) if self._path.is_file() else ""
            # the line of an epoch that was not finished may be cut off
            self.rows = parse_json_lines("\n".join(text.splitlines()[:epochs]), str(self._path), remedy)
        part = self._path.with_name(f"{LOG_FILE}.part")
        part.write_text("".join(f"{json.dumps(row)}\n" for row in self.rows), encoding="utf-8")
        part.replace(self._path)

    def add(self, row: dict[str, Any]) -> None:
        """Appends the row of one epoch."""
        self.rows.append(row)
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")


def progress_text(row: dict[str, Any], config: TrainConfig) -> str:
    """Returns the log row of an epoch as one line of text.

    Args:
        row: row of the log: errors in newtons, time since the start in seconds.
        config: settings of the training.

    >>> progress_text({"epoch": 2, "loss": 0.05, "validation_error_n": 0.041, "training_error_n": 0.05,
    ...     "images_per_s": 61.2, "waiting_share": 0.021, "seconds": 90.0}, TrainConfig(epochs=10))
    'epoch 2/10: loss 0.0500, error 41.0 mN (training 50.0), 61 images/s, waiting 2 %, at most 6 min left'
    """
    remaining_s = row["seconds"] / row["epoch"] * (config.epochs - row["epoch"])
    if config.minutes is not None:
        remaining_s = min(remaining_s, max(0.0, 60 * config.minutes - row["seconds"]))
    error_n = row["validation_error_n"]
    error = "not finite" if error_n is None else f"{error_n * 1e3:.1f} mN"
    training = f"{row['training_error_n'] * 1e3:.1f}"
    errors = f"error {error} (training {training})" if config.validation else f"training error {training} mN"
    return (
        f"epoch {row['epoch']}/{config.epochs}: loss {row['loss']:.4f}, {errors}, {row['images_per_s']:.0f} images/s, "
        f"waiting {100 * row['waiting_share']:.0f} %, at most {duration_text(remaining_s)} left"
    )


def duration_text(seconds: float) -> str:
    """Returns a duration in readable form.

    >>> [duration_text(s) for s in (12.4, 400.0, 8000.0)]
    ['12 s', '7 min', '2 h 13 min']
    """
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
