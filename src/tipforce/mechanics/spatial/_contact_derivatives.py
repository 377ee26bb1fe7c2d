"""Derivatives of the centreline of a catheter in contact with all uncertain parameters, at each instant."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...types import BoolArray, FloatArray, IntArray, frozen
from .._arc import arc_m
from ._compile import compiled
from ._energy import add_pull, assemble
from ._newton import TOLERANCE, relax, solve_factorised
from ._rod import SpatialRod
from ._state import NO_TOUCH, Elastic, Load, Work, elastic_of, line_of, make_work
from ._time_stepping import creep_on

_COLUMNS = {
    "force": slice(0, 3),
    "moment": slice(3, 6),
    "precurvature": slice(6, 8),
    "length": slice(8, 9),
    "creep": slice(9, 10),
}


@dataclass(frozen=True, slots=True, eq=False)
class ContactDerivatives:
    """First derivatives of a centreline at m instants; base frame.

    "force": m/N, 3 columns, force at the point of contact. "moment": m/(N m) on the electrode, 3. "precurvature": m per
    1/m about y and z of the material frame, the same all along. "length": m/m of the flexible shaft, at constant
    curvature and stiffness. "creep": m per unit of the relative change of the crept strain. "stiffness": m per unit of
    relative change of EI and GJ, one for each pattern.

    Attributes:
        centreline_m: (m, points, 3) centrelines.
        slopes: (m, points, 3, columns) derivatives.
        columns: columns of each parameter, by name.
        stable: (m,) whether an equilibrium was found that is a minimum; otherwise the row has no meaning.
    """

    centreline_m: FloatArray
    slopes: FloatArray
    columns: dict[str, slice]
    stable: BoolArray

    def __getitem__(self, name: str) -> FloatArray:
        """Returns the columns (m, points, 3, c) of the parameter ``name``."""
        return self.slopes[..., self.columns[name]]


def contact_derivatives(
    rod: SpatialRod,
    lines_m: FloatArray,
    force_n: FloatArray,
    touch_m: FloatArray,
    points: int | FloatArray,
    *,
    tip_radius_m: float = 0.0,
    precurvature_change_per_m: FloatArray | None = None,
    stiffness_patterns: FloatArray | None = None,
    time_s: FloatArray | None = None,
    creep: float = 0.0,
    creep_time_s: float = 1.0,
) -> ContactDerivatives:
    """Solves equilibria of ``rod`` under known forces, and the derivatives of their centrelines by implicit functions.

    Args:
        rod: the rod.
        lines_m: (m, p, 3) approximate centrelines, uniform in arc length: they select one of several equilibria.
        force_n: (m, 3) force of the wall on the electrode's dome.
        touch_m: (m, 3) point at which it acts.
        points: number of points along the centreline, evenly spaced, or their arc lengths.
        tip_radius_m: radius of the dome.
        precurvature_change_per_m: (m, 3), see `SpatialContactSolver.run`.
        stiffness_patterns: (patterns, segments + 1) relative change of the stiffness in each joint; None: one pattern,
            the same all along.
        time_s: (m,) instants; with creep each strain lasts until the next instant.
        creep: relative stiffness of the creeping spring, see `SpatialContactSolver`.
        creep_time_s: its time constant.

    Returns:
        Centrelines and derivatives.

    Raises:
        ValueError: an array has another shape, or creep is given without ``time_s``.

    >>> rod = SpatialRod(0.05, 4.3e-4, segments=100)
    >>> line = np.linspace(0, 1, 11)[None, :, None] * [0.05, 0.0, 0.0]
    >>> found = contact_derivatives(rod, line, np.zeros((1, 3)), line[:, -1], np.array([0.05]))
    >>> (found["force"][0, 0, 1, 1] / (0.05**3 / (3 * 4.3e-4))).round(3)  # the linear beam's L^3 / 3EI
    np.float64(1.0)
    """
    lines = frozen("lines_m", lines_m, (None, None, 3))
    m, k = len(lines), rod.segments + 1
    force, touch = np.array(frozen("force_n", force_n, (m, 3))), frozen("touch_m", touch_m, (m, 3))
    change = np.zeros((m, 3)) if precurvature_change_per_m is None else precurvature_change_per_m
    patterns = np.ones((1, k)) if stiffness_patterns is None else stiffness_patterns
    patterns = np.array(frozen("stiffness_patterns", patterns, (None, k)))
    if creep > 0 and time_s is None:
        raise ValueError("creep needs the instants time_s")
    times = np.arange(m, dtype=np.float64) if time_s is None else frozen("time_s", time_s, (m,))
    axis = lines[:, -1] - lines[:, -2]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    # Without contact the point has no meaning: the arm is 0.
    in_contact = np.any(force != 0.0, axis=1)
    arm = np.where(in_contact[:, None], touch - (lines[:, -1] - tip_radius_m * axis), 0.0)
    rows = Rows(
        q=orientations_along(rod, lines),
        change=np.array(frozen("precurvature_change_per_m", change, (m, 3))),
        force=force,
        moment=np.cross(arm, force),
        arm=arm,
        relaxing=np.expm1(np.diff(times, append=times[-1:]) / creep_time_s),
    )
    elastic = elastic_of(rod, rod.rigid_length_m - tip_radius_m)._replace(maxwell=creep)
    arc = arc_m(rod.element_lengths_m, points)
    begins = np.cumsum(rod.element_lengths_m) - rod.element_lengths_m
    order = np.argsort(arc, kind="stable")
    element = np.clip(np.searchsorted(begins, arc[order], side="right") - 1, 0, k - 1)
    places = Places(element, arc[order] - begins[element], rod.element_lengths_m, rod.flexible_length_m)
    columns = {**_COLUMNS, "stiffness": slice(10, 10 + len(patterns))}
    count = columns["stiffness"].stop
    spare = Spare(
        rod=elastic._replace(**{name: np.zeros_like(getattr(elastic, name)) for name in _ARRAYS}),
        unit=Load(np.zeros(3), np.zeros(3), line_of(rod, None)),
        here=np.zeros(3 * k),
        sides=np.zeros((count, 3 * k)),
        moves=np.zeros((count, 3)),
    )
    line, slopes, good = np.empty((m, arc.size, 3)), np.empty((m, arc.size, 3, count)), np.empty(m)
    slope_rows(
        rows, elastic, Load(np.zeros(3), np.zeros(3), line_of(rod, None)), np.array(rod.precurvature_per_m), patterns,
        places, spare, make_work(k, 0), line, slopes, good,
    )  # fmt: skip
    back = np.argsort(order, kind="stable")
    return ContactDerivatives(line[:, back], slopes[:, back], columns, good > 0)


_ARRAYS = ("span", "ei", "gj", "rest", "reach", "memory")


def orientations_along(rod: SpatialRod, lines_m: FloatArray) -> FloatArray:
    """Returns the orientations of the elements along centrelines.

    Each frame is the one before, turned by the smallest rotation, so there is no twist except that of the curve.

    Args:
        rod: the rod.
        lines_m: (m, p, 3) centrelines, uniform in arc length.

    Returns:
        (m, segments + 1, 4) quaternions (w, x, y, z).
    """
    lengths = rod.element_lengths_m
    positions = np.concatenate([[0.0], np.cumsum(lengths)]) / rod.length_m * (lines_m.shape[1] - 1)
    low = np.minimum(positions.astype(np.int64), lines_m.shape[1] - 2)
    share = (positions - low)[:, None]
    nodes = lines_m[:, low] * (1 - share) + lines_m[:, low + 1] * share
    tangents = np.diff(nodes, axis=1)
    if rod.rigid_length_m == 0.0:
        tangents[:, -1] = tangents[:, -2]  # an electrode of no length has the direction of the shaft's end
    tangents /= np.linalg.norm(tangents, axis=2, keepdims=True)
    q = np.empty((len(lines_m), rod.segments + 1, 4))
    now, before = np.tile([1.0, 0.0, 0.0, 0.0], (len(lines_m), 1)), np.tile([1.0, 0.0, 0.0], (len(lines_m), 1))
    for i in range(rod.segments + 1):
        tangent = tangents[:, i]
        turn = np.column_stack([1.0 + np.sum(before * tangent, axis=1), np.cross(before, tangent)])
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        w, v = turn[:, :1], turn[:, 1:]
        scalar = w * now[:, :1] - np.sum(v * now[:, 1:], axis=1, keepdims=True)
        now = np.hstack([scalar, w * now[:, 1:] + now[:, :1] * v + np.cross(v, now[:, 1:])])
        before = tangent
        q[:, i] = now
    return q


_FORCE, _MOMENT, _REST, _LENGTH, _CREEP, _PATTERNS = 0, 3, 6, 8, 9, 10
"""First columns of: force (3), moment (3), rest strain about y and z (2), length, creep, stiffness patterns."""
_LENGTH_STEP_SHARE = 1e-5
"""Step of the central difference, as a share of the length."""


class Rows(NamedTuple):
    """Equilibria at m instants.

    Attributes:
        q: (m, k, 4) orientations at the start.
        change: (m, 3) change of the pre-curvature.
        force: (m, 3) force at the lever's end.
        moment: (m, 3) moment on the electrode.
        arm: (m, 3) vector from the lever's end to the point of the force: the derivative of the moment by the force.
        relaxing: (m,) time until the next instant over the creep's time constant, see `creep_on`.
    """

    q: FloatArray
    change: FloatArray
    force: FloatArray
    moment: FloatArray
    arm: FloatArray
    relaxing: FloatArray


class Places(NamedTuple):
    """Points of the centreline.

    Attributes:
        element: (n,) element of each point.
        beyond: (n,) distance along this element.
        lengths: (k,) lengths of the elements.
        flexible: length of the shaft, which ends with the last but one.
    """

    element: IntArray
    beyond: FloatArray
    lengths: FloatArray
    flexible: float


class Spare(NamedTuple):
    """Buffers: a second rod for differences, a unit load, right-hand sides (C, 3k), and the nodes' derivatives."""

    rod: Elastic
    unit: Load
    here: FloatArray
    sides: FloatArray
    moves: FloatArray


@compiled
def _differ(q: FloatArray, other: Elastic, load: Load, here: FloatArray, work: Work, side: FloatArray) -> None:
    """Computes ``side`` = the gradient in ``here`` minus that of ``other``."""
    assemble(q, other, load, NO_TOUCH, work)
    for r in range(here.shape[0]):
        side[r] = here[r] - work.gradient[r]


@compiled
def _keep(q: FloatArray, rod: Elastic, load: Load, work: Work, here: FloatArray) -> None:
    """Computes the energy's gradient into ``here`` (3k,)."""
    assemble(q, rod, load, NO_TOUCH, work)
    for r in range(here.shape[0]):
        here[r] = work.gradient[r]


@compiled
def _fill_sides(
    q: FloatArray, rod: Elastic, load: Load, arm: FloatArray, patterns: FloatArray, flexible: float, spare: Spare,
    work: Work,
) -> None:  # fmt: skip
    """Computes ``spare.sides`` (C, 3k): minus the derivative of the energy's gradient with respect to each parameter.

    The parameters are the force (3) and moment (3), the flexible length, two components of the rest strain, the creep
    and the stiffness patterns.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod.
        load: dead loads.
        arm: (3,) vector in m from the lever's end to the point of the force.
        patterns: (patterns, k) relative change of the stiffness in each joint.
        flexible: flexible length in m.
        spare: buffers; its second rod is overwritten.
        work: buffers of the solver.
    """
    k, sides, here, trial = q.shape[0], spare.sides, spare.here, spare.rod
    force, moment = spare.unit.force, spare.unit.moment
    for r in range(3 * k):
        for c in range(_REST):
            sides[c, r] = 0.0
    for axis in range(3):
        next_axis, last_axis = (axis + 1) % 3, (axis + 2) % 3
        force[axis], moment[next_axis], moment[last_axis] = 1.0, arm[last_axis], -arm[next_axis]  # arm x the unit force
        add_pull(q, rod, spare.unit, sides[_FORCE + axis])
        force[axis], moment[next_axis], moment[last_axis], moment[axis] = 0.0, 0.0, 0.0, 1.0
        add_pull(q, rod, spare.unit, sides[_MOMENT + axis])
        moment[axis] = 0.0

    # The gradient is not linear in the length: a central difference, with the gradient of the shorter rod in ``here``.
    for sign in range(2):
        length_ratio = 1.0 + (2 * sign - 1) * _LENGTH_STEP_SHARE
        for i in range(k):
            trial.span[i] = rod.span[i] * length_ratio
            trial.reach[i] = rod.reach[i] * (length_ratio if i < k - 1 else 1.0)
        scaled = Elastic(trial.span, rod.ei, rod.gj, rod.rest, rod.soft, trial.reach, rod.memory, rod.maxwell,
                         rod.small)  # fmt: skip
        if sign == 0:
            _keep(q, scaled, load, work, here)
        else:
            _differ(q, scaled, load, here, work, sides[_LENGTH])
    scale = 0.5 / (_LENGTH_STEP_SHARE * flexible)
    for r in range(3 * k):
        sides[_LENGTH, r] *= scale

    # The gradient is linear in rest strain, memory and stiffnesses: a difference is the derivative.
    _keep(q, rod, load, work, here)
    for axis in range(1, 3):
        for i in range(k):
            for j in range(3):
                trial.rest[i, j] = rod.rest[i, j] + (1.0 if j == axis else 0.0)
        bent = Elastic(rod.span, rod.ei, rod.gj, trial.rest, rod.soft, rod.reach, rod.memory, rod.maxwell,
                       rod.small)  # fmt: skip
        _differ(q, bent, load, here, work, sides[_REST + axis - 1])
    for i in range(k):
        for j in range(3):
            trial.memory[i, j] = 2.0 * rod.memory[i, j]
    crept = Elastic(rod.span, rod.ei, rod.gj, rod.rest, rod.soft, rod.reach, trial.memory, rod.maxwell, rod.small)
    _differ(q, crept, load, here, work, sides[_CREEP])
    for p in range(patterns.shape[0]):
        for i in range(k):
            stiffness_ratio = 1.0 + patterns[p, i]
            trial.ei[i], trial.gj[i] = stiffness_ratio * rod.ei[i], stiffness_ratio * rod.gj[i]
        firm = Elastic(rod.span, trial.ei, trial.gj, rod.rest, rod.soft, rod.reach, rod.memory, rod.maxwell,
                       rod.small)  # fmt: skip
        _differ(q, firm, load, here, work, sides[_PATTERNS + p])


@compiled
def _walk(q: FloatArray, places: Places, spare: Spare, points: FloatArray, slopes: FloatArray) -> None:
    """Computes points (n, 3) and their derivatives (n, 3, C) from the elements' turns in ``spare.sides``."""
    sides, moves = spare.sides, spare.moves
    columns, n = sides.shape[0], places.element.shape[0]
    for c in range(columns):
        for j in range(3):
            moves[c, j] = 0.0
    x = y = z = 0.0
    point = 0
    for i in range(q.shape[0]):
        w, a, b, c_ = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        t0, t1, t2 = 1 - 2 * (b * b + c_ * c_), 2 * (a * b + w * c_), 2 * (a * c_ - w * b)
        y0, y1, y2 = 2 * (a * b - w * c_), 1 - 2 * (a * a + c_ * c_), 2 * (b * c_ + w * a)
        z0, z1, z2 = 2 * (a * c_ + w * b), 2 * (b * c_ - w * a), 1 - 2 * (a * a + b * b)
        stretch = 1.0 / places.flexible if i < q.shape[0] - 1 else 0.0
        while point < n and places.element[point] == i:
            reach = places.beyond[point]
            points[point, 0], points[point, 1], points[point, 2] = x + reach * t0, y + reach * t1, z + reach * t2
            for c in range(columns):
                # an element's direction turns by w x (1, 0, 0) in its own frame
                second, third = reach * sides[c, 3 * i + 2], -reach * sides[c, 3 * i + 1]
                along = reach * stretch if c == _LENGTH else 0.0
                slopes[point, 0, c] = moves[c, 0] + second * y0 + third * z0 + along * t0
                slopes[point, 1, c] = moves[c, 1] + second * y1 + third * z1 + along * t1
                slopes[point, 2, c] = moves[c, 2] + second * y2 + third * z2 + along * t2
            point += 1
        reach = places.lengths[i]
        x, y, z = x + reach * t0, y + reach * t1, z + reach * t2
        for c in range(columns):
            second, third = reach * sides[c, 3 * i + 2], -reach * sides[c, 3 * i + 1]
            along = reach * stretch if c == _LENGTH else 0.0
            moves[c, 0] += second * y0 + third * z0 + along * t0
            moves[c, 1] += second * y1 + third * z1 + along * t1
            moves[c, 2] += second * y2 + third * z2 + along * t2


@compiled
def slope_rows(
    rows: Rows, rod: Elastic, load: Load, base_rest: FloatArray, patterns: FloatArray, places: Places, spare: Spare,
    work: Work, points: FloatArray, slopes: FloatArray, good: FloatArray,
) -> None:  # fmt: skip
    """Computes equilibria and their derivatives at consecutive instants.

    Args:
        rows: orientations, loads and creep at each instant; the orientations are start, then result.
        rod: values of the rod; ``rest`` and ``memory`` are overwritten, the memory from its present values on.
        load: buffer of the load.
        base_rest: (segments + 1, 3) the rod's own pre-curvature.
        patterns: (patterns, segments + 1) relative change of the stiffness in each joint.
        places: elements and arc lengths of the points.
        spare: buffers of the derivatives.
        work: buffers of Newton's method.
        points: (m, n, 3) points that are written.
        slopes: (m, n, 3, columns) derivatives that are written.
        good: (m,) written: 1 if a stable shape was found, else 0.
    """
    for row in range(rows.q.shape[0]):
        q = rows.q[row]
        for i in range(q.shape[0]):
            for j in range(3):
                rod.rest[i, j] = base_rest[i, j] + rows.change[row, j]
        for j in range(3):
            load.force[j], load.moment[j] = rows.force[row, j], rows.moment[row, j]
        out = relax(q, rod, load, NO_TOUCH, work, TOLERANCE)
        good[row] = 1.0 if out.converged and out.stable else 0.0
        # `relax` leaves the factors at ``q`` in ``work``; `assemble` does not change them.
        _fill_sides(q, rod, load, rows.arm[row], patterns, places.flexible, spare, work)
        for c in range(spare.sides.shape[0]):
            solve_factorised(work, 0, spare.sides[c])
        _walk(q, places, spare, points[row], slopes[row])
        creep_on(q, rod, rows.relaxing[row])
