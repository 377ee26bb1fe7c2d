"""Forces by the rod's mechanics: one frame, and all frames so far."""

from ._detection import Detected, Detection
from ._facts import RodFacts
from ._knowledge import MODES, Knowledge, LineError, rod_model, stated_stds
from ._lines import POINTS, LineFrame
from ._settings import NoiseSettings, PriorSettings, RodSettings, RodTrackSettings
from .rod import Rod
from .rod_track import RodTrack

__all__ = [
    "MODES",
    "POINTS",
    "Detected",
    "Detection",
    "Knowledge",
    "LineError",
    "LineFrame",
    "NoiseSettings",
    "PriorSettings",
    "Rod",
    "RodFacts",
    "RodSettings",
    "RodTrack",
    "RodTrackSettings",
    "rod_model",
    "stated_stds",
]
