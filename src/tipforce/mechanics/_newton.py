"""Newton's method on the energy of the discrete planar elastica, pressed by springs at its tip.

Unknowns are the tangent angles: one a segment of length h, and one of the rigid tip. Inextensible segments make the
Hessian of the bending energy and of a dead tip load tridiagonal; each of the two contact springs adds a term of rank
one, which the Woodbury identity takes in.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..types import FloatArray
from ._rod import Rod

__all__ = ["NO_LOAD", "NO_SPRINGS", "Elastic", "Load", "Outcome", "Springs", "elastic_of", "energy_at", "relax"]


class Elastic(NamedTuple):
    """The rod as numbers: segment length, lever of the loaded point beyond the shaft, EI, k_0, 1 / k_s^2."""

    h: float
    lever: float
    ei: float
    k0: float
    soft: float


class Load(NamedTuple):
    """Dead load at the lever's end, base frame: force (fx, fy) and moment m about z."""

    fx: float
    fy: float
    m: float


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
    """``depth`` and ``slide`` of the ball (see `Springs`; slide is not reckoned from the anchor)."""

    iterations: int
    converged: bool
    stable: bool
    energy: float
    depth: float
    slide: float


NO_LOAD = Load(0.0, 0.0, 0.0)
NO_SPRINGS = Springs(1.0, 0.0, math.inf, 0.0, 0.0, 0.0, 0.0)

_MAX_ITERATIONS = 80
_MAX_TURN = 0.4
"""Largest change of an angle in one step, rad: keeps the iteration on the branch it comes from."""
_TOLERANCE = 1e-10
"""Residual moment relative to EI / (length of the shaft)."""


def elastic_of(rod: Rod, lever_m: float) -> Elastic:
    """The numbers of ``rod``, loaded at ``lever_m`` beyond the end of its shaft."""
    return Elastic(
        rod.flexible_length_m / rod.segments,
        lever_m,
        rod.bending_stiffness_nm2,
        rod.precurvature_per_m,
        rod.stiffening_curvature_per_m**-2,
    )


@njit(cache=True, error_model="numpy")
def energy_at(
    theta: FloatArray, cosine: FloatArray, sine: FloatArray, rod: Elastic, load: Load, springs: Springs
) -> tuple[float, float, float]:
    """Energy, depth and slide at ``theta``; leaves the cosines and sines in their arrays."""
    last = theta.size - 1
    x = y = bend = previous = 0.0
    for i in range(last + 1):
        span = rod.h if 0 < i < last else 0.5 * rod.h
        k = (theta[i] - previous) / span
        previous = theta[i]
        density = 0.5 * (k - rod.k0) ** 2
        if rod.soft > 0.0:  # the integral of (k / k_s)^2 (k - k_0) from k_0
            density += rod.soft * (k**4 / 4 - rod.k0 * k**3 / 3 + rod.k0**4 / 12)
        bend += span * rod.ei * density
        cosine[i] = math.cos(theta[i])
        sine[i] = math.sin(theta[i])
        reach = rod.h if i < last else rod.lever
        x += reach * cosine[i]
        y += reach * sine[i]
    depth = x * springs.dx + y * springs.dy + springs.radius - springs.position
    slide = y * springs.dx - x * springs.dy + springs.radius * theta[last]
    total = bend - load.fx * x - load.fy * y - load.m * theta[last] + 0.5 * springs.kt * (slide - springs.anchor) ** 2
    if depth > 0.0 and springs.kn > 0.0:
        total += 0.5 * springs.kn * depth**2
    return total, depth, slide


@njit(cache=True, error_model="numpy")
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
    """Fill ``work`` (7, n): gradient, diagonal, off-diagonal, the springs' two directions. Returns max |gradient|."""
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
        moment = rod.ei * stiffer * (k - rod.k0)
        slope = rod.ei * (stiffer + 2.0 * rod.soft * k * (k - rod.k0)) / span
        reach = rod.h if i < last else rod.lever
        c, s = reach * cosine[i], reach * sine[i]
        gradient[i] = moment + fx * s - fy * c
        diagonal[i] = slope + fx * c + fy * s
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


@njit(cache=True, error_model="numpy")
def _newton_step(work: FloatArray, shift: float, step: FloatArray) -> bool:
    """Solve (H + shift I) step = -gradient; False where H + shift I is not positive definite.

    H = T + a a' + c c' with T tridiagonal. By the inertia of the bordered matrix, H has as many negative eigenvalues
    as T less those of the 2x2 matrix 1 + [a c]' T^-1 [a c]: no eigenvalues need be computed.
    """
    n = step.size
    gradient, diagonal, upper, along, across = work[0], work[1], work[2], work[3], work[4]
    pivot, first, second = work[5], work[6], work[7]
    negative = 0
    for i in range(n):  # T = L D L'; forward substitution of the three right-hand sides goes along
        pivot[i] = diagonal[i] + shift
        step[i], first[i], second[i] = -gradient[i], along[i], across[i]
        if i > 0:
            factor = upper[i - 1] / pivot[i - 1]
            pivot[i] -= factor * upper[i - 1]
            step[i] -= factor * step[i - 1]
            first[i] -= factor * first[i - 1]
            second[i] -= factor * second[i - 1]
        if pivot[i] == 0.0:
            pivot[i] = 1e-300
        if pivot[i] < 0.0:
            negative += 1
    for i in range(n - 1, -1, -1):
        back = upper[i] if i < n - 1 else 0.0
        j = i + 1 if i < n - 1 else i
        step[i] = (step[i] - back * step[j]) / pivot[i]
        first[i] = (first[i] - back * first[j]) / pivot[i]
        second[i] = (second[i] - back * second[j]) / pivot[i]
    aa, ac, cc, a_step, c_step = 1.0, 0.0, 1.0, 0.0, 0.0
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


@njit(cache=True, error_model="numpy")
def relax(theta: FloatArray, rod: Elastic, load: Load, springs: Springs) -> Outcome:
    """Move ``theta`` (n,) in place to the nearest minimum of the energy; ``stable`` tells whether it is one.

    Each step is Newton's where the Hessian is positive definite, else that of the shifted Hessian, cut so that no
    angle turns by more than 0.4 rad, and halved until the energy falls.
    """
    n = theta.size
    work = np.empty((8, n))
    trial, step, cosine, sine = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    energy, depth, slide = energy_at(theta, cosine, sine, rod, load, springs)
    small = _TOLERANCE * rod.ei / (rod.h * (n - 1))
    iteration = 0
    while True:
        residual = _assemble(theta, cosine, sine, rod, load, springs, depth, slide, work)
        stable = _newton_step(work, 0.0, step)
        if residual <= small:
            return Outcome(iteration, True, stable, energy, depth, slide)
        if iteration == _MAX_ITERATIONS:
            return Outcome(iteration, False, stable, energy, depth, slide)
        iteration += 1
        shift = 1e-3 * rod.ei / rod.h
        while not stable and not _newton_step(work, shift, step):
            shift *= 4.0
        longest = descent = 0.0
        for i in range(n):
            longest = max(longest, abs(step[i]))
            descent += work[0, i] * step[i]
        scale = min(1.0, _MAX_TURN / longest)
        # Close to the minimum the gain drowns in rounding: let a Newton step pass there.
        slack = 1e-14 * (abs(energy) + rod.ei / (rod.h * n))
        while True:
            for i in range(n):
                trial[i] = theta[i] + scale * step[i]
            tried, depth, slide = energy_at(trial, cosine, sine, rod, load, springs)
            if tried <= energy + 1e-4 * scale * descent + slack:
                break
            scale *= 0.5
            if scale < 1e-10:  # no descent left: what stands is as good as rounding allows
                energy, depth, slide = energy_at(theta, cosine, sine, rod, load, springs)
                return Outcome(iteration, False, stable, energy, depth, slide)
        energy = tried
        theta[:] = trial
