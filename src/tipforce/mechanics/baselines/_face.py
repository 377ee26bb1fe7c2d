"""The one face of all rod models: a load in, a bent shape out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...types import FloatArray

__all__ = ["Bent", "BentShape", "RodModel"]


class BentShape(Protocol):
    """What a model says of the bent catheter, base frame."""

    @property
    def tip_m(self) -> FloatArray:
        """(2,): the electrode's end."""
        ...

    @property
    def converged(self) -> bool:
        """False: no equilibrium was found, and the numbers are not to be used."""
        ...

    def centreline_m(self, points: int) -> FloatArray:
        """(points, 2): base to tip, uniform in the arc length of the unloaded catheter."""
        ...


class RodModel(Protocol):
    """A model of the planar catheter, clamped at the base, loaded at its tip."""

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> BentShape:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z; smooth in both."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Bent:
    """A shape as places ``nodes_m`` (k, 2), straight in between, at ``arc_m`` (k,) along the unloaded catheter."""

    arc_m: FloatArray
    nodes_m: FloatArray
    converged: bool

    @property
    def tip_m(self) -> FloatArray:
        """(2,): the electrode's end, base frame."""
        return self.nodes_m[-1]

    def centreline_m(self, points: int) -> FloatArray:
        """(points, 2): base to tip, uniform in the arc length of the unloaded catheter."""
        wanted = np.linspace(0.0, self.arc_m[-1], points)
        line = np.empty((points, 2))
        for axis in range(2):
            line[:, axis] = np.interp(wanted, self.arc_m, self.nodes_m[:, axis])
        return line
