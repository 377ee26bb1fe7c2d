"""Time stepping of the tip on the wall: one equilibrium for each instant, with creep, friction and damping."""

import math
from typing import NamedTuple

import numpy as np

from ...types import BoolArray, FloatArray
from ._compile import compiled
from ._energy import (
    contact_at,
    exponential_spring,
    joint_moment,
    log_factors,
    log_scale,
    normal_force,
    tangential_force,
    tip_at,
    unturned,
)
from ._face import face_axes
from ._newton import TOLERANCE, Solution, copy_turns, relax
from ._state import Elastic, Load, Touch, Work

_MIN_TURN_COSINE = math.cos(0.5 * 0.02)
"""Turns of up to 0.02 rad per instant are extrapolated."""


class WallLaw(NamedTuple):
    """The values of the wall's laws, see `Touch`.

    Attributes:
        axes: (3, 3) rows d (into the wall), t1, t2.
        radius: radius of the ball.
        stiffness: stiffness of the normal force.
        hertz: factor of Hertz's law; 0: linear.
        damping: damping of the normal force.
        kt: stiffness along the wall.
        friction: Coulomb's coefficient.
        side: stiffness of the contact of each node of the shaft.
        dt_s: time between instants.
        base_rest: (k, 3) the rod's own pre-curvature.
        growth: growth of the exponential law; 0: none.
        face_radius: radius of the tissue's face, see `face_axes`; 0: flat.
    """

    axes: FloatArray
    radius: float
    stiffness: float
    hertz: float
    damping: float
    kt: float
    friction: float
    side: float
    dt_s: float
    relaxing: float
    """dt / time constant of the creep."""
    base_rest: FloatArray
    growth: float
    face_radius: float


class History(NamedTuple):
    """State of the last instant, from which the next one starts.

    Attributes:
        q: (k, 4) orientations.
        before: (k, 4) orientations of the instant before.
        centre: (3,) centre of the dome.
        wall: (3,) the wall's point.
        way: (2,) way of the touching point along the wall, relative to the wall.
        anchor: (2,) rest position of the tissue to which it sticks.
        begun: (1,) whether there was an instant.
        touching: (1,) whether the dome touches.
        indentation: (1,) depth of the tissue.
    """

    q: FloatArray
    before: FloatArray
    centre: FloatArray
    wall: FloatArray
    way: FloatArray
    anchor: FloatArray
    begun: BoolArray
    touching: BoolArray
    indentation: FloatArray


class Instants(NamedTuple):
    """Results at each of m instants, base frame.

    Attributes:
        shapes: (m, k, 4) orientations.
        dome_force: (m, 3) force on the dome.
        touch: (m, 3) its point.
        base_moment: (m, 3) moment at the clamp.
        side_force: (m,) force of the shaft's side along d.
        indentation: (m,) depth of the tissue.
        touching: (m,) whether the dome touches.
        slipping: (m,) whether it slips.
        converged: (m,) whether Newton's method converged.
        stable: (m,) whether the shape is a minimum.
    """

    shapes: FloatArray
    dome_force: FloatArray
    touch: FloatArray
    base_moment: FloatArray
    side_force: FloatArray
    indentation: FloatArray
    touching: BoolArray
    slipping: BoolArray
    converged: BoolArray
    stable: BoolArray


def make_instants(rows: int, elements: int) -> Instants:
    """Makes the arrays of the results.

    Args:
        rows: number of instants.
        elements: number of elements, segments + 1.

    Returns:
        The arrays.
    """
    vectors, flags = np.empty((3, rows, 3)), np.empty((4, rows), np.bool_)
    return Instants(
        np.empty((rows, elements, 4)), vectors[0], vectors[1], vectors[2], np.empty(rows), np.empty(rows),
        flags[0], flags[1], flags[2], flags[3],
    )  # fmt: skip


def make_history(start: FloatArray) -> History:
    """Makes the state before the first instant, at the orientations ``start`` (k, 4)."""
    return History(np.array(start), np.array(start), np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(2),
        np.zeros(1, np.bool_), np.zeros(1, np.bool_), np.zeros(1))  # fmt: skip


@compiled
def _resting_indentation(law: WallLaw, rate: float, indentation: float) -> float:
    """Returns the indentation in m at the end of this instant without contact: the tissue recovers, by implicit Euler.

    The spring force of ``law`` at the new depth balances the damper: force + ``rate`` (depth - ``indentation``) = 0.
    """
    if rate == 0.0 or indentation <= 0.0:
        return 0.0
    if law.hertz == 0.0 and law.growth == 0.0:
        return indentation * rate / (law.stiffness + rate)
    depth = indentation
    for _ in range(50):  # convex and rising: Newton's method comes down from the indentation
        if law.growth > 0.0:
            force, slope, _ = exponential_spring(law.stiffness, law.growth, depth)
            change = (force + rate * (depth - indentation)) / (slope + rate)
        else:
            root = law.stiffness * law.hertz * math.sqrt(depth)
            change = (root * depth + rate * (depth - indentation)) / (1.5 * root + rate)
        depth -= change
        if change <= 1e-15 * indentation:
            break
    return max(depth, 0.0)


@compiled
def _extrapolate(q: FloatArray, before: FloatArray) -> None:
    """Turns each element further by the turn of the last instant: from ``before`` to ``q``, which moves to ``before``.

    If one turned fast, as in a snap, the next instant cannot be predicted from it: all elements stay.
    """
    slow = True
    for i in range(q.shape[0]):
        dot = 0.0
        for k in range(4):
            dot += q[i, k] * before[i, k]
        slow = slow and abs(dot) > _MIN_TURN_COSINE
    if not slow:
        copy_turns(q, before)
        return
    for i in range(q.shape[0]):
        w0, x0, y0, z0 = before[i, 0], before[i, 1], before[i, 2], before[i, 3]
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        dw, dx = w * w0 + x * x0 + y * y0 + z * z0, x * w0 - w * x0 - y * z0 + z * y0
        dy, dz = y * w0 - w * y0 - z * x0 + x * z0, z * w0 - w * z0 - x * y0 + y * x0
        before[i, 0], before[i, 1], before[i, 2], before[i, 3] = w, x, y, z
        w, x, y, z = (
            dw * w - dx * x - dy * y - dz * z,
            dw * x + dx * w + dy * z - dz * y,
            dw * y + dy * w + dz * x - dx * z,
            dw * z + dz * w + dx * y - dy * x,
        )
        size = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        q[i, 0], q[i, 1], q[i, 2], q[i, 3] = w * size, x * size, y * size, z * size


@compiled
def _strain(q: FloatArray, rod: Elastic, i: int) -> tuple[float, float, float]:
    """Returns the strain (3) in joint ``i`` in 1/m (twist, curvature about y and z) from the orientations ``q``."""
    w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    w0, x0, y0, z0 = 1.0, 0.0, 0.0, 0.0
    if i > 0:
        w0, x0, y0, z0 = q[i - 1, 0], q[i - 1, 1], q[i - 1, 2], q[i - 1, 3]
    c = w0 * w + x0 * x + y0 * y + z0 * z
    a = w0 * x - x0 * w - y0 * z + z0 * y
    b = w0 * y - y0 * w - z0 * x + x0 * z
    d = w0 * z - z0 * w - x0 * y + y0 * x
    f = math.copysign(log_scale(a * a + b * b + d * d, abs(c)) / rod.span[i], c)
    return f * a, f * b, f * d


@compiled
def creep_on(q: FloatArray, rod: Elastic, relaxing: float) -> None:
    """Moves the Maxwell springs' dashpots toward the strain, by implicit Euler.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod; ``memory`` is changed.
        relaxing: time step over time constant; infinite: they creep fully.
    """
    share = 1.0 if relaxing == math.inf else relaxing / (1.0 + relaxing)
    for i in range(q.shape[0]):
        u = _strain(q, rod, i)
        for k in range(3):
            rod.memory[i, k] += share * (u[k] - rod.rest[i, k] - rod.memory[i, k])


@compiled
def _with_tie(touch: Touch, kt: float) -> Touch:
    """Returns the same wall with a tie that never slips, or, if ``kt`` is 0, with the drag as a dead load."""
    return Touch(
        touch.active, touch.axes, touch.place, touch.radius, touch.stiffness, touch.hertz, touch.rate,
        touch.indentation, touch.rest, kt, touch.zero, touch.arm, touch.drag, -1.0, touch.side, touch.side_radius,
        touch.growth,
    )  # fmt: skip


@compiled
def _solve_instant(q: FloatArray, saved: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work) -> Solution:
    """Solves the equilibrium on the wall; ``q`` (k, 4): start, then result; ``saved`` (k, 4): buffer.

    On a rough wall Newton's method with stick and slip usually converges directly. If it fails, for instance when the
    rod snaps, the energy is minimised: first with the tip tied, then with the slipping force as a constant load, and
    Newton's method is tried again from each of these.
    """
    copy_turns(q, saved)
    out = relax(q, rod, load, touch, work, TOLERANCE)
    steps = out.iterations
    if not (touch.kt > 0.0 and touch.active):
        return out
    helper = _with_tie(touch, touch.kt)
    attempt = 0
    while not out.converged and attempt < 12:
        attempt += 1
        copy_turns(saved, q)
        steps += relax(q, rod, load, helper, work, 1e-6).iterations
        copy_turns(q, saved)
        px, py, pz = tip_at(q, rod, work.tangent)
        depth, first, second = contact_at(q, px, py, pz, touch)
        touch.drag[0], touch.drag[1], _ = tangential_force(touch, normal_force(touch, depth)[0], first, second)
        helper = _with_tie(touch, 0.0)
        out = relax(q, rod, load, touch, work, TOLERANCE)
        steps += out.iterations
    touch.drag[0] = touch.drag[1] = 0.0
    return Solution(steps, out.converged, out.stable, out.residual)


@compiled
def _base_moment(q: FloatArray, rod: Elastic) -> tuple[float, float, float]:
    """Returns the moment (3) in the first joint in N m, base frame: the loads' moment about the clamp."""
    p0, p1, p2 = _strain(q, rod, 0)
    rest = (rod.rest[0, 0], rod.rest[0, 1], rod.rest[0, 2])
    memory = (rod.memory[0, 0], rod.memory[0, 1], rod.memory[0, 2])
    g0, g1, g2, _, _, _, _ = joint_moment(rod.ei[0], rod.gj[0], rod.soft, (p0, p1, p2), rest, memory, rod.maxwell)
    span = rod.span[0]
    p0, p1, p2 = p0 * span, p1 * span, p2 * span
    angle2 = p0 * p0 + p1 * p1 + p2 * p2
    half = 0.5 * math.sqrt(angle2)
    kappa, _ = log_factors(angle2, math.sin(half) ** 2, math.cos(half))
    # g + phi x g / 2 + kappa phi x (phi x g), see `_add_joints`
    c0, c1, c2 = p1 * g2 - p2 * g1, p2 * g0 - p0 * g2, p0 * g1 - p1 * g0
    return (
        g0 + 0.5 * c0 + kappa * (p1 * c2 - p2 * c1),
        g1 + 0.5 * c1 + kappa * (p2 * c0 - p0 * c2),
        g2 + 0.5 * c2 + kappa * (p0 * c1 - p1 * c0),
    )


@compiled
def _side_force(rod: Elastic, touch: Touch, tangent: FloatArray) -> float:
    """Returns the total force in N of the shaft's nodes on the wall along d; ``tangent`` (k, 3): element directions."""
    height, total = touch.radius - touch.place, 0.0
    for i in range(tangent.shape[0] - 1):
        for k in range(3):
            height += rod.reach[i] * tangent[i, k] * touch.axes[0, k]
        total += touch.side * max(0.0, height)
    return total


@compiled
def integrate(
    rod: Elastic,
    load: Load,
    law: WallLaw,
    history: History,
    work: Work,
    wall: FloatArray,
    change: FloatArray,
    advance: FloatArray,
    instants: Instants,
) -> int:
    """Solves consecutive instants.

    Args:
        rod: values of the rod; ``rest`` and ``memory`` are changed.
        load: dead loads.
        law: laws of the wall.
        history: state of the last instant, before and after.
        work: buffers of Newton's method.
        wall: (m, 3) point of the wall at each instant in m, base frame.
        change: (m, 3) change of the pre-curvature in 1/m.
        advance: (m,) advance of the clamp along x in m.
        instants: results that are written.

    Returns:
        Number of steps of Newton's method.
    """
    q, axes = history.q, law.axes.copy()
    saved, zero, arm, vector, drag = np.empty_like(q), np.zeros(2), np.zeros(3), np.zeros(3), np.zeros(2)
    rate = law.damping / law.dt_s
    steps = 0
    for row in range(wall.shape[0]):
        for i in range(q.shape[0]):
            for k in range(3):
                rod.rest[i, k] = law.base_rest[i, k] + change[row, k]
        if not history.begun[0]:  # the rod has been without contact for a long time
            without_creep = Elastic(rod.span, rod.ei, rod.gj, rod.rest, rod.soft, rod.reach, rod.memory, 0.0, rod.small)
            no_wall = Touch(False, axes, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, zero, arm, drag, -1.0, 0.0, 0.0, 0.0)
            relax(q, without_creep, load, no_wall, work, TOLERANCE)
            creep_on(q, rod, math.inf)
            copy_turns(q, history.before)
            px, py, pz = tip_at(q, rod, work.tangent)
            history.centre[0], history.centre[1], history.centre[2] = px + advance[row], py, pz
            for k in range(3):
                history.wall[k] = wall[row, k]
            history.begun[0] = True
        indentation, touching = history.indentation[0], history.touching[0]
        if not touching:
            history.anchor[0], history.anchor[1] = history.way[0], history.way[1]
        # The point of the dome that will touch first, at the expected orientation of the electrode.
        _extrapolate(q, history.before)
        bulge = 0.0
        if law.face_radius != 0.0:  # the face's tangent plane at the expected position of the dome
            px, py, pz = tip_at(q, rod, work.tangent)
            vector[0], vector[1] = px + advance[row] - wall[row, 0], py - wall[row, 1]
            vector[2] = pz - wall[row, 2]
            bulge = face_axes(law.axes, law.face_radius, vector, axes)
        arm[0], arm[1], arm[2] = unturned(q[-1, 0], q[-1, 1], q[-1, 2], q[-1, 3], axes[0, 0], axes[0, 1], axes[0, 2])
        # Position of the surface along d; then the end of the tie: the point to which the tip sticks, as it has moved.
        place = bulge - axes[0, 0] * advance[row]
        for k in range(3):
            arm[k] *= law.radius
        last = history.before[-1]
        vector[0], vector[1], vector[2] = unturned(last[0], -last[1], -last[2], -last[3], arm[0], arm[1], arm[2])
        for k in range(2):
            zero[k] = history.anchor[k] - history.way[k] - axes[k + 1, 0] * advance[row]
        for k in range(3):
            place += axes[0, k] * wall[row, k]
            shift = history.centre[k] + vector[k] + wall[row, k] - history.wall[k]
            zero[0] += axes[1, k] * shift
            zero[1] += axes[2, k] * shift
        rest = _resting_indentation(law, rate, indentation)
        grips = touching and law.friction > 0.0
        touch = Touch(
            True, axes, place, law.radius, law.stiffness, law.hertz, rate, indentation, rest,
            law.kt if grips else 0.0, zero, arm, drag, law.friction if grips else -1.0, law.side, law.radius,
            law.growth,
        )  # fmt: skip
        out = _solve_instant(q, saved, rod, load, touch, work)
        steps += out.iterations
        px, py, pz = tip_at(q, rod, work.tangent)
        depth, first, second = contact_at(q, px, py, pz, touch)
        normal, _, _ = normal_force(touch, depth)
        t1, t2, slips = tangential_force(touch, normal, first, second)
        slipping = slips and normal > 0.0
        history.way[0], history.way[1] = history.anchor[0] + first, history.anchor[1] + second
        if slipping:  # the anchor follows, so that the tie has the force of friction
            history.anchor[0] = history.way[0] + t1 / law.kt
            history.anchor[1] = history.way[1] + t2 / law.kt
        history.centre[0], history.centre[1], history.centre[2] = px + advance[row], py, pz
        history.indentation[0] = depth if normal > 0.0 else rest
        history.touching[0] = normal > 0.0
        moment = instants.base_moment[row]
        moment[0], moment[1], moment[2] = _base_moment(q, rod)
        instants.side_force[row] = _side_force(rod, touch, work.tangent) if law.side > 0.0 else 0.0
        if rod.maxwell > 0.0:
            creep_on(q, rod, law.relaxing)
        copy_turns(q, instants.shapes[row])
        for k in range(3):
            instants.dome_force[row, k] = t1 * axes[1, k] + t2 * axes[2, k] - normal * axes[0, k]
            history.wall[k] = wall[row, k]
            instants.touch[row, k] = history.centre[k] + law.radius * axes[0, k]
        instants.indentation[row], instants.touching[row] = history.indentation[0], history.touching[0]
        instants.slipping[row], instants.converged[row], instants.stable[row] = slipping, out.converged, out.stable
    return steps
