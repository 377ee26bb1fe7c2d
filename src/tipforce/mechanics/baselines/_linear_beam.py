"""Linear finite elements, as Gao et al. took them (thesis 2.3.2.3)."""

from dataclasses import dataclass, field

import numpy as np

from ...types import FloatArray, frozen
from .._rod import Rod
from ._face import Bent
from ._rest import CATHETER_7F_M, mean_curvature, nodes_at, stiffness_at

__all__ = ["LinearBeam"]


@dataclass(frozen=True, slots=True, eq=False)
class LinearBeam:
    """Bernoulli-Euler frame elements, linear about the unloaded shape; stiffness = slope of the moment there.

    ``elements`` straight two-node elements with cubic deflection and a stretch stiffness EA = 16 EI / d^2, that of a
    solid round section of ``diameter_m``. Exact for small loads on a straight shaft. Known failures: a tip that is
    bent by 90 degrees grows longer instead of turning back (deflection alpha / 3: +35 % at alpha = 2), and an
    axial force on a straight shaft never bends it.
    """

    rod: Rod
    elements: int = 20
    diameter_m: float = CATHETER_7F_M
    _rest: Bent = field(init=False, repr=False)
    _compliance: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.elements < 1 or not self.diameter_m > 0:
            raise ValueError(f"a linear beam needs an element and a positive diameter, got {self}")
        rod, n = self.rod, self.elements
        edges = np.linspace(0.0, rod.flexible_length_m, n + 1)
        nodes, angles = nodes_at(rod, edges)
        lever = rod.rigid_length_m * np.array([np.cos(angles[-1]), np.sin(angles[-1])])
        stiffer = 1 + (mean_curvature(rod, edges) / rod.stiffening_curvature_per_m) ** 2
        bending = stiffness_at(rod, 0.5 * (edges[1:] + edges[:-1])) * stiffer
        whole = np.zeros((3 * n + 3, 3 * n + 3))
        for i in range(n):
            whole[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += _element(
                nodes[i + 1] - nodes[i], bending[i], self.diameter_m
            )
        # Loads at the tip: unit fx, fy and moment, carried to the last node by the rigid electrode.
        loads = np.zeros((3 * n, 3))
        loads[-3:] = [[1, 0, 0], [0, 1, 0], [-lever[1], lever[0], 1]]
        moved = np.linalg.solve(whole[3:, 3:], loads).reshape(n, 3, 3)
        turned = np.array([[-lever[1]], [lever[0]]]) * moved[-1, 2]
        compliance = np.concatenate([np.zeros((1, 2, 3)), moved[:, :2], (moved[-1, :2] + turned)[None]])
        rest = Bent(np.append(edges, rod.length_m), np.vstack([nodes, nodes[-1] + lever]), True)
        object.__setattr__(self, "_rest", rest)
        object.__setattr__(self, "_compliance", frozen("compliance", compliance, (n + 2, 2, 3)))

    def bend(self, force_n: FloatArray, moment_nm: float = 0.0) -> Bent:
        """Shape under ``force_n`` (2,) on the tip, base frame, and ``moment_nm`` about z; linear in both."""
        load = np.array([force_n[0], force_n[1], moment_nm])
        return Bent(self._rest.arc_m, self._rest.nodes_m + self._compliance @ load, True)


def _element(chord: FloatArray, ei: float, diameter_m: float) -> FloatArray:
    """(6, 6) stiffness of a frame element along ``chord`` (2,) for x, y and angle of either end."""
    length = float(np.hypot(*chord))
    c, s = chord / length
    ea = 16 * ei / diameter_m**2
    axial, shear, couple = ea / length, 12 * ei / length**3, 6 * ei / length**2
    local = np.zeros((6, 6))
    local[np.ix_([0, 3], [0, 3])] = [[axial, -axial], [-axial, axial]]
    local[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = [
        [shear, couple, -shear, couple],
        [couple, 4 * ei / length, -couple, 2 * ei / length],
        [-shear, -couple, shear, -couple],
        [couple, 2 * ei / length, -couple, 4 * ei / length],
    ]
    turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return turn.T @ local @ turn
