"""From the nodes of one or several grids to the force, its intervals, and the constants of the session."""

import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from ..session import DIRECTIONS_RAD, MOST_PULL
from ._constants import FORCE
from ._direction import SpaceDirection
from ._posterior import Fit, Nodes

_ROOTS = (-math.sqrt(3.0), 0.0, math.sqrt(3.0))
_SHARES = (1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0)
"""Across the grid: Gauss-Hermite, exact for the first five moments."""
_MODE_SHARE = 0.05
"""A mirror image with a smaller share does not count as a mode."""
_TAIL = 0.05
"""Share outside of the 90 % intervals, on either side."""
_PROFILE = 0.5 * 1.6448536**2
"""Difference of the costs within which a force explains the lines as well as the best one: 90 %, one degree of freedom.
"""
_NEAR_NOTHING = 0.3
"""The prior's density is infinite at no force and along the axis: it ends at this share of a node's distance."""


class SpaceForce(NamedTuple):
    """Posterior of the force.

    Attributes:
        force_n: (3,) mean over contact and none.
        covariance_n2: (3, 3).
        contact: probability of contact.
        low_n: (4,) lower ends of the 90 % intervals of fx, fy, fz and the magnitude.
        high_n: (4,) upper ends.
        modes: number of separate forces that explain the lines: 2 where one view leaves the depth open up to its mirror
            image, 0 where no force that pushes at the tip does.
    """

    force_n: FloatArray
    covariance_n2: FloatArray
    contact: float
    low_n: FloatArray
    high_n: FloatArray
    modes: int


class _Samples(NamedTuple):
    """``points`` (n, 3) of the force, N; their weights without (``flat``) and with its prior; the node of each.

    ``of_direction``: (n,) likelihood of the direction of each, by this frame alone.
    """

    points: FloatArray
    flat: FloatArray
    weight: FloatArray
    of_direction: FloatArray
    of_node: IntArray


def _samples(nodes: Nodes, best: float, largest_n: float, direction: SpaceDirection) -> _Samples:
    """Returns weighted points of the force: at each node of a grid, Gauss-Hermite points in the free directions.

    The prior of the force is uniform in its magnitude, in the angle to the tip's axis, and about this axis; it ends at
    ``largest_n``, and at the angle to which friction may turn a push (`DIRECTIONS_RAD`). The frames before show the
    ``direction``. As a density in space it is infinite at no force and along the axis: `_NEAR_NOTHING` limits it.
    Weights are relative to a density whose logarithm is ``best``.
    """
    free = FORCE - nodes.held
    covariance = nodes.basis.T @ nodes.covariance[:, :FORCE, :FORCE] @ nodes.basis
    root = np.linalg.cholesky(covariance[:, :free, :free] + 1e-14 * np.eye(free))  # 1e-14 N^2: rounding
    # the Gauss-Hermite points of a standard normal distribution in these directions, and their shares
    unit = np.array(list(product(_ROOTS, repeat=free)))
    share = np.prod(np.array(list(product(_SHARES, repeat=free))), axis=1)
    offsets = np.einsum("pij,sj->psi", root, unit) @ nodes.basis[:, :free].T
    points = (nodes.q[:, None, :FORCE] + offsets).reshape(-1, FORCE)
    size = np.linalg.norm(points, axis=1)
    axial = np.einsum("psk,pk->ps", points.reshape(len(nodes.q), -1, FORCE), nodes.tip_axis).ravel()
    flat = (np.exp(nodes.log_weight - best)[:, None] * share).ravel() * (size <= largest_n)
    node_width_n = nodes.spacing ** (1.0 / nodes.held)
    free_std_n = np.sqrt(np.einsum("pkk->p", covariance[:, :free, :free]) / free)
    least2 = np.repeat((_NEAR_NOTHING * node_width_n) ** 2 + 0.25 * free_std_n**2, len(unit))
    lateral2 = np.maximum(size**2 - axial**2, 0.0)
    of_magnitude = 1.0 / (largest_n * np.sqrt(size**2 + least2))
    of_angle = 1.0 / (math.pi * DIRECTIONS_RAD * np.sqrt(lateral2 + least2))
    # the volume of a node, and of the Gaussian across it; the other unknowns are the same with and without a force
    volume = nodes.spacing * (2.0 * math.pi) ** (0.5 * free)
    flat *= volume
    possible = flat * of_magnitude * _is_possible(axial, size, largest_n)
    weight = possible * of_angle * direction.density(points, nodes.tip_axis[int(nodes.log_weight.argmax())])
    of_direction = possible / np.sqrt(size**2 + least2)  # an angle has an area of the size squared
    return _Samples(points, flat, weight, of_direction, np.repeat(np.arange(len(nodes.q)), len(unit)))


def _is_possible(axial: FloatArray, size: FloatArray, largest_n: float) -> npt.NDArray[np.bool_]:
    """Returns (n,) whether a tissue can push so: not along the tip's axis, but for friction, and at most so much.

    Args:
        axial: (n,) components of the forces along the tip's axis, N.
        size: (n,) their magnitudes, N.
        largest_n: the prior of the force ends here.
    """
    return (axial < MOST_PULL * size) & (size <= largest_n)


def mixed_force(
    grids: Sequence[Nodes], free: Fit, log_odds: float, largest_n: float, direction: SpaceDirection
) -> tuple[SpaceForce, list[FloatArray], tuple[FloatArray, FloatArray]]:
    """Returns the force, averaged over contact and no contact, and the nodes' shares for the constants.

    Each hypothesis counts with its prior odds and the integral of its density. No contact is one more point, zero.

    The prior of the force counts once, for the force of this instant. For the constants its prior is flat, pulls
    included: one that prefers some forces, counted again with every instant, would draw the constants to where all
    forces are such.

    Args:
        grids: fitted grids; none where nothing fits with a force.
        free: the fit without a force.
        log_odds: logarithm of the odds of contact beforehand.
        largest_n: the prior of the force ends here.
        direction: of the force, by the frames before.

    Returns:
        The force; the nodes' shares; forces (n, 3) with the likelihoods (n,) of their directions by this frame alone.
    """
    best = max((float(nodes.log_weight.max()) for nodes in grids), default=-math.inf)
    parts = [_samples(nodes, best, largest_n, direction) for nodes in grids]
    total = sum(float(part.weight.sum()) for part in parts)
    contact = 0.0
    if total > 0.0:
        posterior_log_odds = math.inf
        if free.ok:
            posterior_log_odds = math.log(total) + best - (-free.cost - 0.5 * free.log_det) + log_odds
        contact = 1.0 / (1.0 + math.exp(-max(-60.0, min(60.0, posterior_log_odds))))
    points = np.concatenate([*(part.points for part in parts), np.zeros((1, FORCE))])
    shares = np.concatenate([*(part.weight * (contact / total if total > 0.0 else 0.0) for part in parts), [0.0]])
    shares[-1] = 1.0 - contact
    mean = shares @ points
    covariance = (points - mean).T @ ((points - mean) * shares[:, None])
    values = np.column_stack([points, np.linalg.norm(points, axis=1)])
    ends = np.array([_ends(column, shares) for column in values.T])
    low, high = ends[:, 0], ends[:, 1]
    if contact > 0.0:
        _widen_by_profile(grids, free, largest_n, low, high)
    flat = [np.bincount(part.of_node, part.flat, len(nodes.q)) for part, nodes in zip(parts, grids, strict=True)]
    total_flat = sum(float(weights.sum()) for weights in flat)
    modes = sum(float(part.weight.sum()) > _MODE_SHARE * total for part in parts) if total > 0.0 else 0
    force = SpaceForce(mean, covariance, contact, low, high, modes)
    directions = points[:-1], np.concatenate([*(part.of_direction for part in parts), np.zeros(0)])
    return force, [weights / max(total_flat, 1e-300) for weights in flat], directions


def _ends(values: FloatArray, shares: FloatArray) -> tuple[float, float]:
    """Returns the 5 and 95 % quantiles of weighted points, linear between them; half of a share is below its point."""
    order = np.argsort(values)
    order = order[shares[order] > 0.0]
    middles = np.cumsum(shares[order]) - 0.5 * shares[order]
    low, high = np.interp([_TAIL, 1.0 - _TAIL], middles, values[order])
    return float(low), float(high)


def _widen_by_profile(grids: Sequence[Nodes], free: Fit, largest_n: float, low: FloatArray, high: FloatArray) -> None:
    """Widens the intervals to all forces that explain the lines nearly as well as the best one (profile likelihood).

    Where the shape shows nothing of a force the prior alone would decide, in favour of no contact. Where a grid ends on
    a push that explains the lines, because the rod alone would buckle under more, larger pushes are not excluded: a
    tissue that holds the tip may carry them, up to ``largest_n``. ``low`` and ``high`` (4,) are the ends for fx, fy, fz
    and the magnitude, N, changed in place.
    """
    best = min([free.cost if free.ok else math.inf, *(float(nodes.cost.min()) for nodes in grids)])
    if free.ok and free.cost <= best + _PROFILE:
        low[:], high[:] = np.minimum(low, 0.0), np.maximum(high, 0.0)
    for nodes in grids:
        spare_cost = best + _PROFILE - nodes.cost
        covariance = nodes.covariance[:, :FORCE, :FORCE]
        # about a node the cost is quadratic: it rises by 0.5 (distance / std)^2
        reach = np.sqrt(2.0 * np.maximum(spare_cost, 0.0))[:, None] * np.sqrt(np.einsum("pkk->pk", covariance))
        force = nodes.q[:, :FORCE]
        size = np.linalg.norm(force, axis=1)
        axial = np.einsum("pk,pk->p", force, nodes.tip_axis)
        pushes = _is_possible(axial, size, largest_n)
        use = pushes & (spare_cost >= 0.0)
        if use.any():
            direction = force / np.maximum(size, 1e-9)[:, None]
            variance = np.einsum("pa,pab,pb->p", direction, covariance, direction)  # of the magnitude
            size_reach = np.sqrt(variance * 2.0 * np.maximum(spare_cost, 0.0))
            below = np.column_stack([force - reach, np.maximum(size - size_reach, 0.0)])[use]
            above = np.column_stack([force + reach, size + size_reach])[use]
            low[:], high[:] = np.minimum(low, below.min(axis=0)), np.maximum(high, above.max(axis=0))
            largest = int(np.argmax(np.where(pushes, size, -1.0)))  # the push on which the grid ends
            if use[largest] and size[largest] + nodes.spacing ** (1.0 / nodes.held) < largest_n:
                end = np.append(direction[largest] * largest_n, largest_n)
                low[:], high[:] = np.minimum(low, end), np.maximum(high, end)


def mixed_constants(
    grids: Sequence[Nodes], shares: Sequence[FloatArray], free: Fit, *, contact: bool
) -> tuple[FloatArray, FloatArray]:
    """Returns mean (unknowns,) and covariance (unknowns, unknowns) of the unknowns, in contact or without.

    In contact they are the moments of a mixture: each node has a Gaussian and a share.

    Args:
        grids: fitted grids.
        shares: flat shares of their nodes, from `mixed_force`.
        free: the fit without a force.
        contact: which of the two.
    """
    if not contact:
        covariance = np.asarray(np.linalg.inv(free.matrix), np.float64)
        covariance[:FORCE] = covariance[:, :FORCE] = 0.0
        return free.q.copy(), covariance
    q = np.concatenate([nodes.q for nodes in grids])
    share = np.concatenate(list(shares))
    mean = share @ q
    from_mean = q - mean
    within_nodes = np.einsum("p,pij->ij", share, np.concatenate([nodes.covariance for nodes in grids]))
    return mean, within_nodes + (from_mean * share[:, None]).T @ from_mean
