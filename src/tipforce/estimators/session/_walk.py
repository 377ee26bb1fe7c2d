"""Posterior of the force from one line: a walk along the direction that the shape shows least.

Unknown are the force, and constants ``z`` of the session with a Gaussian prior. The shape shows where the tip is, and
little of the force along the chord of the shaft. So the force in contact is given by its component along the chord, and
by the position of the loaded point across it: the rod is held there, as a tissue holds it, and does not buckle as it
would under a dead load. Along the chord the force is fixed at evenly spaced nodes. At each node the rest (the position,
and ``z``) is fitted by Gauss-Newton and integrated by Laplace's approximation. Each node starts from the one before it
along the tangent, so that one evaluation of the rod is usually enough.
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
_K0, _EI, _CREEP = (UNKNOWNS.index(name) for name in ("precurvature_per_m", "stiffness", "creep"))
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
    theta: FloatArray
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
    """(NODES,): the same by the line alone, without other evidence."""


def make_scratch(rod: Work, unknowns: int) -> Scratch:
    """Makes the buffers.

    Args:
        rod: buffers of the rod's fit, see `make_work`.
        unknowns: number of unknowns.

    Returns:
        The buffers.
    """
    n = rod.theta.size
    return Scratch(
        rod, np.zeros(unknowns), np.zeros(n), np.zeros(unknowns), np.zeros(unknowns), np.zeros(n),
        np.zeros((NODES, 2)), np.zeros((NODES, unknowns)), np.zeros((NODES, unknowns, unknowns)), np.zeros(NODES),
        np.zeros(NODES), np.zeros(NODES), np.zeros(unknowns), np.zeros((NODES, unknowns)), np.zeros(NODES),
        np.zeros(NODES),
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
    count, rod_q = q.size, scratch.rod_q
    for k in range(count):
        rod_q[k] = q[k]
    rod_q[_K0] += session.gain_per_m_deg * (session.knob_deg * (1.0 + q[count - 3]) + q[count - 2])


@njit(cache=True, nogil=True)
def _add_knob_and_lever(q: FloatArray, size_n: float, session: Session, scratch: Scratch) -> None:
    """Fills the slopes of the last unknowns, for a force of ``size_n``."""
    work, count, gain = scratch.rod, q.size, session.gain_per_m_deg
    for row in range(work.residual.size):
        slope = work.slopes[row, _K0]
        work.slopes[row, count - 3] = gain * session.knob_deg * slope
        work.slopes[row, count - 2] = gain * slope
        work.slopes[row, count - 1] = session.lever_per_m_n * size_n * slope


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
    count, work = q.size, scratch.rod
    _copy_rod(q, session, scratch)
    size, per_n = math.hypot(q[0], q[1]), session.lever_per_m_n
    scratch.rod_q[_K0] += per_n * size * q[count - 1]
    if not is_possible(scratch.rod_q, session.model):
        return False
    converged, stable = predict_line(scratch.rod_q, session.model, line, session.modes, work, False)
    if not (converged and stable):
        return False
    _add_knob_and_lever(q, size, session, scratch)
    if size > 1e-6:
        for row in range(work.residual.size):
            share = per_n * q[count - 1] * work.slopes[row, _K0] / size
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
    count, work = q.size, scratch.rod
    _copy_rod(q, session, scratch)
    if not is_possible(scratch.rod_q, session.model):
        return False
    lever = session.lever_per_m_n * q[count - 1]
    if not predict_held_line(scratch.rod_q, lever, session.c, session.s, session.model, line, session.modes, work):
        return False
    size = math.hypot(q[0], work.reaction[0])
    _add_knob_and_lever(q, size, session, scratch)
    rates, known = scratch.rates, work.reaction_rates
    bend = known[_K0]
    for k in range(count):
        rates[k] = known[k] if FORCE <= k < _SHAPE else 0.0
    rates[_ACROSS], rates[ALONG], rates[_CREEP] = known[1], known[0], known[_SHAPE]
    gain = session.gain_per_m_deg
    rates[count - 3], rates[count - 2] = gain * session.knob_deg * bend, gain * bend
    rates[count - 1] = session.lever_per_m_n * size * bend
    if size > 1e-6:
        share = lever * q[0] / size
        rates[ALONG] += share * bend
        for row in range(work.residual.size):
            work.slopes[row, 0] += share * work.slopes[row, _K0]
    return True


@njit(cache=True, nogil=True)
def _assemble(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    session: Session,
    fixed: int,
    scratch: Scratch,
) -> tuple[float, float]:
    """Computes information and side at ``q``, in which the first two unknowns change places.

    The last ``fixed`` of these two stay. Returns the cost and the squared misfit.
    """
    work = scratch.rod
    rows, count = work.residual.size, q.size
    loss = plain = 0.0
    white, matrix, side = work.white, work.matrix, work.side
    for row in range(rows):
        work.slopes[row, _ACROSS], work.slopes[row, ALONG] = work.slopes[row, 1], work.slopes[row, 0]
    for i in range(rows):
        value = 0.0
        for j in range(i + 1):
            value += session.whiten[i, j] * work.residual[j]
        size = abs(value)
        plain += value * value
        limit = session.huber
        loss += 0.5 * value * value if size <= limit else limit * (size - 0.5 * limit)
        weight = 1.0 if size <= limit else math.sqrt(limit / size)
        for k in range(count):
            white[i, k] = 0.0
        for j in range(i + 1):
            share = weight * session.whiten[i, j]
            if share != 0.0:
                for k in range(count):
                    white[i, k] += share * work.slopes[j, k]
        white[i, count] = weight * value
    for a in range(count):
        total = 0.0
        for j in range(FORCE, count):
            part = information[a, j]
            matrix[a, j] = part
            total -= part * (q[j] - mean[j])
        matrix[a, 0] = matrix[a, 1] = 0.0
        side[a] = total
        if a >= FORCE:
            loss -= 0.5 * total * (q[a] - mean[a])
    if fixed < FORCE:  # the shape shows force over stiffness: a flat prior of the force would prefer stiff rods
        side[_EI] -= 1.0 / (1.0 + q[_EI])
        loss += math.log(1.0 + q[_EI])
    for i in range(rows):
        for a in range(count):
            value = white[i, a]
            side[a] += value * white[i, count]
            for b in range(a + 1):
                matrix[a, b] += value * white[i, b]
    for a in range(count):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    for a in range(FORCE - fixed, FORCE):
        for b in range(count):
            scratch.tangent[b] = matrix[a, b]  # of the last one, for the tangent of the walk
            matrix[a, b] = matrix[b, a] = 0.0
        matrix[a, a] = 1.0
        side[a] = 0.0
    return loss, plain


@njit(cache=True, nogil=True)
def _add_step(q: FloatArray, step: FloatArray, share: float) -> None:
    """Adds ``share`` of ``step``, in the order of the system, to ``q``."""
    q[0] += share * step[ALONG]
    q[1] += share * step[_ACROSS]
    for k in range(FORCE, q.size):
        q[k] += share * step[k]


@njit(cache=True, nogil=True)
def _predict_as(fixed: int, q: FloatArray, session: Session, line: Line, scratch: Scratch) -> bool:
    return predict(q, session, line, scratch) if fixed else predict_held(q, session, line, scratch)


@njit(cache=True, nogil=True)
def relax(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    session: Session,
    line: Line,
    fixed: int,
    force_information: float,
    most: int,
    scratch: Scratch,
) -> Fit:
    """Moves ``q`` to the minimum (Levenberg-Marquardt).

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

    Returns:
        The fit.
    """
    work, count = scratch.rod, q.size
    trial = scratch.start
    damping, best, accepted = 0.0, math.inf, False
    chi2, log_det, gap = math.inf, math.nan, math.inf
    for k in range(count):
        trial[k] = q[k]
    taken = 0
    for _ in range(_TRIES):
        for i in range(work.theta.size):
            scratch.kept[i] = work.theta[i]
        fine = _predict_as(fixed, trial, session, line, scratch)
        turned = 0.0
        if accepted and fine:
            for i in range(work.theta.size):
                turned = max(turned, abs(work.theta[i] - scratch.kept[i]))
        cost = plain = math.inf
        if fine and turned < _MAX_TURN_RAD:
            cost, plain = _assemble(trial, mean, information, session, fixed, scratch)
            cost += 0.5 * force_information * trial[0] ** 2
        if not accepted and cost == math.inf:
            return Fit(math.inf, math.inf, math.nan, math.inf, False)
        if cost <= best:
            small = best - cost < 1e-4 and damping < 1e-2
            for k in range(count):
                q[k] = trial[k]
            best, chi2, accepted = cost, plain, True
            if fixed == 0:
                work.matrix[ALONG, ALONG] += force_information
                work.side[ALONG] -= force_information * q[0]
            damping = 0.0 if damping < 1e-3 else 0.2 * damping
            taken += 1
            if small or taken > most:
                log_det = factorise(work.matrix, 0.0, work.factor)
                gap = 0.0
                break
        else:
            for i in range(work.theta.size):
                work.theta[i] = scratch.kept[i]
            damping = max(1e-2, 6.0 * damping)
            if damping > _MAX_DAMPING:
                break
            # the system belongs to the last accepted point: it must be there again
            if not _predict_as(fixed, q, session, line, scratch):
                break
            _assemble(q, mean, information, session, fixed, scratch)
            if fixed == 0:
                work.matrix[ALONG, ALONG] += force_information
                work.side[ALONG] -= force_information * q[0]
        log_det = factorise(work.matrix, damping, work.factor)
        if math.isnan(log_det):
            damping = max(1e-3, 4.0 * damping)
            for k in range(count):
                trial[k] = q[k]
            continue
        gap = 0.0
        for k in range(count):
            work.step[k] = work.side[k]
        solve_in(work.factor, work.step)
        for k in range(count):
            gap += work.step[k] * work.side[k]
            trial[k] = q[k]
        if gap < 1e-3 and damping == 0.0:
            _add_step(q, work.step, 1.0)
            best -= 0.5 * gap
            break
        _add_step(trial, work.step, 1.0)
    return Fit(best, chi2, log_det, gap, accepted and gap < 1.0 and not math.isnan(log_det))


@njit(cache=True, nogil=True)
def _node(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    session: Session,
    line: Line,
    scratch: Scratch,
    place: int,
) -> bool:
    """Fits the node ``place`` from ``q``, whose force along the chord stays; whether it fits.

    Then ``tangent`` holds the change of the unknowns per newton along the walk.
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
        for k in range(count):
            work.step[k] = work.side[k]
        solve_in(work.factor, work.step)
        gap = 0.0
        for k in range(count):
            gap += work.step[k] * work.side[k]
        _add_step(q, work.step, 1.0)
        if gap < _GAP or turn == _NODE_STEPS - 1:
            break
    if gap > 1.0:
        return False
    rates, reaction_n = scratch.node_rates[place], work.reaction[0]
    for k in range(count):
        reaction_n += scratch.rates[k] * work.step[k]
        rates[k] = scratch.rates[k] if k != ALONG else 0.0
        scratch.nodes[place, k] = q[k]
        for j in range(count):
            scratch.factors[place, k, j] = work.factor[k, j]
        scratch.tangent[k] = -scratch.tangent[k]
    scratch.tangent[ALONG] = 0.0
    solve_in(work.factor, scratch.tangent)
    scratch.tangent[ALONG] = 1.0
    variance = 0.0
    for k in range(count):
        work.step[k] = rates[k]
    solve_in(work.factor, work.step)
    for k in range(count):
        variance += rates[k] * work.step[k]
    scratch.across_std[place] = math.hypot(math.sqrt(variance), session.across_error_n)
    scratch.forces[place, 0], scratch.forces[place, 1] = reaction_n, q[0]
    scratch.nodes[place, 0] = session.c * q[0] - session.s * reaction_n
    scratch.nodes[place, 1] = session.s * q[0] + session.c * reaction_n
    scratch.costs[place] = cost - 0.5 * gap
    scratch.weights[place] = -scratch.costs[place] - 0.5 * log_det
    return True


@njit(cache=True, nogil=True)
def walk(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    session: Session,
    line: Line,
    std_n: float,
    scratch: Scratch,
) -> tuple[int, float]:
    """Walks from ``q`` along the chord to both sides.

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
    work, count = scratch.rod, q.size
    step_n = min(_LONGEST_N, max(_SHORTEST_N, _NODE_STD * std_n))
    at = q.copy()
    for i in range(work.theta.size):
        scratch.theta[i] = work.theta[i]
    fits = _node(at, mean, information, session, line, scratch, 0)
    if not fits:
        return 0, step_n
    middle_tangent, middle = scratch.tangent.copy(), at.copy()
    middle_theta, middle_reaction = work.theta.copy(), work.reaction[0]
    found, best = 1, scratch.weights[0]
    for way in (1.0, -1.0):
        for k in range(count):
            at[k], scratch.tangent[k] = middle[k], middle_tangent[k]
        for i in range(work.theta.size):
            work.theta[i] = middle_theta[i]
        work.reaction[0] = middle_reaction
        for _ in range(NODES):
            if found == NODES:
                break
            _add_step(at, scratch.tangent, way * step_n)
            if math.hypot(at[0], work.reaction[0]) > session.largest_n:
                break
            fits = _node(at, mean, information, session, line, scratch, found)
            if not fits:
                break
            best = max(best, scratch.weights[found])
            found += 1
            if scratch.weights[found - 1] < best - _DEPTH:
                break
    return found, step_n
