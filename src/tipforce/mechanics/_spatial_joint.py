"""One joint of the spatial rod: the rotation vector between two neighbours, and the energy of the strain."""

import math

from ._spatial_compile import compiled

__all__ = ["joint_energy", "joint_moment", "log_factors", "log_scale"]

_SMALL = 0.02
"""Squared sine of half the angle below which series take over: they are exact to rounding there."""


@compiled
def log_scale(sine2: float, cosine: float) -> float:
    """Factor from v to the rotation vector, for the unit quaternion (cosine, v) with v.v = sine2 and cosine >= 0."""
    if sine2 < _SMALL:
        s = sine2
        tail = s * (35 / 1152 + s * (63 / 2816 + s * (231 / 13312 + s * 143 / 10240)))
        return 2.0 + s * (1 / 3 + s * (3 / 20 + s * (5 / 56 + 2.0 * tail)))
    sine = math.sqrt(sine2)
    return 2.0 * math.atan2(sine, cosine) / sine


@compiled
def log_factors(angle2: float, sine2: float, cosine: float) -> tuple[float, float]:
    """k(a) = (1 - (a/2) cot(a/2)) / a^2 of the rotation angle a, and k'(a) / a.

    1 + phi x / 2 + k phi x (phi x .) is the inverse of the rotation vector's right Jacobian (Bullo and Murray 1995).
    """
    a2 = angle2
    if sine2 < _SMALL:
        k = 1 / 12 + a2 * (1 / 720 + a2 * (1 / 30240 + a2 * (1 / 1209600 + a2 / 47900160)))
        return k, 1 / 360 + a2 * (1 / 7560 + a2 * (1 / 201600 + a2 / 5987520))
    angle, sine = math.sqrt(a2), math.sqrt(sine2)
    cotangent = cosine / sine
    k = (1.0 - 0.5 * angle * cotangent) / a2
    slope = 0.5 * cotangent - 0.25 * angle / sine2
    return k, (-slope / angle - 2.0 * k) / a2


@compiled
def joint_energy(ei: float, gj: float, soft: float, u: tuple, rest: tuple, memory: tuple, maxwell: float) -> float:  # type: ignore[type-arg]
    """Energy per metre at the strain u; ``maxwell``: share of EI and GJ of the spring that has crept to ``memory``."""
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
    """Gradient (3) of `joint_energy`, and its second derivatives 00, 11, 12, 22 (01 and 02 vanish)."""
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
