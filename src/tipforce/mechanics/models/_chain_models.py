"""PlanarRod models whose state is angles alone: rigid links, particles and springs, arcs of constant curvature.

Unknowns are the angles q_1 .. q_m; q_0 = 0 is the clamp. Between q_(i-1) and q_i acts a spring of span a_i with the
moment EI (1 + (k / k_s)^2) (k - k_0), k = (q_i - q_(i-1)) / a_i. Either the shaft is straight links at the angles
q_i, which may stretch along themselves, or it is arcs that turn from q_(i-1) to q_i. The Hessian of the energy is
tridiagonal for both, and Newton's method finds the equilibrium.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit

from ...types import FloatArray
from ..planar import PlanarRod
from ._interface import CATHETER_7F_M, PolylineShape, RodModel, first_share, mean_curvature, stiffness_at

_MAX_ITERATIONS = 60
_MAX_TURN = 0.4
"""Largest change of an angle in one step, rad: the iteration then stays on its branch."""
_MAX_JUMP = 0.7
"""Largest change of an angle from one load to the next, rad; for a larger one, the load is raised in smaller steps."""
_TOLERANCE = 1e-11
"""Residual moment relative to the softest spring's moment for one radian."""


class Chain(NamedTuple):
    """A chain of m joints with links and arcs.

    Attributes:
        span_m: (m,) length of shaft of each joint.
        stiffness_nm2: (m,) EI.
        precurvature_per_m: (m,) pre-curvature.
        soft: 1 / k_s^2 of the stiffening law, in m^2.
        link_m: (m,) length of each link, 0 without a link.
        give_m_per_n: (m,) lengthening of each link per newton of pull along it.
        arc_m: (m,) length of each arc, 0 without an arc.
    """

    span_m: FloatArray
    stiffness_nm2: FloatArray
    precurvature_per_m: FloatArray
    soft: float
    link_m: FloatArray
    give_m_per_n: FloatArray
    arc_m: FloatArray


@njit(cache=True, error_model="numpy")
def _shrink(d: float) -> tuple[float, float, float]:
    """Returns the ratio of chord to length of an arc that turns by ``d``, and its first two derivatives."""
    if abs(d) < 0.1:
        d2 = d * d
        return (
            1.0 - d2 / 24.0 * (1.0 - d2 / 80.0 * (1.0 - d2 / 168.0)),
            -d / 12.0 * (1.0 - d2 / 40.0 * (1.0 - d2 / 112.0)),
            -1.0 / 12.0 + d2 / 160.0 * (1.0 - d2 * (5.0 / 336.0)),
        )
    x = 0.5 * d
    s = math.sin(x) / x
    slope = (math.cos(x) - s) / x
    return s, 0.5 * slope, 0.25 * (-s - 2.0 * slope / x)


@njit(cache=True, error_model="numpy")
def _energy(q: FloatArray, chain: Chain, fx: float, fy: float, moment: float) -> float:
    """Returns the potential energy in J of bending, stretch and tip load, at the angles ``q`` (n,) in rad.

    The base has the angle 0. ``fx`` and ``fy`` are the tip force in N, ``moment`` the tip moment in N m.
    """
    total, previous_angle = -moment * q[-1], 0.0
    for i in range(q.size):
        span_m, rest_curvature = chain.span_m[i], chain.precurvature_per_m[i]
        curvature = (q[i] - previous_angle) / span_m
        density = 0.5 * (curvature - rest_curvature) ** 2 + chain.soft * (
            curvature**4 / 4 - rest_curvature * curvature**3 / 3 + rest_curvature**4 / 12
        )
        total += span_m * chain.stiffness_nm2[i] * density
        pull = fx * math.cos(q[i]) + fy * math.sin(q[i])
        total -= (chain.link_m[i] + 0.5 * chain.give_m_per_n[i] * pull) * pull
        if chain.arc_m[i] > 0.0:
            middle = 0.5 * (q[i] + previous_angle)
            total -= (
                chain.arc_m[i] * _shrink(q[i] - previous_angle)[0] * (fx * math.cos(middle) + fy * math.sin(middle))
            )
        previous_angle = q[i]
    return total


@njit(cache=True, error_model="numpy")
def _assemble(q: FloatArray, chain: Chain, fx: float, fy: float, moment: float, work: FloatArray) -> float:
    """Computes gradient, diagonal and upper diagonal of the Hessian of `_energy` into the rows of ``work`` (4, m).

    Returns the largest component of the gradient in N m.
    """
    gradient, diagonal, upper = work[0], work[1], work[2]
    previous_angle = 0.0
    for i in range(q.size):
        span_m, ei, k0 = chain.span_m[i], chain.stiffness_nm2[i], chain.precurvature_per_m[i]
        k = (q[i] - previous_angle) / span_m
        stiffer = 1.0 + chain.soft * k * k
        joint_moment = ei * stiffer * (k - k0)
        joint_slope = ei * (stiffer + 2.0 * chain.soft * k * (k - k0)) / span_m
        c, s = math.cos(q[i]), math.sin(q[i])
        pull, push = fx * c + fy * s, fy * c - fx * s
        reach = chain.link_m[i] + chain.give_m_per_n[i] * pull
        gradient[i] = joint_moment - reach * push
        diagonal[i] = joint_slope + reach * pull - chain.give_m_per_n[i] * push * push
        # The same joint's part for the angle before it, and the coupling of both.
        left_gradient, left_diagonal, coupling = -joint_moment, joint_slope, -joint_slope
        if chain.arc_m[i] > 0.0:
            middle = 0.5 * (q[i] + previous_angle)
            c, s = math.cos(middle), math.sin(middle)
            along, across = chain.arc_m[i] * (fx * c + fy * s), chain.arc_m[i] * (fy * c - fx * s)
            short, short1, short2 = _shrink(q[i] - previous_angle)
            gradient[i] -= 0.5 * across * short + along * short1
            left_gradient -= 0.5 * across * short - along * short1
            diagonal[i] -= -0.25 * along * short + across * short1 + along * short2
            left_diagonal -= -0.25 * along * short - across * short1 + along * short2
            coupling += 0.25 * along * short + along * short2
        if i > 0:
            gradient[i - 1] += left_gradient
            diagonal[i - 1] += left_diagonal
            upper[i - 1] = coupling
        previous_angle = q[i]
    gradient[q.size - 1] -= moment
    return np.max(np.abs(gradient))


@njit(cache=True, error_model="numpy")
def _newton_step(work: FloatArray, shift: float, step: FloatArray) -> bool:
    """Solves (H + shift I) step = -gradient (tridiagonal) for ``work`` of `_assemble`; False if it is not definite."""
    gradient, diagonal, upper, pivot = work[0], work[1], work[2], work[3]
    n = step.size
    for i in range(n):
        pivot[i] = diagonal[i] + shift
        step[i] = -gradient[i]
        if i > 0:
            factor = upper[i - 1] / pivot[i - 1]
            pivot[i] -= factor * upper[i - 1]
            step[i] -= factor * step[i - 1]
        if not pivot[i] > 0.0:
            return False
    step[n - 1] /= pivot[n - 1]
    for i in range(n - 2, -1, -1):
        step[i] = (step[i] - upper[i] * step[i + 1]) / pivot[i]
    return True


@njit(cache=True, error_model="numpy")
def _relax(q: FloatArray, chain: Chain, fx: float, fy: float, moment: float, work: FloatArray) -> bool:
    """Moves the angles ``q`` (m,) in place to the nearest minimum of the energy; returns whether one was found.

    Newton's method; the Hessian is shifted until it is positive definite, and a step is halved until the energy falls.
    ``work`` (6, m): buffer.
    """
    step, trial = work[4], work[5]
    spring = np.min(chain.stiffness_nm2 / chain.span_m)
    energy = _energy(q, chain, fx, fy, moment)
    for _ in range(_MAX_ITERATIONS):
        residual = _assemble(q, chain, fx, fy, moment, work)
        definite = _newton_step(work, 0.0, step)
        if residual <= _TOLERANCE * spring:
            if definite:  # one more step removes the rest: the result is smooth in the load down to rounding
                q += step
            return True  # also where it is a saddle: a straight column above its buckling load stays straight
        shift = 1e-3 * spring
        while not definite:
            definite = _newton_step(work, shift, step)
            shift *= 4.0
        scale = min(1.0, _MAX_TURN / np.max(np.abs(step)))
        descent = np.dot(work[0], step)
        slack = 1e-14 * (abs(energy) + spring)  # close to the minimum the gain is smaller than rounding
        while True:
            trial[:] = q + scale * step
            trial_energy = _energy(trial, chain, fx, fy, moment)
            if trial_energy <= energy + 1e-4 * scale * descent + slack:
                break
            scale *= 0.5
            if scale < 1e-10:
                return False
        energy = trial_energy
        q[:] = trial
    return False


@njit(cache=True, error_model="numpy")
def _solve_chain(chain: Chain, fx: float, fy: float, moment: float, first_share: float, q: FloatArray) -> bool:
    """Raises the load from 0, so that ``q`` (m,) ends on the unloaded shape's branch; False: not converged.

    ``first_share``: share of the load in the first step; steps are halved where they fail or jump.
    """
    work, saved = np.empty((6, q.size)), np.empty(q.size)
    q[:] = np.cumsum(chain.span_m * chain.precurvature_per_m)
    share, step, converged = 0.0, first_share, True
    while share < 1.0:
        saved[:] = q
        target = min(1.0, share + step)
        converged = _relax(q, chain, target * fx, target * fy, target * moment, work)
        if (converged and np.max(np.abs(q - saved)) < _MAX_JUMP) or step < 1e-3:
            share = target
        else:
            q[:] = saved
            step *= 0.5
    return converged


def _solve_links(rod: PlanarRod, chain: Chain, clamped_m: float, load: tuple[float, float, float]) -> PolylineShape:
    """Returns the shape of straight links behind a first one of ``clamped_m`` that stays along x."""
    fx, fy, moment_nm = load
    angles = np.empty(chain.span_m.size)
    converged = _solve_chain(chain, fx, fy, moment_nm, first_share(rod, fx, fy, moment_nm), angles)
    steps_m = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    steps_m *= (chain.link_m + chain.give_m_per_n * (steps_m @ np.array([fx, fy])))[:, None]
    nodes = np.zeros((angles.size + 2, 2))
    arc = np.zeros(angles.size + 2)
    nodes[1:, 0] = arc[1:] = clamped_m
    nodes[2:] += np.cumsum(steps_m, axis=0)
    arc[2:] += np.cumsum(chain.link_m)
    return PolylineShape(arc, nodes, bool(converged))


@dataclass(frozen=True, slots=True, eq=False)
class RigidLinks(RodModel):
    """Multi-body model (thesis 2.3.2.1): rigid links and ``joints`` hinges with torsion springs, at rest.

    The finite segment method (Huston): the shaft is cut into equal pieces of length h, and each piece's flexibility
    is in one hinge at its middle, stiffness EI / h. The first half piece is clamped, the last one carries the
    electrode. Known failure: too stiff and angular with few joints; deflection under a small load is
    1 - 1 / (4 joints^2) of the true one.
    """

    rod: PlanarRod
    joints: int = 10
    _chain: Chain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Builds the chain: ``joints`` equal pieces with a hinge in the middle of each; links do not lengthen."""
        if self.joints < 1:
            raise ValueError(f"joints: expected at least 1, got {self.joints}")
        rod, n = self.rod, self.joints
        edges_m = np.linspace(0.0, rod.flexible_length_m, n + 1)
        piece_m = rod.flexible_length_m / n
        links_m = np.append(np.full(n - 1, piece_m), 0.5 * piece_m + rod.rigid_length_m)
        chain = Chain(
            span_m=np.full(n, piece_m),
            stiffness_nm2=stiffness_at(rod, 0.5 * (edges_m[1:] + edges_m[:-1])),
            precurvature_per_m=mean_curvature(rod, edges_m),
            soft=rod.stiffening_curvature_per_m**-2,
            link_m=links_m,
            give_m_per_n=np.zeros(n),
            arc_m=np.zeros(n),
        )
        object.__setattr__(self, "_chain", chain)

    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        return _solve_links(self.rod, self._chain, 0.5 * self._chain.span_m[0], (fx, fy, moment_nm))


@dataclass(frozen=True, slots=True, eq=False)
class MassSpring(RodModel):
    """Particles on a string (thesis 2.3.2.2), at rest.

    ``pieces`` + 1 particles along the shaft with stretch springs between neighbours and bending springs at each; the
    masses do not matter at rest. Stretch stiffness EA = 16 EI / d^2, that of a solid round section of ``diameter_m``.
    For given directions the lengths follow from the load, so only directions are unknowns. Known failure: the
    length is not kept, and the spring constants follow from no physical law ("not physically reliable").
    """

    rod: PlanarRod
    pieces: int = 20
    diameter_m: float = CATHETER_7F_M
    _chain: Chain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Builds the chain: a bending spring at each particle, and links that the pull along them lengthens."""
        if self.pieces < 1 or not self.diameter_m > 0:
            raise ValueError(f"a mass-spring chain needs a piece and a positive diameter, got {self}")
        rod, n = self.rod, self.pieces
        h = rod.flexible_length_m / n
        middles = np.concatenate([[0.0], (np.arange(n) + 0.5) * h, [rod.flexible_length_m]])
        particles = np.linspace(0.0, rod.flexible_length_m, n + 1)
        stretch = 16 * stiffness_at(rod, middles[1:-1]) / self.diameter_m**2
        chain = Chain(
            span_m=np.diff(middles),
            stiffness_nm2=stiffness_at(rod, particles),
            precurvature_per_m=mean_curvature(rod, middles),
            soft=rod.stiffening_curvature_per_m**-2,
            link_m=np.append(np.full(n, h), rod.rigid_length_m),
            give_m_per_n=np.append(h / stretch, 0.0),
            arc_m=np.zeros(n + 1),
        )
        object.__setattr__(self, "_chain", chain)

    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        return _solve_links(self.rod, self._chain, 0.0, (fx, fy, moment_nm))


_MIN_POINTS = 48
"""Least number of points of the centreline along the shaft."""


@dataclass(frozen=True, slots=True, eq=False)
class ConstantCurvature(RodModel):
    """The shaft as ``arcs`` equal arcs, each of one curvature, with the least energy: exact bending energy and load.

    One arc is the kinematics used to steer catheter robots. More arcs are the strain parametrisation of a
    Cosserat rod and converge to it, the differential-geometry model of Back et al. (thesis table 2), here in the plane
    and without stretch and shear. Known failure of one arc: a force cannot bend the base more than the tip, so the
    deflection under a small force is 1 - 1 / (4 arcs^2) = 3/4 of the true one. Exact for a pure moment.
    """

    rod: PlanarRod
    arcs: int = 1
    _chain: Chain = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Builds the chain: ``arcs`` equal arcs, and the rigid electrode as a link at the last one."""
        if self.arcs < 1:
            raise ValueError(f"arcs: expected at least 1, got {self.arcs}")
        rod, n = self.rod, self.arcs
        edges = np.linspace(0.0, rod.flexible_length_m, n + 1)
        links = np.zeros(n)
        links[-1] = rod.rigid_length_m
        chain = Chain(
            span_m=np.diff(edges),
            stiffness_nm2=stiffness_at(rod, 0.5 * (edges[1:] + edges[:-1])),
            precurvature_per_m=mean_curvature(rod, edges),
            soft=rod.stiffening_curvature_per_m**-2,
            link_m=links,
            give_m_per_n=np.zeros(n),
            arc_m=np.diff(edges),
        )
        object.__setattr__(self, "_chain", chain)

    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        """Solves the angle at the end of each arc, and returns points on the arcs, then the electrode's end."""
        rod, n, chain = self.rod, self.arcs, self._chain
        ends = np.empty(n)
        converged = _solve_chain(chain, fx, fy, moment_nm, first_share(rod, fx, fy, moment_nm), ends)
        # One chord for each of the equal pieces of the arcs: exact points on them.
        per_arc = -(-_MIN_POINTS // n)
        turn = np.diff(ends, prepend=0.0) / per_arc
        starts = np.append(0.0, ends[:-1])
        middles = (starts[:, None] + turn[:, None] * (np.arange(per_arc) + 0.5)).ravel()
        chords = np.repeat(chain.arc_m / per_arc * np.sinc(0.5 * turn / np.pi), per_arc)
        angles = np.append(middles, ends[-1])
        lengths = np.append(chords, rod.rigid_length_m)
        nodes = np.zeros((angles.size + 1, 2))
        np.cumsum(lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1), axis=0, out=nodes[1:])
        arc = np.append(np.linspace(0.0, rod.flexible_length_m, n * per_arc + 1), rod.length_m)
        return PolylineShape(arc, nodes, bool(converged))
