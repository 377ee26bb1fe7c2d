"""Rigid links with torsion springs: multi-body."""

from dataclasses import dataclass, field

import numpy as np

from ...types import FloatArray
from .._rod import Rod
from ._chain import Chain
from ._face import Bent
from ._links import bend_links
from ._rest import mean_curvature, stiffness_at

__all__ = ["RigidLinks"]


@dataclass(frozen=True, slots=True, eq=False)
class RigidLinks:
    """Multi-body model (thesis 2.3.2.1): ``joints`` hinges with torsion springs between rigid links, in its rest state.

    The finite segment method (Huston): the shaft is cut into equal pieces of length h, and each piece's flexibility
    sits in one hinge at its middle, stiffness EI / h. The first half piece is clamped, the last one carries the
    electrode. Known failure: too stiff and angular with few joints; deflection under a small load is
    1 - 1 / (4 joints^2) of the true one.
    """

    rod: Rod
    joints: int = 10
    _chain: Chain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.joints < 1:
            raise ValueError(f"joints: expected at least 1, got {self.joints}")
        rod, n = self.rod, self.joints
        edges = np.linspace(0.0, rod.flexible_length_m, n + 1)
        h = rod.flexible_length_m / n
        links = np.append(np.full(n - 1, h), 0.5 * h + rod.rigid_length_m)
        chain = Chain(
            np.full(n, h),
            stiffness_at(rod, 0.5 * (edges[1:] + edges[:-1])),
            mean_curvature(rod, edges),
            rod.stiffening_curvature_per_m**-2,
            links,
            np.zeros(n),
            np.zeros(n),
        )
        object.__setattr__(self, "_chain", chain)

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> Bent:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z."""
        return bend_links(self.rod, self._chain, 0.5 * self._chain.span_m[0], force_n, moment_nm)
