"""Newton's method on the energy of the discrete planar elastica under a dead load, and continuation.

Unknowns are the tangent angles: one per segment of length h, and one of the rigid tip. Inextensible segments make the
Hessian of the bending energy and of a dead tip load tridiagonal. The continuation (`follow`) raises all loads
together, from the unloaded shape to the whole load.
"""

from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._compile import compiled
from ._sincos import cosine_and_sine


class Elastic(NamedTuple):
    """The values of the rod: segment length, lever of the loaded point beyond the shaft, EI and k_0 (n,), 1 / k_s^2."""

    h: float
    lever: float
    ei: FloatArray
    k0: FloatArray
    soft: float
    scale: float
    """Unit of the residuals: the moment EI / length of the shaft."""


class Load(NamedTuple):
    """Dead load, base frame.

    Attributes:
        fx: force at the lever's end along x.
        fy: force at the lever's end along y.
        m: moment about z at the lever's end.
        carried: (n, 2) distributed load beyond each segment, and half of its own, which acts at its middle.
    """

    fx: float
    fy: float
    m: float
    carried: FloatArray


class Solution(NamedTuple):
    """Result of Newton's method.

    Attributes:
        iterations: number of steps.
        converged: whether the residual is within the tolerance.
        stable: whether the shape is a minimum of the energy.
        energy: energy in J.
        residual: largest unbalanced moment on a segment over EI / length of the shaft.
    """

    iterations: int
    converged: bool
    stable: bool
    energy: float
    residual: float


SCRATCH = 9
"""Number of rows of n values that `relax_in` needs."""
INVERSE_PIVOTS, COSINE, SINE = 4, 7, 8
"""Rows of the scratch: 1 / pivots of the Hessian, cosine and sine of the angles."""
_MAX_ITERATIONS = 80
_MAX_TURN_RAD = 0.4
"""Largest change of an angle in one step, rad: the iteration then stays on its branch."""
TOLERANCE = 1e-11
"""Residual that ends the iteration. Rounding leaves about 1e-16 x segments x the largest angle."""


@compiled
def sincos(angle: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Computes cosines and sines in a loop of vector instructions.

    Scalar calls of the library's functions would take more than half of the time of a solution.

    Args:
        angle: (n,) angles in rad.
        cosine: (n,) cosines that are written.
        sine: (n,) sines that are written.
    """
    for i in range(angle.size):
        cosine[i], sine[i] = cosine_and_sine(angle[i])


@compiled
def bending_density(k: float, k0: float, soft: float) -> float:
    """Returns the bending energy per metre over EI.

    Args:
        k: curvature in 1/m.
        k0: pre-curvature in 1/m.
        soft: 1 / k_s^2 of the stiffening law, in m^2.

    Returns:
        The energy in 1/m^2.
    """
    density = 0.5 * (k - k0) ** 2
    if soft > 0.0:  # the integral of (k / k_s)^2 (k - k_0) from k_0
        density += soft * (k**4 / 4 - k0 * k**3 / 3 + k0**4 / 12)
    return density


@compiled
def energy_at(theta: FloatArray, cosine: FloatArray, sine: FloatArray, rod: Elastic, load: Load) -> float:
    """Returns the energy of a shape: elastic energy minus work of the load.

    Args:
        theta: (n,) angles of the elements in rad.
        cosine: (n,) their cosines, written.
        sine: (n,) their sines, written.
        rod: values of the rod.
        load: the load.

    Returns:
        The energy in J.
    """
    last = theta.size - 1
    sincos(theta, cosine, sine)
    x = y = bending_energy = distributed_work = previous = 0.0
    for i in range(last + 1):
        span = rod.h if 0 < i < last else 0.5 * rod.h
        k = (theta[i] - previous) / span
        previous = theta[i]
        bending_energy += span * rod.ei[i] * bending_density(k, rod.k0[i], rod.soft)
        reach = rod.h if i < last else rod.lever
        x += reach * cosine[i]
        y += reach * sine[i]
        distributed_work += reach * (load.carried[i, 0] * cosine[i] + load.carried[i, 1] * sine[i])
    return bending_energy - load.fx * x - load.fy * y - load.m * theta[last] - distributed_work


@compiled
def assemble(
    theta: FloatArray, cosine: FloatArray, sine: FloatArray, rod: Elastic, load: Load, work: FloatArray
) -> float:
    """Computes gradient and Hessian of the energy.

    Args:
        theta: (n,) angles of the elements in rad.
        cosine: (n,) their cosines.
        sine: (n,) their sines.
        rod: values of the rod.
        load: the load.
        work: (5, n) buffer: gradient, diagonal and off-diagonal of the Hessian are written to its first rows.

    Returns:
        The largest component of the gradient in N m.
    """
    last = theta.size - 1
    gradient, diagonal, upper = work[0], work[1], work[2]
    previous = 0.0
    for i in range(last + 1):
        # Joint i bends between elements i - 1 and i: its moment acts on both with opposite signs.
        span = rod.h if 0 < i < last else 0.5 * rod.h
        k = (theta[i] - previous) / span
        previous = theta[i]
        stiffer = 1.0 + rod.soft * k * k  # EI grows with the curvature k
        moment = rod.ei[i] * stiffer * (k - rod.k0[i])
        slope = rod.ei[i] * (stiffer + 2.0 * rod.soft * k * (k - rod.k0[i])) / span  # of the moment with the angle
        reach = rod.h if i < last else rod.lever
        c, s = reach * cosine[i], reach * sine[i]
        force_x, force_y = load.fx + load.carried[i, 0], load.fy + load.carried[i, 1]
        gradient[i] = moment + force_x * s - force_y * c
        diagonal[i] = slope + force_x * c + force_y * s
        if i > 0:
            gradient[i - 1] -= moment
            diagonal[i - 1] += slope
            upper[i - 1] = -slope
    gradient[last] -= load.m
    residual = 0.0
    for i in range(last + 1):
        residual = max(residual, abs(gradient[i]))
    return residual


@compiled
def newton_step(work: FloatArray, shift: float, step: FloatArray) -> bool:
    """Solves (H + shift I) step = -gradient.

    H = L D L' with bidiagonal L; the factors and 1 / D are left in ``work``.

    Args:
        work: (5, n) buffer of `assemble`.
        shift: added to the diagonal, N m.
        step: (n,) written, rad.

    Returns:
        Whether H + shift I is positive definite.
    """
    n = step.size
    gradient, diagonal, upper, factor, inverse_pivot = work[0], work[1], work[2], work[3], work[4]
    negative = 0
    forward = inverse = 0.0
    for i in range(n):  # D^-1 of the forward substitution in the same loop
        pivot = diagonal[i] + shift
        right = -gradient[i]
        if i > 0:
            factor[i - 1] = upper[i - 1] * inverse
            pivot -= factor[i - 1] * upper[i - 1]
            right -= factor[i - 1] * forward
        if pivot == 0.0:
            pivot = 1e-300
        if pivot < 0.0:
            negative += 1
        forward = right
        inverse = 1.0 / pivot
        step[i] = right * inverse
        inverse_pivot[i] = inverse
    for i in range(n - 2, -1, -1):
        step[i] -= factor[i] * step[i + 1]
    return negative == 0


@compiled
def relax_in(theta: FloatArray, rod: Elastic, load: Load, tolerance: float, scratch: FloatArray) -> Solution:
    """Moves a shape in place to the nearest minimum of the energy.

    Each step is Newton's if the Hessian is positive definite, else that of the shifted Hessian. It is limited so that
    no angle turns by more than 0.4 rad, and halved until the energy falls.

    Args:
        theta: (n,) angles of the elements in rad; start, then result.
        rod: values of the rod.
        load: the load.
        tolerance: residual that ends the iteration.
        scratch: (SCRATCH, n) buffer; afterwards with the Hessian's factors, which `solve_factorised` uses.

    Returns:
        The result; ``stable``: whether the shape is a minimum.
    """
    n = theta.size
    work, trial, step, cosine, sine = scratch[:5], scratch[5], scratch[6], scratch[COSINE], scratch[SINE]
    energy = energy_at(theta, cosine, sine, rod, load)
    iteration = 0
    while True:
        residual = assemble(theta, cosine, sine, rod, load, work) / rod.scale
        stable = newton_step(work, 0.0, step)
        if residual <= tolerance or iteration == _MAX_ITERATIONS:
            return Solution(iteration, residual <= tolerance, stable, energy, residual)
        iteration += 1
        # The smallest possible shift: past a fold the gradient is small and the step follows the softest direction.
        shift = 1e-7 * rod.ei[0] / rod.h
        while not stable and not newton_step(work, shift, step):
            shift *= 8.0
        longest = descent = 0.0
        for i in range(n):
            longest = max(longest, abs(step[i]))
            descent += work[0, i] * step[i]
        scale = min(1.0, _MAX_TURN_RAD / longest)
        # Close to the minimum the gain is smaller than rounding: a Newton step is accepted there.
        slack = 1e-14 * (abs(energy) + rod.scale)
        while True:
            for i in range(n):
                trial[i] = theta[i] + scale * step[i]
            tried = energy_at(trial, cosine, sine, rod, load)
            if tried <= energy + 1e-4 * scale * descent + slack:
                break
            scale *= 0.5
            if scale < 1e-10:  # no descent is left: rounding allows no better shape
                energy = energy_at(theta, cosine, sine, rod, load)
                return Solution(iteration, False, stable, energy, residual)
        energy = tried
        for i in range(n):  # the assignment of a slice takes seconds to compile, because of its error message
            theta[i] = trial[i]


@compiled
def solve_factorised(scratch: FloatArray, answer: FloatArray) -> None:
    """Solves a linear system with the factors of the Hessian from `relax_in`.

    Only for stable shapes: if the Hessian is not positive definite, the factors may be those of a shifted one.

    Args:
        scratch: (SCRATCH, n) buffer of `relax_in`.
        answer: (n,) right-hand side, then the solution.
    """
    factor, inverse = scratch[3], scratch[INVERSE_PIVOTS]
    last = answer.size - 1
    for i in range(1, last + 1):
        answer[i] -= factor[i - 1] * answer[i - 1]
    answer[last] *= inverse[last]
    for i in range(last - 1, -1, -1):
        answer[i] = answer[i] * inverse[i] - factor[i] * answer[i + 1]


_MAX_MISMATCH_RAD = 0.02
"""Largest difference, rad, of a step of the load from the mean of the tangents at its two ends.

On a smooth branch it falls with the cube of the step; at a jump to another branch it is the jump, for every step.
"""
_MAX_TANGENT_STEP_RAD = 0.6
"""Largest change of an angle in one step of the load along the tangent, rad."""
_MIN_LOAD_STEP = 1e-5
"""Share of the load below which a step that still fails is a fold, or the point of buckling."""
_PATH_TOLERANCE = 1e-5
"""Largest residual of the shapes between the unloaded and the final one."""
_RESTART_STEP = 0.02
"""Share of the load in the first step after a fold."""


@compiled
def _tangent(rod: Elastic, load: Load, scratch: FloatArray, tangent: FloatArray) -> None:
    """Computes into ``tangent`` (n,) the change of the angles in rad for each unit of the share of ``load``.

    ``scratch``: from `relax_in`, with the factors of the Hessian at the present shape.
    """
    last = tangent.size - 1
    cosine, sine = scratch[COSINE], scratch[SINE]
    for i in range(last + 1):
        reach = rod.h if i < last else rod.lever
        tangent[i] = reach * ((load.fy + load.carried[i, 1]) * cosine[i] - (load.fx + load.carried[i, 0]) * sine[i])
    tangent[last] += load.m
    solve_factorised(scratch, tangent)


@compiled
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copies (n,); the assignment of a slice takes seconds to compile, because of its error message."""
    for i in range(source.size):
        target[i] = source[i]


@compiled
def follow(theta: FloatArray, rod: Elastic, load: Load, first: float, scratch: FloatArray) -> tuple[Solution, bool]:
    """Moves a shape from the unloaded one to that of the whole load.

    A branch that becomes unstable without a fold (a straight rod pushed along its axis) is followed further.

    Args:
        theta: (n,) angles of the elements in rad; unloaded shape, then result.
        rod: values of the rod.
        load: the whole load.
        first: first step, as a share of the load.
        scratch: (SCRATCH + 4, n) buffer.

    Returns:
        The result, and whether the branch has no jump.
    """
    n = theta.size
    work, theta_before, carried = scratch[:SCRATCH], scratch[SCRATCH], np.zeros((n, 2))
    tangent, tangent_before, tangent_last = scratch[SCRATCH + 1], scratch[SCRATCH + 2], scratch[SCRATCH + 3]
    outcome = relax_in(theta, rod, Load(0.0, 0.0, 0.0, carried), _PATH_TOLERANCE, work)
    _tangent(rod, load, work, tangent)
    _copy(tangent, tangent_last)
    stable = outcome.stable
    iterations = outcome.iterations
    followed = True
    share, step, last_step = 0.0, first, 0.0
    while share < 1.0:
        if stable:
            longest = 0.0
            for i in range(n):
                longest = max(longest, abs(tangent[i]))
            step = max(_MIN_LOAD_STEP, min(step, _MAX_TANGENT_STEP_RAD / (longest + 1e-300)))
        target = min(1.0, share + step)
        step = target - share
        _copy(theta, theta_before)
        _copy(tangent, tangent_before)
        if stable:
            # The tangent, and its change over the last step.
            half_bend = 0.5 * step * step / last_step if last_step > 0.0 else 0.0
            for i in range(n):
                theta[i] += step * tangent[i] + half_bend * (tangent[i] - tangent_last[i])
        for i in range(n):
            carried[i, 0], carried[i, 1] = target * load.carried[i, 0], target * load.carried[i, 1]
        part_load = Load(target * load.fx, target * load.fy, target * load.m, carried)
        tolerance = TOLERANCE if target == 1.0 else _PATH_TOLERANCE
        outcome = relax_in(theta, rod, part_load, tolerance, work)
        iterations += outcome.iterations
        was_stable, stable = stable, outcome.stable
        if stable:
            _tangent(rod, load, work, tangent)
        mismatch = largest_change = 0.0
        for i in range(n):
            largest_change = max(largest_change, abs(theta[i] - theta_before[i]))
            mismatch = max(mismatch, abs(theta[i] - theta_before[i] - 0.5 * step * (tangent[i] + tangent_before[i])))
        if stable and was_stable and outcome.converged and mismatch <= _MAX_MISMATCH_RAD:  # the step is accepted
            share, last_step = target, step
            _copy(tangent_before, tangent_last)
            if mismatch < 0.125 * _MAX_MISMATCH_RAD:
                step *= 2.0
        elif not was_stable or step < 1.5 * _MIN_LOAD_STEP:
            # After the end of a stable part there is no tangent: the branch is followed if the shape does not move.
            followed = followed and outcome.converged and largest_change <= _MAX_MISMATCH_RAD
            share, step, last_step = target, _RESTART_STEP, 0.0
        else:  # the step is tried again, shorter
            _copy(theta_before, theta)
            _copy(tangent_before, tangent)
            stable = True
            step = max(0.3 * step, _MIN_LOAD_STEP)
    whole = Solution(iterations, outcome.converged, outcome.stable, outcome.energy, outcome.residual)
    return whole, followed
