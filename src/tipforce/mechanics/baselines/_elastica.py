"""The elastica behind the common face."""

from dataclasses import dataclass

import numpy as np

from ...types import FloatArray
from .._free import bend
from .._rod import Rod
from ._face import Bent

__all__ = ["Elastica"]


@dataclass(frozen=True, slots=True)
class Elastica:
    """The reference that the others are measured by: `bend` of ``rod``, Kirchhoff's planar rod without stretch."""

    rod: Rod

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> Bent:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z."""
        shape = bend(self.rod, force_n, moment_nm)
        arc = np.append(np.linspace(0.0, self.rod.flexible_length_m, self.rod.segments + 1), self.rod.length_m)
        return Bent(arc, self.rod.nodes_m(shape.angles_rad), shape.converged)
