"""A plain solver for the planar rod under a dead load: dense Newton steps on the energy, the load raised in steps.

It shares nothing but the rod's description with the solvers of the program, which are held against it. It is itself
held against the exact elastica in tests/mechanics/test_elastica.py.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from tipforce.mechanics import PlanarRod


@dataclass(frozen=True)
class PlanarShape:
    """An equilibrium: ``angles_rad`` (segments + 1,) are those of the segments and of the electrode."""

    rod: PlanarRod
    angles_rad: np.ndarray
    converged: bool

    @property
    def tip_m(self) -> np.ndarray:
        return self.centreline_m(2)[-1]

    @property
    def tip_angle_rad(self) -> float:
        return float(self.angles_rad[-1])

    def centreline_m(self, points: int | np.ndarray) -> np.ndarray:
        """(points, 2), base to tip; ``points``: how many, uniform in arc length, or their arc lengths in m."""
        lengths = _lengths(self.rod)
        arc = np.linspace(0.0, lengths.sum(), points) if isinstance(points, int) else points
        covered = np.clip(arc[:, None] - (np.cumsum(lengths) - lengths), 0.0, lengths)
        return covered @ np.column_stack([np.cos(self.angles_rad), np.sin(self.angles_rad)])


def solve_static(rod: PlanarRod, force_n: np.ndarray, moment_nm: float = 0.0) -> PlanarShape:
    """Shape of ``rod`` under ``force_n`` (2,) on its tip, base frame, and ``moment_nm`` about z."""
    load = np.array([*force_n, moment_nm])
    size = np.hypot(*load[:2]) * rod.length_m**2 + abs(moment_nm) * rod.length_m
    steps = max(1, math.ceil(3.0 * size / rod.bending_stiffness_nm2))
    angles, converged = np.cumsum(rod.precurvatures_per_m * _spans(rod)), True
    for share in np.arange(1, steps + 1) / steps:
        angles, converged = _balance(rod, share * load, angles)
    return PlanarShape(rod, angles, converged)


def _lengths(rod: PlanarRod) -> np.ndarray:
    return np.append(np.full(rod.segments, rod.flexible_length_m / rod.segments), rod.rigid_length_m)


def _spans(rod: PlanarRod) -> np.ndarray:
    """Length of shaft that belongs to each joint."""
    spans = np.full(rod.segments + 1, rod.flexible_length_m / rod.segments)
    spans[[0, -1]] /= 2
    return spans


def _derivatives(rod: PlanarRod, load: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (n,) and Hessian (n, n) of the energy by the angles."""
    spans, rest, soft = _spans(rod), rod.precurvatures_per_m, rod.stiffening_curvature_per_m**-2
    bend = (np.eye(angles.size) - np.eye(angles.size, k=-1)) / spans[:, None]  # curvatures = bend @ angles
    k = bend @ angles
    moment = rod.stiffnesses_nm2 * (1 + soft * k * k) * (k - rest)
    slope = rod.stiffnesses_nm2 * (1 + soft * k * k + 2 * soft * k * (k - rest))
    x, y = _lengths(rod) * np.array([np.cos(angles), np.sin(angles)])
    gradient = bend.T @ (spans * moment) + load[0] * y - load[1] * x
    gradient[-1] -= load[2]
    return gradient, bend.T @ ((spans * slope)[:, None] * bend) + np.diag(load[0] * x + load[1] * y)


def _balance(rod: PlanarRod, load: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, bool]:
    """The equilibrium next to ``angles``, and whether it is one: stable, and balanced to rounding."""
    scale = rod.bending_stiffness_nm2 / rod.flexible_length_m
    for _ in range(200):
        gradient, hessian = _derivatives(rod, load, angles)
        shift, factor = 0.0, None
        while factor is None:
            try:
                factor = cho_factor(hessian + shift * np.eye(angles.size))
            except LinAlgError:  # not a minimum: downhill, along the softest direction
                shift = max(1e-6 * np.abs(np.diag(hessian)).max(), 4.0 * shift)
        if np.abs(gradient).max() <= 1e-11 * scale:
            return angles, shift == 0.0
        step = cho_solve(factor, -gradient)
        angles = angles + step * min(1.0, 0.3 / np.abs(step).max())
    return angles, False
