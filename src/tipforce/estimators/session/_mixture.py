"""From the nodes of a walk to the force, its intervals, and the session's constants.

A node is a force at which the walk (`_walk`) fitted the line: ``scratch`` holds its components along the chord of the
shaft and across it, fit cost, and the standard deviation across. (``c``, ``s``) is the unit vector along the chord;
forces are in N, in the frame of the clamp. "No contact" is one further hypothesis, with a fit without force.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...mechanics.planar import FORCE, solve_in
from ...types import FloatArray, IntArray
from ._walk import DIRECTIONS, NODES, Fit, Scratch

_ACROSS = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
_ACROSS_SHARE = np.array([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0])
"""Across the walk: Gauss-Hermite, exact for the first five moments."""
_TAIL = 0.05
"""Share outside of the 90 % intervals, on either side."""
_PROFILE = 0.5 * 1.6448536**2
"""Difference of the costs within which a force explains the line as well as the best one: 90 %, one degree of freedom.
"""
_LEAST_SHARE = 1e-3
"""Nodes with a smaller share than this do not count for the constants."""
_MOST_FRICTION = 0.3
"""The normal of a tissue at the dome is at most 90 degrees from the tip's axis. Friction turns the force further."""
MOST_PULL = math.sin(math.atan(_MOST_FRICTION))
"""Largest share of a force in contact that pulls along the tip's axis."""
DIRECTIONS_RAD = math.pi + 2.0 * math.atan(_MOST_FRICTION)
"""Angle that the directions of a force in contact fill, about the tip's axis."""
EVEN_DIRECTIONS = np.ones(DIRECTIONS)
_HALVINGS = 6
"""Steps of the search for the last possible force between two nodes."""
_NEAR_NOTHING = 0.3
"""The density of a uniform magnitude is infinite at no force: it ends at this share of a node's distance."""


class Mixed(NamedTuple):
    """``force_n`` (2,), ``covariance_n2`` (2, 2): over contact and none; ``contact``: probability of contact.

    ``low_n``, ``high_n`` (3,): ends of the 90 % intervals of fx, fy and the magnitude. ``excess``: cost of the best
    possible hypothesis over that of the best force at all; see `is_possible`.
    """

    force_n: FloatArray
    covariance_n2: FloatArray
    contact: float
    low_n: FloatArray
    high_n: FloatArray
    excess: float


class Evidence(NamedTuple):
    """Knowledge of the force beside the line.

    ``log_odds``: logarithm of the Bayes factor of contact; (``towards_x``, ``towards_y``): direction of the force,
    whose density is the mean of von Mises distributions; ``strengths`` (k,): their concentrations; ``heights`` (k,):
    their densities over that of an even one, in the direction itself; ``density`` (n,): of the depth, at even forces
    from 0 to the largest, over its mean; ``unreliable``: probability that nothing of this holds; ``directions``
    (DIRECTIONS,): density of the direction by the frames before, over an even one.
    """

    log_odds: float
    towards_x: float
    towards_y: float
    strengths: FloatArray
    heights: FloatArray
    density: FloatArray
    unreliable: float
    directions: FloatArray


NO_EVIDENCE = Evidence(0.0, 1.0, 0.0, np.zeros(1), np.ones(1), np.ones(2), 1.0, EVEN_DIRECTIONS)


@njit(cache=True, nogil=True)
def _bin_of(x: float, y: float) -> int:
    """Returns the bin, of `DIRECTIONS`, of the direction (x, y)."""
    return int((math.atan2(y, x) / (2.0 * math.pi) + 0.5) * DIRECTIONS) % DIRECTIONS


@njit(cache=True, nogil=True)
def _depth_ratio(size: float, largest_n: float, evidence: Evidence) -> float:
    """Returns the likelihood ratio of the read depth: a force of this magnitude against any force in contact.

    The table ``evidence.density`` ends at ``largest_n``.
    """
    if evidence.unreliable >= 1.0:
        return 1.0
    count = evidence.density.size
    position = size / largest_n * (count - 1)  # in the table of densities, between whose values we interpolate
    below = min(int(position), count - 2)
    part = min(1.0, position - below)
    depth_ratio = (1.0 - part) * evidence.density[below] + part * evidence.density[below + 1]
    return (1.0 - evidence.unreliable) * depth_ratio + evidence.unreliable


@njit(cache=True, nogil=True)
def _direction_ratio(x: float, y: float, size: float, evidence: Evidence) -> float:
    """Returns the likelihood ratio of the read direction: force (x, y) of magnitude ``size`` against any direction."""
    if evidence.unreliable >= 1.0 or size <= 0.0:
        return 1.0
    cosine, ratio, count = (x * evidence.towards_x + y * evidence.towards_y) / size, 0.0, evidence.strengths.size
    for k in range(count):
        ratio += evidence.heights[k] * math.exp(evidence.strengths[k] * (cosine - 1.0)) / count
    return (1.0 - evidence.unreliable) * ratio + evidence.unreliable


@njit(cache=True, nogil=True)
def _force_at(node: int, offset_n: float, c: float, s: float, scratch: Scratch) -> tuple[float, float, float]:
    """Returns x, y and magnitude, N, of a node's force after ``offset_n`` is added across the chord (c, s)."""
    across, along = scratch.forces[node, 0] + offset_n, scratch.forces[node, 1]
    x, y = c * along - s * across, s * along + c * across
    return x, y, math.hypot(x, y)


@njit(cache=True, nogil=True)
def _quantile(values: FloatArray, order: IntArray, shares: FloatArray, level: float) -> float:
    """Returns the quantile ``level`` of points ``values`` (n,) with ``shares`` (n,), whose sum is 1.

    The cumulative distribution is interpolated; half of a point's share is below it. ``order`` (n,) sorts the points.
    """
    sum_below, last_level, last_value = 0.0, -1.0, values[order[0]]  # level -1: no point with a share yet
    for k in order:
        if shares[k] == 0.0:
            continue
        point_level = sum_below + 0.5 * shares[k]
        if point_level >= level:
            if last_level < 0.0 or point_level <= last_level:
                return float(values[k])
            part = (level - last_level) / (point_level - last_level)
            return float(last_value + part * (values[k] - last_value))
        sum_below += shares[k]
        last_level, last_value = point_level, values[k]
    return float(last_value)


@njit(cache=True, nogil=True)
def is_possible(x: float, y: float, size: float, axis_x: float, axis_y: float, largest_n: float) -> bool:
    """Returns whether a tissue can push so: not along the tip's axis (``axis_x``, ``axis_y``), but for friction."""
    return x * axis_x + y * axis_y < MOST_PULL * size and size <= largest_n


@njit(cache=True, nogil=True)
def _last_possible(
    here: tuple[float, float, float], there: tuple[float, float, float], axis_x: float, axis_y: float, largest_n: float
) -> tuple[float, float, float]:
    """Returns the last possible force on the way from ``here`` to ``there``, each x, y and magnitude.

    See `is_possible`. A magnitude of -1: neither end is possible.
    """
    if is_possible(*there, axis_x, axis_y, largest_n):
        return there
    if not is_possible(*here, axis_x, axis_y, largest_n):
        return 0.0, 0.0, -1.0
    for _ in range(_HALVINGS):
        x, y = 0.5 * (here[0] + there[0]), 0.5 * (here[1] + there[1])
        middle = x, y, math.hypot(x, y)
        if is_possible(*middle, axis_x, axis_y, largest_n):
            here = middle
        else:
            there = middle
    return here


@njit(cache=True, nogil=True)
def _stretch(force: tuple[float, float, float], low: FloatArray, high: FloatArray) -> None:
    """Widens the intervals ``low`` to ``high`` (3,) to a force: x, y, magnitude; -1 changes nothing."""
    if force[2] >= 0.0:
        for k in range(3):
            low[k], high[k] = min(low[k], force[k]), max(high[k], force[k])


@njit(cache=True, nogil=True)
def _widen_by_profile(
    found: int, c: float, s: float, axis_x: float, axis_y: float, free: Fit, largest_n: float, evidence: Evidence,
    low: FloatArray, high: FloatArray, scratch: Scratch,
) -> None:  # fmt: skip
    """Widens the intervals to all forces that explain the line nearly as well as the best one (profile likelihood).

    Where the shape shows nothing of a force, the prior alone would decide the quantiles, in favour of no contact.
    `_PROFILE` is the allowed difference of the costs. ``low`` and ``high`` (3,) are the ends for fx, fy and the
    magnitude, N, changed in place. A force in contact pushes against the tip's axis, the unit vector (``axis_x``,
    ``axis_y``), but for friction, and is at most ``largest_n``. For ``found``, ``free`` and ``evidence`` see
    `mixed_force`.
    """
    free_cost = free.cost + evidence.log_odds
    best = free_cost if free.ok else math.inf
    costs = np.empty(found)
    for i in range(found):
        x, y, size = _force_at(i, 0.0, c, s, scratch)
        ratio = _depth_ratio(size, largest_n, evidence) * _direction_ratio(x, y, size, evidence)
        costs[i] = scratch.costs[i] - math.log(ratio * evidence.directions[_bin_of(x, y)])
        best = min(best, costs[i])
    if free.ok and free_cost <= best + _PROFILE:
        low[2] = 0.0
        for axis in range(2):
            low[axis], high[axis] = min(low[axis], 0.0), max(high[axis], 0.0)
    for i in range(found):
        spare_cost = best + _PROFILE - costs[i]
        if spare_cost < 0.0:
            continue
        here = _force_at(i, 0.0, c, s, scratch)
        # across the walk the cost is quadratic: it rises by 0.5 (distance / std)^2
        reach_n = scratch.across_std[i] * math.sqrt(2.0 * spare_cost)
        for side in (-1.0, 0.0, 1.0):
            there = _force_at(i, side * reach_n, c, s, scratch)
            _stretch(_last_possible(here, there, axis_x, axis_y, largest_n), low, high)
        for k in (i - 1, i + 1):  # the last possible force may be between two nodes
            if 0 <= k < found and costs[k] <= best + _PROFILE:
                there = _force_at(k, 0.0, c, s, scratch)
                _stretch(_last_possible(here, there, axis_x, axis_y, largest_n), low, high)


@njit(cache=True, nogil=True)
def mixed_force(
    found: int, step_n: float, c: float, s: float, angle: float, free: Fit, prior_odds: float, largest_n: float,
    evidence: Evidence, scratch: Scratch,
) -> Mixed:  # fmt: skip
    """Returns the force of a line, averaged over contact and no contact; sets the nodes' shares in ``scratch``.

    Each node has three forces, at Gauss-Hermite points across the walk; "no contact" is one more force, zero.

    The prior of the force in contact is uniform in magnitude and direction, also where a free tip would buckle: a
    tissue holds the tip. It counts once, for the force of this line. For the constants the density is flat in the
    position of the tip and in the force over the stiffness, pulls included. Any other prior, counted again with every
    frame, would draw the constants to where its forces are: the limit to pushes alone moved forces across the tip's
    axis by 5 to 50 mN in a session (docs/results/session.md).

    Args:
        found: number of nodes.
        step_n: their distance.
        c: cosine of the direction of the walk.
        s: its sine.
        angle: of the tip's axis, rad: forces in contact push at the tip, but for friction.
        free: fit without a force.
        prior_odds: logarithm of the odds of contact beforehand.
        largest_n: the prior of the force ends here.
        evidence: knowledge beside the line: direction and depth that a network read at the tip.
        scratch: the nodes. Their shares become: ``weights``, for the constants, without any prior of the force;
            ``by_line``, with this prior and the directions; ``shares``, with the read depth as well. ``directions``
            become those of this line.

    Returns:
        The force, its probability of contact, and its intervals.
    """
    count = 3 * found
    points, shares = np.zeros((3, count + 1)), np.zeros(count + 1)  # rows: fx, fy, magnitude
    axis_x, axis_y = math.cos(angle), math.sin(angle)
    scratch.directions[:] = 0.0
    best = -math.inf  # subtracted from the log densities, so that exp() neither overflows nor is zero everywhere
    for i in range(found):
        best = max(best, scratch.weights[i])
    total_flat = total_direction = total_evidence = 0.0
    lowest_possible = free.cost if free.ok else math.inf
    lowest = lowest_possible
    for i in range(found):
        # the rate N/m turns a density of the force into one of the tip's position, the unknown that was integrated
        density, rate_n_per_m = math.exp(scratch.weights[i] - best), abs(scratch.node_rates[i, 0])
        flat = with_direction = with_evidence = 0.0
        lowest = min(lowest, scratch.costs[i])
        for j in range(3):
            x, y, size = _force_at(i, _ACROSS[j] * scratch.across_std[i], c, s, scratch)
            k = 3 * i + j
            points[0, k], points[1, k], points[2, k] = x, y, size
            if size <= largest_n:
                flat += density * _ACROSS_SHARE[j]
            if is_possible(x, y, size, axis_x, axis_y, largest_n):
                if _ACROSS[j] == 0.0:
                    lowest_possible = min(lowest_possible, scratch.costs[i])
                prior = rate_n_per_m / (DIRECTIONS_RAD * largest_n * math.hypot(size, _NEAR_NOTHING * step_n))
                share = density * _ACROSS_SHARE[j] * prior * _direction_ratio(x, y, size, evidence)
                place = _bin_of(x, y)
                scratch.directions[place] += share
                share *= evidence.directions[place]
                with_direction += share
                shares[k] = share * _depth_ratio(size, largest_n, evidence)
                with_evidence += shares[k]
        scratch.weights[i], scratch.by_line[i], scratch.shares[i] = flat, with_direction, with_evidence
        total_flat += flat
        total_direction += with_direction
        total_evidence += with_evidence
    contact = 0.0
    if total_direction > 0.0 and total_flat > 0.0:
        # both densities are integrals of exp(-cost); the common factors of the other unknowns cancel
        log_touching = math.log(total_direction * step_n * math.sqrt(2.0 * math.pi)) + best
        log_free = -free.cost - 0.5 * free.log_det if free.ok else -math.inf
        log_odds = max(-60.0, min(60.0, log_touching - log_free + prior_odds + evidence.log_odds))
        contact = 1.0 / (1.0 + math.exp(-log_odds))
    for k in range(count):
        shares[k] *= contact / total_evidence if total_evidence > 0.0 else 0.0
    for i in range(found):
        scratch.weights[i] /= total_flat if total_flat > 0.0 else 1.0
        scratch.by_line[i] /= total_direction if total_direction > 0.0 else 1.0
        scratch.shares[i] /= total_evidence if total_evidence > 0.0 else 1.0
    shares[count] = 1.0 - contact
    mean, covariance = np.zeros(2), np.zeros((2, 2))
    for k in range(count):
        for a in range(2):
            mean[a] += shares[k] * points[a, k]
    for k in range(count + 1):
        for a in range(2):
            for b in range(2):
                covariance[a, b] += shares[k] * (points[a, k] - mean[a]) * (points[b, k] - mean[b])
    low, high = np.zeros(3), np.zeros(3)
    for a in range(3):
        order = np.argsort(points[a])
        low[a], high[a] = _quantile(points[a], order, shares, _TAIL), _quantile(points[a], order, shares, 1.0 - _TAIL)
    if contact > 0.0:
        _widen_by_profile(found, c, s, axis_x, axis_y, free, largest_n, evidence, low, high, scratch)
    excess = lowest_possible - lowest if lowest < math.inf else 0.0
    return Mixed(mean, covariance, contact, low, high, excess)


@njit(cache=True, nogil=True)
def mixed_constants(
    found: int, weights: FloatArray, contact: float, free_q: FloatArray, free_factor: FloatArray, c: float, s: float,
    scratch: Scratch,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Returns mean (unknowns,) and covariance (unknowns, unknowns) over the nodes and the fit without a force.

    The result is the Gaussian with the moments of a mixture: each node adds its own Gaussian (Laplace's approximation
    at fixed force along the chord) and its distance from the mean. The first two unknowns are the force in x and y.

    Args:
        found: number of nodes.
        weights: (NODES,) shares of the nodes: ``weights`` or ``shares`` of ``scratch``.
        contact: probability of contact.
        free_q: (unknowns,) fit without a force.
        free_factor: (unknowns, unknowns) Cholesky factor of its information.
        c: cosine of the direction of the walk.
        s: its sine.
        scratch: the nodes.
    """
    n = free_q.size
    shares = np.zeros(NODES + 1)  # the last used one is that of no contact
    total = 0.0
    for i in range(found):
        share = contact * weights[i]
        shares[i] = share if share > _LEAST_SHARE * contact else 0.0
        total += shares[i]
    shares[found] = 1.0 - contact if contact < 1.0 - 1e-6 else 0.0
    total += shares[found]
    mean, covariance = np.zeros(n), np.zeros((n, n))
    for i in range(found + 1):
        share = shares[i] / total
        if share > 0.0:
            q = scratch.nodes[i] if i < found else free_q
            for a in range(n):
                mean[a] += share * q[a]
    column = np.zeros(n)
    for i in range(found + 1):
        share = shares[i] / total
        if share == 0.0:
            continue
        q = scratch.nodes[i] if i < found else free_q
        factor = scratch.factors[i] if i < found else free_factor
        for a in range(n):
            for b in range(n):
                covariance[a, b] += share * (q[a] - mean[a]) * (q[b] - mean[b])
        for a in range(FORCE, n):  # the node's own covariance: the inverse of its information, column by column
            for b in range(n):
                column[b] = 1.0 if a == b else 0.0
            solve_in(factor, column)
            for b in range(FORCE, n):
                covariance[a, b] += share * column[b]
        if i == found:
            continue
        # the force across the walk depends on the unknowns by node_rates: its covariance with them, then its variance
        variance = 0.0
        column[:] = scratch.node_rates[i]
        solve_in(factor, column)
        for b in range(n):
            variance += share * column[b] * scratch.node_rates[i, b]
        for b in range(FORCE, n):  # the direction across is (-s, c)
            covariance[0, b] -= s * share * column[b]
            covariance[b, 0] -= s * share * column[b]
            covariance[1, b] += c * share * column[b]
            covariance[b, 1] += c * share * column[b]
        covariance[0, 0] += s * s * variance
        covariance[1, 1] += c * c * variance
        covariance[0, 1] -= c * s * variance
        covariance[1, 0] -= c * s * variance
    return mean, covariance
