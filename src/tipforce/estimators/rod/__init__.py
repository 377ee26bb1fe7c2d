"""Forces by the rod's mechanics: one frame, and all frames so far."""

from ._settings import NoiseSettings, PriorSettings, RodSettings, RodTrackSettings
from .rod import Rod
from .rod_track import RodTrack

__all__ = ["NoiseSettings", "PriorSettings", "Rod", "RodSettings", "RodTrack", "RodTrackSettings"]
