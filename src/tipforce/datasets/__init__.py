"""Labelled samples, sessions and splits."""

from ._dataset import Dataset, RowStore
from ._describe import dataset_at, describe_dataset, session_images
from ._folder import write_dataset
from ._growing_images import GrowingImages
from ._growing_shards import GrowingShards
from ._image_operations import Blur, Disc, ImageOperation, Light, Noise, Warp
from ._join import join
from ._open import open_dataset
from ._perturb import PERTURBATIONS, Perturbation, in_memory, perturbed
from ._protocols import THESIS_SESSIONS, Protocol, catheter_splits, splits, standard_split, thesis_split
from ._recordings import open_recordings
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
from ._subsets import every_nth, random_subset, without_sessions

__all__ = [
    "LEAVE_ONE_OUT_SESSIONS",
    "PERTURBATIONS",
    "THESIS_SESSIONS",
    "Blur",
    "Dataset",
    "Disc",
    "Growing",
    "GrowingImages",
    "GrowingShards",
    "ImageOperation",
    "Light",
    "Noise",
    "Perturbation",
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
    "every_nth",
    "in_memory",
    "join",
    "open_dataset",
    "open_recordings",
    "perturbed",
    "random_folds",
    "random_split",
    "random_subset",
    "session_folds",
    "session_images",
    "session_split",
    "splits",
    "standard_split",
    "thesis_split",
    "without_sessions",
    "write_dataset",
]
