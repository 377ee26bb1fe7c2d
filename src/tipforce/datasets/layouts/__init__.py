"""Published data sets in the layout their authors gave them: one file a layout."""

from collections.abc import Callable
from pathlib import Path

from .._dataset import Dataset
from . import _soft_arm, _tendon_manipulator

__all__ = ["LAYOUTS"]

LAYOUTS: dict[str, tuple[Callable[[Path], bool], Callable[[Path], Dataset]]] = {
    "tendon-manipulator": (_tendon_manipulator.recognises, _tendon_manipulator.open_layout),
    "soft-arm": (_soft_arm.recognises, _soft_arm.open_layout),
}
"""Name -> (does a folder look like it, how to open it)."""
