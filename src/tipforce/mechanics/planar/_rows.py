"""Many loads on one planar rod: each takes the next free lane, or goes the careful way alone where the quick one fails.

Cold, a load is raised from nothing along its branch's own power series (`look_ahead`), in steps for which the series
holds; after each of them Newton's method takes out what is missing. Warm, Newton's method begins at what is given.
Whatever is not plain (a Hessian that is not positive definite, a correction that is too long or does not shrink, a fold
that comes near) is left to `follow` and `relax_in`, whose word on the branch then stands.
"""

import math
from typing import NamedTuple

import numpy as np

from ...types import FloatArray, IntArray
from ._continuation import follow
from ._lanes import (
    CARRY,
    GO,
    K0,
    LONGEST,
    LOWEST,
    MISS,
    MOMENT,
    PX,
    PY,
    REACH,
    RESIDUAL,
    SHARE,
    SIZES,
    SPAN,
    THETA,
    advance,
    compiled,
    elements,
    energy_in,
    evaluate,
    factorise,
    look_ahead,
    make_lanes,
    measure_way,
)
from ._newton import NO_SPRINGS, SCRATCH, TOLERANCE, Elastic, Load, Outcome, relax_in

__all__ = ["settle_rows"]

_MISMATCH = 0.02
"""Longest correction after a step of the load, rad, and largest miss of the branch's slope at its end, times the step.

A shape of another branch lies further away than that, or goes on another way.
"""
_AHEAD = 2e-3
"""What the first term that the series leaves out may come to, rad."""
_NEAR = 3e-3
"""Correction after which a shape on the way will do, rad: what is left is of the size of its square."""
_SHORTEST = 2e-3
"""Share of the load below which a step is not plain."""
_LONGEST_FIRST = 0.4
"""Longest first correction of a warm start, rad."""
_MOST = 12
"""Corrections of a warm start, or of one step of the load."""
_START, _CORRECT, _WARM = 0, 1, 2
_ON, _ARRIVED, _BACK, _SETTLED, _NOT_PLAIN = 0, 1, 2, 3, 4


class _Course(NamedTuple):
    """How far the load in each lane is. ``row``: which one, -1: none; ``phase``; ``verdict`` on it.

    ``steps``: of Newton's method in all, ``tries``: since the last step of the load; ``at``: share of the load that was
    reached; ``moved``: corrections since then, or the last one of a warm start.
    """

    row: IntArray
    phase: IntArray
    verdict: IntArray
    steps: IntArray
    tries: IntArray
    at: FloatArray
    moved: FloatArray


@compiled
def _judge(w: FloatArray, c: _Course, lane: int, lanes: tuple[float, ...], small: float) -> int:
    """What has come of a lane; tells `advance` to make Newton's step where there is one. NaN is never plain."""
    width = len(lanes)
    mine, tip = width + lane, elements(w, lanes) * width + lane
    firm, quiet, longest = w[LOWEST, tip] < 0.0, w[RESIDUAL, tip] <= small, w[LONGEST, tip]
    if c.phase[lane] == _START:
        return _ARRIVED if firm else _NOT_PLAIN
    if c.phase[lane] == _WARM:
        if quiet:
            return _SETTLED
        limit = _LONGEST_FIRST if c.tries[lane] == 0 else 0.5 * c.moved[lane]
        if not (firm and longest <= limit and c.tries[lane] < _MOST):
            return _NOT_PLAIN
        c.moved[lane] = longest
    else:
        if not firm:
            return _BACK
        whole = w[SHARE, mine] == 1.0
        if whole and quiet:
            return _ARRIVED
        c.moved[lane] += longest
        if not (c.moved[lane] <= _MISMATCH and c.tries[lane] < _MOST):
            return _BACK
        if longest <= _NEAR and not whole:
            c.steps[lane] += 1
            return _ARRIVED
    c.steps[lane] += 1
    c.tries[lane] += 1
    w[GO, mine] = 1.0
    return _ON


@compiled
def _aim(w: FloatArray, c: _Course, lane: int, lanes: tuple[float, ...], step: float, go: float) -> int:
    """The next step of the load, or `_NOT_PLAIN` where it has become too short."""
    mine, left = len(lanes) + lane, 1.0 - c.at[lane]
    if step < min(_SHORTEST, left):
        return _NOT_PLAIN
    w[CARRY, mine], w[SHARE, mine], w[GO, mine] = step, 1.0 if step >= left else c.at[lane] + step, go
    c.phase[lane], c.tries[lane], c.moved[lane] = _CORRECT, 0, 0.0
    return _ON


@compiled
def _go_on(w: FloatArray, c: _Course, lane: int, lanes: tuple[float, ...]) -> int:
    """From a shape that was reached, if it is on the branch still: how long may the next step be."""
    width = len(lanes)
    mine, tip = width + lane, elements(w, lanes) * width + lane
    if c.phase[lane] == _CORRECT:
        if not w[CARRY, mine] * w[MISS, tip] <= _MISMATCH:
            return _BACK
        if w[SHARE, mine] == 1.0:
            return _SETTLED
        c.at[lane] = w[SHARE, mine]
    first, third, fourth = w[SIZES, tip] + 1e-300, w[SIZES + 2, tip] + 1e-300, w[SIZES + 3, tip]
    # The fifth term, from the last two, and from the odd ones: a straight rod has no even ones.
    fifth = max(fourth * (fourth / third), third * (third / first)) + 1e-300
    left, step = 1.0 - c.at[lane], (_AHEAD / fifth) ** 0.2
    return _aim(w, c, lane, lanes, left if step >= left else min(step, 0.5 * left), 3.0)


@compiled
def _seat(
    w: FloatArray,
    c: _Course,
    lane: int,
    lanes: tuple[float, ...],
    row: int,
    load: Load,
    k0: FloatArray,
    start: FloatArray,
    warm: bool,
) -> None:
    """Row ``row`` into an idle lane: at ``start`` with the whole load, or without load at its own shape."""
    width, angle = len(lanes), 0.0
    j = lane
    for i in range(k0.size):
        j += width
        w[K0, j] = k0[i]
        w[PX, j] = w[REACH, j] * (load.fx + load.carried[i, 0])
        w[PY, j] = w[REACH, j] * (load.fy + load.carried[i, 1])
        angle += k0[i] / w[SPAN, j]
        w[THETA, j] = start[i] if warm else angle
    w[MOMENT, j] = load.m
    w[SHARE, width + lane] = 1.0 if warm else 0.0
    w[GO, width + lane] = w[CARRY, width + lane] = 0.0
    c.row[lane], c.phase[lane], c.steps[lane], c.tries[lane] = row, _WARM if warm else _START, 0, 0
    c.at[lane] = c.moved[lane] = 0.0


@compiled
def _carefully(theta: FloatArray, rod: Elastic, load: Load, warm: bool, scratch: FloatArray) -> tuple[Outcome, float]:
    """One load by itself, and the value of `Branch`; ``theta`` holds what to start from where ``warm``."""
    n = theta.size
    last = n - 1
    outcome = Outcome(0, False, False, 0.0, 0.0, 0.0, 0.0)
    if warm:
        outcome = relax_in(theta, rod, load, NO_SPRINGS, TOLERANCE, scratch[:SCRATCH])
    if outcome.converged:
        return outcome, 2.0
    previous = 0.0
    for i in range(n):
        previous += rod.k0[i] * (rod.h if 0 < i < last else 0.5 * rod.h)
        theta[i] = previous
    x, y = load.fx + load.carried[0, 0], load.fy + load.carried[0, 1]
    size = math.hypot(x, y) * (rod.h * last + rod.lever) + abs(load.m)
    outcome, followed = follow(theta, rod, load, min(1.0, rod.scale / (size + 1e-300)), scratch)
    return outcome, 0.0 if followed else 1.0


@compiled
def _tick(w: FloatArray, c: _Course, soft: float, small: float, lanes: tuple[float, ...]) -> None:
    """One look at all lanes at once, and the verdict on each. New angles are still to be gone to, by `advance`."""
    evaluate(w, soft, lanes)
    factorise(w, lanes)
    arrived = False
    for lane in range(len(lanes)):
        w[GO, len(lanes) + lane] = 0.0
        c.verdict[lane] = _judge(w, c, lane, lanes, small) if c.row[lane] >= 0 else _ON
        arrived = arrived or c.verdict[lane] == _ARRIVED
    if arrived:
        look_ahead(w, soft, lanes)
        measure_way(w, lanes)
    for lane in range(len(lanes)):
        if c.verdict[lane] == _ARRIVED:
            c.verdict[lane] = _go_on(w, c, lane, lanes)
        if c.verdict[lane] == _BACK:
            c.verdict[lane] = _aim(w, c, lane, lanes, 0.4 * w[CARRY, len(lanes) + lane], 2.0)


@compiled
def settle_rows(
    angles: FloatArray,
    warm: bool,
    rod: Elastic,
    k0: FloatArray,
    force: FloatArray,
    moment: FloatArray,
    carried: FloatArray,
    numbers: FloatArray,
    lanes: tuple[float, ...],
) -> None:
    """Fill ``angles`` (m, n) with the shapes under m loads; where ``warm``, it holds what to start from.

    ``k0`` (m, n) or (1, n) for all; ``carried`` (n, 2) for all; ``numbers`` (m, 6) receives energy, residual,
    converged, stable, branch, iterations. A start from which no equilibrium is found gives way to the unloaded shape.
    ``lanes``: as many numbers as loads are to go side by side.
    """
    rows, n = angles.shape
    width = len(lanes)
    w = make_lanes(rod, n, lanes)
    plain = np.zeros((5, width), np.int64)
    c = _Course(plain[0], plain[1], plain[2], plain[3], plain[4], np.zeros(width), np.zeros(width))
    own = 1 if k0.shape[0] > 1 else 0
    waiting, rest = 0, 0
    left = np.empty(rows, np.int64)
    tip = n * width
    for lane in range(width):
        c.row[lane] = -1
    while True:
        busy = False
        for lane in range(width):
            if c.row[lane] < 0 and waiting < rows:
                load = Load(force[waiting, 0], force[waiting, 1], float(moment[waiting]), carried)
                _seat(w, c, lane, lanes, waiting, load, k0[own * waiting], angles[waiting], warm)
                waiting += 1
            busy = busy or c.row[lane] >= 0
        if not busy:
            break
        _tick(w, c, rod.soft, TOLERANCE * rod.scale, lanes)
        arrived = False
        for lane in range(width):
            arrived = arrived or w[GO, width + lane] == 3.0
            row = c.row[lane]
            if c.verdict[lane] == _SETTLED:
                for i in range(n):
                    angles[row, i] = w[THETA, (i + 1) * width + lane]
                numbers[row, 0] = energy_in(w, lane, rod.soft, lanes)
                numbers[row, 1], numbers[row, 2] = w[RESIDUAL, tip + lane] / rod.scale, 1.0
                numbers[row, 3] = 1.0 if w[LOWEST, tip + lane] < 0.0 else 0.0
                numbers[row, 4], numbers[row, 5] = 2.0 if warm else 0.0, c.steps[lane]
                c.row[lane] = -1
            elif c.verdict[lane] == _NOT_PLAIN:
                left[rest] = row
                rest += 1
                c.row[lane] = -1
        advance(w, arrived, lanes)
    scratch = np.empty((SCRATCH + 4, n))
    for k in range(rest):
        row = left[k]
        alone = Elastic(rod.h, rod.lever, rod.ei, k0[own * row], rod.soft, rod.scale)
        load = Load(force[row, 0], force[row, 1], float(moment[row]), carried)
        outcome, branch = _carefully(angles[row], alone, load, warm, scratch)
        numbers[row, 0], numbers[row, 1] = outcome.energy, outcome.residual
        numbers[row, 2], numbers[row, 3] = outcome.converged, outcome.stable
        numbers[row, 4], numbers[row, 5] = branch, outcome.iterations
