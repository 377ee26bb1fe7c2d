"""github.com/chendaxia777/Vision-force-estimation: images of a soft arm and three force components (ICRA 2024).

``images.mat``: ``input_test`` (n, 1, 64, 64), 0..1, stored with rows and columns exchanged; ``forces.mat``:
``target_test`` (n, 3, 1, 1) in newtons. MATLAB 7.3 files. The rows are not the frames of one video: stamps are counts.
"""

from pathlib import Path

import numpy as np

from ..._system.extras import import_extra
from ...errors import FileFormatError
from ...types import Catheter, FloatArray, SessionInfo
from .._dataset import Dataset
from .._stores import ImageArray

SESSION = "soft-arm"
REMARKS = (
    "github.com/chendaxia777/Vision-force-estimation, commit 87f02557, All_1camera/no_pressure; the stamps are "
    "counted, for the images are no consecutive frames"
)


def recognises(folder: Path) -> bool:
    """Returns whether both files exist."""
    return (folder / "images.mat").is_file() and (folder / "forces.mat").is_file()


def open_layout(folder: Path) -> Dataset:
    """Returns all images as one session; raises MissingExtraError without h5py, FileFormatError for other contents."""
    images = _read(folder / "images.mat", "input_test", (None, 1, 64, 64))
    forces = _read(folder / "forces.mat", "target_test", (len(images), 3, 1, 1))
    count = len(images)
    grey = np.rint(np.clip(images[:, 0].transpose(0, 2, 1), 0.0, 1.0) * 255.0).astype(np.uint8)
    stamps = np.arange(count, dtype=np.int64) * 1_000_000_000
    return Dataset(
        store=ImageArray(stamps, {}, np.ascontiguousarray(grey)),
        session=np.full(count, SESSION),
        stamp_ns=stamps,
        actuation={},
        force_n=np.ascontiguousarray(forces[:, :, 0, 0]),
        known=np.ones(3, np.bool_),
        names=np.array([f"image {k}" for k in range(count)]),
        session_info={
            SESSION: SessionInfo(SESSION, Catheter("soft continuum arm"), force_frame="sensor", remarks=REMARKS)
        },
        rows=np.arange(count),
        title="soft-arm (images of 64x64, three force components)",
    )


def _read(path: Path, key: str, shape: tuple[int | None, ...]) -> FloatArray:
    h5py = import_extra("h5py", "real-data")
    try:
        with h5py.File(path, "r") as file:
            values = np.asarray(file[key], dtype=np.float64)
    except (OSError, KeyError) as error:
        raise FileFormatError(f"{path}: expected a MATLAB 7.3 file with {key!r} ({error})") from None
    if values.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, values.shape, strict=True)):
        raise FileFormatError(f"{path}: {key} has the shape {values.shape}, expected {shape}")
    return values
