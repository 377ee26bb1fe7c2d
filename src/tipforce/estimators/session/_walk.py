"""Posterior of the force from one line: a walk along the direction that the shape shows least.

Unknown are the force, and constants ``z`` of the session with a Gaussian prior. The prior of the force is flat, so a
Gaussian about the best fit is wrong where the shape shows little of it. Along that direction the force is therefore
fixed at evenly spaced nodes. At each node the rest (the other component of the force, and ``z``) is fitted by
Gauss-Newton and integrated by Laplace's approximation. Each node starts from the one before it along the tangent, so
that one evaluation of the rod is usually enough.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ...mechanics.planar import FORCE, UNKNOWNS, Line, Model, Work, factorise, is_possible, predict_line, solve_in
from ...types import FloatArray

EXTRA = 3
"""Unknowns behind those of the rod and the lasting errors of the line: see `Session`."""
NODES = 49
"""Largest number of nodes."""
_K0, _EI = UNKNOWNS.index("precurvature_per_m"), UNKNOWNS.index("stiffness")
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
_L, _A = 0, 1


class Session(NamedTuple):
    """Everything that the fit of one line needs beside the line.

    The unknowns are `UNKNOWNS`, the amplitudes of the lasting errors of line and image, then the relative error of the
    knob's gain, the position of the mechanism in the knob's play in degrees, and the lever of the force about the
    middle of the dome. The curvature of the unloaded shaft is ``precurvature + gain (knob (1 + error) + play)``. The
    lever times the force is a moment at the tip: it has the effect of a further curvature.

    ``modes`` (points + 1, modes + `EXTRA`), the last `EXTRA` columns zero; ``whiten`` (points + 1, points + 1);
    ``gain_per_m_deg``, ``knob_deg``: 0 without a knob; ``lever_per_m_n``: curvature per newton at one standard
    deviation of the lever; ``huber``: largest whitened residual that counts with its square; ``largest_n``: upper end
    of the force's prior.
    """

    model: Model
    modes: FloatArray
    whiten: FloatArray
    gain_per_m_deg: float
    knob_deg: float
    lever_per_m_n: float
    huber: float
    largest_n: float


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
        np.zeros(NODES), np.zeros(NODES),
    )  # fmt: skip


class Fit(NamedTuple):
    """``cost``: minus the log density at the minimum, up to a constant; ``chi2``: squares of the whitened misfit."""

    cost: float
    chi2: float
    log_det: float
    gap: float
    ok: bool


@njit(cache=True, nogil=True)
def predict(q: FloatArray, session: Session, line: Line, scratch: Scratch) -> bool:
    """Computes residual and slopes of the line at ``q`` into ``scratch.rod``.

    Args:
        q: (unknowns,) see `Session`.
        session: constants of the fit.
        line: the line.
        scratch: buffers; ``rod.theta`` holds the start of the shape.

    Returns:
        Whether there is such a stable shape.
    """
    count, work = q.size, scratch.rod
    rod_q = scratch.rod_q
    for k in range(count):
        rod_q[k] = q[k]
    size = math.hypot(q[0], q[1])
    gain, knob = session.gain_per_m_deg, session.knob_deg
    per_n = session.lever_per_m_n
    rod_q[_K0] = q[_K0] + gain * (knob * (1.0 + q[count - 3]) + q[count - 2]) + per_n * size * q[count - 1]
    if not is_possible(rod_q, session.model):
        return False
    converged, stable = predict_line(rod_q, session.model, line, session.modes, work, False)
    if not (converged and stable):
        return False
    for row in range(work.residual.size):
        slope = work.slopes[row, _K0]
        work.slopes[row, count - 3] = gain * knob * slope
        work.slopes[row, count - 2] = gain * slope
        work.slopes[row, count - 1] = per_n * size * slope
        if size > 1e-6:
            share = per_n * q[count - 1] * slope / size
            work.slopes[row, 0] += share * q[0]
            work.slopes[row, 1] += share * q[1]
    return True


@njit(cache=True, nogil=True)
def _assemble(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    session: Session,
    c: float,
    s: float,
    fixed: int,
    scratch: Scratch,
) -> tuple[float, float]:
    """Computes information and side at ``q``; its force is turned to across and along (``c``, ``s``).

    The last ``fixed`` of these two are held. Returns the cost and the squared misfit.
    """
    work = scratch.rod
    rows, count = work.residual.size, q.size
    loss = plain = 0.0
    white, matrix, side = work.white, work.matrix, work.side
    for row in range(rows):
        x, y = work.slopes[row, 0], work.slopes[row, 1]
        work.slopes[row, _L] = -s * x + c * y
        work.slopes[row, _A] = c * x + s * y
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
def _turned_step(q: FloatArray, step: FloatArray, share: float, c: float, s: float) -> None:
    """Adds ``share`` of ``step``, whose force is across and along, to ``q``."""
    across, along = share * step[_L], share * step[_A]
    q[0] += c * along - s * across
    q[1] += s * along + c * across
    for k in range(FORCE, q.size):
        q[k] += share * step[k]


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
    """Moves ``q`` to the minimum, with the last ``fixed`` components of the force held (Levenberg-Marquardt).

    Args:
        q: (unknowns,) start, then result.
        mean: (unknowns,) mean of the prior of the constants.
        information: (unknowns, unknowns) inverse of its covariance; the rows of the force do not count.
        session: constants of the fit.
        line: the line.
        fixed: number of held components of the force: 0, or 2.
        force_information: of a Gaussian about no force, which the start of a walk has in place of the flat prior.
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
        fine = predict(trial, session, line, scratch)
        turned = 0.0
        if accepted and fine:
            for i in range(work.theta.size):
                turned = max(turned, abs(work.theta[i] - scratch.kept[i]))
        cost = plain = math.inf
        if fine and turned < _MAX_TURN_RAD:
            cost, plain = _assemble(trial, mean, information, session, 1.0, 0.0, fixed, scratch)
            cost += 0.5 * force_information * (trial[0] ** 2 + trial[1] ** 2)
        if not accepted and cost == math.inf:
            return Fit(math.inf, math.inf, math.nan, math.inf, False)
        if cost <= best:
            small = best - cost < 1e-4 and damping < 1e-2
            for k in range(count):
                q[k] = trial[k]
            best, chi2, accepted = cost, plain, True
            # for this order of the force: across = y, along = x
            if fixed == 0:
                work.matrix[_A, _A] += force_information
                work.side[_A] -= force_information * q[0]
            if fixed < 2:
                work.matrix[_L, _L] += force_information
                work.side[_L] -= force_information * q[1]
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
            if not predict(q, session, line, scratch):
                break
            _assemble(q, mean, information, session, 1.0, 0.0, fixed, scratch)
            if fixed == 0:
                work.matrix[_A, _A] += force_information
                work.side[_A] -= force_information * q[0]
            if fixed < 2:
                work.matrix[_L, _L] += force_information
                work.side[_L] -= force_information * q[1]
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
            _turned_step(q, work.step, 1.0, 1.0, 0.0)
            best -= 0.5 * gap
            break
        _turned_step(trial, work.step, 1.0, 1.0, 0.0)
    return Fit(best, chi2, log_det, gap, accepted and gap < 1.0 and not math.isnan(log_det))


@njit(cache=True, nogil=True)
def _node(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    session: Session,
    line: Line,
    c: float,
    s: float,
    scratch: Scratch,
    place: int,
) -> bool:
    """Fits the node ``place`` from ``q``, whose component along the walk is held; whether it fits.

    Then ``tangent`` holds the change of the unknowns per newton along the walk.
    """
    work, count = scratch.rod, q.size
    cost = gap = log_det = math.inf
    for turn in range(_NODE_STEPS):
        if not predict(q, session, line, scratch):
            return False
        cost, _ = _assemble(q, mean, information, session, c, s, 1, scratch)
        log_det = factorise(work.matrix, 0.0, work.factor)
        if math.isnan(log_det):
            return False
        for k in range(count):
            work.step[k] = work.side[k]
        solve_in(work.factor, work.step)
        gap = 0.0
        for k in range(count):
            gap += work.step[k] * work.side[k]
        _turned_step(q, work.step, 1.0, c, s)
        if gap < _GAP or turn == _NODE_STEPS - 1:
            break
    if gap > 1.0:
        return False
    for k in range(count):
        scratch.nodes[place, k] = q[k]
        for j in range(count):
            scratch.factors[place, k, j] = work.factor[k, j]
        scratch.tangent[k] = -scratch.tangent[k]
    scratch.tangent[_A] = 0.0
    solve_in(work.factor, scratch.tangent)
    scratch.tangent[_A] = 1.0
    for k in range(count):
        work.step[k] = 1.0 if k == _L else 0.0
    solve_in(work.factor, work.step)
    scratch.across_std[place] = math.sqrt(work.step[_L])
    scratch.forces[place, 0], scratch.forces[place, 1] = -s * q[0] + c * q[1], c * q[0] + s * q[1]
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
    c: float,
    s: float,
    std_n: float,
    scratch: Scratch,
) -> tuple[int, float]:
    """Walks from ``q`` along (``c``, ``s``) to both sides.

    Args:
        q: (unknowns,) the best fit.
        mean: (unknowns,) mean of the prior of the constants.
        information: (unknowns, unknowns) inverse of its covariance.
        session: constants of the fit.
        line: the line.
        c: cosine of the direction of the walk.
        s: its sine.
        std_n: standard deviation along the walk at ``q``.
        scratch: buffers; the nodes are left in them, in any order.

    Returns:
        Number of nodes, and their distance in N.
    """
    work, count = scratch.rod, q.size
    step_n = min(_LONGEST_N, max(_SHORTEST_N, _NODE_STD * std_n))
    at = q.copy()
    for i in range(work.theta.size):
        scratch.theta[i] = work.theta[i]
    fits = _node(at, mean, information, session, line, c, s, scratch, 0)
    if not fits:
        return 0, step_n
    middle_tangent, middle = scratch.tangent.copy(), at.copy()
    middle_theta = work.theta.copy()
    found, best = 1, scratch.weights[0]
    for way in (1.0, -1.0):
        for k in range(count):
            at[k], scratch.tangent[k] = middle[k], middle_tangent[k]
        for i in range(work.theta.size):
            work.theta[i] = middle_theta[i]
        for _ in range(NODES):
            if found == NODES:
                break
            _turned_step(at, scratch.tangent, way * step_n, c, s)
            if math.hypot(at[0], at[1]) > session.largest_n:
                break
            fits = _node(at, mean, information, session, line, c, s, scratch, found)
            if not fits:
                break
            best = max(best, scratch.weights[found])
            found += 1
            if scratch.weights[found - 1] < best - _DEPTH:
                break
    return found, step_n
