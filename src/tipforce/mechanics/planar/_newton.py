"""Newton's method on the energy of the discrete planar elastica, pressed by springs at its tip, and continuation.

Unknowns are the tangent angles: one a segment of length h, and one of the rigid tip. Inextensible segments make the
Hessian of the bending energy and of a dead tip load tridiagonal; each of the two contact springs adds a term of rank
one, which the Woodbury identity takes in. The continuation (`follow`) raises all loads together, from the unloaded
shape to the whole load.
"""

import math
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._compile import compiled
from ._rod import Rod
from ._simd import circle


class Elastic(NamedTuple):
    """The rod as numbers: segment length, lever of the loaded point beyond the shaft, EI and k_0 (n,), 1 / k_s^2."""

    h: float
    lever: float
    ei: FloatArray
    k0: FloatArray
    soft: float
    scale: float
    """Moment by which residuals are measured: EI / length of the shaft."""


class Load(NamedTuple):
    """Dead load, base frame: force (fx, fy) and moment m about z at the lever's end, and what is spread on the way.

    ``carried`` (n, 2): the distributed load beyond each segment, and half of its own: its middle carries that.
    """

    fx: float
    fy: float
    m: float
    carried: FloatArray


class Springs(NamedTuple):
    """A ball of ``radius`` at the lever's end against a plane whose inward direction (into the wall) is (dx, dy).

    The plane lies at ``position`` along that direction. ``kn`` acts on the depth of the ball, on contact only; ``kt``
    acts on the way of the ball's touching point along the wall, t = (-dy, dx), rolling counted, from ``anchor``.
    """

    dx: float
    dy: float
    position: float
    kn: float
    kt: float
    anchor: float
    radius: float


class Outcome(NamedTuple):
    """``depth`` and ``slide`` of the ball (see `Springs`; slide is not reckoned from the anchor).

    ``residual``: largest unbalanced moment on a segment over EI / length of the shaft.
    """

    iterations: int
    converged: bool
    stable: bool
    energy: float
    residual: float
    depth: float
    slide: float


NO_SPRINGS = Springs(1.0, 0.0, math.inf, 0.0, 0.0, 0.0, 0.0)

SCRATCH = 12
"""Rows of n numbers that `relax_in` needs."""
_MAX_ITERATIONS = 80
_MAX_TURN = 0.4
"""Largest change of an angle in one step, rad: keeps the iteration on the branch it comes from."""
TOLERANCE = 1e-11
"""Residual that ends the iteration. Rounding leaves about 1e-16 x segments x the largest angle."""


def elastic_of(rod: Rod, lever_m: float) -> Elastic:
    """The numbers of ``rod``, loaded at ``lever_m`` beyond the end of its shaft."""
    return Elastic(
        rod.flexible_length_m / rod.segments,
        lever_m,
        rod.stiffnesses_nm2,
        rod.precurvatures_per_m,
        rod.stiffening_curvature_per_m**-2,
        rod.bending_stiffness_nm2 / rod.flexible_length_m,
    )


@compiled
def sincos(angle: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Fills ``cosine`` and ``sine``, in a loop of vector instructions.

    One angle after the other, as the library's functions take them, would cost more than half of a solve.
    """
    for i in range(angle.size):
        cosine[i], sine[i] = circle(angle[i])


@compiled
def bending_density(k: float, k0: float, soft: float) -> float:
    """Energy per metre over EI, at curvature ``k`` against the pre-curvature ``k0``; ``soft``: 1 / k_s^2."""
    density = 0.5 * (k - k0) ** 2
    if soft > 0.0:  # the integral of (k / k_s)^2 (k - k_0) from k_0
        density += soft * (k**4 / 4 - k0 * k**3 / 3 + k0**4 / 12)
    return density


@compiled
def energy_at(
    theta: FloatArray, cosine: FloatArray, sine: FloatArray, rod: Elastic, load: Load, springs: Springs
) -> tuple[float, float, float]:
    """Energy, depth and slide at ``theta``; leaves the cosines and sines in their arrays."""
    last = theta.size - 1
    sincos(theta, cosine, sine)
    x = y = bend = spread = previous = 0.0
    for i in range(last + 1):
        span = rod.h if 0 < i < last else 0.5 * rod.h
        k = (theta[i] - previous) / span
        previous = theta[i]
        bend += span * rod.ei[i] * bending_density(k, rod.k0[i], rod.soft)
        reach = rod.h if i < last else rod.lever
        x += reach * cosine[i]
        y += reach * sine[i]
        spread += reach * (load.carried[i, 0] * cosine[i] + load.carried[i, 1] * sine[i])
    depth = x * springs.dx + y * springs.dy + springs.radius - springs.position
    slide = y * springs.dx - x * springs.dy + springs.radius * theta[last]
    total = bend - load.fx * x - load.fy * y - load.m * theta[last] - spread
    total += 0.5 * springs.kt * (slide - springs.anchor) ** 2
    if depth > 0.0 and springs.kn > 0.0:
        total += 0.5 * springs.kn * depth**2
    return total, depth, slide


@compiled
def _assemble(
    theta: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    rod: Elastic,
    load: Load,
    springs: Springs,
    depth: float,
    slide: float,
    work: FloatArray,
) -> float:
    """Fill ``work`` (8, n): gradient, diagonal, off-diagonal, the springs' two directions. Returns max |gradient|."""
    last = theta.size - 1
    gradient, diagonal, upper, along, across = work[0], work[1], work[2], work[3], work[4]
    normal = springs.kn * depth if depth > 0.0 and springs.kn > 0.0 else 0.0
    drag = springs.kt * (slide - springs.anchor)
    fx = load.fx - normal * springs.dx + drag * springs.dy
    fy = load.fy - normal * springs.dy - drag * springs.dx
    root_n = math.sqrt(springs.kn) if normal > 0.0 else 0.0
    root_t = math.sqrt(springs.kt)
    previous = 0.0
    for i in range(last + 1):
        span = rod.h if 0 < i < last else 0.5 * rod.h
        k = (theta[i] - previous) / span
        previous = theta[i]
        stiffer = 1.0 + rod.soft * k * k
        moment = rod.ei[i] * stiffer * (k - rod.k0[i])
        slope = rod.ei[i] * (stiffer + 2.0 * rod.soft * k * (k - rod.k0[i])) / span
        reach = rod.h if i < last else rod.lever
        c, s = reach * cosine[i], reach * sine[i]
        here_x, here_y = fx + load.carried[i, 0], fy + load.carried[i, 1]
        gradient[i] = moment + here_x * s - here_y * c
        diagonal[i] = slope + here_x * c + here_y * s
        along[i] = root_n * (springs.dy * c - springs.dx * s)
        across[i] = root_t * (springs.dx * c + springs.dy * s)
        if i > 0:
            gradient[i - 1] -= moment
            diagonal[i - 1] += slope
            upper[i - 1] = -slope
    gradient[last] += drag * springs.radius - load.m
    across[last] += root_t * springs.radius
    residual = 0.0
    for i in range(last + 1):
        residual = max(residual, abs(gradient[i]))
    return residual


@compiled
def _newton_step(work: FloatArray, shift: float, in_contact: bool, step: FloatArray) -> bool:
    """Solve (H + shift I) step = -gradient; False where H + shift I is not positive definite.

    H = T + a a' + c c' with T tridiagonal. By the inertia of the bordered matrix, H has as many negative eigenvalues
    as T less those of the 2x2 matrix 1 + [a c]' T^-1 [a c]: no eigenvalues need be computed. Not ``in_contact``: a and
    c are nothing.
    """
    n = step.size
    gradient, diagonal, upper, along, across = work[0], work[1], work[2], work[3], work[4]
    factor, first, second = work[5], work[6], work[7]
    negative = 0
    before = inverse = 0.0
    for i in range(n):  # T = L D L'; D^-1 of the forward substitution goes along
        pivot = diagonal[i] + shift
        right = -gradient[i]
        if i > 0:
            share = upper[i - 1] * inverse
            factor[i - 1] = share
            pivot -= share * upper[i - 1]
            right -= share * before
        if pivot == 0.0:
            pivot = 1e-300
        if pivot < 0.0:
            negative += 1
        before = right
        inverse = 1.0 / pivot
        step[i] = right * inverse
        first[i] = inverse
    for i in range(n - 2, -1, -1):
        step[i] -= factor[i] * step[i + 1]
    if not in_contact:
        return negative == 0
    aa, ac, cc, a_step, c_step = 1.0, 0.0, 1.0, 0.0, 0.0
    before = other = 0.0
    for i in range(n):
        one, two, inverse = along[i], across[i], first[i]
        if i > 0:
            one -= factor[i - 1] * before
            two -= factor[i - 1] * other
        before, other = one, two
        first[i], second[i] = one * inverse, two * inverse
    for i in range(n - 2, -1, -1):
        first[i] -= factor[i] * first[i + 1]
        second[i] -= factor[i] * second[i + 1]
    for i in range(n):
        aa += along[i] * first[i]
        ac += along[i] * second[i]
        cc += across[i] * second[i]
        a_step += along[i] * step[i]
        c_step += across[i] * step[i]
    determinant = aa * cc - ac * ac
    if determinant < 0.0:
        negative -= 1
    elif aa + cc < 0.0:
        negative -= 2
    if negative != 0 or determinant == 0.0:
        return False
    p = (cc * a_step - ac * c_step) / determinant
    q = (aa * c_step - ac * a_step) / determinant
    for i in range(n):
        step[i] -= p * first[i] + q * second[i]
    return True


@compiled
def relax(theta: FloatArray, rod: Elastic, load: Load, springs: Springs) -> Outcome:
    """`relax_in` with a scratch of its own."""
    return relax_in(theta, rod, load, springs, TOLERANCE, np.empty((SCRATCH, theta.size)))


@compiled
def relax_in(
    theta: FloatArray, rod: Elastic, load: Load, springs: Springs, tolerance: float, scratch: FloatArray
) -> Outcome:
    """Move ``theta`` (n,) in place to the nearest minimum of the energy; ``stable`` tells whether it is one.

    Each step is Newton's where the Hessian is positive definite, else that of the shifted Hessian, cut so that no
    angle turns by more than 0.4 rad, and halved until the energy falls. ``scratch`` (SCRATCH, n) is left with the
    Hessian's factors at ``theta``: `solve_for` goes on from there.
    """
    n = theta.size
    work, trial, step, cosine, sine = scratch[:8], scratch[8], scratch[9], scratch[10], scratch[11]
    in_contact = springs.kn > 0.0 or springs.kt > 0.0
    energy, depth, slide = energy_at(theta, cosine, sine, rod, load, springs)
    iteration = 0
    while True:
        residual = _assemble(theta, cosine, sine, rod, load, springs, depth, slide, work) / rod.scale
        stable = _newton_step(work, 0.0, in_contact, step)
        if residual <= tolerance or iteration == _MAX_ITERATIONS:
            return Outcome(iteration, residual <= tolerance, stable, energy, residual, depth, slide)
        iteration += 1
        # As little shift as will do: past a fold the gradient is small, and the softest way is the one to go.
        shift = 1e-7 * rod.ei[0] / rod.h
        while not stable and not _newton_step(work, shift, in_contact, step):
            shift *= 8.0
        longest = descent = 0.0
        for i in range(n):
            longest = max(longest, abs(step[i]))
            descent += work[0, i] * step[i]
        scale = min(1.0, _MAX_TURN / longest)
        # Close to the minimum the gain drowns in rounding: let a Newton step pass there.
        slack = 1e-14 * (abs(energy) + rod.scale)
        while True:
            for i in range(n):
                trial[i] = theta[i] + scale * step[i]
            tried, depth, slide = energy_at(trial, cosine, sine, rod, load, springs)
            if tried <= energy + 1e-4 * scale * descent + slack:
                break
            scale *= 0.5
            if scale < 1e-10:  # no descent left: what stands is as good as rounding allows
                energy, depth, slide = energy_at(theta, cosine, sine, rod, load, springs)
                return Outcome(iteration, False, stable, energy, residual, depth, slide)
        energy = tried
        for i in range(n):  # a slice's assignment would cost the compiler seconds, for the message of its error
            theta[i] = trial[i]


@compiled
def solve_factorised(scratch: FloatArray, answer: FloatArray) -> None:
    """Solve with the factors of the Hessian that `relax_in` left, without springs; ``answer`` holds the side first.

    For shapes that are stable: of a Hessian that is not positive definite other factors may have been left.
    """
    factor, inverse = scratch[5], scratch[6]
    last = answer.size - 1
    for i in range(1, last + 1):
        answer[i] -= factor[i - 1] * answer[i - 1]
    answer[last] *= inverse[last]
    for i in range(last - 1, -1, -1):
        answer[i] = answer[i] * inverse[i] - factor[i] * answer[i + 1]


@compiled
def hessian_bands(theta: FloatArray, rod: Elastic, load: Load) -> FloatArray:
    """(2, n): diagonal and off-diagonal of the Hessian at ``theta``, without springs."""
    scratch = np.empty((SCRATCH, theta.size))
    _, depth, slide = energy_at(theta, scratch[10], scratch[11], rod, load, NO_SPRINGS)
    _assemble(theta, scratch[10], scratch[11], rod, load, NO_SPRINGS, depth, slide, scratch[:8])
    return scratch[1:3].copy()


_MISMATCH = 0.02
"""Largest angle, rad, by which a step of the load may miss the mean of the tangents at its two ends.

On a smooth branch the miss falls with the cube of the step; a jump to another branch misses by the jump, whatever the
step.
"""
_LONGEST = 0.6
"""Longest way of an angle in one step of the load along the tangent, rad."""
_SHORTEST = 1e-5
"""Share of the load below which a step that still fails is taken for a fold, or for the point of buckling."""
_ON_THE_WAY = 1e-5
"""Residual that will do for the shapes that are passed through."""
_ANEW = 0.02
"""Share of the load in the first step after that."""


@compiled
def _tangent(rod: Elastic, load: Load, scratch: FloatArray, way: FloatArray) -> None:
    """Change of the angles with the share of the load, into ``way``; ``scratch``: what `relax_in` left there."""
    last = way.size - 1
    cosine, sine = scratch[10], scratch[11]
    for i in range(last + 1):
        reach = rod.h if i < last else rod.lever
        way[i] = reach * ((load.fy + load.carried[i, 1]) * cosine[i] - (load.fx + load.carried[i, 0]) * sine[i])
    way[last] += load.m
    solve_factorised(scratch, way)


@compiled
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copies (n,); a slice's assignment would cost the compiler seconds, for the message of its error."""
    for i in range(source.size):
        target[i] = source[i]


@compiled
def follow(theta: FloatArray, rod: Elastic, load: Load, first: float, scratch: FloatArray) -> tuple[Outcome, bool]:
    """From the unloaded ``theta`` to the whole load; True where the branch was followed without a jump.

    A branch that loses its stability without a fold (a straight rod pushed along its axis) is followed on. ``scratch``
    (SCRATCH + 4, n).
    """
    n = theta.size
    work, before, way, way_before = scratch[:SCRATCH], scratch[12], scratch[13], scratch[14]
    way_last, carried = scratch[15], np.zeros((n, 2))
    outcome = relax_in(theta, rod, Load(0.0, 0.0, 0.0, carried), NO_SPRINGS, _ON_THE_WAY, work)
    _tangent(rod, load, work, way)
    _copy(way, way_last)
    stable = outcome.stable
    iterations = outcome.iterations
    followed = True
    share, step, last_step = 0.0, first, 0.0
    while share < 1.0:
        if stable:
            longest = 0.0
            for i in range(n):
                longest = max(longest, abs(way[i]))
            step = max(_SHORTEST, min(step, _LONGEST / (longest + 1e-300)))
        target = min(1.0, share + step)
        step = target - share
        _copy(theta, before)
        _copy(way, way_before)
        if stable:
            # The tangent, and its change over the last step.
            bent = 0.5 * step * step / last_step if last_step > 0.0 else 0.0
            for i in range(n):
                theta[i] += step * way[i] + bent * (way[i] - way_last[i])
        for i in range(n):
            carried[i, 0], carried[i, 1] = target * load.carried[i, 0], target * load.carried[i, 1]
        part = Load(target * load.fx, target * load.fy, target * load.m, carried)
        tolerance = TOLERANCE if target == 1.0 else _ON_THE_WAY
        outcome = relax_in(theta, rod, part, NO_SPRINGS, tolerance, work)
        iterations += outcome.iterations
        was_stable, stable = stable, outcome.stable
        if stable:
            _tangent(rod, load, work, way)
        miss = moved = 0.0
        for i in range(n):
            moved = max(moved, abs(theta[i] - before[i]))
            miss = max(miss, abs(theta[i] - before[i] - 0.5 * step * (way[i] + way_before[i])))
        if stable and was_stable and outcome.converged and miss <= _MISMATCH:
            share, last_step = target, step
            _copy(way_before, way_last)
            if miss < 0.125 * _MISMATCH:
                step *= 2.0
        elif not was_stable or step < 1.5 * _SHORTEST:
            # Past the end of a stable stretch there is no tangent to hold on to: only what stands still is followed.
            followed = followed and outcome.converged and moved <= _MISMATCH
            share, step, last_step = target, _ANEW, 0.0
        else:
            _copy(before, theta)
            _copy(way_before, way)
            stable = True
            step = max(0.3 * step, _SHORTEST)
    whole = Outcome(iterations, outcome.converged, outcome.stable, outcome.energy, outcome.residual, 0.0, 0.0)
    return whole, followed
