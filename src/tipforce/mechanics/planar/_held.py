"""Equilibrium of the planar elastica whose tip is held across one direction.

A tissue holds the tip: it carries more along the shaft than a dead load could, under which the rod buckles. So the
load is not given by both components of the force, but by the component along a direction, and by the position of the
loaded point across it; the component across is the reaction. Such shapes stay stable up to some eight times the load
under which a free tip gives way.
"""

import math
from typing import NamedTuple

from ...types import FloatArray
from ._compile import compiled
from ._newton import COSINE, INVERSE_PIVOTS, SINE, Elastic, Load, assemble, newton_step, sincos, solve_factorised

_MAX_ITERATIONS = 40
_MAX_TURN_RAD = 0.4
"""Largest change of an angle in one step, rad."""
_MAX_MISS = 1e-9
"""Largest distance of the loaded point from where it is held, as a share of the shaft's length."""


class Hold(NamedTuple):
    """How the tip is held.

    Attributes:
        along_n: component of the force along (``c``, ``s``).
        aside_m: position of the loaded point across this direction, to its left.
        c: cosine of the direction in the base frame.
        s: its sine.
        lever_per_m_n: curvature of the unloaded shaft for each newton of the force (a moment at the tip).
    """

    along_n: float
    aside_m: float
    c: float
    s: float
    lever_per_m_n: float


class Held(NamedTuple):
    """Result.

    Attributes:
        converged: whether the residual is within the tolerance.
        stable: whether the shape is a minimum of the energy while the tip is held.
        across_n: reaction across the direction.
        give: displacement across the direction for each newton of the reaction, m; negative where a dead load would
            buckle the rod.
    """

    converged: bool
    stable: bool
    across_n: float
    give: float


@compiled
def aside(theta: FloatArray, h: float, lever: float, c: float, s: float) -> float:
    """Returns the position in m of the loaded point to the left of the direction.

    Args:
        theta: (n,) angles of the elements in rad.
        h: length of a segment, m.
        lever: distance of the loaded point beyond the shaft, m.
        c: cosine of the direction.
        s: its sine.
    """
    last, x, y = theta.size - 1, 0.0, 0.0
    for i in range(last + 1):
        reach = h if i < last else lever
        x += reach * math.cos(theta[i])
        y += reach * math.sin(theta[i])
    return c * y - s * x


@compiled
def hold_in(
    theta: FloatArray,
    rod: Elastic,
    k0: FloatArray,
    hold: Hold,
    across_n: float,
    tolerance: float,
    scratch: FloatArray,
    carried: FloatArray,
    yielding: FloatArray,
) -> Held:
    """Moves a shape in place to the equilibrium of the held rod (Newton's method on shape and reaction together).

    Args:
        theta: (n,) angles of the elements in rad; start, then result.
        rod: values of the rod; its ``k0`` is written: ``k0`` and the effect of the force's lever.
        k0: (n,) curvature without load and lever, 1/m.
        hold: how the tip is held.
        across_n: start of the reaction.
        tolerance: residual that ends the iteration.
        scratch: (SCRATCH, n) buffer; afterwards with the factors of the Hessian.
        carried: (n, 2) zeros.
        yielding: (n,) written: change of the angles for each newton of the reaction.

    Returns:
        The result.
    """
    n = theta.size
    last = n - 1
    work, step, cosine, sine = scratch[:5], scratch[6], scratch[COSINE], scratch[SINE]
    c, s, length = hold.c, hold.s, rod.h * last
    iteration = 0
    while True:
        force_n = math.hypot(hold.along_n, across_n)
        for i in range(n):
            rod.k0[i] = k0[i] + hold.lever_per_m_n * force_n
        sincos(theta, cosine, sine)
        load = Load(c * hold.along_n - s * across_n, s * hold.along_n + c * across_n, 0.0, carried)
        residual = assemble(theta, cosine, sine, rod, load, work) / rod.scale
        positive = newton_step(work, 0.0, step)
        negative = 0
        if not positive:
            for i in range(n):
                negative += 1 if scratch[INVERSE_PIVOTS, i] < 0.0 else 0
        # How the angles yield to the reaction: through its lever arm, and through the curvature that it adds.
        curvature_per_n = hold.lever_per_m_n * across_n / force_n if force_n > 1e-9 else 0.0
        previous = 0.0
        for i in range(n):
            reach = rod.h if i < last else rod.lever
            yielding[i] = reach * (c * cosine[i] + s * sine[i])
        if curvature_per_n != 0.0:
            for i in range(n):
                span = rod.h if 0 < i < last else 0.5 * rod.h
                k = (theta[i] - previous) / span
                previous = theta[i]
                joint = rod.ei[i] * (1.0 + rod.soft * k * k) * curvature_per_n
                yielding[i] += joint
                if i > 0:
                    yielding[i - 1] -= joint
        solve_factorised(scratch, yielding)
        # How far the loaded point is from where it is held, and its move by the step and for each newton.
        miss_m = hold.aside_m
        give_m_per_n = moved_m = 0.0
        for i in range(n):
            reach = rod.h if i < last else rod.lever
            miss_m -= reach * (c * sine[i] - s * cosine[i])
            arm = reach * (c * cosine[i] + s * sine[i])
            give_m_per_n += arm * yielding[i]
            moved_m += arm * step[i]
        # The hold removes one direction: it stabilises a shape with one negative eigenvalue if that gives way to it.
        stable = negative == 0 or (negative == 1 and give_m_per_n < 0.0)
        done = residual <= tolerance and abs(miss_m) <= _MAX_MISS * length
        if done or iteration == _MAX_ITERATIONS or give_m_per_n == 0.0:
            return Held(done, stable, across_n, give_m_per_n)
        change_n = (miss_m - moved_m) / give_m_per_n
        longest = 1e-300
        for i in range(n):
            step[i] += change_n * yielding[i]
            longest = max(longest, abs(step[i]))
        scale = min(1.0, _MAX_TURN_RAD / longest)
        if not scale > 0.0:  # not a number
            return Held(False, False, across_n, give_m_per_n)
        for i in range(n):
            theta[i] += scale * step[i]
        across_n += scale * change_n
        iteration += 1
