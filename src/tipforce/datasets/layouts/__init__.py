"""Published data sets in their original layout: one module for each, and the layouts of other packages."""

from pathlib import Path
from typing import Protocol

from ..._system.registry import Registry
from .._dataset import Dataset

__all__ = ["LAYOUTS", "Layout"]


class Layout(Protocol):
    """The layout of a published data set: a module with two functions, or an object with two methods."""

    def recognises(self, folder: Path) -> bool:
        """Returns whether ``folder`` has this layout, by the names of its files: it must be fast."""
        ...

    def open_layout(self, folder: Path) -> Dataset:
        """Returns the labelled samples of ``folder``."""
        ...


LAYOUTS: Registry[Layout] = Registry(
    "tipforce.layouts",
    "layout",
    {
        "tendon-manipulator": "tipforce.datasets.layouts._tendon_manipulator",
        "soft-arm": "tipforce.datasets.layouts._soft_arm",
        "soft-arm-two-views": "tipforce.datasets.layouts._soft_arm_two_views",
    },
)
"""Name -> the layout."""
