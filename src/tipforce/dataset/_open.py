"""One door for everything that holds labelled samples."""

from pathlib import Path

from ._dataset import Dataset

__all__ = ["open_dataset"]


def open_dataset(path: str | Path) -> Dataset:
    """The samples in ``path``: a dataset folder, recordings, or a published layout."""
    raise NotImplementedError(path)
