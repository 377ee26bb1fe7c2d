"""How the centreline moves with all that is uncertain of a rod, for many equilibria in a row while the shaft creeps."""

from typing import NamedTuple

from ..types import FloatArray, IntArray
from ._spatial_assembly import add_pull, assemble
from ._spatial_compile import compiled
from ._spatial_march import creep_on
from ._spatial_newton import TOLERANCE, relax, solve_factorised
from ._spatial_parts import NO_TOUCH, Elastic, Load, Work

__all__ = ["Places", "Rows", "Spare", "slope_rows"]

_FORCE, _MOMENT, _REST, _LENGTH, _CREEP, _PATTERNS = 0, 3, 6, 8, 9, 10
"""First columns of: force (3), moment (3), rest strain about y and z (2), length, creep, stiffness patterns."""
_SHARE = 1e-5
"""Of the length, for its central difference."""


class Rows(NamedTuple):
    """A row for each equilibrium: ``q`` (m, k, 4) to start from, ``change`` (m, 3) of the pre-curvature.

    ``force``, ``moment``, ``arm`` (m, 3): at the lever's end, on the electrode, and from the lever's end to where the
    force acts: what the moment changes by when the force does. ``relaxing`` (m,): time until the next row over the
    creep's time constant, as `creep_on` takes it.
    """

    q: FloatArray
    change: FloatArray
    force: FloatArray
    moment: FloatArray
    arm: FloatArray
    relaxing: FloatArray


class Places(NamedTuple):
    """Points of the centreline: each in which ``element`` (n,), and how far along it ``beyond`` (n,).

    ``lengths`` (k,): of the elements; ``flexible``: of the shaft, whose last element but one ends it.
    """

    element: IntArray
    beyond: FloatArray
    lengths: FloatArray
    flexible: float


class Spare(NamedTuple):
    """Room: a second rod to differ from, a load of one unit, right-hand sides (C, 3k), and the nodes' moves."""

    rod: Elastic
    unit: Load
    here: FloatArray
    sides: FloatArray
    moves: FloatArray


@compiled
def _differ(q: FloatArray, other: Elastic, load: Load, here: FloatArray, work: Work, side: FloatArray) -> None:
    """``side`` = the gradient that is kept in ``here`` less that of ``other``."""
    assemble(q, other, load, NO_TOUCH, work)
    for r in range(here.shape[0]):
        side[r] = here[r] - work.gradient[r]


@compiled
def _keep(q: FloatArray, rod: Elastic, load: Load, work: Work, here: FloatArray) -> None:
    assemble(q, rod, load, NO_TOUCH, work)
    for r in range(here.shape[0]):
        here[r] = work.gradient[r]


@compiled
def _fill_sides(
    q: FloatArray, rod: Elastic, load: Load, arm: FloatArray, patterns: FloatArray, flexible: float, spare: Spare,
    work: Work,
) -> None:  # fmt: skip
    """``spare.sides``: -dg/dp of every unknown."""
    k, sides, here, other = q.shape[0], spare.sides, spare.here, spare.rod
    force, moment = spare.unit.force, spare.unit.moment
    for r in range(3 * k):
        for c in range(_REST):
            sides[c, r] = 0.0
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        force[axis], moment[one], moment[two] = 1.0, arm[two], -arm[one]  # arm x the unit force
        add_pull(q, rod, spare.unit, sides[_FORCE + axis])
        force[axis], moment[one], moment[two], moment[axis] = 0.0, 0.0, 0.0, 1.0
        add_pull(q, rod, spare.unit, sides[_MOMENT + axis])
        moment[axis] = 0.0

    # A length's change is no linear matter: a central difference, the shorter rod's gradient kept meanwhile.
    for sign in range(2):
        share = 1.0 + (2 * sign - 1) * _SHARE
        for i in range(k):
            other.span[i] = rod.span[i] * share
            other.reach[i] = rod.reach[i] * (share if i < k - 1 else 1.0)
        scaled = Elastic(other.span, rod.bend, rod.twist, rod.rest, rod.soft, other.reach, rod.memory, rod.maxwell,
                         rod.small)  # fmt: skip
        if sign == 0:
            _keep(q, scaled, load, work, here)
        else:
            _differ(q, scaled, load, here, work, sides[_LENGTH])
    scale = 0.5 / (_SHARE * flexible)
    for r in range(3 * k):
        sides[_LENGTH, r] *= scale

    # The gradient is linear in rest strain, memory and stiffnesses: a difference is the derivative.
    _keep(q, rod, load, work, here)
    for axis in range(1, 3):
        for i in range(k):
            for j in range(3):
                other.rest[i, j] = rod.rest[i, j] + (1.0 if j == axis else 0.0)
        bent = Elastic(rod.span, rod.bend, rod.twist, other.rest, rod.soft, rod.reach, rod.memory, rod.maxwell,
                       rod.small)  # fmt: skip
        _differ(q, bent, load, here, work, sides[_REST + axis - 1])
    for i in range(k):
        for j in range(3):
            other.memory[i, j] = 2.0 * rod.memory[i, j]
    crept = Elastic(rod.span, rod.bend, rod.twist, rod.rest, rod.soft, rod.reach, other.memory, rod.maxwell, rod.small)
    _differ(q, crept, load, here, work, sides[_CREEP])
    for p in range(patterns.shape[0]):
        for i in range(k):
            share = 1.0 + patterns[p, i]
            other.bend[i], other.twist[i] = share * rod.bend[i], share * rod.twist[i]
        firm = Elastic(rod.span, other.bend, other.twist, rod.rest, rod.soft, rod.reach, rod.memory, rod.maxwell,
                       rod.small)  # fmt: skip
        _differ(q, firm, load, here, work, sides[_PATTERNS + p])


@compiled
def _walk(q: FloatArray, places: Places, spare: Spare, points: FloatArray, slopes: FloatArray) -> None:
    """Places (n, 3) and their slopes (n, 3, C) from the elements' turns, which stand in ``spare.sides``."""
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
            way = places.beyond[point]
            points[point, 0], points[point, 1], points[point, 2] = x + way * t0, y + way * t1, z + way * t2
            for c in range(columns):
                # an element's direction turns by w x (1, 0, 0) in its own frame
                second, third = way * sides[c, 3 * i + 2], -way * sides[c, 3 * i + 1]
                along = way * stretch if c == _LENGTH else 0.0
                slopes[point, 0, c] = moves[c, 0] + second * y0 + third * z0 + along * t0
                slopes[point, 1, c] = moves[c, 1] + second * y1 + third * z1 + along * t1
                slopes[point, 2, c] = moves[c, 2] + second * y2 + third * z2 + along * t2
            point += 1
        way = places.lengths[i]
        x, y, z = x + way * t0, y + way * t1, z + way * t2
        for c in range(columns):
            second, third = way * sides[c, 3 * i + 2], -way * sides[c, 3 * i + 1]
            along = way * stretch if c == _LENGTH else 0.0
            moves[c, 0] += second * y0 + third * z0 + along * t0
            moves[c, 1] += second * y1 + third * z1 + along * t1
            moves[c, 2] += second * y2 + third * z2 + along * t2


@compiled
def slope_rows(
    rows: Rows, rod: Elastic, load: Load, base_rest: FloatArray, patterns: FloatArray, places: Places, spare: Spare,
    work: Work, points: FloatArray, slopes: FloatArray, good: FloatArray,
) -> None:  # fmt: skip
    """Fill ``points`` (m, n, 3), ``slopes`` (m, n, 3, C) and ``good`` (m,): 1 where a stable shape was found.

    ``rod.rest``, ``rod.memory`` and ``load`` are written over; the memory goes on from what it holds.
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
        # `relax` leaves the factors at ``q`` in ``work``; assembling does not touch them.
        _fill_sides(q, rod, load, rows.arm[row], patterns, places.flexible, spare, work)
        for c in range(spare.sides.shape[0]):
            solve_factorised(work, 0, spare.sides[c])
        _walk(q, places, spare, points[row], slopes[row])
        creep_on(q, rod, rows.relaxing[row])
