"""Following the unloaded shape's branch: all loads are raised together, with a tangent ahead of Newton's method."""

import numpy as np
from numba import njit

from ...types import FloatArray
from ._newton import NO_SPRINGS, SCRATCH, TOLERANCE, Elastic, Load, Outcome, relax_in, solve_for

__all__ = ["follow"]


_MISMATCH = 0.02
"""Largest angle, rad, by which a step of the load may miss the mean of the tangents at its two ends.

On a smooth branch the miss falls with the cube of the step; a jump to another branch misses by the jump, whatever the
step.
"""
_LONGEST = 0.6
"""Longest way of an angle in one step of the load along the tangent, rad."""
_SHORTEST = 1e-5
"""Share of the load below which a step that still fails is taken for a fold, or for the point of buckling."""
_ON_THE_WAY = 1e-5
"""Residual that will do for the shapes that are passed through."""
_ANEW = 0.02
"""Share of the load in the first step after that."""


@njit(cache=True, error_model="numpy")
def _tangent(rod: Elastic, load: Load, scratch: FloatArray, way: FloatArray) -> None:
    """Change of the angles with the share of the load, into ``way``; ``scratch``: what `relax_in` left there."""
    last = way.size - 1
    cosine, sine = scratch[10], scratch[11]
    for i in range(last + 1):
        reach = rod.h if i < last else rod.lever
        way[i] = reach * ((load.fy + load.carried[i, 1]) * cosine[i] - (load.fx + load.carried[i, 0]) * sine[i])
    way[last] += load.m
    solve_for(scratch, way)


@njit(cache=True, error_model="numpy")
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copy (n,); a slice's assignment would cost the compiler seconds, for the message of its error."""
    for i in range(source.size):
        target[i] = source[i]


@njit(cache=True, error_model="numpy")
def follow(theta: FloatArray, rod: Elastic, load: Load, first: float, scratch: FloatArray) -> tuple[Outcome, bool]:
    """From the unloaded ``theta`` to the whole load; True where the branch was followed without a jump.

    A branch that loses its stability without a fold (a straight rod pushed along its axis) is followed on. ``scratch``
    (SCRATCH + 4, n).
    """
    n = theta.size
    work, before, way, way_before = scratch[:SCRATCH], scratch[12], scratch[13], scratch[14]
    way_last, carried = scratch[15], np.zeros((n, 2))
    outcome = relax_in(theta, rod, Load(0.0, 0.0, 0.0, carried), NO_SPRINGS, _ON_THE_WAY, work)
    _tangent(rod, load, work, way)
    _copy(way, way_last)
    stable = outcome.stable
    iterations = outcome.iterations
    followed = True
    share, step, last_step = 0.0, first, 0.0
    while share < 1.0:
        if stable:
            longest = 0.0
            for i in range(n):
                longest = max(longest, abs(way[i]))
            step = max(_SHORTEST, min(step, _LONGEST / (longest + 1e-300)))
        target = min(1.0, share + step)
        step = target - share
        _copy(theta, before)
        _copy(way, way_before)
        if stable:
            # The tangent, and its change over the last step.
            bent = 0.5 * step * step / last_step if last_step > 0.0 else 0.0
            for i in range(n):
                theta[i] += step * way[i] + bent * (way[i] - way_last[i])
        for i in range(n):
            carried[i, 0], carried[i, 1] = target * load.carried[i, 0], target * load.carried[i, 1]
        part = Load(target * load.fx, target * load.fy, target * load.m, carried)
        tolerance = TOLERANCE if target == 1.0 else _ON_THE_WAY
        outcome = relax_in(theta, rod, part, NO_SPRINGS, tolerance, work)
        iterations += outcome.iterations
        was_stable, stable = stable, outcome.stable
        if stable:
            _tangent(rod, load, work, way)
        miss = moved = 0.0
        for i in range(n):
            moved = max(moved, abs(theta[i] - before[i]))
            miss = max(miss, abs(theta[i] - before[i] - 0.5 * step * (way[i] + way_before[i])))
        if stable and was_stable and outcome.converged and miss <= _MISMATCH:
            share, last_step = target, step
            _copy(way_before, way_last)
            if miss < 0.125 * _MISMATCH:
                step *= 2.0
        elif not was_stable or step < 1.5 * _SHORTEST:
            # Past the end of a stable stretch there is no tangent to hold on to: only what stands still is followed.
            followed = followed and outcome.converged and moved <= _MISMATCH
            share, step, last_step = target, _ANEW, 0.0
        else:
            _copy(before, theta)
            _copy(way_before, way)
            stable = True
            step = max(0.3 * step, _SHORTEST)
    whole = Outcome(iterations, outcome.converged, outcome.stable, outcome.energy, outcome.residual, 0.0, 0.0)
    return whole, followed
