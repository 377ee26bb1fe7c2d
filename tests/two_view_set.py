"""Writes a set of image pairs as the public two-view set of the soft arm is stored."""

from pathlib import Path

import numpy as np
import pytest


def write_two_view_set(folder: Path, samples: int = 3) -> dict[str, np.ndarray]:
    """Writes a set as the source does; returns the arrays of its files."""
    h5py = pytest.importorskip("h5py")
    folder.mkdir(parents=True)
    images = np.zeros((samples, 3, 64, 64))
    images[:, 0, 2, 60] = 1.0  # column 2, row 60 as MATLAB stores it
    images[:, 2, 30, 10] = 0.5
    pressures = np.linspace(0.1, 0.6, 6) + 0.01 * np.arange(samples)[:, None]
    images[:, 1] = np.tile(np.pad(pressures, ((0, 0), (0, 2))), 8)[:, None]
    arrays = {"input_test": images, "target_test": np.arange(3.0 * samples).reshape(samples, 3, 1, 1)}
    for name, values in arrays.items():
        with h5py.File(folder / f"{name}.mat", "w") as file:
            file[name] = values
    return arrays
