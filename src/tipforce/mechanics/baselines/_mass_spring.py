"""Particles and springs: particle-based."""

from dataclasses import dataclass, field

import numpy as np

from ...types import FloatArray
from .._rod import Rod
from ._chain import Chain
from ._face import Bent
from ._links import bend_links
from ._rest import CATHETER_7F_M, mean_curvature, stiffness_at

__all__ = ["MassSpring"]


@dataclass(frozen=True, slots=True, eq=False)
class MassSpring:
    """Particles on a string (thesis 2.3.2.2) in the state in which their motion has died out.

    ``pieces`` + 1 particles along the shaft with stretch springs between neighbours and bending springs at each; the
    masses do not matter at rest. Stretch stiffness EA = 16 EI / d^2, that of a solid round section of ``diameter_m``.
    For given directions the lengths follow from the load, so only directions are solved for. Known failure: the
    length is not kept, and what the springs should be is a matter of taste ("not physically reliable").
    """

    rod: Rod
    pieces: int = 20
    diameter_m: float = CATHETER_7F_M
    _chain: Chain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.pieces < 1 or not self.diameter_m > 0:
            raise ValueError(f"a mass-spring chain needs a piece and a positive diameter, got {self}")
        rod, n = self.rod, self.pieces
        h = rod.flexible_length_m / n
        middles = np.concatenate([[0.0], (np.arange(n) + 0.5) * h, [rod.flexible_length_m]])
        particles = np.linspace(0.0, rod.flexible_length_m, n + 1)
        stretch = 16 * stiffness_at(rod, middles[1:-1]) / self.diameter_m**2
        chain = Chain(
            np.diff(middles),
            stiffness_at(rod, particles),
            mean_curvature(rod, middles),
            rod.stiffening_curvature_per_m**-2,
            np.append(np.full(n, h), rod.rigid_length_m),
            np.append(h / stretch, 0.0),
            np.zeros(n + 1),
        )
        object.__setattr__(self, "_chain", chain)

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> Bent:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z."""
        return bend_links(self.rod, self._chain, 0.0, force_n, moment_nm)
