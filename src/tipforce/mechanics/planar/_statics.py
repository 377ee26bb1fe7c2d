"""Equilibrium under dead loads: at the tip, and spread along the rod."""

from dataclasses import dataclass, replace

import numpy as np

from ...types import BoolArray, FloatArray, IntArray, frozen
from .._branch import Branch
from ._batch import MANY, ONE, make_results, solve_batch
from ._newton import elastic_of
from ._rod import Rod


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """An equilibrium of ``rod``: ``angles_rad`` (segments + 1,), see `Rod.unloaded_angles_rad`.

    The load it is under: ``force_n`` (2,), ``moment_nm``, ``distributed_n_per_m`` as given to `solve_static`.
    ``energy_j``: bending energy less the work of the load. ``residual``: largest unbalanced moment on a segment,
    relative to EI / length of the shaft. ``converged``: ``residual`` is at most 1e-11; if not, the shape is not to be
    used. ``stable``: a strict minimum of the energy. ``branch``: see `Branch` and `on_unloaded_branch`.
    """

    rod: Rod
    angles_rad: FloatArray
    force_n: FloatArray
    moment_nm: float
    distributed_n_per_m: FloatArray | None
    energy_j: float
    residual: float
    converged: bool
    stable: bool
    branch: Branch
    iterations: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "angles_rad", frozen("angles_rad", self.angles_rad, (self.rod.segments + 1,)))
        object.__setattr__(self, "force_n", frozen("force_n", self.force_n, (2,)))

    @property
    def tip_m(self) -> FloatArray:
        """(2,): the electrode's end, base frame."""
        return self.rod.nodes_m(self.angles_rad)[-1]

    @property
    def tip_angle_rad(self) -> float:
        """Direction of the electrode's axis, counter-clockwise from x."""
        return float(self.angles_rad[-1])

    @property
    def moments_nm(self) -> FloatArray:
        """(segments + 1,): bending moments at the joints; the first is what the clamp holds."""
        return self.rod.moments_nm(self.angles_rad)

    def centreline_m(self, points: int | FloatArray) -> FloatArray:
        """(points, 2): base to tip; ``points``: how many, uniform in arc length, or their arc lengths in m."""
        return self.rod.centreline_m(self.angles_rad, points)

    def on_unloaded_branch(self) -> bool:
        """Whether raising all loads together from nothing leads here, without a jump.

        Known where the shape was reached that way; for one that was reached from a start it is tried out.
        """
        if self.branch is not Branch.GIVEN:
            return self.branch is Branch.UNLOADED
        cold = solve_static(self.rod, self.force_n, self.moment_nm, self.distributed_n_per_m)
        return cold.branch is Branch.UNLOADED and bool(np.abs(cold.angles_rad - self.angles_rad).max() < 1e-6)


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """m equilibria from one call: the rows of what a `Shape` holds; ``branch`` (m,) holds values of `Branch`.

    ``precurvature_per_m`` (m,): each row's own, or None where the rod's holds for all.
    """

    rod: Rod
    angles_rad: FloatArray
    force_n: FloatArray
    moment_nm: FloatArray
    distributed_n_per_m: FloatArray | None
    precurvature_per_m: FloatArray | None
    energy_j: FloatArray
    residual: FloatArray
    converged: BoolArray
    stable: BoolArray
    branch: IntArray
    iterations: IntArray

    def __len__(self) -> int:
        return len(self.angles_rad)

    @property
    def tip_m(self) -> FloatArray:
        """(m, 2): the electrode's end, base frame."""
        return self.centreline_m(np.array([self.rod.length_m]))[:, 0]

    def centreline_m(self, points: int | FloatArray) -> FloatArray:
        """(m, points, 2): base to tip; ``points``: how many, uniform in arc length, or their arc lengths in m."""
        return self.rod.centreline_m(self.angles_rad, points)

    def __getitem__(self, row: int) -> Shape:
        """The shape in ``row``, with the rod that has its pre-curvature."""
        curved = self.precurvature_per_m
        return Shape(
            self.rod if curved is None else replace(self.rod, precurvature_per_m=float(curved[row])),
            self.angles_rad[row],
            self.force_n[row],
            float(self.moment_nm[row]),
            self.distributed_n_per_m,
            float(self.energy_j[row]),
            float(self.residual[row]),
            bool(self.converged[row]),
            bool(self.stable[row]),
            Branch(int(self.branch[row])),
            int(self.iterations[row]),
        )


def carried_n(rod: Rod, distributed_n_per_m: FloatArray | None) -> FloatArray:
    """(segments + 1, 2): the part of a distributed load that the middle of each element carries.

    Raises ValueError where the load is neither (2,) nor (segments + 1, 2).
    """
    whole = (rod.segments + 1, 2)
    if distributed_n_per_m is None:
        return np.zeros(whole)
    if np.shape(distributed_n_per_m) not in ((2,), whole) or not np.isfinite(distributed_n_per_m).all():
        raise ValueError(f"distributed_n_per_m: expected finite numbers (2,) or {whole}, got {distributed_n_per_m}")
    weight = np.broadcast_to(distributed_n_per_m, whole) * rod.element_lengths_m[:, None]
    return np.cumsum(weight[::-1], axis=0)[::-1] - 0.5 * weight


def solve_static_batch(
    rod: Rod,
    force_n: FloatArray,
    moment_nm: FloatArray | float = 0.0,
    distributed_n_per_m: FloatArray | None = None,
    precurvature_per_m: FloatArray | None = None,
    start: Shapes | FloatArray | None = None,
) -> Shapes:
    """Shapes of ``rod`` under m loads in one compiled call: ``force_n`` (m, 2), ``moment_nm`` (m,) or one for all.

    ``precurvature_per_m`` (m,): a constant one for each row, in place of the rod's. ``start``: shapes of the same m
    rows, or their angles (m, segments + 1). All else as in `solve_static`.

    Raises ValueError where rows do not fit together.

    >>> shapes = solve_static_batch(Rod(0.048, 4.3e-4), np.array([[0.0, 0.1], [-0.1, 0.1]]))
    >>> (shapes.tip_m * 1e3).round(2)
    array([[47.13,  8.31],
           [46.63, 10.35]])
    """
    force = np.ascontiguousarray(force_n, np.float64)
    if force.ndim != 2 or force.shape[1] != 2 or not np.isfinite(force).all():
        raise ValueError(f"force_n: expected finite numbers (m, 2), got {force.shape}: {force}")
    rows, n = len(force), rod.segments + 1
    if np.shape(moment_nm) not in ((), (rows,)) or not np.isfinite(moment_nm).all():
        raise ValueError(f"moment_nm: expected one finite number or ({rows},), got {moment_nm}")
    moment = np.full(rows, moment_nm, dtype=np.float64)
    curved = None if precurvature_per_m is None else frozen("precurvature_per_m", precurvature_per_m, (rows,))
    if curved is not None and rows:  # an impossible one is refused by the rod
        replace(rod, precurvature_per_m=float(curved[np.abs(curved).argmax()]))
    k0 = rod.precurvatures_per_m[None] if curved is None else np.repeat(curved[:, None], n, axis=1)
    if start is None:
        angles = np.empty((rows, n))
    else:
        angles = np.array(start.angles_rad if isinstance(start, Shapes) else start, dtype=np.float64)
        if angles.shape != (rows, n):
            raise ValueError(f"start: expected angles ({rows}, {n}), got {angles.shape}")
    results = make_results(rows)
    elastic, carried = elastic_of(rod, rod.rigid_length_m), carried_n(rod, distributed_n_per_m)
    solve_batch(angles, start is not None, elastic, k0, force, moment, carried, results, ONE if rows == 1 else MANY)
    return Shapes(
        rod=rod,
        angles_rad=angles,
        force_n=force,
        moment_nm=moment,
        distributed_n_per_m=distributed_n_per_m,
        precurvature_per_m=curved,
        energy_j=results.energy,
        residual=results.residual,
        converged=results.converged > 0,
        stable=results.stable > 0,
        branch=results.branch,
        iterations=results.iterations,
    )


def solve_static(
    rod: Rod,
    force_n: FloatArray,
    moment_nm: float = 0.0,
    distributed_n_per_m: FloatArray | None = None,
    start: Shape | FloatArray | None = None,
) -> Shape:
    """Shape of ``rod`` under ``force_n`` (2,) on its tip, base frame, and ``moment_nm`` about z.

    ``distributed_n_per_m``: a dead load along shaft and electrode, base frame, such as weight or a stream's drag: (2,)
    the same everywhere, or (segments + 1, 2) for each segment and the electrode.

    Above the buckling load there are several equilibria. Without ``start`` this one is reached by raising all loads
    together from nothing; `Branch` tells whether that went without a jump. With ``start``, a shape or its angles, it
    is the one next to that.

    >>> shape = solve_static(Rod(0.048, 4.3e-4), np.array([0.0, 0.1]))
    >>> shape.stable, shape.branch.name, (shape.tip_m * 1e3).round(2)
    (True, 'UNLOADED', array([47.13,  8.31]))
    """
    near = start.angles_rad if isinstance(start, Shape) else start
    return solve_static_batch(
        rod,
        np.asarray(force_n, dtype=np.float64)[None],
        moment_nm,
        distributed_n_per_m,
        start=None if near is None else near[None],
    )[0]
