"""The elastica behind the common face."""

from dataclasses import dataclass

from ...types import FloatArray
from .._free import Shape, bend
from .._rod import Rod

__all__ = ["Elastica"]


@dataclass(frozen=True, slots=True)
class Elastica:
    """The reference that the others are measured by: `bend` of ``rod``, Kirchhoff's planar rod without stretch."""

    rod: Rod

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> Shape:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z."""
        return bend(self.rod, force_n, moment_nm)
