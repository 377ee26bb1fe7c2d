"""Writing the folder layout: images and ``metadata.csv``."""

from pathlib import Path

from ._dataset import Dataset

__all__ = ["write_dataset"]


def write_dataset(dataset: Dataset, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write ``dataset`` as images, ``metadata.csv`` and ``dataset.json``; returns the folder."""
    raise NotImplementedError(folder, dataset, overwrite)
