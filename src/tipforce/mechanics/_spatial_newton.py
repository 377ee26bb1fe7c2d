"""Newton's method on the spatial rod: one rotation a segment, safeguarded by the energy."""

import math
from typing import NamedTuple

from ..types import FloatArray
from ._spatial_assembly import assemble, unturned
from ._spatial_band import factorise, solve
from ._spatial_compile import compiled
from ._spatial_energy import energy_at
from ._spatial_parts import Elastic, Load, Touch, Work

__all__ = ["TOLERANCE", "Outcome", "copy_turns", "longest_turn", "newton_step", "relax", "solve_factorised", "turn"]

TOLERANCE = 1e-11
"""Residual moment relative to EI / (length of the shaft)."""
_MAX_ITERATIONS = 80
_MAX_TURN = 0.4
"""Largest turn of an element in one step, rad: keeps the iteration on the branch it comes from."""


class Outcome(NamedTuple):
    """``residual``: largest moment left over, relative to EI / length of the shaft."""

    iterations: int
    converged: bool
    stable: bool
    residual: float


@compiled
def solve_factorised(work: Work, m: int, rhs: FloatArray) -> None:
    """Overwrite ``rhs`` by (H + contacts)^-1 rhs, with what `newton_step` has left in ``work``."""
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
    """Factorise and solve for the step; returns the number of negative eigenvalues of the Hessian.

    With B the rows, T the band and K their stiffness, H = T + B' K B has as many negative eigenvalues as T less
    those of I + K B T^-1 B' (inertia of the bordered matrix; the pivots tell, for K is a diagonal where it counts).
    The last ``loose`` rows, friction in slip, are left out of the count.
    """
    band, hessian, small = work.band, work.hessian, work.small
    for r in range(band.shape[0]):
        for i in range(6):
            band[r, i] = hessian[r, i]
        work.step[r] = -work.gradient[r]
    negative = factorise(band, shift, work.skew, work.tail)
    for i in range(m):
        for r in range(band.shape[0]):
            work.solved[i, r] = work.rows[i, r]
        solve(band, work.tail, work.solved[i])
    for i in range(m):
        for j in range(m):
            dot = 0.0
            for r in range(band.shape[0]):
                dot += work.rows[i, r] * work.solved[j, r]
            work.compliance[i, j] = dot
    for i in range(m):
        for j in range(m):
            value = 1.0 if i == j else 0.0
            for k in range(m):
                if work.firm[i, k] != 0.0:
                    value += work.firm[i, k] * work.compliance[k, j]
            small[i, j] = value
    for k in range(m):
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
    """Out = q turned by ``scale`` x step; (1, w / 2) normalised equals exp(w) to second order."""
    half = 0.5 * scale
    for i in range(q.shape[0]):
        a, b, c = half * step[3 * i], half * step[3 * i + 1], half * step[3 * i + 2]
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        nw, nx = w - a * x - b * y - c * z, x + a * w + c * y - b * z
        ny, nz = y + b * w + a * z - c * x, z + c * w + b * x - a * y
        size = 1.0 / math.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = nw * size, nx * size, ny * size, nz * size


@compiled
def copy_turns(source: FloatArray, target: FloatArray) -> None:
    """Copy (k, 4) orientations; an assignment of slices would cost the compiler seconds for its error message."""
    for i in range(source.shape[0]):
        for k in range(4):
            target[i, k] = source[i, k]


@compiled
def longest_turn(step: FloatArray) -> float:
    """Largest length of the turns in ``step`` (3k,)."""
    longest = 0.0
    for r in range(0, step.shape[0], 3):
        longest = max(longest, step[r] ** 2 + step[r + 1] ** 2 + step[r + 2] ** 2)
    return math.sqrt(longest)


@compiled
def _twist_work(q: FloatArray, step: FloatArray, scale: float, moment: FloatArray) -> float:
    """Work of a dead moment along the last element's turn, whose axis stays where it is during one step."""
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
    """A step that makes the residual smaller, for what has no energy: slip, and a dead moment past its minimum."""
    scale = min(1.0, _MAX_TURN / longest_turn(work.step))
    for _ in range(6):
        turn(q, work.step, scale, work.trial)
        # `assemble` leaves ``work.step`` alone
        tried, m, loose = assemble(work.trial, rod, load, touch, work)
        if tried < (1.0 - 0.1 * scale) * residual:
            copy_turns(work.trial, q)
            return True, tried, m, loose
        scale *= 0.5
    return False, residual, 0, 0


@compiled
def relax(q: FloatArray, rod: Elastic, load: Load, touch: Touch, work: Work, tolerance: float) -> Outcome:
    """Move ``q`` (k, 4) in place to the nearest equilibrium; ``stable`` tells whether it is a minimum.

    Each step is Newton's where the Hessian is positive definite, else that of the shifted Hessian, cut so that no
    element turns by more than 0.4 rad, and halved until the energy falls. Slipping friction has no energy: there the
    residual must fall, and the iteration gives up early. A dead moment has none either, but along one step its work
    is a plain integral; ``stable`` is then that of the Hessian's symmetric part, enough but not necessary.
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
            return Outcome(iteration, True, negative == 0, residual / rod.small)
        if iteration == (12 if dry else _MAX_ITERATIONS):
            return Outcome(iteration, False, negative == 0, residual / rod.small)
        iteration += 1
        if dry or (turned and negative != 0):
            moved, residual, m, loose = _follow_residual(q, rod, load, touch, work, residual)
            if moved:
                energy = 0.0 if dry else energy_at(q, rod, load, touch, work.tangent)
                continue
            if dry:
                return Outcome(iteration, False, negative == 0, residual / rod.small)
            residual, m, loose = assemble(q, rod, load, touch, work)
            negative = newton_step(work, m, loose, 0.0)
        shift = 1e-3 * rod.small * (q.shape[0] - 1)
        while negative != 0:
            negative = newton_step(work, m, loose, shift)
            shift *= 4.0
        descent = 0.0
        for r in range(work.step.shape[0]):
            descent += work.gradient[r] * work.step[r]
        scale = min(1.0, _MAX_TURN / longest_turn(work.step))
        # Close to the minimum the gain drowns in rounding: let a Newton step pass there.
        slack = 1e-14 * (abs(energy) + rod.small)
        while True:
            turn(q, work.step, scale, work.trial)
            tried = energy_at(work.trial, rod, load, touch, work.tangent)
            gain = _twist_work(q, work.step, scale, load.moment) if turned else 0.0
            if tried - gain <= energy + 1e-4 * scale * descent + slack:
                break
            scale *= 0.5
            if scale < 1e-10:  # no descent left: what stands is as good as rounding allows
                return Outcome(iteration, False, False, residual / rod.small)
        energy = tried
        copy_turns(work.trial, q)
        residual, m, loose = assemble(q, rod, load, touch, work)
