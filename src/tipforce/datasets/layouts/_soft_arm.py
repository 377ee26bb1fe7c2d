"""github.com/chendaxia777/Vision-force-estimation: images of a soft arm and three force components (ICRA 2024).

``images.mat``: ``input_test`` (n, 1, 64, 64), 0..1, stored with rows and columns exchanged; ``forces.mat``:
``target_test`` (n, 3, 1, 1) in newtons. MATLAB 7.3 files. The rows are not the frames of one video: stamps are counts.
"""

from pathlib import Path

import numpy as np

from ...types import Catheter, SessionInfo
from .._dataset import Dataset
from .._stores import ImageArrays
from ._matlab_arrays import read_array, upright_grey

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
    images = read_array(folder / "images.mat", "input_test", (None, 1, 64, 64))
    forces = read_array(folder / "forces.mat", "target_test", (len(images), 3, 1, 1))
    count = len(images)
    stamps = np.arange(count, dtype=np.int64) * 1_000_000_000
    return Dataset(
        store=ImageArrays(stamps, {}, {"camera": upright_grey(images[:, 0])}),
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
