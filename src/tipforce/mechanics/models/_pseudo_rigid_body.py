"""Howell's pseudo-rigid-body model with one hinge."""

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from ...types import FloatArray
from ..planar import PlanarRod
from ._interface import PolylineShape, RodModel, first_share, mean_stiffness, nodes_at

_GAMMA = 0.8517
"""Characteristic radius over length, transverse load (Howell, Compliant Mechanisms, 2001, 5.1)."""
_K_THETA = 2.67617
"""Stiffness coefficient for that gamma."""
_C_THETA = 1.2385
"""Ratio of the turn of the beam's end to that of the hinge, transverse load."""


@dataclass(frozen=True, slots=True, eq=False)
class PseudoRigidBody(RodModel):
    """1R: the shaft as a rigid link with one hinge at (1 - gamma) of its length and a spring K = gamma K_theta EI / L.

    gamma = 0.8517 and K_theta = 2.67617 are those for a transverse end force, for every direction of the load: the
    axial part acts through the geometry alone. Pre-curvature is that of Howell's initially curved beams: the hinge
    stays on the base tangent, the link leads from there to the unloaded end of the shaft. The electrode turns 1.2385
    times the hinge's angle and acts as a lever; the equilibrium is the least energy of spring and load, moments
    included.

    Good for the tip alone, whose deflection is within 1 % of the elastica's for alpha = 2 to 10 on a straight
    shaft; the links are no centreline. Known failures: small loads (-4.5 %), axial loads, and moments, which
    would need other constants (2/3 of the true angle).
    """

    rod: PlanarRod
    _numbers: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Computes hinge, link, electrode and spring of the unloaded rod."""
        rod = self.rod
        nodes, angles = nodes_at(rod, np.linspace(0.0, rod.flexible_length_m, rod.segments + 1))
        hinge = (1 - _GAMMA) * rod.flexible_length_m
        link = nodes[-1] - [hinge, 0.0]
        spring = _GAMMA * _K_THETA * mean_stiffness(rod) / rod.flexible_length_m
        numbers = [hinge, np.hypot(*link), math.atan2(link[1], link[0]), angles[-1], rod.rigid_length_m, spring]
        object.__setattr__(self, "_numbers", np.array(numbers))

    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        """Places the clamp, the hinge, the end of the shaft and the tip."""
        hinge, radius, rest, end, lever, _ = self._numbers
        turn, converged = _turn(self._numbers, fx, fy, moment_nm, first_share(self.rod, fx, fy, moment_nm))
        nodes = np.zeros((4, 2))
        nodes[1, 0] = hinge
        nodes[2] = hinge + radius * math.cos(rest + turn), radius * math.sin(rest + turn)
        axis = end + _C_THETA * turn
        nodes[3] = nodes[2] + [lever * math.cos(axis), lever * math.sin(axis)]
        shaft = self.rod.flexible_length_m
        return PolylineShape(np.array([0.0, hinge, shaft, shaft + lever]), nodes, bool(converged))


@njit(cache=True, error_model="numpy")
def _turn(numbers: FloatArray, fx: float, fy: float, moment: float, first_share: float) -> tuple[float, bool]:
    """Returns the angle of the hinge in rad and whether it converged, by Newton's method while the load is raised.

    ``numbers`` (6,): of `PseudoRigidBody`; ``fx``, ``fy`` in N and ``moment`` in N m act on the tip; ``first_share``:
    share of the load in the first step. Raising the load in steps keeps the angle on the unloaded branch.
    """
    radius, rest_rad, end_rad, lever, spring = numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]
    turn = share = 0.0
    step, converged = first_share, True
    while share < 1.0:
        target = min(1.0, share + step)
        trial, converged, is_last = turn, False, False
        for _ in range(50):
            if is_last:
                converged = True
                break
            c, s = math.cos(rest_rad + trial), math.sin(rest_rad + trial)
            ca, sa = math.cos(end_rad + _C_THETA * trial), math.sin(end_rad + _C_THETA * trial)
            gradient = spring * trial - target * radius * (fy * c - fx * s)
            gradient -= target * _C_THETA * (lever * (fy * ca - fx * sa) + moment)
            slope = spring + target * radius * (fx * c + fy * s) + target * _C_THETA**2 * lever * (fx * ca + fy * sa)
            change = -gradient / max(slope, 0.1 * spring)  # a positive slope: the step goes downhill in the energy
            trial += max(-0.4, min(0.4, change))  # rad: the iteration stays on its branch
            is_last = abs(change) < 1e-9
        if (converged and abs(trial - turn) < 0.7) or step < 1e-3:  # a larger turn, in rad, is a jump
            share, turn = target, trial
        else:
            step *= 0.5
    return turn, converged
