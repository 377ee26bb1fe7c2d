"""Energy of the spatial rod with its contact, its gradient and its Hessian.

The unknowns are small turns of the elements. A turn w_i is in the element's own frame, R_i -> R_i exp(w_i). Second
derivatives are those of the energy along such turns, complete: the block-tridiagonal part is in the band, and each
contact spring adds a term of rank one.
"""

import math

from ...types import FloatArray
from ._compile import compiled
from ._state import Elastic, Load, Touch, Work

_SERIES_SINE2 = 0.02
"""Below this squared sine of half the angle, series are used: they are exact to rounding there."""
_MAX_GROWTH_DEPTHS = 6.0
"""From this many times the depth in which it grows by e, an exponential law continues as its tangent."""


@compiled
def log_scale(sine2: float, cosine: float) -> float:
    """Returns the factor from the vector part v of a unit quaternion to the rotation vector.

    Args:
        sine2: v.v, the square of the sine of half the rotation angle.
        cosine: scalar part, >= 0.

    Returns:
        The factor.
    """
    if sine2 < _SERIES_SINE2:
        s = sine2
        tail = s * (35 / 1152 + s * (63 / 2816 + s * (231 / 13312 + s * 143 / 10240)))
        return 2.0 + s * (1 / 3 + s * (3 / 20 + s * (5 / 56 + 2.0 * tail)))
    sine = math.sqrt(sine2)
    return 2.0 * math.atan2(sine, cosine) / sine


@compiled
def log_factors(angle2: float, sine2: float, cosine: float) -> tuple[float, float]:
    """Returns k(a) = (1 - (a/2) cot(a/2)) / a^2 of the rotation angle a, and k'(a) / a.

    1 + phi x / 2 + k phi x (phi x .) is the inverse of the rotation vector's right Jacobian (Bullo and Murray 1995).

    Args:
        angle2: a^2 in rad^2.
        sine2: square of the sine of a/2.
        cosine: cosine of a/2.

    Returns:
        k and k' / a.
    """
    a2 = angle2
    if sine2 < _SERIES_SINE2:
        k = 1 / 12 + a2 * (1 / 720 + a2 * (1 / 30240 + a2 * (1 / 1209600 + a2 / 47900160)))
        return k, 1 / 360 + a2 * (1 / 7560 + a2 * (1 / 201600 + a2 / 5987520))
    angle, sine = math.sqrt(a2), math.sqrt(sine2)
    cotangent = cosine / sine
    k = (1.0 - 0.5 * angle * cotangent) / a2
    slope = 0.5 * cotangent - 0.25 * angle / sine2
    return k, (-slope / angle - 2.0 * k) / a2


@compiled
def joint_energy(ei: float, gj: float, soft: float, u: tuple, rest: tuple, memory: tuple, maxwell: float) -> float:  # type: ignore[type-arg]
    """Returns the energy of a joint per metre.

    Args:
        ei: bending stiffness in N m^2.
        gj: torsional stiffness in N m^2.
        soft: 1 / k_s^2 of the stiffening law, in m^2.
        u: strain (3) in 1/m.
        rest: pre-curvature (3) in 1/m.
        memory: crept strain (3) in 1/m.
        maxwell: relative stiffness of the spring that creeps.

    Returns:
        The energy in J/m.
    """
    e0, e1, e2 = u[0] - rest[0], u[1] - rest[1], u[2] - rest[2]
    total = 0.5 * (gj * e0 * e0 + ei * (e1 * e1 + e2 * e2))
    if soft > 0.0:
        now, then = u[1] * u[1] + u[2] * u[2], rest[1] * rest[1] + rest[2] * rest[2]
        both = u[1] * rest[1] + u[2] * rest[2]
        total += ei * soft * (now * now / 4 - both * now / 3 + then * then / 12)
    if maxwell > 0.0:
        e0, e1, e2 = e0 - memory[0], e1 - memory[1], e2 - memory[2]
        total += 0.5 * maxwell * (gj * e0 * e0 + ei * (e1 * e1 + e2 * e2))
    return total


@compiled
def joint_moment(
    ei: float,
    gj: float,
    soft: float,
    u: tuple,  # type: ignore[type-arg]
    rest: tuple,  # type: ignore[type-arg]
    memory: tuple,  # type: ignore[type-arg]
    maxwell: float,
) -> tuple[float, float, float, float, float, float, float]:
    """Returns the derivatives of `joint_energy` by the strain.

    Args:
        ei: bending stiffness in N m^2.
        gj: torsional stiffness in N m^2.
        soft: 1 / k_s^2 of the stiffening law, in m^2.
        u: strain (3) in 1/m.
        rest: pre-curvature (3) in 1/m.
        memory: crept strain (3) in 1/m.
        maxwell: relative stiffness of the spring that creeps.

    Returns:
        The gradient (3) in N m, and the second derivatives 00, 11, 12, 22 in N m^2 (01 and 02 vanish).
    """
    e0, e1, e2 = u[0] - rest[0], u[1] - rest[1], u[2] - rest[2]
    more = 1.0 + maxwell
    g0 = gj * (more * e0 - maxwell * memory[0])
    g1 = ei * (more * e1 - maxwell * memory[1])
    g2 = ei * (more * e2 - maxwell * memory[2])
    k11 = k22 = ei * more
    k12 = 0.0
    if soft > 0.0:
        now = u[1] * u[1] + u[2] * u[2]
        both = u[1] * rest[1] + u[2] * rest[2]
        firm = ei * soft
        g1 += firm * (now * (u[1] - rest[1] / 3) - both * u[1] * (2 / 3))
        g2 += firm * (now * (u[2] - rest[2] / 3) - both * u[2] * (2 / 3))
        round_ = now - both * (2 / 3)
        k11 += firm * (round_ + 2.0 * u[1] * (u[1] - rest[1] * (2 / 3)))
        k22 += firm * (round_ + 2.0 * u[2] * (u[2] - rest[2] * (2 / 3)))
        k12 = firm * (2.0 * u[1] * u[2] - (u[1] * rest[2] + rest[1] * u[2]) * (2 / 3))
    return g0, g1, g2, gj * more, k11, k12, k22


@compiled
def exponential_spring(stiffness: float, growth: float, depth: float) -> tuple[float, float, float]:
    """Returns force, slope and energy of tissue that stiffens exponentially (Fung): c (exp(``growth`` depth) - 1).

    From `_MAX_GROWTH_DEPTHS` / ``growth`` on the force continues along its tangent: no trial of Newton's method
    overflows.

    Args:
        stiffness: stiffness in N/m of the secant at depth 1 / ``growth``, which determines c.
        growth: growth in 1/m.
        depth: indentation in m.

    Returns:
        Force in N, slope in N/m, energy in J.
    """
    scale = stiffness / (growth * (math.e - 1.0))
    over = max(growth * depth - _MAX_GROWTH_DEPTHS, 0.0)
    bend = growth * depth - over
    rise = math.exp(bend)
    force = scale * (rise - 1.0 + rise * over)
    energy = scale / growth * (rise - 1.0 - bend + over * (rise - 1.0) + 0.5 * rise * over * over)
    return force, scale * growth * rise, energy


@compiled
def normal_force(touch: Touch, depth: float) -> tuple[float, float, float]:
    """Returns the normal force on the rounded tip of the catheter.

    It is elastic, plus ``touch.rate`` (N/m) times the change since ``touch.indentation``; zero up to ``touch.rest``.

    Args:
        touch: laws of the contact.
        depth: indentation in m.

    Returns:
        Force in N, its slope with the depth in N/m, and its energy in J from ``touch.rest`` on.
    """
    if not (touch.active and depth > touch.rest):
        return 0.0, 0.0, 0.0
    over, since, base = depth - touch.indentation, depth - touch.rest, touch.rest - touch.indentation
    force, slope = touch.rate * over, touch.rate
    energy = 0.5 * touch.rate * (over * over - base * base)
    if touch.hertz > 0.0:
        root = touch.hertz * math.sqrt(depth)
        force += touch.stiffness * root * depth
        slope += 1.5 * touch.stiffness * root
        energy += 0.4 * touch.stiffness * (root * depth * depth - touch.hertz * touch.rest**2.5)
    elif touch.growth > 0.0:
        spring, firm, stored = exponential_spring(touch.stiffness, touch.growth, depth)
        force += spring
        slope += firm
        energy += stored - exponential_spring(touch.stiffness, touch.growth, touch.rest)[2]
    else:
        force += touch.stiffness * depth
        slope += touch.stiffness
        energy += 0.5 * touch.stiffness * since * (depth + touch.rest)
    return force, slope, energy


@compiled
def tangential_force(touch: Touch, normal: float, first: float, second: float) -> tuple[float, float, bool]:
    """Returns the wall's tangential force on the dome.

    Args:
        touch: laws of the contact.
        normal: normal force in N.
        first: way of the touching point along t1 in m.
        second: its way along t2 in m.

    Returns:
        Force along t1 and t2 in N, and whether the point slips.
    """
    if touch.kt <= 0.0:
        return touch.drag[0], touch.drag[1], False
    t1, t2 = -touch.kt * first, -touch.kt * second
    pull, limit = math.hypot(t1, t2), touch.friction * normal
    if touch.friction < 0.0 or pull <= limit:
        return t1, t2, False
    return t1 * limit / pull, t2 * limit / pull, True


@compiled
def tip_at(q: FloatArray, rod: Elastic, tangent: FloatArray) -> tuple[float, float, float]:
    """Returns the lever's end relative to the clamp.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod.
        tangent: (k, 3) directions of the elements, written.

    Returns:
        x, y, z in m, base frame.
    """
    px = py = pz = 0.0
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        tx, ty, tz = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
        tangent[i, 0], tangent[i, 1], tangent[i, 2] = tx, ty, tz
        reach = rod.reach[i]
        px += reach * tx
        py += reach * ty
        pz += reach * tz
    return px, py, pz


@compiled
def contact_at(q: FloatArray, px: float, py: float, pz: float, touch: Touch) -> tuple[float, float, float]:
    """Returns depth and tangential way of the dome, which rolls on the wall.

    Args:
        q: (k, 4) orientations of the elements.
        px: x of the lever's end in m, from `tip_at`.
        py: its y.
        pz: its z.
        touch: laws of the contact.

    Returns:
        Depth, and way of the touching point along t1 and t2 from ``touch.zero``, in m.
    """
    axes, last = touch.axes, q.shape[0] - 1
    w, x, y, z = q[last, 0], q[last, 1], q[last, 2], q[last, 3]
    a, b, c = touch.arm[0], touch.arm[1], touch.arm[2]
    # v + 2 q x (q x v + w v), the quaternion's rotation of the arm
    u, v, s = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    mx, my, mz = px + a + 2.0 * (y * s - z * v), py + b + 2.0 * (z * u - x * s), pz + c + 2.0 * (x * v - y * u)
    depth = axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz + touch.radius - touch.place
    first = axes[1, 0] * mx + axes[1, 1] * my + axes[1, 2] * mz - touch.zero[0]
    second = axes[2, 0] * mx + axes[2, 1] * my + axes[2, 2] * mz - touch.zero[1]
    return depth, first, second


@compiled
def energy_at(q: FloatArray, rod: Elastic, load: Load, touch: Touch, tangent: FloatArray) -> float:
    """Returns the elastic energy minus the work of the dead forces. A moment has no energy.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod.
        load: dead loads.
        touch: laws of the contact.
        tangent: (k, 3) directions of the elements, written.

    Returns:
        The energy in J.
    """
    total = 0.0
    w0, x0, y0, z0 = 1.0, 0.0, 0.0, 0.0
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        # (c; a, b, d): quaternion of the turn in joint i; its rotation vector over the joint's length is the strain.
        c = w0 * w + x0 * x + y0 * y + z0 * z
        a = w0 * x - x0 * w - y0 * z + z0 * y
        b = w0 * y - y0 * w - z0 * x + x0 * z
        d = w0 * z - z0 * w - x0 * y + y0 * x
        f = log_scale(a * a + b * b + d * d, abs(c)) / rod.span[i]
        if c < 0.0:
            f = -f
        rest = (rod.rest[i, 0], rod.rest[i, 1], rod.rest[i, 2])
        memory = (rod.memory[i, 0], rod.memory[i, 1], rod.memory[i, 2])
        strain = (f * a, f * b, f * d)
        total += rod.span[i] * joint_energy(rod.ei[i], rod.gj[i], rod.soft, strain, rest, memory, rod.maxwell)
        w0, x0, y0, z0 = w, x, y, z
    px, py, pz = tip_at(q, rod, tangent)
    total -= load.force[0] * px + load.force[1] * py + load.force[2] * pz
    for i in range(q.shape[0]):
        line = load.line[i]
        total -= line[0] * tangent[i, 0] + line[1] * tangent[i, 1] + line[2] * tangent[i, 2]
    if touch.active:
        depth, first, second = contact_at(q, px, py, pz, touch)
        total += normal_force(touch, depth)[2]
        total += 0.5 * touch.kt * (first * first + second * second) - touch.drag[0] * first - touch.drag[1] * second
        if touch.side > 0.0:
            height = touch.side_radius - touch.place  # depth of each node of the shaft in the tissue
            for i in range(q.shape[0] - 1):
                for axis in range(3):
                    height += rod.reach[i] * tangent[i, axis] * touch.axes[0, axis]
                if height > 0.0:
                    total += 0.5 * touch.side * height * height
    return total


@compiled
def unturned(w: float, x: float, y: float, z: float, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Returns a vector of the base frame in the frame of a quaternion.

    Args:
        w: scalar part of the unit quaternion.
        x: vector part, x.
        y: vector part, y.
        z: vector part, z.
        a: x of the vector, base frame.
        b: its y.
        c: its z.

    Returns:
        The vector's three components.
    """
    u, v, s = y * c - z * b - w * a, z * a - x * c - w * b, x * b - y * a - w * c
    return a + 2.0 * (y * s - z * v), b + 2.0 * (z * u - x * s), c + 2.0 * (x * v - y * u)


@compiled
def add_pull(q: FloatArray, rod: Elastic, load: Load, out: FloatArray) -> None:
    """Adds the moments of the dead loads on each element: minus their part of the gradient.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod.
        load: dead loads.
        out: (3k,) moments in N m that are changed, in the frame of each element.
    """
    fx, fy, fz = load.force[0], load.force[1], load.force[2]
    last = q.shape[0] - 1
    for i in range(last + 1):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        reach, line = rod.reach[i], load.line[i]
        _, l1, l2 = unturned(w, x, y, z, reach * fx + line[0], reach * fy + line[1], reach * fz + line[2])
        out[3 * i + 1] -= l2
        out[3 * i + 2] += l1
        if i == last:
            m0, m1, m2 = unturned(w, x, y, z, load.moment[0], load.moment[1], load.moment[2])
            out[3 * i] += m0
            out[3 * i + 1] += m1
            out[3 * i + 2] += m2


@compiled
def _add_joints(q: FloatArray, rod: Elastic, gradient: FloatArray, band: FloatArray) -> None:
    """Computes gradient and Hessian of the elastic energy of all joints; overwrites ``gradient`` and ``band``.

    Joint i connects elements i - 1 and i; joint 0 connects the fixed base, which has the identity as orientation.
    phi is the rotation vector across the joint, g the joint's moment in N m, K its derivative with respect to phi.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod.
        gradient: (3k,) derivatives in N m with respect to turns of each element about its own axes.
        band: (3k, 6) Hessian in N m: ``band[r, c]`` is the symmetric matrix's entry (r, r + c).
    """
    w0, x0, y0, z0 = 1.0, 0.0, 0.0, 0.0
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        co = w0 * w + x0 * x + y0 * y + z0 * z
        p0 = w0 * x - x0 * w - y0 * z + z0 * y
        p1 = w0 * y - y0 * w - z0 * x + x0 * z
        p2 = w0 * z - z0 * w - x0 * y + y0 * x
        w0, x0, y0, z0 = w, x, y, z
        sine2 = p0 * p0 + p1 * p1 + p2 * p2
        scale = log_scale(sine2, abs(co))
        kappa, fall = log_factors(scale * scale * sine2, sine2, abs(co))
        if co < 0.0:
            scale = -scale
        p0, p1, p2 = scale * p0, scale * p1, scale * p2  # the rotation vector from element i - 1 to i
        inverse = 1.0 / rod.span[i]
        rest = (rod.rest[i, 0], rod.rest[i, 1], rod.rest[i, 2])
        memory = (rod.memory[i, 0], rod.memory[i, 1], rod.memory[i, 2])
        strain = (p0 * inverse, p1 * inverse, p2 * inverse)
        g0, g1, g2, k00, k11, k12, k22 = joint_moment(rod.ei[i], rod.gj[i], rod.soft, strain, rest, memory, rod.maxwell)
        k00, k11, k12, k22 = k00 * inverse, k11 * inverse, k12 * inverse, k22 * inverse
        # A = left Jacobian's inverse, 1 - phi x / 2 + kappa phi x (phi x .); the right one's is its transpose.
        core = 1.0 - kappa * (p0 * p0 + p1 * p1 + p2 * p2)
        a00, a11, a22 = core + kappa * p0 * p0, core + kappa * p1 * p1, core + kappa * p2 * p2
        a01, a10 = kappa * p0 * p1 + 0.5 * p2, kappa * p0 * p1 - 0.5 * p2
        a02, a20 = kappa * p0 * p2 - 0.5 * p1, kappa * p0 * p2 + 0.5 * p1
        a12, a21 = kappa * p1 * p2 + 0.5 * p0, kappa * p1 * p2 - 0.5 * p0
        r = 3 * i
        gradient[r] = a00 * g0 + a01 * g1 + a02 * g2
        gradient[r + 1] = a10 * g0 + a11 * g1 + a12 * g2
        gradient[r + 2] = a20 * g0 + a21 * g1 + a22 * g2
        # C: derivative of kappa phi x (phi x g) with phi; (g x .) / 2 comes with it, once with each sign.
        pg, pp = p0 * g0 + p1 * g1 + p2 * g2, p0 * p0 + p1 * p1 + p2 * p2
        e0 = fall * (p0 * pg - g0 * pp) - 2.0 * kappa * g0
        e1 = fall * (p1 * pg - g1 * pp) - 2.0 * kappa * g1
        e2 = fall * (p2 * pg - g2 * pp) - 2.0 * kappa * g2
        c00, c01, c02 = (e0 + kappa * g0) * p0 + kappa * pg, e0 * p1 + kappa * p0 * g1, e0 * p2 + kappa * p0 * g2
        c10, c11, c12 = e1 * p0 + kappa * p1 * g0, (e1 + kappa * g1) * p1 + kappa * pg, e1 * p2 + kappa * p1 * g2
        c20, c21, c22 = e2 * p0 + kappa * p2 * g0, e2 * p1 + kappa * p2 * g1, (e2 + kappa * g2) * p2 + kappa * pg
        # P = A K + (g x .) / 2 + C: derivative of the moment on element i
        q00, q01, q02 = a00 * k00 + c00, a01 * k11 + a02 * k12 + c01 - 0.5 * g2, a01 * k12 + a02 * k22 + c02 + 0.5 * g1
        q10, q11, q12 = a10 * k00 + c10 + 0.5 * g2, a11 * k11 + a12 * k12 + c11, a11 * k12 + a12 * k22 + c12 - 0.5 * g0
        q20, q21, q22 = a20 * k00 + c20 - 0.5 * g1, a21 * k11 + a22 * k12 + c21 + 0.5 * g0, a21 * k12 + a22 * k22 + c22
        # P A': element i by itself, of which the symmetric part is kept
        band[r, 0] = q00 * a00 + q01 * a01 + q02 * a02
        band[r, 1] = 0.5 * (q00 * a10 + q01 * a11 + q02 * a12 + q10 * a00 + q11 * a01 + q12 * a02)
        band[r, 2] = 0.5 * (q00 * a20 + q01 * a21 + q02 * a22 + q20 * a00 + q21 * a01 + q22 * a02)
        band[r + 1, 0] = q10 * a10 + q11 * a11 + q12 * a12
        band[r + 1, 1] = 0.5 * (q10 * a20 + q11 * a21 + q12 * a22 + q20 * a10 + q21 * a11 + q22 * a12)
        band[r + 2, 0] = q20 * a20 + q21 * a21 + q22 * a22
        band[r, 3] = band[r, 4] = band[r, 5] = 0.0
        band[r + 1, 2] = band[r + 1, 3] = band[r + 1, 4] = band[r + 1, 5] = 0.0
        band[r + 2, 1] = band[r + 2, 2] = band[r + 2, 3] = band[r + 2, 4] = band[r + 2, 5] = 0.0
        if i == 0:
            continue
        s = r - 3
        gradient[s] -= a00 * g0 + a10 * g1 + a20 * g2
        gradient[s + 1] -= a01 * g0 + a11 * g1 + a21 * g2
        gradient[s + 2] -= a02 * g0 + a12 * g1 + a22 * g2
        # -P A: row of element i, column of element i - 1
        band[s, 3] = -(q00 * a00 + q01 * a10 + q02 * a20)
        band[s, 4] = -(q10 * a00 + q11 * a10 + q12 * a20)
        band[s, 5] = -(q20 * a00 + q21 * a10 + q22 * a20)
        band[s + 1, 2] = -(q00 * a01 + q01 * a11 + q02 * a21)
        band[s + 1, 3] = -(q10 * a01 + q11 * a11 + q12 * a21)
        band[s + 1, 4] = -(q20 * a01 + q21 * a11 + q22 * a21)
        band[s + 2, 1] = -(q00 * a02 + q01 * a12 + q02 * a22)
        band[s + 2, 2] = -(q10 * a02 + q11 * a12 + q12 * a22)
        band[s + 2, 3] = -(q20 * a02 + q21 * a12 + q22 * a22)
        # Q = A' K - (g x .) / 2 + C, then Q A: element i - 1 by itself
        q00, q01, q02 = a00 * k00 + c00, a10 * k11 + a20 * k12 + c01 + 0.5 * g2, a10 * k12 + a20 * k22 + c02 - 0.5 * g1
        q10, q11, q12 = a01 * k00 + c10 - 0.5 * g2, a11 * k11 + a21 * k12 + c11, a11 * k12 + a21 * k22 + c12 + 0.5 * g0
        q20, q21, q22 = a02 * k00 + c20 + 0.5 * g1, a12 * k11 + a22 * k12 + c21 - 0.5 * g0, a12 * k12 + a22 * k22 + c22
        band[s, 0] += q00 * a00 + q01 * a10 + q02 * a20
        band[s, 1] += 0.5 * (q00 * a01 + q01 * a11 + q02 * a21 + q10 * a00 + q11 * a10 + q12 * a20)
        band[s, 2] += 0.5 * (q00 * a02 + q01 * a12 + q02 * a22 + q20 * a00 + q21 * a10 + q22 * a20)
        band[s + 1, 0] += q10 * a01 + q11 * a11 + q12 * a21
        band[s + 1, 1] += 0.5 * (q10 * a02 + q11 * a12 + q12 * a22 + q20 * a01 + q21 * a11 + q22 * a21)
        band[s + 2, 0] += q20 * a02 + q21 * a12 + q22 * a22


@compiled
def _hold(touch: Touch, normal: float, slope: float, first: float, second: float, work: Work, m: int) -> None:
    """Fills the stiffness of the tangential force into ``work.firm`` (m, m), whose last two rows are t1 and t2.

    ``normal``: normal force in N, ``slope``: its slope in N/m; ``first``, ``second``: way along t1 and t2 in m. In slip
    the force follows the normal force and keeps the direction of the way.
    """
    firm, i, j = work.firm, m - 2, m - 1
    _, _, slips = tangential_force(touch, normal, first, second)
    if not slips:
        firm[i, i] = firm[j, j] = touch.kt
        return
    way_m = math.hypot(first, second)
    s1, s2, across = first / way_m, second / way_m, touch.friction * normal / way_m
    firm[i, 0], firm[j, 0] = touch.friction * slope * s1, touch.friction * slope * s2
    firm[i, i], firm[j, j] = across * s2 * s2, across * s1 * s1
    firm[i, j] = firm[j, i] = -across * s1 * s2


@compiled
def _add_arm(fx: float, fy: float, fz: float, arm: FloatArray, r: int, gradient: FloatArray, band: FloatArray) -> None:
    """Adds gradient and Hessian of a dead force (fx, fy, fz) in the electrode's frame, at ``arm`` (3,) from the lever.

    ``r``: first row of the electrode in ``gradient`` (3k,) and ``band`` (3k, 6).
    """
    a, b, c = arm[0], arm[1], arm[2]
    gradient[r] -= b * fz - c * fy
    gradient[r + 1] -= c * fx - a * fz
    gradient[r + 2] -= a * fy - b * fx
    dot = a * fx + b * fy + c * fz
    band[r, 0] += dot - a * fx
    band[r, 1] -= 0.5 * (a * fy + b * fx)
    band[r, 2] -= 0.5 * (a * fz + c * fx)
    band[r + 1, 0] += dot - b * fy
    band[r + 1, 1] -= 0.5 * (b * fz + c * fy)
    band[r + 2, 0] += dot - c * fz


@compiled
def assemble(q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work) -> tuple[float, int, int]:
    """Computes ``work``'s gradient, hessian, skew, rows and firm.

    The rows are: the dome's depth, the touched nodes' depths, the dome's way along t1 and t2; those without stiffness
    are left out.

    Args:
        q: (k, 4) orientations of the elements.
        rod: values of the rod.
        load: dead loads.
        touch: laws of the contact.
        work: buffers of Newton's method.

    Returns:
        Largest component of the gradient in N m, number of rows, and number of rows in slip.
    """
    gradient, band, rows, firm = work.gradient, work.hessian, work.rows, work.firm
    last = q.shape[0] - 1
    _add_joints(q, rod, gradient, band)
    fx, fy, fz = load.force[0], load.force[1], load.force[2]
    px, py, pz = tip_at(q, rod, work.tangent)
    d0, d1, d2 = touch.axes[0, 0], touch.axes[0, 1], touch.axes[0, 2]
    m, sides, height = 0, 0, 0.0
    t1 = t2 = hx = hy = hz = 0.0
    tied = slips = False
    if touch.active:
        depth, first, second = contact_at(q, px, py, pz, touch)
        normal, slope, _ = normal_force(touch, depth)
        tied = touch.kt > 0.0
        m = int(normal > 0.0 or tied)
        if touch.side > 0.0:
            height = touch.side_radius - touch.place
            for i in range(last):
                along = work.tangent[i, 0] * d0 + work.tangent[i, 1] * d1 + work.tangent[i, 2] * d2
                height += rod.reach[i] * along
                sides += int(height > 0.0)
        first_side = m
        m += sides + 2 * int(tied)
        for i in range(m):
            for j in range(m):
                firm[i, j] = 0.0
        if first_side > 0:
            firm[0, 0] = slope
        for i in range(first_side, first_side + sides):
            firm[i, i] = touch.side
        t1, t2, slips = tangential_force(touch, normal, first, second)
        if tied:
            _hold(touch, normal, slope, first, second, work, m)
        hx = touch.axes[1, 0] * t1 + touch.axes[2, 0] * t2
        hy = touch.axes[1, 1] * t1 + touch.axes[2, 1] * t2
        hz = touch.axes[1, 2] * t1 + touch.axes[2, 2] * t2
        fx, fy, fz = fx + hx - normal * d0, fy + hy - normal * d1, fz + hz - normal * d2
    side = m - 2 * int(tied)  # one beyond the row of the node that was met last
    work.skew[0] = work.skew[1] = work.skew[2] = 0.0
    for i in range(last, -1, -1):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        reach, line, r = rod.reach[i], load.line[i], 3 * i
        if sides > 0 and i < last:
            if height > 0.0:  # the node at this element's end touches: its force acts on all elements before it
                side -= 1
                push = touch.side * height
                fx, fy, fz = fx - push * d0, fy - push * d1, fz - push * d2
            along = work.tangent[i, 0] * d0 + work.tangent[i, 1] * d1 + work.tangent[i, 2] * d2
            height -= reach * along
        l0, l1, l2 = unturned(w, x, y, z, reach * fx + line[0], reach * fy + line[1], reach * fz + line[2])
        gradient[r + 1] += l2
        gradient[r + 2] -= l1
        band[r, 1] -= 0.5 * l1
        band[r, 2] -= 0.5 * l2
        band[r + 1, 0] += l0
        band[r + 2, 0] += l0
        if m > 0:
            _, n1, n2 = unturned(w, x, y, z, d0, d1, d2)
            tail = m - 2 * int(tied)
            for row in range(tail):
                met = row < tail - sides or row >= side
                rows[row, r] = 0.0
                rows[row, r + 1] = -reach * n2 if met else 0.0
                rows[row, r + 2] = reach * n1 if met else 0.0
            if tied:
                for k in range(2):
                    axes = touch.axes[k + 1]
                    _, n1, n2 = unturned(w, x, y, z, axes[0], axes[1], axes[2])
                    rows[tail + k, r] = 0.0
                    rows[tail + k, r + 1] = -reach * n2
                    rows[tail + k, r + 2] = reach * n1
        if i == last:
            m0, m1, m2 = unturned(w, x, y, z, load.moment[0], load.moment[1], load.moment[2])
            gradient[r] -= m0
            gradient[r + 1] -= m1
            gradient[r + 2] -= m2
            # The moment's own derivative is unsymmetric; with the frame's turn one half remains at an equilibrium.
            work.skew[0], work.skew[1], work.skew[2] = -0.5 * m0, -0.5 * m1, -0.5 * m2
            if touch.active and (t1 != 0.0 or t2 != 0.0):
                h0, h1, h2 = unturned(w, x, y, z, hx, hy, hz)
                _add_arm(h0, h1, h2, touch.arm, r, gradient, band)
            if tied:
                for k in range(2):
                    axes, row = touch.axes[k + 1], rows[m - 2 + k]
                    n0, n1, n2 = unturned(w, x, y, z, axes[0], axes[1], axes[2])
                    row[r] += touch.arm[1] * n2 - touch.arm[2] * n1
                    row[r + 1] += touch.arm[2] * n0 - touch.arm[0] * n2
                    row[r + 2] += touch.arm[0] * n1 - touch.arm[1] * n0
    residual = 0.0
    for r in range(gradient.shape[0]):
        residual = max(residual, abs(gradient[r]))
    return residual, m, 2 * int(slips)
