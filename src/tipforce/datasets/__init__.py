"""Labelled samples, their sessions, and splits."""

from ._calibration_images import calibration_images
from ._dataset import Dataset, RowStore
from ._describe import dataset_at, describe_dataset, session_images
from ._folder import write_dataset
from ._growing import Growing, GrowingImages, GrowingShards, SessionSamples
from ._join import every_nth, join, random_subset, without_sessions
from ._open import is_published_layout, open_dataset
from ._perturb import PERTURBATIONS, Blur, Disc, ImageOperation, Light, Noise, Perturbation, Warp, in_memory, perturbed
from ._recordings import open_recordings
from ._source import DatasetSource, file_names, open_source
from ._splits import (
    LEAVE_ONE_OUT_SESSIONS,
    THESIS_SESSIONS,
    Protocol,
    Split,
    blocked_folds,
    blocked_split,
    catheter_splits,
    random_folds,
    random_split,
    session_folds,
    splits,
    standard_split,
    thesis_split,
)

__all__ = [
    "LEAVE_ONE_OUT_SESSIONS",
    "PERTURBATIONS",
    "THESIS_SESSIONS",
    "Blur",
    "Dataset",
    "DatasetSource",
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
    "calibration_images",
    "catheter_splits",
    "dataset_at",
    "describe_dataset",
    "every_nth",
    "file_names",
    "in_memory",
    "is_published_layout",
    "join",
    "open_dataset",
    "open_recordings",
    "open_source",
    "perturbed",
    "random_folds",
    "random_split",
    "random_subset",
    "session_folds",
    "session_images",
    "splits",
    "standard_split",
    "thesis_split",
    "without_sessions",
    "write_dataset",
]
