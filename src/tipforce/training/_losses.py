"""Losses that tasks share."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["component_rms"]

_SMALLEST = 1e-12
"""N^2: keeps the root's slope finite where an answer is exact."""


def component_rms(found: "Tensor", wanted: "Tensor") -> "Tensor":
    """(b,): thesis eq. (19) of each sample, the root of the mean over the components of the squared difference.

    ``found`` and ``wanted`` (b, t).
    """
    return ((found - wanted) ** 2).mean(dim=1).add(_SMALLEST).sqrt()
