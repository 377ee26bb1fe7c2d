"""Following the unloaded shape's branch in space: all loads are raised together, a tangent ahead of Newton's method."""

import numpy as np

from ..types import FloatArray
from ._continuation import Branch
from ._spatial_assembly import add_pull
from ._spatial_compile import compiled
from ._spatial_newton import Outcome, copy_turns, longest_turn, relax, solve_factorised, turn
from ._spatial_parts import Elastic, Load, Touch, Work

__all__ = ["raise_load"]

_MISMATCH = 0.05
"""Largest turn, rad, by which a step of the load may miss the mean of the tangents at its two ends.

On a smooth branch the miss falls with the cube of the step; a jump to another branch misses by the jump.
"""
_LONGEST = 0.6
"""Longest turn of an element in one step of the load along the tangent, rad."""
_SHORTEST = 1e-5
"""Share of the load below which a step that still fails is taken for a fold, or for the point of buckling."""
_ANEW = 0.02
"""Share of the load in the first step after that."""
_ROUGH = 1e-5
"""Relative residual that is good enough on the way to the load."""
_UNLOADED, _FALLEN = int(Branch.UNLOADED), int(Branch.FALLEN)


@compiled
def _mismatch(old: FloatArray, q: FloatArray, step: float, before: FloatArray, after: FloatArray) -> float:
    """Largest difference between the turns from ``old`` to ``q`` and ``step`` times the mean of the two tangents."""
    worst = 0.0
    for i in range(q.shape[0]):
        w0, x0, y0, z0 = old[i, 0], old[i, 1], old[i, 2], old[i, 3]
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        twice = 2.0 if w0 * w + x0 * x + y0 * y + z0 * z > 0.0 else -2.0
        a = twice * (w0 * x - x0 * w - y0 * z + z0 * y)
        b = twice * (w0 * y - y0 * w - z0 * x + x0 * z)
        c = twice * (w0 * z - z0 * w - x0 * y + y0 * x)
        half, r = 0.5 * step, 3 * i
        a -= half * (before[r] + after[r])
        b -= half * (before[r + 1] + after[r + 1])
        c -= half * (before[r + 2] + after[r + 2])
        worst = max(worst, a * a + b * b + c * c)
    return np.sqrt(worst)


@compiled
def _tangent(q: FloatArray, rod: Elastic, load: Load, work: Work, way: FloatArray) -> None:
    """Turns per share of the load, from the factors that `relax` has left."""
    for r in range(way.shape[0]):
        way[r] = 0.0
    add_pull(q, rod, load, way)
    solve_factorised(work, 0, way)


@compiled
def raise_load(
    q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work, tolerance: float
) -> tuple[Outcome, int]:
    """From the unloaded ``q`` to the whole load, without a wall; also the value of `Branch`.

    Where a step cannot be made small enough to follow, the branch has ended in a fold and the rod falls. A branch
    that loses its stability without a fold (a straight rod pushed along its axis) is followed on.
    """
    saved, now = np.empty_like(q), Load(np.zeros(3), np.zeros(3), np.zeros_like(load.line))
    before, after = np.empty(3 * q.shape[0]), np.empty(3 * q.shape[0])
    turned = load.moment[0] != 0.0 or load.moment[1] != 0.0 or load.moment[2] != 0.0
    out = relax(q, rod, now, touch, work, tolerance)
    _tangent(q, rod, load, work, before)
    share, step, steps, branch, was_stable = 0.0, 1.0, out.iterations, _UNLOADED, out.stable
    while share < 1.0:
        step = min(step, 1.0 - share, _LONGEST / (longest_turn(before) + 1e-300))
        last = share + step >= 1.0 - 1e-12
        target = 1.0 if last else share + step
        for k in range(3):
            now.force[k], now.moment[k] = target * load.force[k], target * load.moment[k]
        for i in range(q.shape[0]):
            for k in range(3):
                now.line[i, k] = target * load.line[i, k]
        copy_turns(q, saved)
        turn(saved, before, step, q)
        out = relax(q, rod, now, touch, work, tolerance if last else _ROUGH)
        steps += out.iterations
        _tangent(q, rod, load, work, after)
        miss = _mismatch(saved, q, step, before, after)
        followed = out.converged and miss <= _MISMATCH
        if (not followed or (was_stable and not out.stable and not turned)) and step > _SHORTEST:
            copy_turns(saved, q)
            step *= 0.4
            continue
        if not followed:
            branch = _FALLEN
        if step <= _SHORTEST:
            step = _ANEW
        elif miss < 0.125 * _MISMATCH:
            step *= 2.0
        share, was_stable = target, out.stable
        before, after = after, before
    return Outcome(steps, out.converged, out.stable, out.residual), branch
