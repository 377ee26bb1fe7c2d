"""Equilibrium under a dead load at the tip."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..types import FloatArray, frozen
from ._newton import NO_LOAD, NO_SPRINGS, Elastic, Load, Outcome, elastic_of, relax
from ._rod import Rod

__all__ = ["Shape", "bend"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """An equilibrium of ``rod``: ``angles_rad`` (segments + 1,), see `Rod.unloaded_angles_rad`.

    ``energy_j``: bending energy less the work of the load. ``stable``: a strict minimum of the energy.
    ``converged``: False where Newton's method gave up; the shape is then not to be used.
    """

    rod: Rod
    angles_rad: FloatArray
    energy_j: float
    converged: bool
    stable: bool
    iterations: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "angles_rad", frozen("angles_rad", self.angles_rad, (self.rod.segments + 1,)))

    @property
    def tip_m(self) -> FloatArray:
        """(2,): the electrode's end, base frame."""
        return self.rod.nodes_m(self.angles_rad)[-1]

    @property
    def tip_angle_rad(self) -> float:
        """Direction of the electrode's axis, counter-clockwise from x."""
        return float(self.angles_rad[-1])


@njit(cache=True, error_model="numpy")
def _continue_load(theta: FloatArray, rod: Elastic, load: Load, first_step: float) -> Outcome:
    """Raise the load from nothing; halve the step where it fails, turns unstable or jumps to another branch."""
    saved = theta.copy()
    outcome = relax(theta, rod, NO_LOAD, NO_SPRINGS)
    share, step = 0.0, first_step
    iterations = outcome.iterations
    while share < 1.0:
        saved[:] = theta
        target = min(1.0, share + step)
        outcome = relax(theta, rod, Load(target * load.fx, target * load.fy, target * load.m), NO_SPRINGS)
        iterations += outcome.iterations
        jump = np.max(np.abs(theta - saved))
        if (outcome.converged and outcome.stable and jump < 0.7) or step < 1e-3:
            share = target
        else:
            theta[:] = saved
            step *= 0.5
    return Outcome(iterations, outcome.converged, outcome.stable, outcome.energy, outcome.depth, outcome.slide)


def bend(rod: Rod, force_n: FloatArray, moment_nm: float = 0.0, start: Shape | None = None) -> Shape:
    """Shape of ``rod`` under ``force_n`` (2,) on its tip, base frame, and ``moment_nm`` about z.

    Above the buckling load there are several equilibria. Without ``start`` this one is reached by raising the load
    from nothing, so it lies on the unloaded shape's branch; with ``start`` it is the one next to that shape.

    >>> shape = bend(Rod(0.048, 4.3e-4), np.array([0.0, 0.1]))
    >>> shape.stable, (shape.tip_m * 1e3).round(2)
    (True, array([47.13,  8.31]))
    """
    fx, fy = (float(part) for part in force_n)
    elastic = elastic_of(rod, rod.rigid_length_m)
    load = Load(fx, fy, float(moment_nm))
    theta = np.array(rod.unloaded_angles_rad if start is None else start.angles_rad)
    outcome = relax(theta, elastic, load, NO_SPRINGS) if start is not None else None
    if outcome is None or not outcome.converged:
        size = (np.hypot(fx, fy) * rod.length_m**2 + abs(moment_nm) * rod.length_m) / rod.bending_stiffness_nm2
        theta = np.array(rod.unloaded_angles_rad)
        outcome = _continue_load(theta, elastic, load, 1.0 / np.ceil(size + 1e-9))
    return Shape(rod, theta, outcome.energy, outcome.converged, outcome.stable, outcome.iterations)
