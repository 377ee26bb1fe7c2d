"""The result of detection in one image."""

import math
from dataclasses import dataclass

from ..types import BasePose, CentrelinePx, FloatArray, Status

__all__ = ["DetectedShape"]


@dataclass(frozen=True, slots=True, eq=False)
class DetectedShape:
    """The catheter's shape in one image, or the reason why it was not found.

    ``centreline`` and ``base`` are None unless ``status`` is valid; ``diameter_px`` is then the shaft's median
    diameter. ``confidence`` in 0..1: share of the shaft's length where both flanks were detected. ``fitted_px`` (k, 2):
    the image points that a polynomial is fitted to where these are not the centreline: the single-pixel line of thesis
    algorithm 1, one point a column.
    """

    status: Status
    detail: str = ""
    centreline: CentrelinePx | None = None
    base: BasePose | None = None
    diameter_px: float = math.nan
    confidence: float = 0.0
    fitted_px: FloatArray | None = None

    @property
    def found(self) -> bool:
        """True where there is a centreline."""
        return self.status is Status.VALID
