"""Newton's method on the spatial rod, and the continuation from the unloaded shape to the whole load.

The Hessian is 3x3 block-tridiagonal. It is stored as a band of half width 5: row r of ``band`` (3k, 6) holds H[r, r],
H[r, r + 1], ... H[r, r + 5] before, and D[r], L[r + 1, r], ... after the factorisation H = L D L'. The last block is
stored separately as its inverse, because a dead moment makes it unsymmetric.
"""

import math
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from .._branch import Branch
from ._compile import compiled
from ._energy import add_pull, assemble, energy_at, unturned
from ._state import Elastic, Load, Touch, Work

WIDTH = 6


@compiled
def factorise(band: FloatArray, shift: float, skew: FloatArray, tail: FloatArray) -> int:
    """Factorises H + shift = L D L' in place. A pivot of 0 is replaced by a tiny positive one.

    Args:
        band: (3k, 6) upper band of the symmetric part of H, then its factors.
        shift: number that is added to the diagonal.
        skew: (3,) axial vector of the unsymmetric part of the last block.
        tail: (3, 3) inverse of the last block after elimination, written; it contains the unsymmetric part.

    Returns:
        Number of negative eigenvalues of the symmetric part.
    """
    size = band.shape[0]
    body = size - 3
    negative = 0
    for r in range(body):
        pivot = band[r, 0] + shift
        if pivot == 0.0:
            pivot = 1e-300
        if pivot < 0.0:
            negative += 1
        band[r, 0] = pivot
        inverse = 1.0 / pivot
        reach = min(WIDTH, size - r)
        for i in range(1, reach):
            factor = band[r, i] * inverse
            for j in range(i, reach):
                band[r + i, j - i] -= factor * band[r, j]
        for i in range(1, reach):
            band[r, i] *= inverse
    # The last block: the signs of its pivots, then its inverse with the unsymmetric part, from the cofactors.
    a, b, c = band[body, 0] + shift, band[body, 1], band[body, 2]
    d, e, f = band[body + 1, 0] + shift, band[body + 1, 1], band[body + 2, 0] + shift
    second = d - b * b / a
    cross = e - b * c / a
    third = f - c * c / a - cross * cross / second
    negative += int(a < 0.0) + int(second < 0.0) + int(third < 0.0)
    x, y, z = skew[0], skew[1], skew[2]
    m01, m10, m02, m20, m12, m21 = b - z, b + z, c + y, c - y, e - x, e + x
    tail[0, 0] = d * f - m12 * m21
    tail[0, 1] = m02 * m21 - m01 * f
    tail[0, 2] = m01 * m12 - m02 * d
    tail[1, 0] = m12 * m20 - m10 * f
    tail[1, 1] = a * f - m02 * m20
    tail[1, 2] = m02 * m10 - a * m12
    tail[2, 0] = m10 * m21 - d * m20
    tail[2, 1] = m01 * m20 - a * m21
    tail[2, 2] = a * d - m01 * m10
    determinant = a * tail[0, 0] + m01 * tail[1, 0] + m02 * tail[2, 0]
    if determinant == 0.0:
        determinant = 1e-300
    for i in range(3):
        for j in range(3):
            tail[i, j] /= determinant
    return negative


@compiled
def solve(band: FloatArray, tail: FloatArray, rhs: FloatArray) -> None:
    """Solves a linear system in place with the factors of `factorise`.

    Args:
        band: (3k, 6) factors.
        tail: (3, 3) inverse of the last block.
        rhs: (3k,) right-hand side, then the solution.
    """
    size = band.shape[0]
    body = size - 3
    for r in range(body):  # forward substitution, the last block, backward substitution
        value = rhs[r]
        for i in range(1, min(WIDTH, size - r)):
            rhs[r + i] -= band[r, i] * value
    x, y, z = rhs[body], rhs[body + 1], rhs[body + 2]
    for i in range(3):
        rhs[body + i] = tail[i, 0] * x + tail[i, 1] * y + tail[i, 2] * z
    for r in range(body - 1, -1, -1):
        value = rhs[r] / band[r, 0]
        for i in range(1, min(WIDTH, size - r)):
            value -= band[r, i] * rhs[r + i]
        rhs[r] = value


TOLERANCE = 1e-11
"""Residual moment relative to EI / (length of the shaft)."""
_MAX_ITERATIONS = 80
_MAX_TURN_RAD = 0.4
"""Largest turn of an element in one step, rad: the iteration then stays on its branch."""


class Solution(NamedTuple):
    """Result of Newton's method.

    Attributes:
        iterations: number of steps.
        converged: whether the residual is within the tolerance.
        stable: whether the shape is a minimum of the energy.
        residual: largest unbalanced moment, relative to EI / length of the shaft.
    """

    iterations: int
    converged: bool
    stable: bool
    residual: float


@compiled
def solve_factorised(work: Work, m: int, rhs: FloatArray) -> None:
    """Solves a linear system with H + contacts in place, with the factors of `newton_step`.

    Args:
        work: buffers with the factors.
        m: number of rows of the contacts.
        rhs: (3k,) right-hand side, then the solution.
    """
    solve(work.band, work.tail, rhs)
    small, depth, force = work.small, work.forces[0], work.forces[1]
    for i in range(m):
        depth[i] = 0.0
        for r in range(rhs.shape[0]):
            depth[i] += work.rows[i, r] * rhs[r]
    for i in range(m):
        force[i] = 0.0
        for j in range(m):
            force[i] += work.firm[i, j] * depth[j]
        for j in range(i):
            force[i] -= small[i, j] * force[j]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            force[i] -= small[i, j] * force[j]
        force[i] /= small[i, i]
    for i in range(m):
        for r in range(rhs.shape[0]):
            rhs[r] -= force[i] * work.solved[i, r]


@compiled
def newton_step(work: Work, m: int, loose: int, shift: float) -> int:
    """Factorises the Hessian and solves for the step ``work.step``.

    With B the rows, T the band and K their stiffness, H = T + B' K B has as many negative eigenvalues as T minus
    those of I + K B T^-1 B' (inertia of the bordered matrix; they are counted by the pivots, because K is diagonal
    there). Friction in slip is not counted.

    Args:
        work: buffers, filled by `assemble`.
        m: number of rows of the contacts.
        loose: number of the last rows, which slip.
        shift: number that is added to the diagonal of the band.

    Returns:
        Number of negative eigenvalues of the Hessian.
    """
    band, hessian, small = work.band, work.hessian, work.small
    for r in range(band.shape[0]):
        for i in range(6):
            band[r, i] = hessian[r, i]
        work.step[r] = -work.gradient[r]
    negative = factorise(band, shift, work.skew, work.tail)
    for i in range(m):  # T^-1 B'
        for r in range(band.shape[0]):
            work.solved[i, r] = work.rows[i, r]
        solve(band, work.tail, work.solved[i])
    for i in range(m):
        for j in range(m):
            dot = 0.0
            for r in range(band.shape[0]):
                dot += work.rows[i, r] * work.solved[j, r]
            work.compliance[i, j] = dot  # B T^-1 B'
    for i in range(m):  # I + K B T^-1 B'
        for j in range(m):
            value = 1.0 if i == j else 0.0
            for k in range(m):
                if work.firm[i, k] != 0.0:
                    value += work.firm[i, k] * work.compliance[k, j]
            small[i, j] = value
    for k in range(m):  # its LU factors in place; negative pivots are counted
        if not small[k, k] > 0.0 and k < m - loose:
            negative -= 1
        if small[k, k] == 0.0:
            small[k, k] = 1e-300
        for i in range(k + 1, m):
            factor = small[i, k] / small[k, k]
            small[i, k] = factor
            for j in range(k + 1, m):
                small[i, j] -= factor * small[k, j]
    solve_factorised(work, m, work.step)
    return negative


@compiled
def turn(q: FloatArray, step: FloatArray, scale: float, out: FloatArray) -> None:
    """Turns orientations: (1, w / 2) normalised equals exp(w) to second order.

    Args:
        q: (k, 4) orientations of the elements.
        step: (3k,) rotation vectors w in rad, in the frame of each element.
        scale: factor of the step.
        out: (k, 4) turned orientations, written.
    """
    half = 0.5 * scale
    for i in range(q.shape[0]):
        a, b, c = half * step[3 * i], half * step[3 * i + 1], half * step[3 * i + 2]
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        nw, nx = w - a * x - b * y - c * z, x + a * w + c * y - b * z  # the product q (1, a, b, c)
        ny, nz = y + b * w + a * z - c * x, z + c * w + b * x - a * y
        size = 1.0 / math.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = nw * size, nx * size, ny * size, nz * size


@compiled
def copy_turns(source: FloatArray, target: FloatArray) -> None:
    """Copies orientations; the assignment of a slice takes seconds to compile, because of its error message.

    Args:
        source: (k, 4) orientations.
        target: (k, 4) orientations that are written.
    """
    for i in range(source.shape[0]):
        for k in range(4):
            target[i, k] = source[i, k]


@compiled
def longest_turn(step: FloatArray) -> float:
    """Returns the largest length of the turns in ``step`` (3k,)."""
    longest = 0.0
    for r in range(0, step.shape[0], 3):
        longest = max(longest, step[r] ** 2 + step[r + 1] ** 2 + step[r + 2] ** 2)
    return math.sqrt(longest)


@compiled
def _twist_work(q: FloatArray, step: FloatArray, scale: float, moment: FloatArray) -> float:
    """Returns the work in J of a dead ``moment`` (3,) along the last element's turn, whose axis is fixed in a step."""
    last, r = q.shape[0] - 1, step.shape[0] - 3
    m0, m1, m2 = unturned(q[last, 0], q[last, 1], q[last, 2], q[last, 3], moment[0], moment[1], moment[2])
    size = scale * math.sqrt(step[r] ** 2 + step[r + 1] ** 2 + step[r + 2] ** 2)
    if size == 0.0:
        return 0.0
    return scale * (m0 * step[r] + m1 * step[r + 1] + m2 * step[r + 2]) * 2.0 * math.atan(0.5 * size) / size


@compiled
def _follow_residual(
    q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work, residual: float
) -> tuple[bool, float, int, int]:
    """Makes a step of ``work.step`` that reduces the residual, for forces without energy (slip, dead moments).

    Returns whether one of six halved steps did, then the residual in N m and the numbers of rows of `assemble`.
    """
    scale = min(1.0, _MAX_TURN_RAD / longest_turn(work.step))
    for _ in range(6):
        turn(q, work.step, scale, work.trial)
        # `assemble` does not change ``work.step``
        tried, m, loose = assemble(work.trial, rod, load, touch, work)
        if tried < (1.0 - 0.1 * scale) * residual:
            copy_turns(work.trial, q)
            return True, tried, m, loose
        scale *= 0.5
    return False, residual, 0, 0


@compiled
def relax(q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work, tolerance: float) -> Solution:
    """Moves a shape in place to the nearest equilibrium.

    Each step is Newton's if the Hessian is positive definite, else that of the shifted Hessian. It is limited so that
    no element turns by more than 0.4 rad, and halved until the energy falls. Slipping friction has no energy: there the
    residual must fall, and the iteration stops early. A dead moment has none either, but along one step its work is a
    simple integral; ``stable`` is then that of the Hessian's symmetric part, sufficient but not necessary.

    Args:
        q: (k, 4) orientations of the elements; start, then result.
        rod: values of the rod.
        load: dead loads.
        touch: laws of the contact.
        work: buffers of Newton's method.
        tolerance: residual that ends the iteration, relative to ``rod.small``.

    Returns:
        The result; ``stable``: whether the shape is a minimum.
    """
    small = tolerance * rod.small
    dry = touch.active and touch.kt > 0.0 and touch.friction >= 0.0
    turned = load.moment[0] != 0.0 or load.moment[1] != 0.0 or load.moment[2] != 0.0
    residual, m, loose = assemble(q, rod, load, touch, work)
    energy = 0.0 if dry else energy_at(q, rod, load, touch, work.tangent)
    iteration = 0
    while True:
        negative = newton_step(work, m, loose, 0.0)
        if residual <= small:
            return Solution(iteration, True, negative == 0, residual / rod.small)
        if iteration == (12 if dry else _MAX_ITERATIONS):
            return Solution(iteration, False, negative == 0, residual / rod.small)
        iteration += 1
        if dry or (turned and negative != 0):
            moved, residual, m, loose = _follow_residual(q, rod, load, touch, work, residual)
            if moved:
                energy = 0.0 if dry else energy_at(q, rod, load, touch, work.tangent)
                continue
            if dry:
                return Solution(iteration, False, negative == 0, residual / rod.small)
            residual, m, loose = assemble(q, rod, load, touch, work)
            negative = newton_step(work, m, loose, 0.0)
        shift = 1e-3 * rod.small * (q.shape[0] - 1)
        while negative != 0:
            negative = newton_step(work, m, loose, shift)
            shift *= 4.0
        descent = 0.0
        for r in range(work.step.shape[0]):
            descent += work.gradient[r] * work.step[r]
        scale = min(1.0, _MAX_TURN_RAD / longest_turn(work.step))
        # Close to the minimum the gain is smaller than rounding: a Newton step is accepted there.
        slack = 1e-14 * (abs(energy) + rod.small)
        while True:
            turn(q, work.step, scale, work.trial)
            tried = energy_at(work.trial, rod, load, touch, work.tangent)
            gain = _twist_work(q, work.step, scale, load.moment) if turned else 0.0
            if tried - gain <= energy + 1e-4 * scale * descent + slack:
                break
            scale *= 0.5
            if scale < 1e-10:  # no descent is left: rounding allows no better shape
                return Solution(iteration, False, False, residual / rod.small)
        energy = tried
        copy_turns(work.trial, q)
        residual, m, loose = assemble(q, rod, load, touch, work)


_MAX_MISMATCH_RAD = 0.05
"""Largest difference, rad, of a step of the load from the mean of the tangents at its two ends.

On a smooth branch it falls with the cube of the step; at a jump to another branch it is the jump.
"""
_MAX_TANGENT_STEP_RAD = 0.6
"""Longest turn of an element in one step of the load along the tangent, rad."""
_MIN_LOAD_STEP = 1e-5
"""Share of the load below which a step that still fails is a fold, or the point of buckling."""
_RESTART_STEP = 0.02
"""Share of the load in the first step after a fold."""
_PATH_TOLERANCE = 1e-5
"""Largest relative residual of the shapes between the unloaded and the final one."""
_UNLOADED, _FALLEN = int(Branch.UNLOADED), int(Branch.FALLEN)


@compiled
def _mismatch(old: FloatArray, q: FloatArray, step: float, before: FloatArray, after: FloatArray) -> float:
    """Returns the largest difference in rad of the turns from ``old`` to ``q`` (k, 4) from the predicted ones.

    Predicted is ``step``, a share of the load, times the mean of the tangents ``before`` and ``after`` (3k,).
    """
    largest_square = 0.0
    for i in range(q.shape[0]):
        w0, x0, y0, z0 = old[i, 0], old[i, 1], old[i, 2], old[i, 3]
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        two_signed = 2.0 if w0 * w + x0 * x + y0 * y + z0 * z > 0.0 else -2.0
        # Twice the vector part of the relative quaternion: the turn in rad, to second order.
        a = two_signed * (w0 * x - x0 * w - y0 * z + z0 * y)
        b = two_signed * (w0 * y - y0 * w - z0 * x + x0 * z)
        c = two_signed * (w0 * z - z0 * w - x0 * y + y0 * x)
        half, row = 0.5 * step, 3 * i
        a -= half * (before[row] + after[row])
        b -= half * (before[row + 1] + after[row + 1])
        c -= half * (before[row + 2] + after[row + 2])
        largest_square = max(largest_square, a * a + b * b + c * c)
    return np.sqrt(largest_square)


@compiled
def _tangent(q: FloatArray, rod: Elastic, load: Load, work: Work, tangent: FloatArray) -> None:
    """Computes ``tangent`` (3k,), the turns in rad for each unit of the share of ``load``; uses factors of `relax`."""
    for r in range(tangent.shape[0]):
        tangent[r] = 0.0
    add_pull(q, rod, load, tangent)
    solve_factorised(work, 0, tangent)


@compiled
def raise_load(
    q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work, tolerance: float
) -> tuple[Solution, int]:
    """Moves a shape from the unloaded one to that of the whole load, without a wall.

    If even the smallest step fails, the branch has ended in a fold and the rod jumps. A branch that becomes unstable
    without a fold (a straight rod pushed along its axis) is followed further.

    Args:
        q: (k, 4) orientations of the elements; unloaded shape, then result.
        rod: values of the rod.
        load: the whole load.
        touch: `NO_TOUCH`.
        work: buffers of Newton's method.
        tolerance: residual that ends the iteration, relative to ``rod.small``.

    Returns:
        The result, and the `Branch`.
    """
    saved, part_load = np.empty_like(q), Load(np.zeros(3), np.zeros(3), np.zeros_like(load.line))
    tangent_before, tangent_after = np.empty(3 * q.shape[0]), np.empty(3 * q.shape[0])
    turned = load.moment[0] != 0.0 or load.moment[1] != 0.0 or load.moment[2] != 0.0
    out = relax(q, rod, part_load, touch, work, tolerance)
    _tangent(q, rod, load, work, tangent_before)
    share, step, steps, branch, was_stable = 0.0, 1.0, out.iterations, _UNLOADED, out.stable
    while share < 1.0:
        step = min(step, 1.0 - share, _MAX_TANGENT_STEP_RAD / (longest_turn(tangent_before) + 1e-300))
        last = share + step >= 1.0 - 1e-12
        target = 1.0 if last else share + step
        for k in range(3):
            part_load.force[k], part_load.moment[k] = target * load.force[k], target * load.moment[k]
        for i in range(q.shape[0]):
            for k in range(3):
                part_load.line[i, k] = target * load.line[i, k]
        copy_turns(q, saved)
        turn(saved, tangent_before, step, q)
        out = relax(q, rod, part_load, touch, work, tolerance if last else _PATH_TOLERANCE)
        steps += out.iterations
        _tangent(q, rod, load, work, tangent_after)
        mismatch = _mismatch(saved, q, step, tangent_before, tangent_after)
        followed = out.converged and mismatch <= _MAX_MISMATCH_RAD
        if (not followed or (was_stable and not out.stable and not turned)) and step > _MIN_LOAD_STEP:
            copy_turns(saved, q)
            step *= 0.4
            continue
        if not followed:
            branch = _FALLEN
        if step <= _MIN_LOAD_STEP:
            step = _RESTART_STEP
        elif mismatch < 0.125 * _MAX_MISMATCH_RAD:
            step *= 2.0
        share, was_stable = target, out.stable
        tangent_before, tangent_after = tangent_after, tangent_before
    return Solution(steps, out.converged, out.stable, out.residual), branch
