"""Equilibrium of the spatial rod under dead loads."""

import math
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, frozen
from ._spatial_compile import compiled
from ._spatial_newton import TOLERANCE, Outcome, copy_turns, relax
from ._spatial_parts import NO_TOUCH, Elastic, Load, Touch, Work, elastic_of, make_work
from ._spatial_rod import SpatialRod, frames_of

__all__ = ["SpatialShape", "bend_spatial"]

_STEP = 2.0
"""First step of the load, as |F| L^2 / EI."""
_JUMP = 0.7
"""Turn of an element between two loads that counts as a jump to another branch, rad."""
_ROUGH = 1e-4
"""Relative residual that is good enough on the way to the load."""


@dataclass(frozen=True, slots=True, eq=False)
class SpatialShape:
    """An equilibrium of ``rod``: ``quaternions`` (segments + 1, 4), see `SpatialRod.unloaded_quaternions`.

    ``residual``: largest moment out of balance, relative to EI / length of the shaft. ``converged``: False where
    Newton's method gave up; the shape is then not to be used. ``stable``: a strict minimum of the energy; under a tip
    moment, which has no energy in space, that of the symmetric part of the stiffness: enough for stability, but not
    necessary. ``unloaded_branch``: the load was raised from nothing without losing stability and without a jump.
    """

    rod: SpatialRod
    quaternions: FloatArray
    force_n: FloatArray
    moment_nm: FloatArray
    distributed_n_per_m: FloatArray
    residual: float
    converged: bool
    stable: bool
    unloaded_branch: bool
    iterations: int

    def __post_init__(self) -> None:
        value = frozen("quaternions", self.quaternions, (self.rod.segments + 1, 4))
        object.__setattr__(self, "quaternions", value)
        for name in ("force_n", "moment_nm", "distributed_n_per_m"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), (3,)))

    @property
    def frames(self) -> FloatArray:
        """(segments + 1, 3, 3): material frames of the segments and of the electrode, in columns, base frame."""
        return frames_of(self.quaternions)

    @property
    def tip_m(self) -> FloatArray:
        """(3,): the electrode's end, base frame."""
        return self.rod.nodes_m(self.quaternions)[-1]

    def centreline_m(self, points: int) -> FloatArray:
        """(points, 3), base to tip, uniform in arc length."""
        return self.rod.centreline_m(self.quaternions, points)


@compiled
def _raise_load(
    q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work, first_step: float, tolerance: float
) -> tuple[Outcome, bool]:
    """Raise the load from nothing; halve the step where it fails, turns unstable or jumps to another branch."""
    saved = np.empty_like(q)
    now = Load(np.zeros(3), np.zeros(3), np.zeros(3))
    turned = load.moment[0] != 0.0 or load.moment[1] != 0.0 or load.moment[2] != 0.0
    share, step, iterations, branch = 0.0, first_step, 0, True
    outcome = Outcome(0, True, True, 0.0)
    while share < 1.0:
        copy_turns(q, saved)
        target = min(1.0, share + step)
        for k in range(3):
            now.force[k], now.moment[k] = target * load.force[k], target * load.moment[k]
            now.line[k] = target * load.line[k]
        outcome = relax(q, rod, now, touch, work, tolerance if target == 1.0 else _ROUGH)
        iterations += outcome.iterations
        jump = 1.0
        for i in range(q.shape[0]):
            dot = 0.0
            for k in range(4):
                dot += q[i, k] * saved[i, k]
            jump = min(jump, abs(dot))
        good = bool(outcome.converged and (outcome.stable or turned) and jump > math.cos(0.5 * _JUMP))
        if good or step < 1e-3:
            share = target
            branch = branch and good
            step *= 1.5
        else:
            copy_turns(saved, q)
            step *= 0.5
    return Outcome(iterations, outcome.converged, outcome.stable, outcome.residual), branch


def bend_spatial(
    rod: SpatialRod,
    force_n: FloatArray,
    moment_nm: FloatArray | None = None,
    distributed_n_per_m: FloatArray | None = None,
    start: SpatialShape | None = None,
) -> SpatialShape:
    """Shape of ``rod`` under dead loads (3,), base frame: on the tip, on the electrode, and along the whole length.

    The moment keeps its direction in space. Above the buckling load there are several equilibria. Without ``start``
    this one is reached by raising the load from nothing, so it lies on the unloaded shape's branch wherever that
    branch lasts (``unloaded_branch`` tells); with ``start`` it is the one next to that shape.

    >>> shape = bend_spatial(SpatialRod(0.048, 4.3e-4), np.array([0.0, 0.06, 0.08]))
    >>> shape.stable, (shape.tip_m * 1e3).round(2)
    (True, array([47.13,  4.98,  6.65]))
    """
    zero = np.zeros(3)
    parts = [zero if part is None else part for part in (force_n, moment_nm, distributed_n_per_m)]
    names = ("force_n", "moment_nm", "distributed_n_per_m")
    load = Load(*(np.array(frozen(name, part, (3,))) for name, part in zip(names, parts, strict=True)))
    elastic = elastic_of(rod, rod.rigid_length_m)
    work = make_work(rod.segments + 1, 1)
    length, ei = rod.length_m, rod.bending_stiffness_nm2
    outcome, branch = None, False
    q = np.array(rod.unloaded_quaternions if start is None else start.quaternions)
    if start is not None:
        outcome = relax(q, elastic, load, NO_TOUCH, work, TOLERANCE)
        turn = np.abs(np.sum(q * start.quaternions, axis=1)).min()
        branch = start.unloaded_branch and outcome.stable and turn > math.cos(0.5 * _JUMP)
    if outcome is None or not outcome.converged:
        q = np.array(rod.unloaded_quaternions)
        whole = np.linalg.norm(load.force) + np.linalg.norm(load.line) * length
        size = (whole * length**2 + np.linalg.norm(load.moment) * length) / ei
        first = 1.0 / math.ceil(size / _STEP + 1e-9)
        outcome, branch = _raise_load(q, elastic, load, NO_TOUCH, work, first, TOLERANCE)
    return SpatialShape(
        rod, q, *load, outcome.residual, outcome.converged, outcome.stable, bool(branch), outcome.iterations
    )
