"""The free planar rod under several loads side by side: equilibrium, its factors, and the way ahead.

The mechanics are those of `_newton`, without springs. One load alone waits most of the time: each pivot of the
tridiagonal Hessian needs the one before it. Here every row of the work array holds, for element after element, the
numbers of all lanes, one lane a load. Where elements do not wait for each other, loops run along a whole row, and the
compiler makes vector instructions of them; where one waits for the next, all lanes go together (`_octet`), from both
ends of the rod at once. A row begins and ends with the zeros of an element that does not exist.
"""

from typing import Any

import numpy as np

from .._compile import compiled_together
from ..types import FloatArray
from ._newton import Elastic, bending_density
from ._octet import fma, inverse, larger, magnitude, minus, nothing, put, take, times
from ._sincos import sincos

__all__ = [
    "CARRY", "GO", "K0", "LONGEST", "LOWEST", "MISS", "MOMENT", "PX", "PY", "REACH", "RESIDUAL", "SHARE", "SIZES",
    "SPAN", "THETA",
    "advance", "compiled", "energy_in", "evaluate", "factorise", "look_ahead", "make_lanes", "measure_way",
]  # fmt: skip

compiled = compiled_together(__file__, "_*.py")

ORDER = 4
"""Of the series by which a shape goes on with the share of its load."""

# Rows of the work array. Of the rod: 1 / length of shaft in a joint, EI, length of an element.
SPAN, EI, REACH = 0, 1, 2
# Of the loads: pre-curvature, reach times the force carried there, moment at the tip, share of it all that acts.
K0, PX, PY, MOMENT, SHARE = 3, 4, 5, 6, 7
# Angles; their cosines and sines; curvature, moment and its slope in the joints.
THETA, COSINE, SINE, CURVATURE, HELD, SLOPE = 8, 9, 10, 11, 12, 13
# Moment of the whole force on an element, and minus its slope with the angle; the Hessian, its factors, Newton's step.
PULL, TURN, DIAGONAL, FACTOR, INVERSE, STEP = 14, 15, 16, 17, 18, 19
# Series of the branch at the angles (`look_ahead`), ORDER rows; angles that the branch was followed to, series there.
NEXT, BASE, WAY = 20, 24, 25
# What `advance` is told: how far along the series, how much of Newton's step, which of the two.
CARRY, GO = 29, 30
# Largest along the rod, in each row's last element: moment out of balance, minus 1 / pivot, change of an angle in a
# step, difference between the series' slope and the next one, and of the terms of the next series.
RESIDUAL, LOWEST, LONGEST, MISS, SIZES = 31, 32, 33, 34, 35
EXTRA = SIZES + ORDER
_ROWS = EXTRA + 1


@compiled
def make_lanes(rod: Elastic, n: int, lanes: tuple[float, ...]) -> FloatArray:
    """The work array of ``n`` elements: straight rods without load or pre-curvature."""
    width = len(lanes)
    w = np.zeros((_ROWS, (n + 2) * width))
    for i in range(n):
        for j in range((i + 1) * width, (i + 2) * width):
            w[SPAN, j] = (2.0 if i == 0 or i == n - 1 else 1.0) / rod.h
            w[EI, j] = rod.ei[i]
            w[REACH, j] = rod.h if i < n - 1 else rod.lever
            w[SLOPE, j] = w[EI, j] * w[SPAN, j]
    for j in range(width):
        w[LOWEST, j] = -1e300
    return w


@compiled
def evaluate(w: FloatArray, soft: float, lanes: tuple[float, ...]) -> None:
    """Moments and Hessian at the angles; what is out of balance becomes the step's right side."""
    width = len(lanes)
    size = w.shape[1] - 2 * width
    own = slice(width, width + size)
    k, k0, ei, span = w[CURVATURE, own], w[K0, own], w[EI, own], w[SPAN, own]
    cosine, sine, px, py = w[COSINE, own], w[SINE, own], w[PX, own], w[PY, own]
    share, pull, turn, moment = w[SHARE, own], w[PULL, own], w[TURN, own], w[MOMENT, own]
    held, slope, step, diagonal = w[HELD, own], w[SLOPE, own], w[STEP, own], w[DIAGONAL, own]
    theta, held_next, slope_next = w[THETA], w[HELD, 2 * width :], w[SLOPE, 2 * width :]
    sincos(theta[own], cosine, sine)
    # Few arrays in a loop: with many of them the compiler gives up telling them apart.
    for j in range(size):
        k[j] = (theta[j + width] - theta[j]) * span[j]
    if soft > 0.0:
        for j in range(size):
            held[j] = ei[j] * (1.0 + soft * k[j] * k[j]) * (k[j] - k0[j])
        for j in range(size):
            slope[j] = ei[j] * span[j] * (1.0 + soft * k[j] * (3.0 * k[j] - 2.0 * k0[j]))
    else:
        for j in range(size):
            held[j] = ei[j] * (k[j] - k0[j])
    for j in range(size):
        pull[j] = py[j] * cosine[j] - px[j] * sine[j]
    for j in range(size):
        turn[j] = px[j] * cosine[j] + py[j] * sine[j]
    for j in range(size):
        step[j] = held_next[j] - held[j] + share[j] * (pull[j] + moment[j])
    for j in range(size):
        diagonal[j] = slope[j] + slope_next[j] + share[j] * turn[j]


@compiled
def factorise(w: FloatArray, lanes: tuple[float, ...]) -> None:
    """Hessian = L D L', eliminated from both ends at once; solves for Newton's step.

    Either end's chain of pivots has half the length, and one is reckoned while the other waits. FACTOR belongs to the
    joint before an element. Off the diagonal stands minus the slope.
    """
    n = w.shape[1] // len(lanes) - 2
    slope, diagonal, inverted, factor, step = w[SLOPE], w[DIAGONAL], w[INVERSE], w[FACTOR], w[STEP]
    middle = n // 2 + 1
    low = high = low_side = high_side = residual = nothing(lanes)
    lowest = take(w[LOWEST], 0, lanes)  # what no pivot is below
    for k in range(1, middle):
        joint = take(slope, k, lanes)
        share = times(joint, low)
        low = inverse(fma(minus(joint), share, take(diagonal, k, lanes)))
        side = take(step, k, lanes)
        low_side = fma(share, low_side, side)
        put(factor, k, share)
        put(inverted, k, low)
        put(step, k, low_side)
        residual, lowest = larger(residual, magnitude(side)), larger(lowest, minus(low))
        j = n + 1 - k
        if j == middle:
            continue
        joint = take(slope, j + 1, lanes)
        share = times(joint, high)
        high = inverse(fma(minus(joint), share, take(diagonal, j, lanes)))
        side = take(step, j, lanes)
        high_side = fma(share, high_side, side)
        put(factor, j + 1, share)
        put(inverted, j, high)
        put(step, j, high_side)
        residual, lowest = larger(residual, magnitude(side)), larger(lowest, minus(high))
    joint, other = take(slope, middle, lanes), take(slope, middle + 1, lanes)
    share, part = times(joint, low), times(other, high)
    both = inverse(fma(minus(joint), share, fma(minus(other), part, take(diagonal, middle, lanes))))
    side = take(step, middle, lanes)
    put(factor, middle, share)
    put(factor, middle + 1, part)
    put(inverted, middle, both)
    put(step, middle, fma(share, low_side, fma(part, high_side, side)))
    put(w[RESIDUAL], n, larger(residual, magnitude(side)))
    put(w[LOWEST], n, larger(lowest, minus(both)))
    put(w[LONGEST], n, _back(w, STEP, lanes))


@compiled
def _solve(w: FloatArray, row: int, lanes: tuple[float, ...]) -> None:
    """Overwrite a row by the solution, with the factors of `factorise`; the largest of it goes into its SIZES."""
    n = w.shape[1] // len(lanes) - 2
    answer, factor = w[row], w[FACTOR]
    middle = n // 2 + 1
    low, high = nothing(lanes), nothing(lanes)
    for k in range(1, middle):
        low = fma(take(factor, k, lanes), low, take(answer, k, lanes))
        put(answer, k, low)
        j = n + 1 - k
        if j == middle:
            continue
        high = fma(take(factor, j + 1, lanes), high, take(answer, j, lanes))
        put(answer, j, high)
    side = fma(take(factor, middle, lanes), low, take(answer, middle, lanes))
    put(answer, middle, fma(take(factor, middle + 1, lanes), high, side))
    put(w[SIZES + row - NEXT], n, _back(w, row, lanes))


@compiled
def _back(w: FloatArray, row: int, lanes: tuple[float, ...]) -> Any:
    """The second half of a solution, from the middle to both ends; returns the largest of it."""
    n = w.shape[1] // len(lanes) - 2
    answer, factor, inverted = w[row], w[FACTOR], w[INVERSE]
    middle = n // 2 + 1
    low = times(take(answer, middle, lanes), take(inverted, middle, lanes))
    put(answer, middle, low)
    high, largest = low, magnitude(low)
    for k in range(middle - 1, 0, -1):
        low = fma(take(factor, k + 1, lanes), low, times(take(answer, k, lanes), take(inverted, k, lanes)))
        put(answer, k, low)
        largest = larger(largest, magnitude(low))
        j = n + 1 - k
        if j == middle:
            continue
        high = fma(take(factor, j, lanes), high, times(take(answer, j, lanes), take(inverted, j, lanes)))
        put(answer, j, high)
        largest = larger(largest, magnitude(high))
    return largest


@compiled
def look_ahead(w: FloatArray, soft: float, lanes: tuple[float, ...]) -> None:
    """The branch as a series: its angles are theta + sum of NEXT_k (change of the share)^k, k = 1 to ORDER.

    Each order of the equilibrium's own power series is one more solution with the same factors (the asymptotic
    numerical method, Cochelin 1994). With T_k the rows, exp(i theta) has the coefficients (a_k + i b_k) exp(i theta_0):
    what a_k and b_k hold of lower orders goes to the right side.
    """
    width = len(lanes)
    size = w.shape[1] - 2 * width
    own = slice(width, width + size)
    pull, turn, share, moment = w[PULL, own], w[TURN, own], w[SHARE, own], w[MOMENT, own]
    one, two, three, four = w[NEXT, own], w[NEXT + 1, own], w[NEXT + 2, own], w[NEXT + 3, own]
    for j in range(size):
        one[j] = pull[j] + moment[j]
    _solve(w, NEXT, lanes)
    for j in range(size):
        two[j] = -one[j] * (0.5 * share[j] * one[j] * pull[j] + turn[j])
    if soft > 0.0:
        _stiffen(w, soft, 2, lanes)
    _solve(w, NEXT + 1, lanes)
    for j in range(size):
        t = one[j]
        three[j] = (share[j] * t * t * t / 6.0 - two[j]) * turn[j] - t * (share[j] * two[j] + 0.5 * t) * pull[j]
    if soft > 0.0:
        _stiffen(w, soft, 3, lanes)
    _solve(w, NEXT + 2, lanes)
    for j in range(size):
        t, u = one[j], two[j]
        a = t * t * t * t / 24.0 - t * three[j] - 0.5 * u * u
        b = 0.5 * share[j] * t * t * u - three[j] + t * t * t / 6.0
        four[j] = (share[j] * a - t * u) * pull[j] + b * turn[j]
    if soft > 0.0:
        _stiffen(w, soft, 4, lanes)
    _solve(w, NEXT + 3, lanes)


@compiled
def _stiffen(w: FloatArray, soft: float, order: int, lanes: tuple[float, ...]) -> None:
    """Take from the right side what lower orders have in the stiffening moment EI soft (k^3 - k_0 k^2)."""
    width = len(lanes)
    size = w.shape[1] - 2 * width
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
    width = len(lanes)
    length = w.shape[1] - 2 * width
    own = slice(width, width + length)
    h, miss, one = w[CARRY, own], w[MISS, own], w[NEXT, own]
    w1, w2, w3, w4 = w[WAY, own], w[WAY + 1, own], w[WAY + 2, own], w[WAY + 3, own]
    for j in range(length):
        slope = w1[j] + h[j] * (2.0 * w2[j] + h[j] * (3.0 * w3[j] + 4.0 * h[j] * w4[j]))
        miss[j] = abs(one[j] - slope)
    n = length // width
    largest = nothing(lanes)
    for i in range(n):
        largest = larger(largest, take(miss, i, lanes))
    put(miss, n - 1, largest)


@compiled
def advance(w: FloatArray, arrived: bool, lanes: tuple[float, ...]) -> None:
    """New angles in every lane, as the first element of its GO says, where also its SHARE and CARRY stand.

    0: none; 1: by Newton's step; 2: along the series WAY from BASE by CARRY; 3: the same, but Newton's step leads to
    the BASE, and NEXT is the WAY from now on. ``arrived``: some lane has 3.
    """
    width = len(lanes)
    size = w.shape[1] - 2 * width
    own = slice(width, width + size)
    for row in (GO, CARRY, SHARE):
        told = w[row, width:]
        for j in range(size - width):
            told[j + width] = told[j]
    go, h, theta, base, step = w[GO, own], w[CARRY, own], w[THETA, own], w[BASE, own], w[STEP, own]
    if arrived:
        for j in range(size):
            now, was = theta[j] + step[j], base[j]
            base[j] = now if go[j] == 3.0 else was
        for k in range(ORDER):
            old, new = w[WAY + k, own], w[NEXT + k, own]
            for j in range(size):
                now, was = new[j], old[j]
                old[j] = now if go[j] == 3.0 else was
    for j in range(size):
        now, on = theta[j], theta[j] + step[j]
        theta[j] = on if go[j] == 1.0 else now
    w1, w2, w3, w4 = w[WAY, own], w[WAY + 1, own], w[WAY + 2, own], w[WAY + 3, own]
    for j in range(size):
        on, now = base[j] + h[j] * (w1[j] + h[j] * (w2[j] + h[j] * (w3[j] + h[j] * w4[j]))), theta[j]
        theta[j] = on if go[j] >= 2.0 else now


@compiled
def energy_in(w: FloatArray, lane: int, soft: float, lanes: tuple[float, ...]) -> float:
    """Energy of one lane where `evaluate` was last: bending energy less the work of the whole load."""
    width, total = len(lanes), 0.0
    for j in range(width + lane, w.shape[1] - width, width):
        total += w[EI, j] * bending_density(w[CURVATURE, j], w[K0, j], soft) / w[SPAN, j]
        total -= w[TURN, j] + w[MOMENT, j] * w[THETA, j]
    return total
