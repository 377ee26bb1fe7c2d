"""Beams in the plane: linear finite elements (Gao et al.), and large deflection by shooting (Khoshnam et al.)."""

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from ...types import FloatArray, frozen
from ..planar import PlanarRod
from ._interface import (
    CATHETER_7F_M,
    PolylineShape,
    RodModel,
    curvature_at,
    first_share,
    mean_curvature,
    mean_stiffness,
    nodes_at,
    stiffness_at,
)


@dataclass(frozen=True, slots=True, eq=False)
class LinearBeam(RodModel):
    """Bernoulli-Euler frame elements, linear about the unloaded shape; stiffness = slope of the moment there.

    ``elements`` straight two-node elements with cubic deflection and a stretch stiffness EA = 16 EI / d^2, that of a
    solid round section of ``diameter_m``. Exact for small loads on a straight shaft. Known failures: a tip that is
    bent by 90 degrees grows longer instead of turning back (deflection alpha / 3: +35 % at alpha = 2), and an
    axial force on a straight shaft never bends it.
    """

    rod: PlanarRod
    elements: int = 20
    diameter_m: float = CATHETER_7F_M
    _rest: PolylineShape = field(init=False, repr=False)
    _compliance: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Computes the unloaded shape, and how far every point moves for unit loads on the tip.

        The compliance is (elements + 2, 2, 3): metres along x and y for 1 N along x, 1 N along y, and 1 N m about z.
        """
        if self.elements < 1 or not self.diameter_m > 0:
            raise ValueError(f"a linear beam needs an element and a positive diameter, got {self}")
        rod, n = self.rod, self.elements
        edges = np.linspace(0.0, rod.flexible_length_m, n + 1)
        nodes, angles = nodes_at(rod, edges)
        lever = rod.rigid_length_m * np.array([np.cos(angles[-1]), np.sin(angles[-1])])
        stiffer = 1 + (mean_curvature(rod, edges) / rod.stiffening_curvature_per_m) ** 2
        bending_nm2 = stiffness_at(rod, 0.5 * (edges[1:] + edges[:-1])) * stiffer
        stiffness = np.zeros((3 * n + 3, 3 * n + 3))
        for i in range(n):
            stiffness[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += _element(
                nodes[i + 1] - nodes[i], bending_nm2[i], self.diameter_m
            )
        # Loads at the tip: unit fx, fy and moment, carried to the last node by the rigid electrode.
        loads = np.zeros((3 * n, 3))
        loads[-3:] = [[1, 0, 0], [0, 1, 0], [-lever[1], lever[0], 1]]
        moved = np.linalg.solve(stiffness[3:, 3:], loads).reshape(n, 3, 3)  # x, y, angle of each node by each unit load
        turned = np.array([[-lever[1]], [lever[0]]]) * moved[-1, 2]  # the tip moves by the turn of the electrode, too
        compliance = np.concatenate([np.zeros((1, 2, 3)), moved[:, :2], (moved[-1, :2] + turned)[None]])
        rest = PolylineShape(np.append(edges, rod.length_m), np.vstack([nodes, nodes[-1] + lever]), True)
        object.__setattr__(self, "_rest", rest)
        object.__setattr__(self, "_compliance", frozen("compliance", compliance, (n + 2, 2, 3)))

    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        load = np.array([fx, fy, moment_nm])
        return PolylineShape(self._rest.arc_m, self._rest.nodes_m + self._compliance @ load, True)


def _element(chord: FloatArray, ei: float, diameter_m: float) -> FloatArray:
    """Returns the stiffness (6, 6) of a frame element along ``chord`` (2,) for x, y and angle of either end."""
    length = float(np.hypot(*chord))
    c, s = chord / length
    ea = 16 * ei / diameter_m**2
    axial, shear, couple = ea / length, 12 * ei / length**3, 6 * ei / length**2
    local = np.zeros((6, 6))
    local[np.ix_([0, 3], [0, 3])] = [[axial, -axial], [-axial, axial]]
    local[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = [
        [shear, couple, -shear, couple],
        [couple, 4 * ei / length, -couple, 2 * ei / length],
        [-shear, -couple, shear, -couple],
        [couple, 2 * ei / length, -couple, 4 * ei / length],
    ]
    turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return turn.T @ local @ turn


_MAX_ITERATIONS = 25
_TOLERANCE = 1e-11
"""Residual moment relative to EI / (length of the shaft)."""
_MAX_TURN = 0.5
"""Largest change of the tip's angle in one step of Newton's method, rad."""
_MAX_JUMP = 0.7
"""Largest change of the tip's angle from one load to the next, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class LargeDeflection(RodModel):
    """Quasi-static Bernoulli-Euler beam with large deflection from its initial bend (Khoshnam et al.; thesis 2.3.2.3).

    Along the shaft: angle' = k_0 + M / EI and M' = F_x sin(angle) - F_y cos(angle), clamped at the base, with the tip
    load's moment at its end. Khoshnam et al. measure one EI for each bend of the knob (4.3e-4 N m^2 slightly bent to
    9.2e-4 strongly bent) and use it for the whole shaft. Here it is the EI of the rod at its pre-curvature, the same
    all along. Known failure: the stiffness does not change with the curvature along the shaft, nor when the load
    bends the shaft further; with constant stiffness it is the elastica.

    Fourth-order Runge-Kutta with ``steps`` steps; the unknown moment at the base by Newton's method, its derivative
    carried along.
    """

    rod: PlanarRod
    steps: int = 40
    _curvature_per_m: FloatArray = field(init=False, repr=False)
    _stiffness_nm2: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ValueError(f"steps: expected at least 1, got {self.steps}")
        halves = np.linspace(0.0, self.rod.flexible_length_m, 2 * self.steps + 1)
        object.__setattr__(self, "_curvature_per_m", curvature_at(self.rod, halves))
        object.__setattr__(self, "_stiffness_nm2", mean_stiffness(self.rod))

    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        """Returns the shape under a tip force in N and moment in N m; `_solve` of this module finds the base moment."""
        rod = self.rod
        nodes = np.zeros((self.steps + 2, 2))
        converged = _solve(
            self._curvature_per_m, rod.flexible_length_m, rod.rigid_length_m, self._stiffness_nm2,
            (fx, fy, moment_nm), first_share(rod, fx, fy, moment_nm), nodes,
        )  # fmt: skip
        arc = np.append(np.linspace(0.0, rod.flexible_length_m, self.steps + 1), rod.length_m)
        return PolylineShape(arc, nodes, bool(converged))


@njit(cache=True, error_model="numpy")
def _shoot(
    curvature: FloatArray,
    length: float,
    lever: float,
    ei: float,
    load: tuple[float, float, float],
    at_base: float,
    nodes: FloatArray,
) -> tuple[float, float, float, float]:
    """Integrates the beam from base to tip by Runge-Kutta steps of order 4, for one guess of the base moment.

    The equations are angle' = curvature + m / ei and m' = fx sin(angle) - fy cos(angle). Their derivatives with respect
    to the base moment (``*_slope``) are integrated beside them, for Newton's method.

    Args:
        curvature: (2 steps + 1,) curvatures without load in 1/m, at the ends and the middle of each step.
        length: flexible length in m.
        lever: length of the rigid tip in m.
        ei: bending stiffness in N m^2.
        load: force x and y in N and moment in N m at the tip.
        at_base: guess of the moment at the base in N m.
        nodes: (steps + 2, 2) positions in m, written here; the last is the end of the rigid tip.

    Returns:
        The excess of the moment at the flexible end in N m, its slope, the angle there in rad, its slope.
    """
    fx, fy, moment = load
    steps = nodes.shape[0] - 2
    h = length / steps
    angle, m, angle_slope, m_slope, x, y = 0.0, at_base, 0.0, 1.0, 0.0, 0.0
    for i in range(steps):
        sum_angle = sum_m = sum_angle_slope = sum_m_slope = sum_x = sum_y = 0.0  # weighted sums of the four slopes
        d_angle = d_m = d_angle_slope = d_m_slope = 0.0
        for stage in range(4):
            ahead = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
            rest_curvature = curvature[2 * i + (0 if stage == 0 else (2 if stage == 3 else 1))]
            stage_angle, stage_m = angle + ahead * d_angle, m + ahead * d_m
            stage_angle_slope, stage_m_slope = angle_slope + ahead * d_angle_slope, m_slope + ahead * d_m_slope
            c, s = math.cos(stage_angle), math.sin(stage_angle)
            d_angle, d_m = rest_curvature + stage_m / ei, fx * s - fy * c
            d_angle_slope, d_m_slope = stage_m_slope / ei, (fx * c + fy * s) * stage_angle_slope
            sum_angle += weight * d_angle
            sum_m += weight * d_m
            sum_angle_slope += weight * d_angle_slope
            sum_m_slope += weight * d_m_slope
            sum_x += weight * c
            sum_y += weight * s
        angle += h * sum_angle
        m += h * sum_m
        angle_slope += h * sum_angle_slope
        m_slope += h * sum_m_slope
        x += h * sum_x
        y += h * sum_y
        nodes[i + 1, 0], nodes[i + 1, 1] = x, y
    c, s = math.cos(angle), math.sin(angle)
    nodes[steps + 1, 0], nodes[steps + 1, 1] = x + lever * c, y + lever * s
    miss = m - moment - lever * (c * fy - s * fx)
    return miss, m_slope + lever * (s * fy + c * fx) * angle_slope, angle, angle_slope


@njit(cache=True, error_model="numpy")
def _solve(
    curvature: FloatArray,
    length: float,
    lever: float,
    ei: float,
    whole: tuple[float, float, float],
    first_share: float,
    nodes: FloatArray,
) -> bool:
    """Solves the moment at the base while the load is raised from 0; returns whether it converged.

    A step whose iteration fails or whose tip jumps is halved, so that the shape stays on the unloaded branch. The
    arguments are those of `_shoot`, whose ``nodes`` remain; ``first_share``: share of the load in the first step.
    """
    at_base = share = last_angle = 0.0
    step = first_share
    _, _, last_angle, _ = _shoot(curvature, length, lever, ei, (0.0, 0.0, 0.0), 0.0, nodes)
    converged = True
    while share < 1.0:
        target = min(1.0, share + step)
        load = (target * whole[0], target * whole[1], target * whole[2])
        trial, tip_angle, converged = at_base, last_angle, False
        for _ in range(_MAX_ITERATIONS):
            miss, slope, tip_angle, angle_slope = _shoot(curvature, length, lever, ei, load, trial, nodes)
            if abs(miss) * length < _TOLERANCE * ei:
                converged = True
                break
            if not slope > 0.0:  # a conjugate point: on another branch, or not stable
                break
            change = -miss / slope
            trial += change * min(1.0, _MAX_TURN / max(abs(change * angle_slope), 1e-300))
        if (converged and abs(tip_angle - last_angle) < _MAX_JUMP) or step < 1e-3:
            share, at_base, last_angle = target, trial, tip_angle
        else:
            step *= 0.5
    return converged
