"""Forces by the rod's mechanics: one frame, and all frames so far."""

from ._settings import NoiseSettings, PriorSettings, RodSettings
from .rod import Rod

__all__ = ["NoiseSettings", "PriorSettings", "Rod", "RodSettings"]
