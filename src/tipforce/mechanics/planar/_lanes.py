"""The free planar rod under several loads side by side: equilibrium, its factors, and the way ahead.

The mechanics are those of `_newton`, without springs. One load alone waits most of the time: each pivot of the
tridiagonal Hessian needs the one before it. Here every row of the work array holds, for element after element, the
numbers of all lanes, one lane a load. Where elements do not wait for each other, loops go along a whole row, eight
numbers at a time, whosever they are; where one waits for the next, all lanes go together, from both ends of the rod at
once. A row begins and ends with the zeros of an element that does not exist, and has room for the last eight.
"""

from typing import Any

import numpy as np

from ..._compile import compiled_together
from ...types import FloatArray
from ._newton import Elastic, bending_density
from ._octet import EIGHT, alike, choose, fma, inverse, larger, largest_of, magnitude, nothing, put, take
from ._sincos import circle

__all__ = [
    "CARRY", "GO", "K0", "LONGEST", "LOWEST", "MISS", "MOMENT", "PX", "PY", "REACH", "RESIDUAL", "SHARE", "SIZES",
    "SPAN", "THETA",
    "advance", "compiled", "elements", "energy_in", "evaluate", "factorise", "look_ahead", "make_lanes",
    "measure_way",
]  # fmt: skip

compiled = compiled_together(__file__, "_*.py")

ORDER = 4
"""Of the series by which a shape goes on with the share of its load."""

# Rows of the work array. Of the rod: 1 / length of shaft in a joint, EI, length of an element.
SPAN, EI, REACH = 0, 1, 2
# Of the loads: pre-curvature, reach times the force carried there, moment at the tip.
K0, PX, PY, MOMENT = 3, 4, 5, 6
# Angles; curvature, moment and its slope in the joints.
THETA, CURVATURE, HELD, SLOPE = 7, 8, 9, 10
# Moment of the whole force on an element, and minus its slope with the angle; the Hessian, its factors, Newton's step.
PULL, TURN, DIAGONAL, FACTOR, INVERSE, STEP = 11, 12, 13, 14, 15, 16
# Series of the branch at the angles (`look_ahead`), ORDER rows; angles that the branch was followed to, series there.
NEXT, BASE, WAY = 17, 21, 22
# Of each load, in the first element alone: share of it all that acts; what `advance` is told: how far along the series,
# and which way.
SHARE, CARRY, GO = 26, 27, 28
# Largest along the rod, in the last element alone: moment out of balance, minus 1 / pivot, change of an angle in a
# step, difference between the series' slope and the next one, and of the terms of the next series.
RESIDUAL, LOWEST, LONGEST, MISS, SIZES = 29, 30, 31, 32, 33
EXTRA = SIZES + ORDER
_ROWS = EXTRA + 1


@compiled
def elements(w: FloatArray, lanes: tuple[float, ...]) -> int:
    """How many elements a rod has in the work array."""
    return (w.shape[1] - len(EIGHT)) // len(lanes) - 2


@compiled
def _told(w: FloatArray, row: int, lanes: tuple[float, ...]) -> Any:
    """What stands in the first element, for eight numbers at any place."""
    return take(w[row], len(lanes), EIGHT) if len(lanes) == len(EIGHT) else alike(w[row, 1], nothing(EIGHT))


@compiled
def make_lanes(rod: Elastic, n: int, lanes: tuple[float, ...]) -> FloatArray:
    """The work array of ``n`` elements: straight rods without load or pre-curvature."""
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
def evaluate(w: FloatArray, soft: float, lanes: tuple[float, ...]) -> None:
    """Moments and Hessian at the angles; what is out of balance becomes the step's right side."""
    width = len(lanes)
    end = (elements(w, lanes) + 1) * width
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
        put(w[HELD], j, held)
        px, py = take(w[PX], j, EIGHT), take(w[PY], j, EIGHT)
        put(w[PULL], j, py * cosine - px * sine)
        put(w[TURN], j, px * cosine + py * sine)
    share = _told(w, SHARE, lanes)
    for j in range(width, end, len(EIGHT)):
        after = j + width
        load = take(w[PULL], j, EIGHT) + take(w[MOMENT], j, EIGHT)
        put(w[STEP], j, fma(share, load, take(w[HELD], after, EIGHT) - take(w[HELD], j, EIGHT)))
        stiff = take(w[SLOPE], j, EIGHT) + take(w[SLOPE], after, EIGHT)
        put(w[DIAGONAL], j, fma(share, take(w[TURN], j, EIGHT), stiff))


@compiled
def factorise(w: FloatArray, lanes: tuple[float, ...]) -> None:
    """Hessian = L D L', eliminated from both ends at once; solves for Newton's step.

    Either end's chain of pivots has half the length, and one is reckoned while the other waits. FACTOR belongs to the
    joint before an element. Off the diagonal stands minus the slope.
    """
    width, n = len(lanes), elements(w, lanes)
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
    """Overwrite a row of NEXT by the solution, with the factors of `factorise`; the largest of it goes into SIZES."""
    width, n = len(lanes), elements(w, lanes)
    answer, factor = w[NEXT + order - 1], w[FACTOR]
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
    put(w[SIZES + order - 1], n * width, _back(w, NEXT + order - 1, lanes))


@compiled
def _back(w: FloatArray, row: int, lanes: tuple[float, ...]) -> Any:
    """The second half of a solution, from the middle to both ends; returns the largest of it."""
    width, n = len(lanes), elements(w, lanes)
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
def look_ahead(w: FloatArray, soft: float, lanes: tuple[float, ...]) -> None:
    """The branch as a series: its angles are theta + sum of NEXT_k (change of the share)^k, k = 1 to ORDER.

    Each order of the equilibrium's own power series is one more solution with the same factors (the asymptotic
    numerical method, Cochelin 1994). With T_k the rows, exp(i theta) has the coefficients (a_k + i b_k) exp(i theta_0):
    what a_k and b_k hold of lower orders goes to the right side.
    """
    width = len(lanes)
    end = (elements(w, lanes) + 1) * width
    share = _told(w, SHARE, lanes)
    half, sixth, over24 = alike(0.5, share), alike(1.0 / 6.0, share), alike(1.0 / 24.0, share)
    for j in range(width, end, len(EIGHT)):
        put(w[NEXT], j, take(w[PULL], j, EIGHT) + take(w[MOMENT], j, EIGHT))
    _solve(w, 1, lanes)
    for j in range(width, end, len(EIGHT)):
        t, pull, turn = take(w[NEXT], j, EIGHT), take(w[PULL], j, EIGHT), take(w[TURN], j, EIGHT)
        put(w[NEXT + 1], j, nothing(EIGHT) - t * fma(half * share * t, pull, turn))
    if soft > 0.0:
        _stiffen(w, soft, 2, lanes)
    _solve(w, 2, lanes)
    for j in range(width, end, len(EIGHT)):
        t, u = take(w[NEXT], j, EIGHT), take(w[NEXT + 1], j, EIGHT)
        pull, turn = take(w[PULL], j, EIGHT), take(w[TURN], j, EIGHT)
        put(w[NEXT + 2], j, (share * t * t * t * sixth - u) * turn - t * fma(share, u, half * t) * pull)
    if soft > 0.0:
        _stiffen(w, soft, 3, lanes)
    _solve(w, 3, lanes)
    for j in range(width, end, len(EIGHT)):
        t, u, x = take(w[NEXT], j, EIGHT), take(w[NEXT + 1], j, EIGHT), take(w[NEXT + 2], j, EIGHT)
        pull, turn = take(w[PULL], j, EIGHT), take(w[TURN], j, EIGHT)
        a = t * t * t * t * over24 - t * x - half * u * u
        b = half * share * t * t * u - x + t * t * t * sixth
        put(w[NEXT + 3], j, (share * a - t * u) * pull + b * turn)
    if soft > 0.0:
        _stiffen(w, soft, 4, lanes)
    _solve(w, 4, lanes)


@compiled
def _stiffen(w: FloatArray, soft: float, order: int, lanes: tuple[float, ...]) -> None:
    """Take from the right side what lower orders have in the stiffening moment EI soft (k^3 - k_0 k^2)."""
    width = len(lanes)
    size = elements(w, lanes) * width
    own = slice(width, width + size)
    one, two, three, extra = w[NEXT], w[NEXT + 1], w[NEXT + 2], w[EXTRA]
    span, curvature, k0, ei, side = w[SPAN, own], w[CURVATURE, own], w[K0, own], w[EI, own], w[NEXT + order - 1, own]
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
def measure_way(w: FloatArray, lanes: tuple[float, ...]) -> None:
    """How far the slope of the next series is off the one that the last series ends with, at most."""
    width, n = len(lanes), elements(w, lanes)
    h = _told(w, CARRY, lanes)
    two, three, four = alike(2.0, h), alike(3.0, h), alike(4.0, h)
    largest = nothing(EIGHT)
    for j in range(width, (n + 1) * width, len(EIGHT)):
        slope = fma(four * h, take(w[WAY + 3], j, EIGHT), three * take(w[WAY + 2], j, EIGHT))
        slope = fma(h, fma(h, slope, two * take(w[WAY + 1], j, EIGHT)), take(w[WAY], j, EIGHT))
        largest = larger(largest, magnitude(take(w[NEXT], j, EIGHT) - slope))
    put(w[MISS], n * width, largest_of(largest, lanes))


@compiled
def advance(w: FloatArray, arrived: bool, lanes: tuple[float, ...]) -> None:
    """New angles in every lane, as its GO says, where also its SHARE and CARRY stand.

    0: none; 1: by Newton's step; 2: along the series WAY from BASE by CARRY; 3: the same, but Newton's step leads to
    the BASE, and NEXT is the WAY from now on. ``arrived``: some lane has 3.
    """
    width = len(lanes)
    end = (elements(w, lanes) + 1) * width
    go, h = _told(w, GO, lanes), _told(w, CARRY, lanes)
    new, series, some = go - alike(2.5, go), go - alike(1.5, go), go - alike(0.5, go)
    for j in range(width, end, len(EIGHT)):
        now = take(w[THETA], j, EIGHT)
        on, base = now + take(w[STEP], j, EIGHT), take(w[BASE], j, EIGHT)
        if arrived:
            base = choose(new, on, base)
            put(w[BASE], j, base)
        along = nothing(EIGHT)
        for k in range(ORDER - 1, -1, -1):
            term = take(w[WAY + k], j, EIGHT)
            if arrived:
                term = choose(new, take(w[NEXT + k], j, EIGHT), term)
                put(w[WAY + k], j, term)
            along = h * (term + along)
        put(w[THETA], j, choose(series, base + along, choose(some, on, now)))


@compiled
def energy_in(w: FloatArray, lane: int, soft: float, lanes: tuple[float, ...]) -> float:
    """Energy of one lane where `evaluate` was last: bending energy less the work of the whole load."""
    width, total = len(lanes), 0.0
    for j in range(width + lane, (elements(w, lanes) + 1) * width, width):
        total += w[EI, j] * bending_density(w[CURVATURE, j], w[K0, j], soft) / w[SPAN, j]
        total -= w[TURN, j] + w[MOMENT, j] * w[THETA, j]
    return total
