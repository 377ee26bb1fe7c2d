"""github.com/chendaxia777/Vision-force-estimation, ``All_2camera``: two views of a soft arm and three force components.

One folder for each set, which becomes a session, with two MATLAB 7.3 files. ``input_test.mat``: ``input_test``
(n, 3, 64, 64), 0..1, stored with rows and columns exchanged: the image of camera 1, the pressures of the chambers as
stripes, the image of camera 2. ``target_test.mat``: ``target_test`` (n, 3, 1, 1) in newtons. A stripe is one row of the
image and has one pressure; the eight values repeat from the top to the bottom, and the last two of them are empty.

Unknown: the unit of the pressures, which are given in percent of the stored range; the axes of the force sensor;
whether the samples of a set are consecutive frames, so stamps are counts.
"""

from pathlib import Path

import numpy as np

from ...errors import FileFormatError
from ...types import Catheter, FloatArray, SessionInfo, ViewInfo
from .._dataset import Dataset
from .._stores import ImageArrays
from ._matlab_arrays import read_array, upright_grey

INPUT, TARGET = "input_test.mat", "target_test.mat"
SIZE_PX = 64
CHAMBERS = 6
STRIPES = 8
"""Number of rows after which the stripes repeat: one for each chamber, and two empty ones."""
REMARKS = (
    "github.com/chendaxia777/Vision-force-estimation, commit 87f02557, All_2camera; the stamps are counted, and the "
    "unit of the chamber pressures is not documented: 100 percent is the largest value that the files can hold"
)


def recognises(folder: Path) -> bool:
    """Returns whether ``folder``, or a folder in it, holds both files."""
    return bool(_sets(folder))


def open_layout(folder: Path) -> Dataset:
    """Returns one session for each set; raises MissingExtraError without h5py, FileFormatError for other contents."""
    sets = [_read_set(path) for path in _sets(folder)]
    names = [path.resolve().name for path in _sets(folder)]
    counts = [len(force) for _, _, force in sets]
    stamps = np.concatenate([np.arange(count, dtype=np.int64) * 1_000_000_000 for count in counts])
    pressures = np.concatenate([pressure for _, pressure, _ in sets])
    actuation = {f"chamber{k + 1}_percent": np.ascontiguousarray(pressures[:, k]) for k in range(CHAMBERS)}
    views = {
        view: upright_grey(np.concatenate([images[:, channel] for images, _, _ in sets]))
        for view, channel in (("a", 0), ("b", 2))
    }
    arm, at_top = Catheter("soft continuum arm"), {view: ViewInfo(base_side="top") for view in views}
    return Dataset(
        store=ImageArrays(stamps, actuation, views),
        session=np.repeat(names, counts),
        stamp_ns=stamps,
        actuation=actuation,
        force_n=np.concatenate([force for _, _, force in sets]),
        known=np.ones(3, np.bool_),
        names=np.array([f"{name}, pair {k}" for name, count in zip(names, counts, strict=True) for k in range(count)]),
        session_info={
            name: SessionInfo(name, arm, views=at_top, force_frame="sensor", remarks=REMARKS) for name in names
        },
        rows=np.arange(len(stamps)),
        title="soft-arm-two-views (pairs of images of 64x64, three force components)",
    )


def _sets(folder: Path) -> list[Path]:
    """Returns the folders of the sets, in the order of their names."""
    images = [*folder.glob(INPUT), *folder.glob(f"*/{INPUT}")]
    return sorted(path.parent for path in images if (path.parent / TARGET).is_file())


def _read_set(folder: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the stored images (n, 3, 64, 64), the pressures (n, 6) in percent and the forces (n, 3) in newtons."""
    images = read_array(folder / INPUT, "input_test", (None, 3, SIZE_PX, SIZE_PX))
    forces = read_array(folder / TARGET, "target_test", (len(images), 3, 1, 1))
    if not len(images):
        raise FileFormatError(f"{folder / INPUT}: input_test holds no samples")
    stripes = images[:, 1, 0]  # (n, 64): the first column, a value for each row of the displayed image
    repeats = np.isclose(images[:, 1], np.tile(stripes[:, :STRIPES], SIZE_PX // STRIPES)[:, None], atol=1e-6)
    uneven = np.flatnonzero(~repeats.all(axis=(1, 2)))
    if len(uneven):
        raise FileFormatError(
            f"{folder / INPUT}: sample {uneven[0]}: expected the pressures of the chambers in channel 2, as stripes "
            f"that repeat after {STRIPES} rows; found another image"
        )
    return images, 100.0 * stripes[:, :CHAMBERS], np.ascontiguousarray(forces[:, :, 0, 0])
