"""Method 1 of the thesis: support vector regression from the shape of the centreline and the knob."""

from ._settings import SvrSettings
from ._svr import Svr

__all__ = ["Svr", "SvrSettings"]
