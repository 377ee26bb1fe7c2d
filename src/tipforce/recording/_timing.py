"""The offset between the force log's clock and the camera's."""

from collections.abc import Sequence

from ..types import FloatArray, IntArray
from ..vision import Sighting
from ._facts import ClockOffset

__all__ = ["estimate_offset", "shape_coordinates"]


def shape_coordinates(sightings: Sequence[Sighting]) -> FloatArray:
    """(n, 3): Legendre coefficients 1..3 of the tangent angle; NaN where nothing was found."""
    raise NotImplementedError


def estimate_offset(
    frame_ns: IntArray, coordinates: FloatArray, force_ns: IntArray, force_n: FloatArray, *, window_s: float = 0.3
) -> ClockOffset:
    """The offset at which the deflection explains the force best."""
    raise NotImplementedError
