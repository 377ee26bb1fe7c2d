"""A clamp that is advanced by a known way: the catheter is looked at as a camera on the clamp would see it.

Nothing else of the geometry changes: what was stated, learnt and calibrated for the clamp at rest goes on to hold.
"""

import math

from ..types import ADVANCE, Observation, Status
from ..vision import INWARD, image_from_clamp
from ._reading import Abstention

__all__ = ["INWARD", "image_from_clamp", "read_advance_m"]


def read_advance_m(observation: Observation) -> float | Abstention:
    """How far the clamp has been advanced along the base x axis from where the metadata have it; 0: nobody says so."""
    advance_m = 1e-3 * observation.actuation.get(ADVANCE, 0.0)
    if math.isfinite(advance_m):
        return advance_m
    return Abstention(Status.MISSING_INPUT, f"{ADVANCE} is not known at this image, so where the base lies is not")
