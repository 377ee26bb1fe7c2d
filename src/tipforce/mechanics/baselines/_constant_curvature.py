"""Arcs of constant curvature."""

from dataclasses import dataclass, field

import numpy as np

from ...types import FloatArray
from .._rod import Rod
from ._chain import Chain, settle
from ._face import Bent
from ._links import first_share
from ._rest import mean_curvature, stiffness_at

__all__ = ["ConstantCurvature"]

_SHOWN = 48
"""Places of the centreline along the shaft, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class ConstantCurvature:
    """The shaft as ``arcs`` equal arcs, each of one curvature, with the least energy: exact bending energy and load.

    One arc is the kinematics that catheter robots are steered by. More arcs are the strain parametrisation of a
    Cosserat rod and tend to it, the differential-geometry model of Back et al. (thesis table 2), here in the plane
    and without stretch and shear. Known failure of one arc: a force cannot bend the base more than the tip, so the
    deflection under a small force is 1 - 1 / (4 arcs^2) = 3/4 of the true one. Exact for a pure moment.
    """

    rod: Rod
    arcs: int = 1
    _chain: Chain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.arcs < 1:
            raise ValueError(f"arcs: expected at least 1, got {self.arcs}")
        rod, n = self.rod, self.arcs
        edges = np.linspace(0.0, rod.flexible_length_m, n + 1)
        links = np.zeros(n)
        links[-1] = rod.rigid_length_m
        chain = Chain(
            np.diff(edges),
            stiffness_at(rod, 0.5 * (edges[1:] + edges[:-1])),
            mean_curvature(rod, edges),
            rod.stiffening_curvature_per_m**-2,
            links,
            np.zeros(n),
            np.diff(edges),
        )
        object.__setattr__(self, "_chain", chain)

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> Bent:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z."""
        rod, n, chain = self.rod, self.arcs, self._chain
        fx, fy = float(force_n[0]), float(force_n[1])
        ends = np.empty(n)
        converged = settle(chain, fx, fy, float(moment_nm), first_share(rod, fx, fy, moment_nm), ends)
        # Chord after chord of equal pieces of the arcs: exact places on them.
        per_arc = -(-_SHOWN // n)
        turn = np.diff(ends, prepend=0.0) / per_arc
        starts = np.append(0.0, ends[:-1])
        middles = (starts[:, None] + turn[:, None] * (np.arange(per_arc) + 0.5)).ravel()
        chords = np.repeat(chain.arc_m / per_arc * np.sinc(0.5 * turn / np.pi), per_arc)
        angles = np.append(middles, ends[-1])
        lengths = np.append(chords, rod.rigid_length_m)
        nodes = np.zeros((angles.size + 1, 2))
        np.cumsum(lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1), axis=0, out=nodes[1:])
        arc = np.append(np.linspace(0.0, rod.flexible_length_m, n * per_arc + 1), rod.length_m)
        return Bent(arc, nodes, bool(converged))
