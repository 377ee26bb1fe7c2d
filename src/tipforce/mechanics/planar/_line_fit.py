"""From a detected line to the force: Levenberg-Marquardt on the planar rod, one compiled call for a line.

The measurement is the displacement of the detected line across itself at its points, and along itself at its tip. The
unknowns are those of the rod, of its clamp and of the camera (`UNKNOWNS`), then the amplitudes of ``modes``: errors of
the line that last for some time. All have a joint Gaussian prior. Derivatives are exact: the implicit function theorem
at the equilibrium, with one tridiagonal solution per unknown.
"""

import math
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._cholesky import factorise, solve_in
from ._compile import compiled
from ._newton import (
    COSINE,
    SCRATCH,
    SINE,
    TOLERANCE,
    Elastic,
    Load,
    follow,
    relax_in,
    solve_factorised,
)

UNKNOWNS = (
    "force_x_n",
    "force_y_n",
    "precurvature_per_m",
    "stiffness",
    "proximal_stiffness",
    "stiffening_m2",
    "length",
    "scale",
    "base_x_m",
    "base_y_m",
    "base_angle_rad",
    "tilt_x_per_m",
    "tilt_y_per_m",
    "distortion_per_m2",
    "creep",
)
"""Force in the frame of the clamp; pre-curvature; relative changes of EI and of EI over the proximal third; 1 / k_s^2;
relative changes of the flexible length and of the metres per pixel; the clamp in the frame of the line; the
camera: a point at c from the middle of the image moves by c (tilt . c) + distortion |c|^2 c; creep: share of the bend
under earlier forces that remains."""
FORCE = 2
"""Number of the first unknowns, which are the force."""
_FX, _FY, _K0, _EI, _PROXIMAL, _SOFT, _LENGTH, _SCALE, _X, _Y, _ANGLE, _TILT_X, _TILT_Y, _RADIAL, _CREEP = range(
    len(UNKNOWNS)
)
_ROD_UNKNOWNS = 7
"""Number of the first unknowns, which change the rod's shape; creep does, too."""
_CREPT = _ROD_UNKNOWNS
"""Place of the creep among the derivatives of the shape."""
_NONE = np.zeros(0)

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
_MAX_LOAD, _MAX_BEND_RAD, _MIN_SOFT = 10.0, 2.0 * math.pi, -1e-4
"""Limits of force x length^2 / EI, four times the buckling load; turn of the unloaded rod, rad; softening."""
_MAX_TURN_RAD = 1.5
"""A step that turns an element by more than this, rad, is a jump to another branch, and is made shorter."""


class Model(NamedTuple):
    """The nominal rod; the deviations from it are unknowns."""

    segments: int
    flexible_m: float
    rigid_m: float
    stiffness_nm2: float
    profile: FloatArray
    """(segments + 1,): factors on EI at the joints."""
    dome_m: float
    """Distance of the force behind the tip: a wall presses on a round tip through the middle of its dome."""
    rest_per_m: FloatArray
    """(segments + 1,): curvature without load at the joints, beside the pre-curvature that is an unknown."""


class Line(NamedTuple):
    """A detected line in the frame of the prior, base to tip.

    Attributes:
        points: (p, 2) points in m.
        normals: (p, 2) unit vectors to its left.
        from_tip: (p,) arc length between point and tip, the last 0.
        middle: (2,) middle of the image.
        past_n: (2,) mean of the earlier forces over the time of creep: to first order the rod has crept as if a share
            of it acted.
        from_clamp: arc lengths are counted from the clamp, since the line does not show the tip. Then the last row of
            the residual, along the line, means nothing: ``whiten`` must leave it out.
        crept_per_m: (segments + 1,) mean of the earlier curvature beyond the unloaded one over the time of creep, at
            each joint: a share of it remains. Empty: ``past_n`` counts.
    """

    points: FloatArray
    normals: FloatArray
    from_tip: FloatArray
    middle: FloatArray
    past_n: FloatArray
    from_clamp: bool = False
    crept_per_m: FloatArray = _NONE


class Work(NamedTuple):
    """Buffers of one rod and one number of points and unknowns; ``theta`` (n,) holds the start and then the shape."""

    theta: FloatArray
    before: FloatArray
    scratch: FloatArray
    ei: FloatArray
    k0: FloatArray
    carried: FloatArray
    nodes: FloatArray
    turns: FloatArray
    residual: FloatArray
    slopes: FloatArray
    white: FloatArray
    matrix: FloatArray
    factor: FloatArray
    side: FloatArray
    tried: FloatArray
    step: FloatArray
    kept: FloatArray


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


def make_work(model: Model, points: int, unknowns: int) -> Work:
    """Makes the buffers for lines of ``points`` points; the start is the straight rod.

    Args:
        model: the rod.
        points: number of points of a line.
        unknowns: number of unknowns.

    Returns:
        The buffers.
    """
    n, rows = model.segments + 1, points + 1
    return Work(
        np.zeros(n), np.zeros(n), np.zeros((SCRATCH + 4, n)), np.zeros(n), np.zeros(n), np.zeros((n, 2)),
        np.zeros((2, n + 1)), np.zeros((_ROD_UNKNOWNS + 1, 2, n + 1)), np.zeros(rows), np.zeros((rows, unknowns)),
        np.zeros((rows, unknowns + 1)), np.zeros((unknowns, unknowns)), np.zeros((unknowns, unknowns)),
        np.zeros(unknowns), np.zeros(unknowns), np.zeros(unknowns), np.zeros(n),
    )  # fmt: skip


@compiled
def _load(q: FloatArray, line: Line) -> tuple[float, float]:
    """Returns the force that bends the rod as force and creep together do."""
    return q[_FX] + q[_CREEP] * line.past_n[0], q[_FY] + q[_CREEP] * line.past_n[1]


@compiled
def is_possible(q: FloatArray, model: Model) -> bool:
    """Returns whether such a rod exists, with a load in the range of the solver; NaN: False.

    Args:
        q: (unknowns,) values of `UNKNOWNS`; the rest is ignored.
        model: the rod.
    """
    size = math.hypot(q[_FX], q[_FY]) * model.flexible_m**2 / model.stiffness_nm2
    stiff = min(1.0 + q[_EI], 1.0 + q[_PROXIMAL], 1.0 + q[_LENGTH], 1.0 + q[_SCALE]) > 0.3
    largest = 0.0
    for rest in model.rest_per_m:
        largest = max(largest, abs(q[_K0] + rest))
    bend = abs(q[_K0]) * model.flexible_m
    # if the stiffness falls with the curvature there is no unique shape
    return size < _MAX_LOAD and stiff and bend < _MAX_BEND_RAD and q[_SOFT] > _MIN_SOFT and q[_SOFT] * largest**2 < 3.0


@compiled
def _solve_shape(q: FloatArray, model: Model, line: Line, work: Work, cold: bool) -> tuple[bool, bool]:
    """Solves the equilibrium at ``q`` into ``theta``; whether it converged, and whether it is stable."""
    n = model.segments + 1
    h = model.flexible_m * (1.0 + q[_LENGTH]) / model.segments
    for i in range(n):
        share = 1.0 + (q[_PROXIMAL] if 3 * i < model.segments else 0.0)
        work.ei[i] = model.stiffness_nm2 * model.profile[i] * (1.0 + q[_EI]) * share
        work.k0[i] = q[_K0] + model.rest_per_m[i] + (q[_CREEP] * line.crept_per_m[i] if line.crept_per_m.size else 0.0)
    rod = Elastic(h, model.rigid_m - model.dome_m, work.ei, work.k0, q[_SOFT], model.stiffness_nm2 / model.flexible_m)
    fx, fy = _load(q, line)
    load = Load(fx, fy, 0.0, work.carried)
    if cold:
        angle = 0.0
        for i in range(n):
            angle += (q[_K0] + model.rest_per_m[i]) * (h if 0 < i < n - 1 else 0.5 * h)
            work.theta[i] = angle
        outcome, _ = follow(work.theta, rod, load, 0.5, work.scratch)
    else:
        outcome = relax_in(work.theta, rod, load, 1e3 * TOLERANCE, work.scratch[:SCRATCH])
    return outcome.converged, outcome.stable


@compiled
def _turn_rates(q: FloatArray, model: Model, line: Line, work: Work) -> None:
    """Computes nodes (2, n + 1), and their derivatives with each unknown of the rod, into ``turns``."""
    n = model.segments + 1
    last = n - 1
    h = model.flexible_m * (1.0 + q[_LENGTH]) / model.segments
    per_length = model.flexible_m / model.segments
    fx, fy = _load(q, line)
    cosine, sine = work.scratch[COSINE], work.scratch[SINE]
    side = work.before
    for parameter in range(_ROD_UNKNOWNS + 1):
        previous = 0.0
        for i in range(n):
            reach = h if i < last else model.rigid_m - model.dome_m
            value = 0.0
            if parameter == _FX:
                value = -reach * sine[i]
            elif parameter == _FY:
                value = reach * cosine[i]
            else:
                span = h if 0 < i < last else 0.5 * h
                k = (work.theta[i] - previous) / span
                stiffer = 1.0 + q[_SOFT] * k * k
                bent = work.ei[i] * stiffer * (k - work.k0[i])
                if parameter == _K0:
                    joint = work.ei[i] * stiffer
                elif parameter == _EI:
                    joint = -bent / (1.0 + q[_EI])
                elif parameter == _PROXIMAL:
                    joint = -bent / (1.0 + q[_PROXIMAL]) if 3 * i < model.segments else 0.0
                elif parameter == _SOFT:
                    joint = -work.ei[i] * k * k * (k - work.k0[i])
                elif parameter == _CREPT:
                    joint = work.ei[i] * stiffer * line.crept_per_m[i] if line.crept_per_m.size else 0.0
                else:
                    slope = work.ei[i] * (stiffer + 2.0 * q[_SOFT] * k * (k - work.k0[i]))
                    joint = slope * k / h * per_length
                    if i < last:
                        value = per_length * (fy * cosine[i] - fx * sine[i])
                value += joint
                if i > 0:
                    side[i - 1] -= joint
            previous = work.theta[i]
            side[i] = value
        solve_factorised(work.scratch[:SCRATCH], side)
        moves = work.turns[parameter]
        x = y = 0.0
        for i in range(n):
            reach = h if i < last else model.rigid_m
            x -= reach * sine[i] * side[i]
            y += reach * cosine[i] * side[i]
            if parameter == _LENGTH and i < last:
                x += per_length * cosine[i]
                y += per_length * sine[i]
            moves[0, i + 1], moves[1, i + 1] = x, y
    x = y = 0.0
    for i in range(n):
        reach = h if i < last else model.rigid_m
        x += reach * cosine[i]
        y += reach * sine[i]
        work.nodes[0, i + 1], work.nodes[1, i + 1] = x, y


@compiled
def _measure(q: FloatArray, model: Model, line: Line, modes: FloatArray, work: Work) -> None:
    """Computes the residual of the line at ``q`` into ``residual``, its derivatives into ``slopes``."""
    segments, p = model.segments, line.from_tip.size
    h = model.flexible_m * (1.0 + q[_LENGTH]) / segments
    length = h * segments + model.rigid_m
    larger = 1.0 + q[_SCALE]
    c, s = math.cos(q[_ANGLE]), math.sin(q[_ANGLE])
    count = q.size
    # of the first point, on the tangent of the clamp and beside it
    first_x, first_y = line.points[0, 0] - q[_X], line.points[0, 1] - q[_Y]
    ahead, aside = c * first_x + s * first_y, c * first_y - s * first_x
    for i in range(p):
        if line.from_clamp:
            arc = larger * (ahead + line.from_tip[0] - line.from_tip[i])
        else:
            arc = length - line.from_tip[i] * larger
        if arc < 0.0:  # behind the clamp the line is straight
            first, share, x, y, ex, ey = 0, 0.0, arc, 0.0, 1.0, 0.0
        else:
            first = min(int(arc / h), segments)
            share = (arc - first * h) / (h if first < segments else model.rigid_m)
            x = work.nodes[0, first] + share * (work.nodes[0, first + 1] - work.nodes[0, first])
            y = work.nodes[1, first] + share * (work.nodes[1, first + 1] - work.nodes[1, first])
            ex, ey = work.scratch[COSINE, first], work.scratch[SINE, first]
            if first < segments:  # the arc, not its chord: kinks would be visible at a hundredth of a pixel
                before, after = work.theta[first - 1] if first else 0.0, work.theta[first + 1]
                bend = (after - before) / (2.0 if 0 < first < segments - 1 else 1.5)
                sag, lean = -0.5 * bend * h * share * (1.0 - share), -0.5 * bend * (1.0 - 2.0 * share)
                x, y = x - sag * ey, y + sag * ex
                ex, ey = ex - lean * ey, ey + lean * ex
        rx, ry = (c * x - s * y) / larger, (s * x + c * y) / larger
        gx, gy = q[_X] + rx - line.middle[0], q[_Y] + ry - line.middle[1]
        tilt, square = q[_TILT_X] * gx + q[_TILT_Y] * gy, gx * gx + gy * gy
        grow = 1.0 + tilt + q[_RADIAL] * square
        dx = line.points[i, 0] - line.middle[0] - grow * gx
        dy = line.points[i, 1] - line.middle[1] - grow * gy
        rows = 1 if i < p - 1 else 2
        for turn in range(rows):
            nx, ny = line.normals[i, 0], line.normals[i, 1]
            if turn == 1:
                nx, ny = ny, -nx  # along the line
            row = i + turn
            value = nx * dx + ny * dy
            for k in range(modes.shape[1]):
                value -= modes[row, k] * q[count - modes.shape[1] + k]
            work.residual[row] = value
            # through the camera's map: its slope is grow 1 + gx (tilt, ...)
            way = nx * gx + ny * gy
            ux = grow * nx + way * (q[_TILT_X] + 2.0 * q[_RADIAL] * gx)
            uy = grow * ny + way * (q[_TILT_Y] + 2.0 * q[_RADIAL] * gy)
            bx, by = (c * ux + s * uy) / larger, (-s * ux + c * uy) / larger
            along = bx * ex + by * ey
            for k in range(_ROD_UNKNOWNS):
                if arc < 0.0:
                    work.slopes[row, k] = bx * model.flexible_m if k == _LENGTH and not line.from_clamp else 0.0
                    continue
                moves = work.turns[k]
                mx = moves[0, first] + share * (moves[0, first + 1] - moves[0, first])
                my = moves[1, first] + share * (moves[1, first + 1] - moves[1, first])
                work.slopes[row, k] = bx * mx + by * my
                if k == _LENGTH:  # the share of the element at this distance from the tip, or the clamp, changes, too
                    passed = (first + (share if first < segments else 0.0)) / segments
                    grows = -passed if line.from_clamp else 1.0 - passed
                    work.slopes[row, k] += along * model.flexible_m * grows
            work.slopes[row, _X], work.slopes[row, _Y] = ux, uy
            work.slopes[row, _ANGLE] = -ux * ry + uy * rx
            work.slopes[row, _SCALE] = -(ux * rx + uy * ry) / larger
            if line.from_clamp:
                work.slopes[row, _SCALE] += along * arc / larger
                work.slopes[row, _X] -= along * larger * c
                work.slopes[row, _Y] -= along * larger * s
                work.slopes[row, _ANGLE] += along * larger * aside
            else:
                work.slopes[row, _SCALE] -= along * line.from_tip[i]
            work.slopes[row, _TILT_X], work.slopes[row, _TILT_Y] = way * gx, way * gy
            work.slopes[row, _RADIAL] = way * square
            work.slopes[row, _CREEP] = line.past_n[0] * work.slopes[row, _FX] + line.past_n[1] * work.slopes[row, _FY]
            if arc >= 0.0:
                moves = work.turns[_CREPT]
                mx = moves[0, first] + share * (moves[0, first + 1] - moves[0, first])
                my = moves[1, first] + share * (moves[1, first + 1] - moves[1, first])
                work.slopes[row, _CREEP] += bx * mx + by * my
            for k in range(modes.shape[1]):
                work.slopes[row, count - modes.shape[1] + k] = modes[row, k]


@compiled
def predict_line(
    q: FloatArray, model: Model, line: Line, modes: FloatArray, work: Work, cold: bool
) -> tuple[bool, bool]:
    """Computes ``residual`` and ``slopes`` of ``work`` at given unknowns, if a stable shape is found.

    Args:
        q: (unknowns,) `UNKNOWNS`, then the amplitudes of ``modes``.
        model: the rod.
        line: the detected line.
        modes: (points + 1, modes) errors of the line, each with an amplitude that is an unknown.
        work: buffers.
        cold: solve the shape from the unloaded one, not from ``work.theta``.

    Returns:
        Whether the shape converged, and whether it is stable.
    """
    converged, stable = _solve_shape(q, model, line, work, cold)
    if converged and stable:
        _turn_rates(q, model, line, work)
        _measure(q, model, line, modes, work)
    return converged, stable


@compiled
def _cost(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    whiten: FloatArray,
    ease: float,
    limit: float,
    work: Work,
) -> tuple[float, float]:
    """Returns Huber's loss of the whitened residual plus the prior's, and the squares' sum. Fills ``white[:, -1]``."""
    rows, count = work.residual.size, q.size
    loss = plain = 0.0
    for i in range(rows):
        value = 0.0
        for j in range(i + 1):
            value += whiten[i, j] * work.residual[j]
        value *= ease
        work.white[i, count] = value
        size = abs(value)
        plain += value * value
        loss += 0.5 * value * value if size <= limit else limit * (size - 0.5 * limit)
    for i in range(count):
        part = 0.0
        for j in range(count):
            part += information[i, j] * (q[j] - mean[j])
        loss += 0.5 * part * (q[i] - mean[i])
    return loss, plain


@compiled
def _assemble(
    q: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    whiten: FloatArray,
    ease: float,
    limit: float,
    work: Work,
) -> None:
    """Computes the posterior information at ``q`` into ``matrix``, minus the gradient of the cost into ``side``."""
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
    for a in range(count):
        total = 0.0
        for j in range(count):
            work.matrix[a, j] = information[a, j]
            total -= information[a, j] * (q[j] - mean[j])
        work.side[a] = total
    for i in range(rows):
        for a in range(count):
            value = work.white[i, a]
            work.side[a] += value * work.white[i, count]
            for b in range(a + 1):
                work.matrix[a, b] += value * work.white[i, b]
    for a in range(count):
        for b in range(a):
            work.matrix[b, a] = work.matrix[a, b]


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
    cost, plain, plain_there = math.inf, math.inf, math.inf
    damping, iteration, done, stable = 0.0, -1, False, False
    bound, largest = 1e300, 0.0  # far from the line, squares converge faster
    ease = _FIRST_EASE if cold else 1.0
    for k in range(count):
        work.tried[k] = q[k]
    for _ in range(_TRIES_PER_STEP * most + 4):
        for i in range(work.theta.size):
            work.kept[i] = work.theta[i]
        converged, stable_there = False, False
        if is_possible(work.tried, model):
            converged, stable_there = _solve_shape(work.tried, model, line, work, cold and iteration < 0)
        turned = 0.0
        if iteration >= 0:
            for i in range(work.theta.size):
                turned = max(turned, abs(work.theta[i] - work.kept[i]))
        tried_cost = math.inf
        if converged and stable_there and turned < _MAX_TURN_RAD:
            _turn_rates(work.tried, model, line, work)
            _measure(work.tried, model, line, modes, work)
            tried_cost, plain_there = _cost(work.tried, mean, information, whiten, ease, bound, work)
        if iteration < 0 and tried_cost == math.inf:
            return Found(math.inf, math.inf, math.nan, False, stable_there, 0)
        if tried_cost <= cost:
            done = done or (damping < 1e-2 and cost - tried_cost < (_CONVERGED_GAIN if ease == 1.0 else _EASED_GAIN))
            for k in range(count):
                q[k] = work.tried[k]
            cost, plain, stable = tried_cost, plain_there, stable_there
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
    for a in range(count):
        column = covariance[a]
        for b in range(count):
            column[b] = 1.0 if a == b else 0.0
        solve_in(work.factor, column)
    return Found(cost, plain, log_det, done and not math.isnan(log_det), stable, iteration)
