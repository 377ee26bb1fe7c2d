"""Describes a dataset in lines and figures, and yields its images session by session."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..types import FloatArray, Image, SessionInfo
from ..units import newtons_to_grams
from ._calibration_images import calibration_images
from ._dataset import Dataset
from ._folder import METADATA
from ._open import holds_samples, open_dataset


def dataset_at(path: Path) -> Dataset | None:
    """Returns the dataset at ``path``; None if there are only the frames of one session.

    A dataset is: shards, a table, a published layout, several recordings, or a dataset folder of several sessions.
    """
    several = path.is_dir() and len(list(path.glob("*.mcap"))) > 1
    if not (several or holds_samples(path)):
        return None
    dataset = open_dataset(path)
    one_folder = path.is_dir() and (path / METADATA).is_file() and len(dataset.sessions) == 1
    return None if one_folder else dataset


def describe_dataset(dataset: Dataset) -> tuple[list[str], dict[str, Any]]:
    """Returns lines for people (samples, sessions, actuation, forces), and the same as JSON values."""
    counts = [int((dataset.session == name).sum()) for name in dataset.sessions]
    per_session = f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"
    lines = [f"{dataset.title}: {len(dataset)} samples of {len(counts)} sessions, {per_session} each"]
    ranges = {name: _spread(values) for name, values in dataset.actuation.items() if np.isfinite(values).any()}
    forces = {"magnitude_n": dataset.magnitude_n}
    forces |= {f"f{'xyz'[axis]}_n": dataset.force_n[:, axis] for axis in np.flatnonzero(dataset.known).tolist()}
    spreads = {name: _spread(values) for name, values in forces.items()}
    lines += [f"{name:<13} {low:g} to {high:g}, median {middle:g}" for name, (low, middle, high) in ranges.items()]
    for name, (low, middle, high) in spreads.items():
        grams = f"{newtons_to_grams(low):.1f} to {newtons_to_grams(high):.1f} g"
        lines.append(f"{name:<13} {low:.3f} to {high:.3f} N, median {middle:.3f} ({grams})")
    figures = {
        "title": dataset.title,
        "samples": len(dataset),
        "sessions": len(counts),
        "actuation": {name: dict(zip(_NAMES, values, strict=True)) for name, values in ranges.items()},
        "forces": {name: dict(zip(_NAMES, values, strict=True)) for name, values in spreads.items()},
    }
    return lines, figures


_NAMES = ("min", "median", "max")


def _spread(values: FloatArray) -> tuple[float, float, float]:
    low, middle, high = np.nanquantile(values, [0.0, 0.5, 1.0]).tolist()
    return low, middle, high


def session_images(
    dataset: Dataset, view: str, every: int = 1
) -> Iterator[tuple[SessionInfo, tuple[Image, ...], list[tuple[str, Image]]]]:
    """Yields each session: its metadata, its `calibration_images`, and name and image of every ``every``-th sample.

    Args:
        dataset: the dataset.
        view: view of the images.
        every: step between the samples.
    """
    for name in dataset.sessions:
        part = dataset.subset(np.flatnonzero(dataset.session == name)[::every])
        shown: list[tuple[str, Image]] = []
        for image_name, observation in zip(part.names_of(view).tolist(), part.observations(), strict=True):
            if isinstance(image := observation.views.get(view), np.ndarray):
                shown.append((image_name, image))
        yield dataset.session_info[name], calibration_images(dataset, name, view), shown
