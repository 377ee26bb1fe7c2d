"""The force in space from one view or two, by the mechanics of the rod in space."""

from ._settings import SpacePriors, SpaceSettings
from .space import Rod3d

__all__ = ["Rod3d", "SpacePriors", "SpaceSettings"]
