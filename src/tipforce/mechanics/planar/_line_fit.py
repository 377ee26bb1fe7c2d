"""From a detected line to the force: Levenberg-Marquardt on the planar rod, one compiled call for a line.

The unknowns of the line (`UNKNOWNS` and the amplitudes of its modes) have a joint Gaussian prior.
"""

import math
from typing import NamedTuple

from ...types import FloatArray
from ._cholesky import factorise, solve_in
from ._compile import compiled
from ._line import Line, Model, Work, is_possible, load_at, measure, solve_shape, turn_rates

_CONVERGED_STEP = 0.05
"""The fit has converged when a step is shorter than this share of the posterior standard deviation."""
_FIRST_EASE, _EASE_STEP, _EASED_GAIN = 1.0 / 64.0, 8.0, 0.5
"""A start without an earlier shape first uses a noise of the line that is larger by 1 / `_FIRST_EASE`. Otherwise the
first step follows a direction that the line determines poorly, into a curved valley of the cost. When a step gains less
than `_EASED_GAIN`, the noise is divided by `_EASE_STEP`."""
_CONVERGED_GAIN = 1e-3
"""It has also converged when a step lowers the cost by less: a likelihood ratio without any effect on the result."""
_TRIES_PER_STEP = 2
_MAX_DAMPING = 1e8
_MAX_TURN_RAD = 1.5
"""A step that turns an element by more than this, rad, is a jump to another branch, and is made shorter."""


class Found(NamedTuple):
    """Result of the fit.

    Attributes:
        cost: minus the logarithm of the posterior density, up to a constant.
        chi2: squares of the whitened misfit, not limited.
        log_det: logarithm of the determinant of the posterior's information.
        converged: whether the fit has converged.
        stable: whether the shape is stable.
        iterations: number of steps.
    """

    cost: float
    chi2: float
    log_det: float
    converged: bool
    stable: bool
    iterations: int


@compiled
def _cost(
    q: FloatArray, mean: FloatArray, information: FloatArray, whiten: FloatArray, ease: float, limit: float, work: Work
) -> tuple[float, float]:
    """Returns the cost of ``q`` (Huber's loss of the whitened residuals plus the prior's), and their sum of squares.

    The whitened residuals are left in the last column of ``work.white``; for the arguments see `_assemble`.
    """
    rows, count = work.residual.size, q.size
    loss = square_sum = 0.0
    for i in range(rows):
        value = 0.0
        for j in range(i + 1):
            value += whiten[i, j] * work.residual[j]
        value *= ease
        work.white[i, count] = value
        size = abs(value)  # Huber: quadratic up to the limit, then linear
        square_sum += value * value
        loss += 0.5 * value * value if size <= limit else limit * (size - 0.5 * limit)
    for i in range(count):  # the prior's part
        row_sum = 0.0
        for j in range(count):
            row_sum += information[i, j] * (q[j] - mean[j])
        loss += 0.5 * row_sum * (q[i] - mean[i])
    return loss, square_sum


@compiled
def _assemble(
    q: FloatArray, mean: FloatArray, information: FloatArray, whiten: FloatArray, ease: float, limit: float, work: Work
) -> None:
    """Computes the normal equations of a Gauss-Newton step at ``q``: ``work.matrix`` times the step is ``work.side``.

    ``work.matrix`` (n, n) is the posterior information; ``work.side`` (n,) is minus the gradient of the cost.
    ``work.white`` (rows, n + 1) holds the whitened slopes of the residuals and, in its last column, the whitened
    residuals; both are multiplied by the root of their Huber weight.

    Args:
        q: (n,) unknowns.
        mean: (n,) prior mean of the unknowns.
        information: (n, n) prior information.
        whiten: (rows, rows) lower triangular matrix that makes the residuals independent with unit variance.
        ease: factor on the whitened residuals.
        limit: size in standard deviations above which a residual counts linearly.
        work: buffers; ``slopes`` and the last column of ``white`` must be filled.
    """
    rows, count = work.residual.size, q.size
    for i in range(rows):
        value = abs(work.white[i, count])
        weight = 1.0 if value <= limit else math.sqrt(limit / value)
        for k in range(count):
            work.white[i, k] = 0.0
        for j in range(i + 1):
            share = ease * weight * whiten[i, j]
            for k in range(count):
                work.white[i, k] += share * work.slopes[j, k]
        work.white[i, count] *= weight
    for row in range(count):
        total = 0.0
        for j in range(count):
            work.matrix[row, j] = information[row, j]
            total -= information[row, j] * (q[j] - mean[j])
        work.side[row] = total
    for i in range(rows):
        for row in range(count):
            value = work.white[i, row]
            work.side[row] += value * work.white[i, count]
            for column in range(row + 1):
                work.matrix[row, column] += value * work.white[i, column]
    for row in range(count):
        for column in range(row):
            work.matrix[column, row] = work.matrix[row, column]


@compiled
def fit_line(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    model: Model,
    line: Line,
    modes: FloatArray,
    whiten: FloatArray,
    limit: float,
    most: int,
    cold: bool,
    work: Work,
    covariance: FloatArray,
) -> Found:
    """Moves ``q`` from its start to the most probable unknowns.

    Args:
        q: (unknowns,) start, then result: `UNKNOWNS`, then the amplitudes of ``modes``.
        mean: (unknowns,) mean of the prior.
        information: (unknowns, unknowns) inverse of the prior's covariance. A very large entry holds an unknown.
        model: the rod.
        line: the detected line.
        modes: (points + 1, modes) errors of the line, each with an amplitude that is an unknown.
        whiten: (points + 1, points + 1) lower triangular matrix that whitens the noise of the line.
        limit: whitened residuals above this count by their size, not by its square (Huber 1964).
        most: largest number of steps.
        cold: solve the first shape from the unloaded one, not from ``work.theta``.
        work: buffers.
        covariance: (unknowns, unknowns) covariance of the posterior (Laplace's approximation), written.

    Returns:
        Cost, residuals, and whether the fit converged.
    """
    count = q.size
    cost, square_sum, tried_square_sum = math.inf, math.inf, math.inf
    damping, iteration, done, stable = 0.0, -1, False, False
    bound, largest = 1e300, 0.0  # far from the line, squares converge faster
    ease = _FIRST_EASE if cold else 1.0
    for k in range(count):
        work.tried[k] = q[k]
    for _ in range(_TRIES_PER_STEP * most + 4):
        # Solve the shape at the tried unknowns, next to the present shape.
        for i in range(work.theta.size):
            work.kept[i] = work.theta[i]
        converged, tried_stable = False, False
        if is_possible(work.tried, model):
            converged, tried_stable = solve_shape(work.tried, model, line, work, cold and iteration < 0)
        largest_turn = 0.0
        if iteration >= 0:
            for i in range(work.theta.size):
                largest_turn = max(largest_turn, abs(work.theta[i] - work.kept[i]))
        tried_cost = math.inf
        if converged and tried_stable and largest_turn < _MAX_TURN_RAD:
            fx, fy = load_at(work.tried, line)
            turn_rates(work.tried, fx, fy, False, 1.0, 0.0, model, line, work)
            measure(work.tried, model, line, modes, work)
            tried_cost, tried_square_sum = _cost(work.tried, mean, information, whiten, ease, bound, work)
        if iteration < 0 and tried_cost == math.inf:
            return Found(math.inf, math.inf, math.nan, False, tried_stable, 0)
        if tried_cost <= cost:
            done = done or (damping < 1e-2 and cost - tried_cost < (_CONVERGED_GAIN if ease == 1.0 else _EASED_GAIN))
            for k in range(count):
                q[k] = work.tried[k]
            cost, square_sum, stable = tried_cost, tried_square_sum, tried_stable
            largest = 0.0
            for i in range(work.residual.size):
                largest = max(largest, abs(work.white[i, count]))
            _assemble(q, mean, information, whiten, ease, bound, work)
            damping = 0.0 if damping < 1e-3 else 0.2 * damping
            iteration += 1
        else:
            for i in range(work.theta.size):
                work.theta[i] = work.kept[i]
            damping = max(1e-2, 6.0 * damping)
        # Converged with eased noise, or with squares although a residual exceeds the limit: go on with the true cost.
        if done and (ease < 1.0 or (bound > limit and largest > limit)):
            if ease < 1.0:
                ease = min(1.0, _EASE_STEP * ease)
            else:
                bound = limit
            cost, done, damping = math.inf, False, 0.0
            for k in range(count):
                work.tried[k] = q[k]
            continue
        if done or iteration >= most or damping > _MAX_DAMPING:
            break
        # The next step, damped (Levenberg-Marquardt) until the matrix is positive definite.
        while damping <= _MAX_DAMPING and math.isnan(factorise(work.matrix, damping, work.factor)):
            damping = max(1e-3, 4.0 * damping)
        if damping > _MAX_DAMPING:
            break
        decrement = 0.0
        for k in range(count):
            work.step[k] = work.side[k]
        solve_in(work.factor, work.step)
        for k in range(count):
            work.tried[k] = q[k] + work.step[k]
            decrement += work.step[k] * work.side[k]
        done = decrement < _CONVERGED_STEP**2 and damping < 1e-2
    log_det = factorise(work.matrix, 0.0, work.factor)
    for row in range(count):
        column = covariance[row]
        for other in range(count):
            column[other] = 1.0 if row == other else 0.0
        solve_in(work.factor, column)
    return Found(cost, square_sum, log_det, done and not math.isnan(log_det), stable, iteration)
