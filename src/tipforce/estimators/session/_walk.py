"""Posterior of the force from one line: a walk along the direction that the shape shows least.

Unknown are the force, and constants ``z`` of the session with a Gaussian prior. The shape shows where the tip is, and
little of the force along the chord of the shaft. So the force in contact is given by its component along the chord, and
by the position of the loaded point across it: the rod is held there, as a tissue holds it, and does not buckle as it
would under a dead load. Along the chord the force is fixed at evenly spaced nodes. At each node the rest (the position,
and ``z``) is fitted by Gauss-Newton and integrated by Laplace's approximation. Each node starts from the one before it
along the tangent, so that one evaluation of the rod is usually enough.

``q`` (unknowns,) are the unknowns (see `Session`), ``line`` is the detected line. ``mean`` (unknowns,) and
``information`` (unknowns, unknowns), the inverse covariance, are the prior of the constants. ``scratch`` holds buffers:
after a prediction ``scratch.rod`` has the residuals of the line and their slopes, the derivatives by the unknowns.
Metres, newtons, radians; the frame of the clamp: x along the shaft inward, y up.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...mechanics.planar import (
    FORCE,
    UNKNOWNS,
    Line,
    Model,
    Work,
    factorise,
    is_possible,
    predict_held_line,
    predict_line,
    solve_in,
)
from ...types import FloatArray

EXTRA = 3
"""Unknowns behind those of the rod and the lasting errors of the line: see `Session`."""
NODES = 49
"""Largest number of nodes."""
DIRECTIONS = 90
"""Number of bins of the force's direction, from -pi to pi."""
_K0, _EI, _CREEP = (UNKNOWNS.index(name) for name in ("precurvature_per_m", "stiffness", "creep"))
_GAIN, _PLAY, _LEVER = -3, -2, -1
"""The `EXTRA` unknowns, counted from the end."""
_SHAPE = UNKNOWNS.index("length") + 1
"""The unknowns before this one change the shape, and with it the reaction of a held tip."""
_DEPTH = 7.0
"""The walk ends where the density is lower than its maximum by exp(-this)."""
_NODE_STD = 0.6
"""Distance of the nodes over the standard deviation at the best fit, within the limits that follow."""
_SHORTEST_N, _LONGEST_N = 2e-3, 0.04
_GAP = 0.05
"""Squared distance to the minimum, in standard deviations, at which a node is fitted."""
_NODE_STEPS, _TRIES = 3, 60
_MAX_DAMPING = 1e6
_MAX_TURN_RAD = 1.0
"""A step that turns a part of the shaft further is refused: it may have jumped to another, buckled shape."""
_NO_FORCE_N = 1e-6
"""A smaller force has no direction."""
_ACROSS, ALONG = 0, 1
"""Places of the position across and of the force along in the system; in the unknowns the force is first."""


class Session(NamedTuple):
    """Everything that the fit of one line needs beside the line.

    The unknowns are `UNKNOWNS`, the amplitudes of the lasting errors of line and image, then the relative error of the
    knob's gain, the position of the mechanism in the knob's play in degrees, and the lever of the force about the
    middle of the dome. The curvature of the unloaded shaft is ``precurvature + gain (knob (1 + error) + play)``. The
    lever times the force is a moment at the tip: it has the effect of a further curvature.

    ``modes`` (points + 1, modes + `EXTRA`), the last `EXTRA` columns zero; ``whiten`` (points + 1, points + 1);
    ``gain_per_m_deg``, ``knob_deg``: 0 without a knob; ``lever_per_m_n``: curvature per newton at one standard
    deviation of the lever; ``huber``: largest whitened residual that counts with its square; ``largest_n``: upper end
    of the force's prior; ``across_error_n``: see `RodSettings`. (``c``, ``s``): direction of the chord in the frame of
    the clamp, see `predict_held`.
    """

    model: Model
    modes: FloatArray
    whiten: FloatArray
    gain_per_m_deg: float
    knob_deg: float
    lever_per_m_n: float
    huber: float
    largest_n: float
    across_error_n: float = 0.0
    c: float = 1.0
    s: float = 0.0


class Scratch(NamedTuple):
    """Buffers: ``rod`` of the rod's fit, the rest for the nodes."""

    rod: Work
    rod_q: FloatArray
    kept: FloatArray
    tangent: FloatArray
    start: FloatArray
    forces: FloatArray
    """(NODES, 2): across and along the walk."""
    nodes: FloatArray
    factors: FloatArray
    weights: FloatArray
    costs: FloatArray
    across_std: FloatArray
    rates: FloatArray
    """(unknowns,): derivatives of the force across, in the order of the system."""
    node_rates: FloatArray
    shares: FloatArray
    """(NODES,): shares of the nodes in the force of the line; ``weights`` are those for the constants."""
    by_line: FloatArray
    """(NODES,): the same without the depth that a network read: by the line and the read direction."""
    directions: FloatArray
    """(DIRECTIONS,): likelihood of each direction of the force by line and read direction, up to a factor."""


def make_scratch(rod: Work, unknowns: int) -> Scratch:
    """Makes the buffers.

    Args:
        rod: buffers of the rod's fit, see `make_work`.
        unknowns: number of unknowns.
    """
    return Scratch(
        rod, np.zeros(unknowns), np.zeros(rod.theta.size), np.zeros(unknowns), np.zeros(unknowns),
        np.zeros((NODES, 2)), np.zeros((NODES, unknowns)), np.zeros((NODES, unknowns, unknowns)), np.zeros(NODES),
        np.zeros(NODES), np.zeros(NODES), np.zeros(unknowns), np.zeros((NODES, unknowns)), np.zeros(NODES),
        np.zeros(NODES), np.zeros(DIRECTIONS),
    )  # fmt: skip


class Fit(NamedTuple):
    """``cost``: minus the log density at the minimum, up to a constant; ``chi2``: squares of the whitened misfit."""

    cost: float
    chi2: float
    log_det: float
    gap: float
    ok: bool


@njit(cache=True, nogil=True)
def _copy_rod(q: FloatArray, session: Session, scratch: Scratch) -> None:
    """Copies the rod's unknowns, with the curvature that the knob gives, into ``rod_q``."""
    rod_q = scratch.rod_q
    rod_q[:] = q
    rod_q[_K0] += session.gain_per_m_deg * (session.knob_deg * (1.0 + q[_GAIN]) + q[_PLAY])


@njit(cache=True, nogil=True)
def _add_knob_and_lever(size_n: float, session: Session, scratch: Scratch) -> None:
    """Fills the slopes of the residuals by the last unknowns: error of the knob's gain, play, and lever.

    All three act on the shape as a curvature does: their slopes in ``scratch.rod`` are multiples of that of the
    pre-curvature. ``size_n`` is the magnitude of the force, which acts at the lever.
    """
    work, gain = scratch.rod, session.gain_per_m_deg
    for row in range(work.residual.size):
        slope = work.slopes[row, _K0]
        work.slopes[row, _GAIN] = gain * session.knob_deg * slope
        work.slopes[row, _PLAY] = gain * slope
        work.slopes[row, _LEVER] = session.lever_per_m_n * size_n * slope


@njit(cache=True, nogil=True)
def predict(q: FloatArray, session: Session, line: Line, scratch: Scratch) -> bool:
    """Computes residual and slopes of the line under a dead load into ``scratch.rod``.

    Args:
        q: (unknowns,) see `Session`; the first two are the force in the frame of the clamp, N.
        session: constants of the fit.
        line: the line.
        scratch: buffers; ``rod.theta`` holds the start of the shape.

    Returns:
        Whether there is such a stable shape.
    """
    work = scratch.rod
    _copy_rod(q, session, scratch)
    size, per_n = math.hypot(q[0], q[1]), session.lever_per_m_n
    scratch.rod_q[_K0] += per_n * size * q[_LEVER]
    if not is_possible(scratch.rod_q, session.model):
        return False
    converged, stable = predict_line(scratch.rod_q, session.model, line, session.modes, work, False)
    if not (converged and stable):
        return False
    _add_knob_and_lever(size, session, scratch)
    if size > _NO_FORCE_N:  # the force changes the lever's curvature by its magnitude: chain rule
        for row in range(work.residual.size):
            share = per_n * q[_LEVER] * work.slopes[row, _K0] / size
            work.slopes[row, 0] += share * q[0]
            work.slopes[row, 1] += share * q[1]
    return True


@njit(cache=True, nogil=True)
def predict_held(q: FloatArray, session: Session, line: Line, scratch: Scratch) -> bool:
    """Computes residual and slopes of the line of a rod whose tip is held across the chord into ``scratch.rod``.

    The force across the chord, and its derivatives, are left in ``rod.reaction`` and ``rates``.

    Args:
        q: (unknowns,) see `Session`; the first two are the force along (``session.c``, ``session.s``), N, and the
            position of the loaded point to the left of this direction, m.
        session: constants of the fit.
        line: the line.
        scratch: buffers; ``rod.theta`` and ``rod.reaction`` hold the start.

    Returns:
        Whether there is such a stable shape.
    """
    work = scratch.rod
    _copy_rod(q, session, scratch)
    if not is_possible(scratch.rod_q, session.model):
        return False
    lever = session.lever_per_m_n * q[_LEVER]
    if not predict_held_line(scratch.rod_q, lever, session.c, session.s, session.model, line, session.modes, work):
        return False
    size = math.hypot(q[0], work.reaction[0])
    _add_knob_and_lever(size, session, scratch)
    rates, rod_rates = scratch.rates, work.reaction_rates  # of all unknowns here, and of those of the rod's shape
    rates[:] = 0.0
    rates[FORCE:_SHAPE] = rod_rates[FORCE:_SHAPE]
    rates[_ACROSS], rates[ALONG], rates[_CREEP] = rod_rates[1], rod_rates[0], rod_rates[_SHAPE]
    gain, curvature_rate = session.gain_per_m_deg, rod_rates[_K0]
    rates[_GAIN], rates[_PLAY] = gain * session.knob_deg * curvature_rate, gain * curvature_rate
    rates[_LEVER] = session.lever_per_m_n * size * curvature_rate
    if size > _NO_FORCE_N:  # the force along the chord changes the lever's curvature by its magnitude: chain rule
        share = lever * q[0] / size
        rates[ALONG] += share * curvature_rate
        for row in range(work.residual.size):
            work.slopes[row, 0] += share * work.slopes[row, _K0]
    return True


@njit(cache=True, nogil=True)
def _assemble(
    q: FloatArray, mean: FloatArray, information: FloatArray, session: Session, fixed: int, scratch: Scratch
) -> tuple[float, float]:
    """Assembles the Gauss-Newton equations ``matrix @ step = side`` at ``q`` from the last prediction.

    In these equations the first two unknowns change places: position across, then force along (`_ACROSS`, `ALONG`). The
    last ``fixed`` (0, 1 or 2) of these two stay as they are; ``scratch.tangent`` gets the row of the last one. The rows
    of the force in ``information`` do not count: its prior is flat.

    Returns:
        The cost (with Huber's loss of the residuals), and the sum of the squares of the whitened residuals.
    """
    work = scratch.rod
    rows, count = work.residual.size, q.size
    cost = chi2 = 0.0
    white, matrix, side = work.white, work.matrix, work.side
    for row in range(rows):
        work.slopes[row, _ACROSS], work.slopes[row, ALONG] = work.slopes[row, 1], work.slopes[row, 0]
    # whitened slopes and, in the last column, residuals, both weighted as Huber's loss demands
    for i in range(rows):
        residual = 0.0
        for j in range(i + 1):
            residual += session.whiten[i, j] * work.residual[j]
        size = abs(residual)
        chi2 += residual * residual
        limit = session.huber
        cost += 0.5 * residual * residual if size <= limit else limit * (size - 0.5 * limit)
        weight = 1.0 if size <= limit else math.sqrt(limit / size)
        for k in range(count):
            white[i, k] = 0.0
        for j in range(i + 1):
            share = weight * session.whiten[i, j]
            if share != 0.0:
                for k in range(count):
                    white[i, k] += share * work.slopes[j, k]
        white[i, count] = weight * residual
    # the prior's part
    for a in range(count):
        total = 0.0
        for j in range(FORCE, count):
            matrix[a, j] = information[a, j]
            total -= information[a, j] * (q[j] - mean[j])
        matrix[a, 0] = matrix[a, 1] = 0.0
        side[a] = total
        if a >= FORCE:
            cost -= 0.5 * total * (q[a] - mean[a])
    if fixed < FORCE:  # the shape shows force over stiffness: a flat prior of the force would prefer stiff rods
        side[_EI] -= 1.0 / (1.0 + q[_EI])
        cost += math.log(1.0 + q[_EI])
    # the line's part: lower triangle, then its mirror image
    for i in range(rows):
        for a in range(count):
            slope = white[i, a]
            side[a] += slope * white[i, count]
            for b in range(a + 1):
                matrix[a, b] += slope * white[i, b]
    for a in range(count):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    for a in range(FORCE - fixed, FORCE):
        for b in range(count):
            scratch.tangent[b] = matrix[a, b]  # of the last one, for the tangent of the walk
            matrix[a, b] = matrix[b, a] = 0.0
        matrix[a, a] = 1.0
        side[a] = 0.0
    return cost, chi2


@njit(cache=True, nogil=True)
def _newton_step(work: Work) -> float:
    """Solves the factorised equations for ``work.step``; returns the squared distance to the minimum in std devs."""
    work.step[:] = work.side
    solve_in(work.factor, work.step)
    gap = 0.0
    for k in range(work.step.size):
        gap += work.step[k] * work.side[k]
    return gap


@njit(cache=True, nogil=True)
def _add_step(q: FloatArray, step: FloatArray, share: float) -> None:
    """Adds ``share`` of ``step``, in the order of the system, to ``q``."""
    q[0] += share * step[ALONG]
    q[1] += share * step[_ACROSS]
    for k in range(FORCE, q.size):
        q[k] += share * step[k]


@njit(cache=True, nogil=True)
def _predict_as(fixed: int, q: FloatArray, session: Session, line: Line, scratch: Scratch) -> bool:
    """Predicts the line without a force (``fixed``) or in contact, with a held tip; returns whether that succeeds."""
    return predict(q, session, line, scratch) if fixed else predict_held(q, session, line, scratch)


@njit(cache=True, nogil=True)
def relax(
    q: FloatArray, mean: FloatArray, information: FloatArray, session: Session, line: Line, fixed: int,
    force_information: float, most: int, scratch: Scratch,
) -> Fit:  # fmt: skip
    """Moves ``q`` to the minimum of the cost (Levenberg-Marquardt: a step that raises it is damped and repeated).

    Args:
        q: (unknowns,) start, then result; see `predict` without a force, `predict_held` with one.
        mean: (unknowns,) mean of the prior of the constants.
        information: (unknowns, unknowns) inverse of its covariance; the rows of the force do not count.
        session: constants of the fit.
        line: the line.
        fixed: 0, or 2 for no force.
        force_information: of a Gaussian about no force along the chord, which the start of a walk has in place of the
            flat prior.
        most: largest number of steps.
        scratch: buffers; ``rod.theta`` holds the shape of the start. Its matrix is left factorised.
    """
    work = scratch.rod
    trial, last_theta = scratch.start, scratch.kept
    damping, best, accepted = 0.0, math.inf, False
    chi2, log_det, gap = math.inf, math.nan, math.inf
    trial[:] = q
    taken = 0
    for _ in range(_TRIES):
        last_theta[:] = work.theta
        possible = _predict_as(fixed, trial, session, line, scratch)
        if accepted and possible:
            turned_rad = 0.0
            for i in range(work.theta.size):
                turned_rad = max(turned_rad, abs(work.theta[i] - last_theta[i]))
            possible = turned_rad < _MAX_TURN_RAD
        cost = trial_chi2 = math.inf
        if possible:
            cost, trial_chi2 = _assemble(trial, mean, information, session, fixed, scratch)
            cost += 0.5 * force_information * trial[0] ** 2
        if not accepted and cost == math.inf:
            return Fit(math.inf, math.inf, math.nan, math.inf, False)
        lower = cost <= best
        small = lower and best - cost < 1e-4 and damping < 1e-2
        if lower:
            q[:] = trial
            best, chi2, accepted = cost, trial_chi2, True
            damping = 0.0 if damping < 1e-3 else 0.2 * damping
            taken += 1
        else:
            work.theta[:] = last_theta
            damping = max(1e-2, 6.0 * damping)
            if damping > _MAX_DAMPING:
                break
            # the equations are those of the refused point: assemble them at the last accepted one again
            if not _predict_as(fixed, q, session, line, scratch):
                break
            _assemble(q, mean, information, session, fixed, scratch)
        if fixed == 0:
            work.matrix[ALONG, ALONG] += force_information
            work.side[ALONG] -= force_information * q[0]
        if small or (lower and taken > most):
            log_det = factorise(work.matrix, 0.0, work.factor)
            gap = 0.0
            break
        log_det = factorise(work.matrix, damping, work.factor)
        trial[:] = q
        if math.isnan(log_det):  # not positive definite
            damping = max(1e-3, 4.0 * damping)
            continue
        gap = _newton_step(work)
        if gap < 1e-3 and damping == 0.0:
            _add_step(q, work.step, 1.0)
            best -= 0.5 * gap
            break
        _add_step(trial, work.step, 1.0)
    return Fit(best, chi2, log_det, gap, accepted and gap < 1.0 and not math.isnan(log_det))


@njit(cache=True, nogil=True)
def _node(
    q: FloatArray, mean: FloatArray, information: FloatArray, session: Session, line: Line, scratch: Scratch, place: int
) -> bool:
    """Fits one node of the walk: the rest of the unknowns at a fixed force along the chord; returns whether it fits.

    ``q`` is the start, then the fit (see `predict_held`). Row ``place`` of the nodes in ``scratch`` is filled, and
    ``scratch.tangent`` becomes the change of the unknowns per newton along the walk.
    """
    work, count = scratch.rod, q.size
    cost = gap = log_det = math.inf
    for turn in range(_NODE_STEPS):
        if not predict_held(q, session, line, scratch):
            return False
        cost, _ = _assemble(q, mean, information, session, 1, scratch)
        log_det = factorise(work.matrix, 0.0, work.factor)
        if math.isnan(log_det):
            return False
        gap = _newton_step(work)
        _add_step(q, work.step, 1.0)
        if gap < _GAP or turn == _NODE_STEPS - 1:
            break
    if gap > 1.0:
        return False
    rates, reaction_n = scratch.node_rates[place], work.reaction[0]
    for k in range(count):  # the reaction after the last step, which was not evaluated again
        reaction_n += scratch.rates[k] * work.step[k]
    rates[:] = scratch.rates
    rates[ALONG] = 0.0
    scratch.nodes[place] = q
    scratch.factors[place] = work.factor
    # the minimum moves with the force along the chord by minus (matrix^-1 times that force's row)
    scratch.tangent[:] = -scratch.tangent
    scratch.tangent[ALONG] = 0.0
    solve_in(work.factor, scratch.tangent)
    scratch.tangent[ALONG] = 1.0
    variance = 0.0  # of the reaction, across the chord
    work.step[:] = rates
    solve_in(work.factor, work.step)
    for k in range(count):
        variance += rates[k] * work.step[k]
    scratch.across_std[place] = math.hypot(math.sqrt(variance), session.across_error_n)
    scratch.forces[place, 0], scratch.forces[place, 1] = reaction_n, q[0]
    scratch.nodes[place, 0] = session.c * q[0] - session.s * reaction_n
    scratch.nodes[place, 1] = session.s * q[0] + session.c * reaction_n
    scratch.costs[place] = cost - 0.5 * gap
    scratch.weights[place] = -scratch.costs[place] - 0.5 * log_det  # log density, by Laplace's approximation
    return True


@njit(cache=True, nogil=True)
def walk(
    q: FloatArray, mean: FloatArray, information: FloatArray, session: Session, line: Line, std_n: float,
    scratch: Scratch,
) -> tuple[int, float]:  # fmt: skip
    """Fits nodes at evenly spaced forces along the chord, from the best fit to both sides.

    A side ends where the density is negligible, the force is too large, or a node does not fit.

    Args:
        q: (unknowns,) the best fit.
        mean: (unknowns,) mean of the prior of the constants.
        information: (unknowns, unknowns) inverse of its covariance.
        session: constants of the fit.
        line: the line.
        std_n: standard deviation of the force along the chord at ``q``.
        scratch: buffers; the nodes are left in them, in any order.

    Returns:
        Number of nodes, and their distance in N.
    """
    work = scratch.rod
    step_n = min(_LONGEST_N, max(_SHORTEST_N, _NODE_STD * std_n))
    node_q = q.copy()
    if not _node(node_q, mean, information, session, line, scratch, 0):
        return 0, step_n
    middle_tangent, middle_q = scratch.tangent.copy(), node_q.copy()
    middle_theta, middle_reaction = work.theta.copy(), work.reaction[0]
    found, best = 1, scratch.weights[0]
    for direction in (1.0, -1.0):
        node_q[:], scratch.tangent[:] = middle_q, middle_tangent
        work.theta[:] = middle_theta
        work.reaction[0] = middle_reaction
        while found < NODES:
            _add_step(node_q, scratch.tangent, direction * step_n)
            if math.hypot(node_q[0], work.reaction[0]) > session.largest_n:
                break
            if not _node(node_q, mean, information, session, line, scratch, found):
                break
            best = max(best, scratch.weights[found])
            found += 1
            if scratch.weights[found - 1] < best - _DEPTH:
                break
    return found, step_n
