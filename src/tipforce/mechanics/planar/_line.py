"""The line of the planar rod: its displacement from a detected line, and the derivatives with all unknowns.

The measurement is the displacement of the detected line across itself at its points, and along itself at its tip. The
unknowns are those of the rod, of its clamp and of the camera (`UNKNOWNS`), then the amplitudes of ``modes``: errors of
the line that last for some time. Derivatives are exact: the implicit function theorem at the equilibrium, with one
tridiagonal solution per unknown.
"""

import math
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._compile import compiled
from ._held import Hold, aside, hold_in
from ._newton import COSINE, SCRATCH, SINE, TOLERANCE, Elastic, Load, follow, relax_in, solve_factorised

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

_MAX_LOAD, _MAX_BEND_RAD, _MIN_SOFT = 10.0, 2.0 * math.pi, -1e-4
"""Limits of force x length^2 / EI, four times the buckling load; turn of the unloaded rod, rad; softening."""


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
    unloaded: FloatArray
    """(n,) curvature of the unloaded shaft without the lever of a held tip, 1/m."""
    yielding: FloatArray
    """(n,) change of the angles for each newton of the reaction of a held tip."""
    reaction: FloatArray
    """(2,): reaction of a held tip in N, and its displacement for each newton in m."""
    reaction_rates: FloatArray
    """(unknowns of the shape,): derivatives of the reaction; the first two with the force along, and the position."""


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
        np.zeros(unknowns), np.zeros(unknowns), np.zeros(unknowns), np.zeros(n), np.zeros(n), np.zeros(n),
        np.zeros(2), np.zeros(_ROD_UNKNOWNS + 1),
    )  # fmt: skip


@compiled
def load_at(q: FloatArray, line: Line) -> tuple[float, float]:
    """Returns the force in N that bends the rod as force and creep together do.

    Args:
        q: (unknowns,) values of `UNKNOWNS`.
        line: the line.
    """
    return q[_FX] + q[_CREEP] * line.past_n[0], q[_FY] + q[_CREEP] * line.past_n[1]


@compiled
def is_possible(q: FloatArray, model: Model) -> bool:
    """Returns whether such a rod exists, with a load in the range of the solver; NaN: False.

    Args:
        q: (unknowns,) values of `UNKNOWNS`; the rest is ignored.
        model: the rod.
    """
    size = math.hypot(q[_FX], q[_FY]) * model.flexible_m**2 / model.stiffness_nm2
    firm = min(1.0 + q[_EI], 1.0 + q[_PROXIMAL], 1.0 + q[_LENGTH], 1.0 + q[_SCALE]) > 0.3
    largest = 0.0
    for rest in model.rest_per_m:
        largest = max(largest, abs(q[_K0] + rest))
    bend = abs(q[_K0]) * model.flexible_m
    # if the stiffness falls with the curvature there is no unique shape
    return size < _MAX_LOAD and firm and bend < _MAX_BEND_RAD and q[_SOFT] > _MIN_SOFT and q[_SOFT] * largest**2 < 3.0


@compiled
def _rod_at(q: FloatArray, model: Model, line: Line, work: Work) -> Elastic:
    """Returns the rod with the unknowns ``q``; its EI and curvature without load are in ``work.ei`` and ``work.k0``."""
    n = model.segments + 1
    h = model.flexible_m * (1.0 + q[_LENGTH]) / model.segments
    for i in range(n):
        share = 1.0 + (q[_PROXIMAL] if 3 * i < model.segments else 0.0)
        work.ei[i] = model.stiffness_nm2 * model.profile[i] * (1.0 + q[_EI]) * share
        work.k0[i] = q[_K0] + model.rest_per_m[i] + (q[_CREEP] * line.crept_per_m[i] if line.crept_per_m.size else 0.0)
    return Elastic(h, model.rigid_m - model.dome_m, work.ei, work.k0, q[_SOFT], model.stiffness_nm2 / model.flexible_m)


@compiled
def solve_shape(q: FloatArray, model: Model, line: Line, work: Work, cold: bool) -> tuple[bool, bool]:
    """Solves the equilibrium under a dead load into ``theta``.

    Args:
        q: (unknowns,) values of `UNKNOWNS`.
        model: the rod.
        line: the detected line.
        work: buffers.
        cold: start from the unloaded shape, not from ``theta``.

    Returns:
        Whether the shape converged, and whether it is stable.
    """
    rod = _rod_at(q, model, line, work)
    n, h = work.theta.size, rod.h
    fx, fy = load_at(q, line)
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
def turn_rates(
    q: FloatArray, fx: float, fy: float, held: bool, c: float, s: float, model: Model, line: Line, work: Work
) -> None:
    """Computes nodes (2, n + 1), and their derivatives with each unknown of the rod, into ``turns``.

    Args:
        q: (unknowns,) values of `UNKNOWNS`.
        fx: force along x in the frame of the clamp, N.
        fy: force along y, N.
        held: the first two unknowns are the force along (c, s), and the position of the loaded point across it; else
            the force along (c, s), and across it.
        c: cosine of the direction in the frame of the clamp.
        s: its sine.
        model: the rod.
        line: the detected line.
        work: buffers, as `solve_shape` or the solution of the held rod leaves them.
    """
    n = model.segments + 1
    last = n - 1
    h = model.flexible_m * (1.0 + q[_LENGTH]) / model.segments
    per_length = model.flexible_m / model.segments
    cosine, sine = work.scratch[COSINE], work.scratch[SINE]
    side = work.before
    for parameter in range(_ROD_UNKNOWNS + 1):
        # Minus the derivative of the unbalanced moments; `solve_factorised` then gives that of the angles.
        previous = 0.0
        for i in range(n):
            reach = h if i < last else model.rigid_m - model.dome_m
            value = 0.0
            if parameter == _FX:
                value = reach * (s * cosine[i] - c * sine[i])
            elif parameter == _FY:
                value = 0.0 if held else reach * (c * cosine[i] + s * sine[i])
            else:
                span = h if 0 < i < last else 0.5 * h
                k = (work.theta[i] - previous) / span
                stiffer = 1.0 + q[_SOFT] * k * k
                moment = work.ei[i] * stiffer * (k - work.k0[i])
                if parameter == _K0:
                    joint = work.ei[i] * stiffer
                elif parameter == _EI:
                    joint = -moment / (1.0 + q[_EI])
                elif parameter == _PROXIMAL:
                    joint = -moment / (1.0 + q[_PROXIMAL]) if 3 * i < model.segments else 0.0
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
        if held:  # the reaction changes so that the point stays, or moves as `_FY` says
            missing_m = 1.0 if parameter == _FY else 0.0
            for i in range(n):
                reach = h if i < last else model.rigid_m - model.dome_m
                missing_m -= reach * (c * cosine[i] + s * sine[i]) * side[i]
                if parameter == _LENGTH and i < last:
                    missing_m -= per_length * (c * sine[i] - s * cosine[i])
            rate = missing_m / work.reaction[1]
            work.reaction_rates[parameter] = rate
            for i in range(n):
                side[i] += rate * work.yielding[i]
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
def measure(q: FloatArray, model: Model, line: Line, modes: FloatArray, work: Work) -> None:
    """Computes the residual of the line at ``q`` into ``residual``, its derivatives into ``slopes``.

    Args:
        q: (unknowns,) `UNKNOWNS`, then the amplitudes of ``modes``.
        model: the rod.
        line: the detected line.
        modes: (points + 1, modes) errors of the line, each with an amplitude that is an unknown.
        work: buffers, as `turn_rates` leaves them.
    """
    segments, p = model.segments, line.from_tip.size
    h = model.flexible_m * (1.0 + q[_LENGTH]) / segments
    length = h * segments + model.rigid_m
    scale_ratio = 1.0 + q[_SCALE]
    c, s = math.cos(q[_ANGLE]), math.sin(q[_ANGLE])
    count = q.size
    # The first point in the frame of the clamp: along its tangent and beside it.
    first_x, first_y = line.points[0, 0] - q[_X], line.points[0, 1] - q[_Y]
    ahead, aside = c * first_x + s * first_y, c * first_y - s * first_x
    for i in range(p):
        if line.from_clamp:
            arc = scale_ratio * (ahead + line.from_tip[0] - line.from_tip[i])
        else:
            arc = length - line.from_tip[i] * scale_ratio
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
        # (x, y): point of the rod in the frame of the clamp; (gx, gy): from the middle of the image, before distortion.
        rx, ry = (c * x - s * y) / scale_ratio, (s * x + c * y) / scale_ratio
        gx, gy = q[_X] + rx - line.middle[0], q[_Y] + ry - line.middle[1]
        tilt, square_distance = q[_TILT_X] * gx + q[_TILT_Y] * gy, gx * gx + gy * gy
        magnification = 1.0 + tilt + q[_RADIAL] * square_distance
        dx = line.points[i, 0] - line.middle[0] - magnification * gx
        dy = line.points[i, 1] - line.middle[1] - magnification * gy
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
            # Derivatives: the normal is carried back through the camera's map, whose slope is grow 1 + gx (tilt, ...).
            normal_part = nx * gx + ny * gy
            ux = magnification * nx + normal_part * (q[_TILT_X] + 2.0 * q[_RADIAL] * gx)
            uy = magnification * ny + normal_part * (q[_TILT_Y] + 2.0 * q[_RADIAL] * gy)
            bx, by = (c * ux + s * uy) / scale_ratio, (-s * ux + c * uy) / scale_ratio
            along = bx * ex + by * ey
            for k in range(_ROD_UNKNOWNS):
                if arc < 0.0:
                    work.slopes[row, k] = bx * model.flexible_m if k == _LENGTH and not line.from_clamp else 0.0
                    continue
                rates = work.turns[k]
                mx = rates[0, first] + share * (rates[0, first + 1] - rates[0, first])
                my = rates[1, first] + share * (rates[1, first + 1] - rates[1, first])
                work.slopes[row, k] = bx * mx + by * my
                if k == _LENGTH:  # the share of the element at this distance from the tip, or the clamp, changes, too
                    passed = (first + (share if first < segments else 0.0)) / segments
                    grows = -passed if line.from_clamp else 1.0 - passed
                    work.slopes[row, k] += along * model.flexible_m * grows
            work.slopes[row, _X], work.slopes[row, _Y] = ux, uy
            work.slopes[row, _ANGLE] = -ux * ry + uy * rx
            work.slopes[row, _SCALE] = -(ux * rx + uy * ry) / scale_ratio
            if line.from_clamp:
                work.slopes[row, _SCALE] += along * arc / scale_ratio
                work.slopes[row, _X] -= along * scale_ratio * c
                work.slopes[row, _Y] -= along * scale_ratio * s
                work.slopes[row, _ANGLE] += along * scale_ratio * aside
            else:
                work.slopes[row, _SCALE] -= along * line.from_tip[i]
            work.slopes[row, _TILT_X], work.slopes[row, _TILT_Y] = normal_part * gx, normal_part * gy
            work.slopes[row, _RADIAL] = normal_part * square_distance
            work.slopes[row, _CREEP] = line.past_n[0] * work.slopes[row, _FX] + line.past_n[1] * work.slopes[row, _FY]
            if arc >= 0.0:
                rates = work.turns[_CREPT]
                mx = rates[0, first] + share * (rates[0, first + 1] - rates[0, first])
                my = rates[1, first] + share * (rates[1, first + 1] - rates[1, first])
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
    converged, stable = solve_shape(q, model, line, work, cold)
    if converged and stable:
        fx, fy = load_at(q, line)
        turn_rates(q, fx, fy, False, 1.0, 0.0, model, line, work)
        measure(q, model, line, modes, work)
    return converged, stable


@compiled
def predict_held_line(
    q: FloatArray, lever_per_m_n: float, c: float, s: float, model: Model, line: Line, modes: FloatArray, work: Work
) -> bool:
    """Computes ``residual`` and ``slopes`` of ``work`` for a rod whose tip is held across the direction (c, s).

    The first two unknowns are the force along this direction, N, and the position of the loaded point to its left, m,
    both in the frame of the clamp. The reaction, its derivatives with the unknowns of the rod, and its start are in
    ``work``.

    Args:
        q: (unknowns,) `UNKNOWNS` with these two, then the amplitudes of ``modes``.
        lever_per_m_n: curvature of the unloaded shaft for each newton of the force (a moment at the tip).
        c: cosine of the direction.
        s: its sine.
        model: the rod.
        line: the detected line; ``past_n`` does not count.
        modes: (points + 1, modes) errors of the line, each with an amplitude that is an unknown.
        work: buffers; ``theta`` holds the start of the shape.

    Returns:
        Whether there is such a shape.
    """
    rod = _rod_at(q, model, line, work)
    for i in range(work.theta.size):  # a copy, because `hold_in` overwrites ``k0``
        work.unloaded[i] = work.k0[i]
    hold = Hold(q[_FX], q[_FY], c, s, lever_per_m_n)
    found = hold_in(
        work.theta, rod, work.unloaded, hold, work.reaction[0], 1e3 * TOLERANCE, work.scratch[:SCRATCH], work.carried,
        work.yielding,
    )  # fmt: skip
    if not (found.converged and found.stable):
        return False
    work.reaction[0], work.reaction[1] = found.across_n, found.give
    fx, fy = c * q[_FX] - s * found.across_n, s * q[_FX] + c * found.across_n
    turn_rates(q, fx, fy, True, c, s, model, line, work)
    measure(q, model, line, modes, work)
    return True


@compiled
def loaded_point_aside(q: FloatArray, c: float, s: float, model: Model, work: Work) -> float:
    """Returns where the loaded point of the shape in ``work`` is, in m to the left of the direction (c, s).

    Args:
        q: (unknowns,) values of `UNKNOWNS`; only the length counts.
        c: cosine of the direction in the frame of the clamp.
        s: its sine.
        model: the rod.
        work: buffers with the shape.
    """
    h = model.flexible_m * (1.0 + q[_LENGTH]) / model.segments
    return aside(work.theta, h, model.rigid_m - model.dome_m, c, s)
