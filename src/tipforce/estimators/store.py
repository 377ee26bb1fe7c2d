"""The model store: a folder with ``model.json``, ``arrays.npz`` and a model card."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..dataset import Dataset
from ._base import Estimator

__all__ = ["load_model", "read_manifest", "save_model"]


def save_model(
    estimator: Estimator,
    folder: str | Path,
    training: Dataset,
    metrics: Mapping[str, Any] | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Write the fitted ``estimator`` as a model folder, whole or not at all."""
    raise NotImplementedError(estimator, folder, training, metrics, overwrite)


def load_model(folder: str | Path) -> Estimator:
    """The estimator in ``folder``; raises ModelError for a missing, altered or newer model."""
    raise NotImplementedError(folder)


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """What ``model.json`` says; raises ModelError for a missing, unreadable or newer one."""
    raise NotImplementedError(folder)
