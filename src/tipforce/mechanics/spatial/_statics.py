"""Equilibrium of the spatial rod under dead loads."""

from dataclasses import dataclass

import numpy as np

from ...types import FloatArray, frozen
from .._branch import Branch
from ._newton import TOLERANCE, raise_load, relax
from ._rod import SpatialRod, frames_of
from ._state import NO_TOUCH, Load, elastic_of, line_of, make_work


@dataclass(frozen=True, slots=True, eq=False)
class SpatialShape:
    """An equilibrium of a rod.

    Attributes:
        rod: the rod.
        quaternions: (segments + 1, 4) orientations, see `SpatialRod.unloaded_quaternions`.
        force_n: (3,) force at the tip.
        moment_nm: (3,) moment at the tip.
        distributed_n_per_m: distributed load; None: none.
        residual: largest unbalanced moment, relative to EI / length of the shaft.
        converged: False if Newton's method failed; the shape must then not be used.
        stable: whether it is a strict minimum of the energy; under a tip moment, which has no energy in space, that of
            the symmetric part of the stiffness: sufficient for stability, but not necessary.
        branch: see `Branch` and `on_unloaded_branch`.
        iterations: number of steps of Newton's method.
    """

    rod: SpatialRod
    quaternions: FloatArray
    force_n: FloatArray
    moment_nm: FloatArray
    distributed_n_per_m: FloatArray | None
    residual: float
    converged: bool
    stable: bool
    branch: Branch
    iterations: int

    def __post_init__(self) -> None:
        value = frozen("quaternions", self.quaternions, (self.rod.segments + 1, 4))
        object.__setattr__(self, "quaternions", value)

    @property
    def frames(self) -> FloatArray:
        """Material frames (segments + 1, 3, 3) of the segments and of the electrode, in columns, base frame."""
        return frames_of(self.quaternions)

    @property
    def tip_m(self) -> FloatArray:
        """Position (3,) of the electrode's end, base frame."""
        return self.rod.nodes_m(self.quaternions)[-1]

    def centreline_m(self, points: int | FloatArray) -> FloatArray:
        """Returns the centreline (points, 3), base to tip; ``points``: number of points, or arc lengths in m."""
        return self.rod.centreline_m(self.quaternions, points)

    def on_unloaded_branch(self) -> bool:
        """Returns whether the shape is reached by raising all loads together from 0, without a jump.

        This is known if the shape was reached in that way; for one that was reached from a start it is computed.
        """
        if self.branch is not Branch.GIVEN:
            return self.branch is Branch.UNLOADED
        cold = solve_static_spatial(self.rod, self.force_n, self.moment_nm, self.distributed_n_per_m)
        apart = 1.0 - np.abs(np.sum(cold.quaternions * self.quaternions, axis=1)).min()
        return cold.branch is Branch.UNLOADED and bool(apart < 1e-10)


def solve_static_spatial(
    rod: SpatialRod,
    force_n: FloatArray,
    moment_nm: FloatArray | None = None,
    distributed_n_per_m: FloatArray | None = None,
    start: SpatialShape | None = None,
) -> SpatialShape:
    """Solves the shape of ``rod`` under dead loads in the base frame.

    The moment keeps its direction in space. Above the buckling load there are several equilibria. Without ``start`` all
    loads are raised together from 0, so the result is on the unloaded shape's branch as far as that branch exists
    (see ``branch``); with ``start`` it is the equilibrium next to that shape.

    Args:
        rod: the rod.
        force_n: (3,) force on the tip.
        moment_nm: (3,) moment on the electrode.
        distributed_n_per_m: (3,) load along the whole length, or (segments + 1, 3) for each element.
        start: a shape with the same number of segments.

    Returns:
        The equilibrium.

    Raises:
        ValueError: a load has another shape or is not finite, or ``start`` has another number of segments.

    >>> shape = solve_static_spatial(SpatialRod(0.048, 4.3e-4), np.array([0.0, 0.06, 0.08]))
    >>> shape.stable, (shape.tip_m * 1e3).round(2)
    (True, array([47.13,  4.99,  6.65]))
    """
    zero = np.zeros(3)
    force = frozen("force_n", force_n, (3,))
    moment = frozen("moment_nm", zero if moment_nm is None else moment_nm, (3,))
    load = Load(np.array(force), np.array(moment), line_of(rod, distributed_n_per_m))
    if not (np.isfinite(force).all() and np.isfinite(moment).all()):
        raise ValueError(f"expected finite loads, got force_n {force}, moment_nm {moment}")
    if start is not None and start.rod.segments != rod.segments:
        raise ValueError(f"start: expected a shape of {rod.segments} segments, got {start.rod.segments}")
    elastic = elastic_of(rod, rod.rigid_length_m)
    work = make_work(rod.segments + 1, 0)
    outcome, branch = None, Branch.GIVEN
    q = np.array(rod.unloaded_quaternions if start is None else start.quaternions)
    if start is not None:
        outcome = relax(q, elastic, load, NO_TOUCH, work, TOLERANCE)
    if outcome is None or not outcome.converged:
        q = np.array(rod.unloaded_quaternions)
        outcome, value = raise_load(q, elastic, load, NO_TOUCH, work, TOLERANCE)
        branch = Branch(value)
    return SpatialShape(
        rod=rod,
        quaternions=q,
        force_n=force,
        moment_nm=moment,
        distributed_n_per_m=distributed_n_per_m,
        residual=outcome.residual,
        converged=outcome.converged,
        stable=outcome.stable,
        branch=branch,
        iterations=outcome.iterations,
    )
