"""Many loads on one planar rod: a SIMD batch of Newton's method with continuation along the branch's power series.

The mechanics are those of `_newton`, without springs. One load alone waits most of the time: each pivot of the
tridiagonal Hessian needs the one before it. Here every row of the work array holds, for element after element, the
numbers of all lanes, one lane a load. Where elements do not wait for each other, loops go along a whole row, eight
numbers at a time, whichever lane they belong to; where one waits for the next, all lanes go together, from both ends of
the rod at once. A row begins and ends with the zeros of an element that does not exist, and has room for the last
eight. The rows have names (`SPAN` to `EXTRA`).

Cold, a load is raised from nothing along the power series of its branch (`_expand`), in steps for which the series
holds. After each step Newton's method takes out the remaining error. Warm, Newton's method begins at the given shape.
Whatever is not simple (a Hessian that is not positive definite, a correction that is too long or does not shrink, a
fold nearby) is left to `follow` and `relax_in`, one load after the other. Their answer on the branch then holds.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ...types import FloatArray, IntArray
from ._compile import compiled
from ._newton import (
    NO_SPRINGS,
    SCRATCH,
    TOLERANCE,
    Elastic,
    Load,
    Outcome,
    bending_density,
    follow,
    relax_in,
)
from ._simd import (
    EIGHT,
    alike,
    choose,
    circle,
    fma,
    inverse,
    larger,
    largest_of,
    magnitude,
    nothing,
    put,
    take,
)

ONE, MANY = (0.0,), (0.0,) * 8
"""Lanes for one load and for many: eight of them fill the time that one waits for its pivots."""

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
_MAX_CORRECTIONS = 12
"""Corrections of a warm start, or of one step of the load."""
_START, _CORRECT, _WARM = 0, 1, 2
_CONTINUE, _ARRIVED, _STEP_BACK, _SOLVED, _NOT_SIMPLE = 0, 1, 2, 3, 4


ORDER = 4
"""Of the series by which a shape goes on with the share of its load."""

# Rows of the work array. Of the rod: 1 / length of shaft in a joint, EI, length of an element.
SPAN, EI, REACH = 0, 1, 2
# Of the loads: pre-curvature, reach times the force carried there, moment at the tip.
K0, PX, PY, MOMENT = 3, 4, 5, 6
# Angles; curvature, moment and its slope in the joints.
THETA, CURVATURE, BENDING, SLOPE = 7, 8, 9, 10
# Moment of the whole force on an element, and minus its slope with the angle; the Hessian, its factors, Newton's step.
PULL, TURN, DIAGONAL, FACTOR, INVERSE, STEP = 11, 12, 13, 14, 15, 16
# Series of the branch at the angles (`_expand`), ORDER rows; angles that the branch was followed to, series there.
SERIES, BASE, BASE_SERIES = 17, 21, 22
# Of each load, in the first element alone: share of it all that acts; what `_advance` is to do: how far along the
# series, and which action.
SHARE, STEP_ALONG, ACTION = 26, 27, 28
# Largest along the rod, in the last element alone: moment out of balance, minus 1 / pivot, change of an angle in a
# step, difference between the series' slope and the next one, and of the terms of the next series.
RESIDUAL, LOWEST, LONGEST, SLOPE_MISMATCH, SIZES = 29, 30, 31, 32, 33
EXTRA = SIZES + ORDER
_ROWS = EXTRA + 1


@compiled
def _elements(w: FloatArray, lanes: tuple[float, ...]) -> int:
    """Returns how many elements a rod has in the work array."""
    return (w.shape[1] - len(EIGHT)) // len(lanes) - 2


@compiled
def _of_lane(w: FloatArray, row: int, lanes: tuple[float, ...]) -> Any:
    """What stands in the first element, for eight numbers at any place."""
    return take(w[row], len(lanes), EIGHT) if len(lanes) == len(EIGHT) else alike(w[row, 1], nothing(EIGHT))


@compiled
def _make_work(rod: Elastic, n: int, lanes: tuple[float, ...]) -> FloatArray:
    """Returns the work array of ``n`` elements: straight rods without load or pre-curvature."""
    width = len(lanes)
    w = np.zeros((_ROWS, (n + 2) * width + len(EIGHT)))
    for i in range(n):
        for j in range((i + 1) * width, (i + 2) * width):
            w[SPAN, j] = (2.0 if i == 0 or i == n - 1 else 1.0) / rod.h
            w[EI, j] = rod.ei[i]
            w[REACH, j] = rod.h if i < n - 1 else rod.lever
            w[SLOPE, j] = w[EI, j] * w[SPAN, j]
    return w


@compiled
def _evaluate(w: FloatArray, soft: float, lanes: tuple[float, ...]) -> None:
    """Moments and Hessian at the angles; what is out of balance becomes the step's right side."""
    width = len(lanes)
    end = (_elements(w, lanes) + 1) * width
    zero = nothing(EIGHT)
    one, two, three, s = alike(1.0, zero), alike(2.0, zero), alike(3.0, zero), alike(soft, zero)
    for j in range(width, end, len(EIGHT)):
        theta = take(w[THETA], j, EIGHT)
        cosine, sine = circle(theta)
        span, ei, k0 = take(w[SPAN], j, EIGHT), take(w[EI], j, EIGHT), take(w[K0], j, EIGHT)
        k = (theta - take(w[THETA], j - width, EIGHT)) * span
        held = ei * (k - k0)
        if soft > 0.0:
            held = held * fma(s * k, k, one)
            put(w[SLOPE], j, ei * span * fma(s * k, three * k - two * k0, one))
        put(w[CURVATURE], j, k)
        put(w[BENDING], j, held)
        px, py = take(w[PX], j, EIGHT), take(w[PY], j, EIGHT)
        put(w[PULL], j, py * cosine - px * sine)
        put(w[TURN], j, px * cosine + py * sine)
    share = _of_lane(w, SHARE, lanes)
    for j in range(width, end, len(EIGHT)):
        after = j + width
        load = take(w[PULL], j, EIGHT) + take(w[MOMENT], j, EIGHT)
        put(w[STEP], j, fma(share, load, take(w[BENDING], after, EIGHT) - take(w[BENDING], j, EIGHT)))
        stiff = take(w[SLOPE], j, EIGHT) + take(w[SLOPE], after, EIGHT)
        put(w[DIAGONAL], j, fma(share, take(w[TURN], j, EIGHT), stiff))


@compiled
def _factorise(w: FloatArray, lanes: tuple[float, ...]) -> None:
    """Hessian = L D L', eliminated from both ends at once; solves for Newton's step.

    Either end's chain of pivots has half the length, and one is reckoned while the other waits. FACTOR belongs to the
    joint before an element. Off the diagonal stands minus the slope.
    """
    width, n = len(lanes), _elements(w, lanes)
    slope, diagonal, inverted, factor, step = w[SLOPE], w[DIAGONAL], w[INVERSE], w[FACTOR], w[STEP]
    middle = (n // 2 + 1) * width
    low = high = low_side = high_side = residual = low_largest = nothing(lanes)
    low_least = high_least = alike(-1e300, low)
    for a in range(width, middle, width):
        joint = take(slope, a, lanes)
        share = joint * low
        low = inverse(take(diagonal, a, lanes) - joint * share)
        side = take(step, a, lanes)
        low_side = fma(share, low_side, side)
        put(factor, a, share)
        put(inverted, a, low)
        put(step, a, low_side)
        low_largest, low_least = larger(low_largest, magnitude(side)), larger(low_least, nothing(lanes) - low)
        b = (n + 1) * width - a
        if b == middle:
            continue
        joint = take(slope, b + width, lanes)
        share = joint * high
        high = inverse(take(diagonal, b, lanes) - joint * share)
        side = take(step, b, lanes)
        high_side = fma(share, high_side, side)
        put(factor, b + width, share)
        put(inverted, b, high)
        put(step, b, high_side)
        residual, high_least = larger(residual, magnitude(side)), larger(high_least, nothing(lanes) - high)
    joint, after = take(slope, middle, lanes), take(slope, middle + width, lanes)
    share, part = joint * low, after * high
    both = inverse(take(diagonal, middle, lanes) - joint * share - after * part)
    side = take(step, middle, lanes)
    put(factor, middle, share)
    put(factor, middle + width, part)
    put(inverted, middle, both)
    put(step, middle, fma(share, low_side, fma(part, high_side, side)))
    tip = n * width
    put(w[RESIDUAL], tip, larger(larger(residual, low_largest), magnitude(side)))
    put(w[LOWEST], tip, larger(larger(low_least, high_least), nothing(lanes) - both))
    put(w[LONGEST], tip, _back(w, STEP, lanes))


@compiled
def _solve(w: FloatArray, order: int, lanes: tuple[float, ...]) -> None:
    """Overwrites a row of SERIES by the solution, with the factors of `_factorise`; its largest goes into SIZES."""
    width, n = len(lanes), _elements(w, lanes)
    answer, factor = w[SERIES + order - 1], w[FACTOR]
    middle = (n // 2 + 1) * width
    low = high = nothing(lanes)
    for a in range(width, middle, width):
        low = fma(take(factor, a, lanes), low, take(answer, a, lanes))
        put(answer, a, low)
        b = (n + 1) * width - a
        if b == middle:
            continue
        high = fma(take(factor, b + width, lanes), high, take(answer, b, lanes))
        put(answer, b, high)
    side = fma(take(factor, middle, lanes), low, take(answer, middle, lanes))
    put(answer, middle, fma(take(factor, middle + width, lanes), high, side))
    put(w[SIZES + order - 1], n * width, _back(w, SERIES + order - 1, lanes))


@compiled
def _back(w: FloatArray, row: int, lanes: tuple[float, ...]) -> Any:
    """The second half of a solution, from the middle to both ends; returns the largest of it."""
    width, n = len(lanes), _elements(w, lanes)
    answer, factor, inverted = w[row], w[FACTOR], w[INVERSE]
    middle = (n // 2 + 1) * width
    low = take(answer, middle, lanes) * take(inverted, middle, lanes)
    put(answer, middle, low)
    high, low_largest, high_largest = low, magnitude(low), nothing(lanes)
    for a in range(middle - width, 0, -width):
        low = fma(take(factor, a + width, lanes), low, take(answer, a, lanes) * take(inverted, a, lanes))
        put(answer, a, low)
        low_largest = larger(low_largest, magnitude(low))
        b = (n + 1) * width - a
        if b == middle:
            continue
        high = fma(take(factor, b, lanes), high, take(answer, b, lanes) * take(inverted, b, lanes))
        put(answer, b, high)
        high_largest = larger(high_largest, magnitude(high))
    return larger(low_largest, high_largest)


@compiled
def _expand(w: FloatArray, soft: float, lanes: tuple[float, ...]) -> None:
    """The branch as a series: its angles are theta + sum of NEXT_k (change of the share)^k, k = 1 to ORDER.

    Each order of the equilibrium's own power series is one more solution with the same factors (the asymptotic
    numerical method, Cochelin 1994). With T_k the rows, exp(i theta) has the coefficients (a_k + i b_k) exp(i theta_0):
    what a_k and b_k hold of lower orders goes to the right side.
    """
    width = len(lanes)
    end = (_elements(w, lanes) + 1) * width
    share = _of_lane(w, SHARE, lanes)
    half, sixth, over24 = alike(0.5, share), alike(1.0 / 6.0, share), alike(1.0 / 24.0, share)
    for j in range(width, end, len(EIGHT)):
        put(w[SERIES], j, take(w[PULL], j, EIGHT) + take(w[MOMENT], j, EIGHT))
    _solve(w, 1, lanes)
    for j in range(width, end, len(EIGHT)):
        t, pull, turn = take(w[SERIES], j, EIGHT), take(w[PULL], j, EIGHT), take(w[TURN], j, EIGHT)
        put(w[SERIES + 1], j, nothing(EIGHT) - t * fma(half * share * t, pull, turn))
    if soft > 0.0:
        _stiffen(w, soft, 2, lanes)
    _solve(w, 2, lanes)
    for j in range(width, end, len(EIGHT)):
        t, u = take(w[SERIES], j, EIGHT), take(w[SERIES + 1], j, EIGHT)
        pull, turn = take(w[PULL], j, EIGHT), take(w[TURN], j, EIGHT)
        put(w[SERIES + 2], j, (share * t * t * t * sixth - u) * turn - t * fma(share, u, half * t) * pull)
    if soft > 0.0:
        _stiffen(w, soft, 3, lanes)
    _solve(w, 3, lanes)
    for j in range(width, end, len(EIGHT)):
        t, u, x = take(w[SERIES], j, EIGHT), take(w[SERIES + 1], j, EIGHT), take(w[SERIES + 2], j, EIGHT)
        pull, turn = take(w[PULL], j, EIGHT), take(w[TURN], j, EIGHT)
        a = t * t * t * t * over24 - t * x - half * u * u
        b = half * share * t * t * u - x + t * t * t * sixth
        put(w[SERIES + 3], j, (share * a - t * u) * pull + b * turn)
    if soft > 0.0:
        _stiffen(w, soft, 4, lanes)
    _solve(w, 4, lanes)


@compiled
def _stiffen(w: FloatArray, soft: float, order: int, lanes: tuple[float, ...]) -> None:
    """Take from the right side what lower orders have in the stiffening moment EI soft (k^3 - k_0 k^2)."""
    width = len(lanes)
    size = _elements(w, lanes) * width
    own = slice(width, width + size)
    one, two, three, extra = w[SERIES], w[SERIES + 1], w[SERIES + 2], w[EXTRA]
    span, curvature, k0, ei, side = w[SPAN, own], w[CURVATURE, own], w[K0, own], w[EI, own], w[SERIES + order - 1, own]
    for j in range(size):
        k1 = (one[j + width] - one[j]) * span[j]
        bent = 3.0 * curvature[j] - k0[j]
        if order == 2:
            more = bent * k1 * k1
        else:
            k2 = (two[j + width] - two[j]) * span[j]
            if order == 3:
                more = k1 * (2.0 * bent * k2 + k1 * k1)
            else:
                k3 = (three[j + width] - three[j]) * span[j]
                more = bent * (2.0 * k1 * k3 + k2 * k2) + 3.0 * k1 * k1 * k2
        extra[j + width] = more * ei[j] * soft
    for j in range(size):
        side[j] += extra[j + 2 * width] - extra[j + width]


@compiled
def _compare_slopes(w: FloatArray, lanes: tuple[float, ...]) -> None:
    """How far the slope of the next series is off the one that the last series ends with, at most."""
    width, n = len(lanes), _elements(w, lanes)
    h = _of_lane(w, STEP_ALONG, lanes)
    two, three, four = alike(2.0, h), alike(3.0, h), alike(4.0, h)
    largest = nothing(EIGHT)
    for j in range(width, (n + 1) * width, len(EIGHT)):
        slope = fma(four * h, take(w[BASE_SERIES + 3], j, EIGHT), three * take(w[BASE_SERIES + 2], j, EIGHT))
        slope = fma(h, fma(h, slope, two * take(w[BASE_SERIES + 1], j, EIGHT)), take(w[BASE_SERIES], j, EIGHT))
        largest = larger(largest, magnitude(take(w[SERIES], j, EIGHT) - slope))
    put(w[SLOPE_MISMATCH], n * width, largest_of(largest, lanes))


@compiled
def _advance(w: FloatArray, arrived: bool, lanes: tuple[float, ...]) -> None:
    """New angles in every lane, as its ACTION says, where also its SHARE and STEP_ALONG stand.

    0: none; 1: by Newton's step; 2: along BASE_SERIES from BASE by STEP_ALONG; 3: the same, but Newton's step leads
    to the BASE, and SERIES is the BASE_SERIES from now on. ``arrived``: some lane has 3.
    """
    width = len(lanes)
    end = (_elements(w, lanes) + 1) * width
    go, h = _of_lane(w, ACTION, lanes), _of_lane(w, STEP_ALONG, lanes)
    new, series, some = go - alike(2.5, go), go - alike(1.5, go), go - alike(0.5, go)
    for j in range(width, end, len(EIGHT)):
        now = take(w[THETA], j, EIGHT)
        on, base = now + take(w[STEP], j, EIGHT), take(w[BASE], j, EIGHT)
        if arrived:
            base = choose(new, on, base)
            put(w[BASE], j, base)
        along = nothing(EIGHT)
        for k in range(ORDER - 1, -1, -1):
            term = take(w[BASE_SERIES + k], j, EIGHT)
            if arrived:
                term = choose(new, take(w[SERIES + k], j, EIGHT), term)
                put(w[BASE_SERIES + k], j, term)
            along = h * (term + along)
        put(w[THETA], j, choose(series, base + along, choose(some, on, now)))


@compiled
def _energy(w: FloatArray, lane: int, soft: float, lanes: tuple[float, ...]) -> float:
    """Energy of one lane where `_evaluate` was last: bending energy less the work of the whole load."""
    width, total = len(lanes), 0.0
    for j in range(width + lane, (_elements(w, lanes) + 1) * width, width):
        total += w[EI, j] * bending_density(w[CURVATURE, j], w[K0, j], soft) / w[SPAN, j]
        total -= w[TURN, j] + w[MOMENT, j] * w[THETA, j]
    return total


class Results(NamedTuple):
    """What comes out for each of m loads: the fields of `Shapes`, as float64 and int64 arrays (m,)."""

    energy: FloatArray
    residual: FloatArray
    converged: FloatArray
    stable: FloatArray
    branch: IntArray
    iterations: IntArray


def make_results(rows: int) -> Results:
    """Empty results of ``rows`` loads."""
    real, whole = np.zeros((4, rows)), np.zeros((2, rows), np.int64)
    return Results(real[0], real[1], real[2], real[3], whole[0], whole[1])


class _Progress(NamedTuple):
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
def _judge(w: FloatArray, c: _Progress, lane: int, lanes: tuple[float, ...], small: float) -> int:
    """What has come of a lane; tells `_advance` to make Newton's step where there is one. NaN is never plain."""
    width = len(lanes)
    mine, tip = width + lane, _elements(w, lanes) * width + lane
    firm, quiet, longest = w[LOWEST, tip] < 0.0, w[RESIDUAL, tip] <= small, w[LONGEST, tip]
    if c.phase[lane] == _START:
        return _ARRIVED if firm else _NOT_SIMPLE
    if c.phase[lane] == _WARM:
        if quiet:
            return _SOLVED
        limit = _LONGEST_FIRST if c.tries[lane] == 0 else 0.5 * c.moved[lane]
        if not (firm and longest <= limit and c.tries[lane] < _MAX_CORRECTIONS):
            return _NOT_SIMPLE
        c.moved[lane] = longest
    else:
        if not firm:
            return _STEP_BACK
        whole = w[SHARE, mine] == 1.0
        if whole and quiet:
            return _ARRIVED
        c.moved[lane] += longest
        if not (c.moved[lane] <= _MISMATCH and c.tries[lane] < _MAX_CORRECTIONS):
            return _STEP_BACK
        if longest <= _NEAR and not whole:
            c.steps[lane] += 1
            return _ARRIVED
    c.steps[lane] += 1
    c.tries[lane] += 1
    w[ACTION, mine] = 1.0
    return _CONTINUE


@compiled
def _take_step(w: FloatArray, c: _Progress, lane: int, lanes: tuple[float, ...], step: float, go: float) -> int:
    """The next step of the load, or `_NOT_SIMPLE` where it has become too short."""
    mine, left = len(lanes) + lane, 1.0 - c.at[lane]
    if step < min(_SHORTEST, left):
        return _NOT_SIMPLE
    w[STEP_ALONG, mine], w[SHARE, mine], w[ACTION, mine] = step, 1.0 if step >= left else c.at[lane] + step, go
    c.phase[lane], c.tries[lane], c.moved[lane] = _CORRECT, 0, 0.0
    return _CONTINUE


@compiled
def _go_on(w: FloatArray, c: _Progress, lane: int, lanes: tuple[float, ...]) -> int:
    """From a shape that was reached, if it is on the branch still: how long may the next step be."""
    width = len(lanes)
    mine, tip = width + lane, _elements(w, lanes) * width + lane
    if c.phase[lane] == _CORRECT:
        if not w[STEP_ALONG, mine] * w[SLOPE_MISMATCH, tip] <= _MISMATCH:
            return _STEP_BACK
        if w[SHARE, mine] == 1.0:
            return _SOLVED
        c.at[lane] = w[SHARE, mine]
    first, third, fourth = w[SIZES, tip] + 1e-300, w[SIZES + 2, tip] + 1e-300, w[SIZES + 3, tip]
    # The fifth term, from the last two, and from the odd ones: a straight rod has no even ones.
    fifth = max(fourth * (fourth / third), third * (third / first)) + 1e-300
    left, step = 1.0 - c.at[lane], (_AHEAD / fifth) ** 0.2
    return _take_step(w, c, lane, lanes, left if step >= left else min(step, 0.5 * left), 3.0)


@compiled
def _load_lane(
    w: FloatArray,
    c: _Progress,
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
    w[ACTION, width + lane] = w[STEP_ALONG, width + lane] = 0.0
    c.row[lane], c.phase[lane], c.steps[lane], c.tries[lane] = row, _WARM if warm else _START, 0, 0
    c.at[lane] = c.moved[lane] = 0.0


@compiled
def _solve_alone(theta: FloatArray, rod: Elastic, load: Load, warm: bool, scratch: FloatArray) -> tuple[Outcome, int]:
    """One load by itself, and the value of `Branch`; ``theta`` holds what to start from where ``warm``."""
    n = theta.size
    last = n - 1
    outcome = Outcome(0, False, False, 0.0, 0.0, 0.0, 0.0)
    if warm:
        outcome = relax_in(theta, rod, load, NO_SPRINGS, TOLERANCE, scratch[:SCRATCH])
    if outcome.converged:
        return outcome, 2
    previous = 0.0
    for i in range(n):
        previous += rod.k0[i] * (rod.h if 0 < i < last else 0.5 * rod.h)
        theta[i] = previous
    x, y = load.fx + load.carried[0, 0], load.fy + load.carried[0, 1]
    size = math.hypot(x, y) * (rod.h * last + rod.lever) + abs(load.m)
    outcome, followed = follow(theta, rod, load, min(1.0, rod.scale / (size + 1e-300)), scratch)
    return outcome, 0 if followed else 1


@compiled
def _iterate(w: FloatArray, c: _Progress, soft: float, small: float, lanes: tuple[float, ...]) -> None:
    """One look at all lanes at once, and the verdict on each. New angles are still to be gone to, by `_advance`."""
    _evaluate(w, soft, lanes)
    _factorise(w, lanes)
    arrived = False
    for lane in range(len(lanes)):
        w[ACTION, len(lanes) + lane] = 0.0
        c.verdict[lane] = _judge(w, c, lane, lanes, small) if c.row[lane] >= 0 else _CONTINUE
        arrived = arrived or c.verdict[lane] == _ARRIVED
    if arrived:
        _expand(w, soft, lanes)
        _compare_slopes(w, lanes)
    for lane in range(len(lanes)):
        if c.verdict[lane] == _ARRIVED:
            c.verdict[lane] = _go_on(w, c, lane, lanes)
        if c.verdict[lane] == _STEP_BACK:
            c.verdict[lane] = _take_step(w, c, lane, lanes, 0.4 * w[STEP_ALONG, len(lanes) + lane], 2.0)


@compiled
def solve_batch(
    angles: FloatArray,
    warm: bool,
    rod: Elastic,
    k0: FloatArray,
    force: FloatArray,
    moment: FloatArray,
    carried: FloatArray,
    results: Results,
    lanes: tuple[float, ...],
) -> None:
    """Fills ``angles`` (m, n) and ``results`` with the equilibria under m loads.

    ``angles`` holds the start where ``warm``. ``k0`` (m, n), or (1, n) for all; ``carried`` (n, 2) for all. A start
    from which no equilibrium is found gives way to the unloaded shape. ``lanes``: `ONE` or `MANY`.
    """
    rows, n = angles.shape
    width = len(lanes)
    w = _make_work(rod, n, lanes)
    plain = np.zeros((5, width), np.int64)
    c = _Progress(plain[0], plain[1], plain[2], plain[3], plain[4], np.zeros(width), np.zeros(width))
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
                _load_lane(w, c, lane, lanes, waiting, load, k0[own * waiting], angles[waiting], warm)
                waiting += 1
            busy = busy or c.row[lane] >= 0
        if not busy:
            break
        _iterate(w, c, rod.soft, TOLERANCE * rod.scale, lanes)
        arrived = False
        for lane in range(width):
            arrived = arrived or w[ACTION, width + lane] == 3.0
            row = c.row[lane]
            if c.verdict[lane] == _SOLVED:
                for i in range(n):
                    angles[row, i] = w[THETA, (i + 1) * width + lane]
                results.energy[row] = _energy(w, lane, rod.soft, lanes)
                results.residual[row], results.converged[row] = w[RESIDUAL, tip + lane] / rod.scale, 1.0
                results.stable[row] = 1.0 if w[LOWEST, tip + lane] < 0.0 else 0.0
                results.branch[row], results.iterations[row] = 2 if warm else 0, c.steps[lane]
                c.row[lane] = -1
            elif c.verdict[lane] == _NOT_SIMPLE:
                left[rest] = row
                rest += 1
                c.row[lane] = -1
        _advance(w, arrived, lanes)
    scratch = np.empty((SCRATCH + 4, n))
    for k in range(rest):
        row = left[k]
        alone = Elastic(rod.h, rod.lever, rod.ei, k0[own * row], rod.soft, rod.scale)
        load = Load(force[row, 0], force[row, 1], float(moment[row]), carried)
        outcome, branch = _solve_alone(angles[row], alone, load, warm, scratch)
        results.energy[row], results.residual[row] = outcome.energy, outcome.residual
        results.converged[row], results.stable[row] = outcome.converged, outcome.stable
        results.branch[row], results.iterations[row] = branch, outcome.iterations
