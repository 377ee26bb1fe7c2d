"""Labelled samples, sessions and splits."""

from ._dataset import Dataset, RowStore
from ._describe import dataset_at, describe_dataset, pictures
from ._disturb import DISTURBANCES, Disturbance, disturbed, held
from ._draw import draw, leave_out, thin
from ._growing_images import GrowingImages
from ._growing_shards import GrowingShards
from ._join import join
from ._open import open_dataset
from ._picture_operations import Blur, Disc, Light, Noise, PictureOperation, Warp
from ._protocols import THESIS_SESSIONS, Protocol, catheter_splits, splits, standard_split, thesis_split
from ._recordings import open_recordings
from ._replacing import replacing_folder
from ._samples import Growing, SessionSamples
from ._splits import (
    LEAVE_ONE_OUT_SESSIONS,
    Split,
    blocked_folds,
    blocked_split,
    random_folds,
    random_split,
    session_folds,
    session_split,
)
from ._write import write_dataset

__all__ = [
    "DISTURBANCES",
    "LEAVE_ONE_OUT_SESSIONS",
    "THESIS_SESSIONS",
    "Blur",
    "Dataset",
    "Disc",
    "Disturbance",
    "Growing",
    "GrowingImages",
    "GrowingShards",
    "Light",
    "Noise",
    "PictureOperation",
    "Protocol",
    "RowStore",
    "SessionSamples",
    "Split",
    "Warp",
    "blocked_folds",
    "blocked_split",
    "catheter_splits",
    "dataset_at",
    "describe_dataset",
    "disturbed",
    "draw",
    "held",
    "join",
    "leave_out",
    "open_dataset",
    "open_recordings",
    "pictures",
    "random_folds",
    "random_split",
    "replacing_folder",
    "session_folds",
    "session_split",
    "splits",
    "standard_split",
    "thesis_split",
    "thin",
    "write_dataset",
]
