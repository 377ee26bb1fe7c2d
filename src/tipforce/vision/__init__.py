"""Seeing the catheter: frame -> mask -> ordered centreline -> base frame -> coefficients."""

from ._settings import BaseSide, Polarity, VisionSettings
from ._sighting import Sighting

__all__ = ["BaseSide", "Polarity", "Sighting", "VisionSettings"]
