"""The common interface of all rod models."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ...types import FloatArray
from ..planar import PlanarRod


@dataclass(frozen=True, slots=True, eq=False)
class PolylineShape:
    """The bent catheter of a model, base frame: points, straight in between.

    Attributes:
        arc_m: (k,) arc lengths of the points along the unloaded catheter.
        nodes_m: (k, 2) positions of the points.
        converged: False: no equilibrium was found, and the values must not be used.
    """

    arc_m: FloatArray
    nodes_m: FloatArray
    converged: bool

    @property
    def tip_m(self) -> FloatArray:
        """Position (2,) of the electrode's end, base frame."""
        return self.nodes_m[-1]

    def centreline_m(self, points: int) -> FloatArray:
        """Returns the centreline (points, 2), base to tip, uniform in the arc length of the unloaded catheter."""
        wanted = np.linspace(0.0, self.arc_m[-1], points)
        line = np.empty((points, 2))
        for axis in range(2):
            line[:, axis] = np.interp(wanted, self.arc_m, self.nodes_m[:, axis])
        return line


class RodModel(ABC):
    """A model of the planar catheter, clamped at the base, loaded at its tip."""

    __slots__ = ()

    def solve_static(self, force_n: FloatArray, moment_nm: float = 0.0) -> PolylineShape:
        """Returns the shape under a load on the tip; small changes of the load give small changes of the shape.

        Args:
            force_n: (2,) force on the tip, base frame.
            moment_nm: moment about z.

        Returns:
            The shape.
        """
        return self._solve(float(force_n[0]), float(force_n[1]), float(moment_nm))

    @abstractmethod
    def _solve(self, fx: float, fy: float, moment_nm: float) -> PolylineShape:
        """Returns the shape under the force (fx, fy) in N and the moment in N m."""


CATHETER_7F_M = 2.33e-3
"""Outer diameter of a 7F catheter."""


def curvature_at(rod: PlanarRod, arc_m: FloatArray) -> FloatArray:
    """Returns the pre-curvature along the shaft, linear between the rod's joints.

    Args:
        rod: the rod.
        arc_m: (k,) arc lengths from the base.

    Returns:
        (k,) curvatures in 1/m.
    """
    joints = np.linspace(0.0, rod.flexible_length_m, rod.segments + 1)
    return np.interp(arc_m, joints, rod.precurvatures_per_m)


def _angle_at(rod: PlanarRod, arc_m: FloatArray) -> FloatArray:
    """Returns the tangent angle of the unloaded shaft at ``arc_m`` (k,), the exact integral of `curvature_at`."""
    joints = np.linspace(0.0, rod.flexible_length_m, rod.segments + 1)
    curvature = curvature_at(rod, joints)
    at_joints = np.append(0.0, np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(joints)))
    left = np.clip(np.searchsorted(joints, arc_m, side="right") - 1, 0, rod.segments - 1)
    return at_joints[left] + 0.5 * (curvature[left] + curvature_at(rod, arc_m)) * (arc_m - joints[left])


def mean_curvature(rod: PlanarRod, edges_m: FloatArray) -> FloatArray:
    """Returns the mean pre-curvature of each piece of the shaft.

    Args:
        rod: the rod.
        edges_m: (k + 1,) arc lengths of the pieces' ends.

    Returns:
        (k,) curvatures in 1/m.
    """
    return np.diff(_angle_at(rod, edges_m)) / np.diff(edges_m)


def stiffness_at(rod: PlanarRod, arc_m: FloatArray) -> FloatArray:
    """Returns EI for small curvature along the shaft, linear between the rod's joints.

    Args:
        rod: the rod.
        arc_m: (k,) arc lengths from the base.

    Returns:
        (k,) bending stiffnesses in N m^2.
    """
    joints = np.linspace(0.0, rod.flexible_length_m, rod.segments + 1)
    return np.interp(arc_m, joints, rod.stiffnesses_nm2)


def mean_stiffness(rod: PlanarRod) -> float:
    """Returns one EI for the whole shaft: that at the pre-curvature, weighted by compliance; for models with one EI.

    EI is the slope of the moment at the pre-curvature. The weights are those with which a piece's compliance moves the
    tip.
    """
    edges = np.linspace(0.0, rod.flexible_length_m, 4 * rod.segments + 1)
    arc = 0.5 * (edges[1:] + edges[:-1])
    stiffnesses = stiffness_at(rod, arc) * (1 + (curvature_at(rod, arc) / rod.stiffening_curvature_per_m) ** 2)
    weight = (rod.length_m - arc) ** 2
    return float(weight.sum() / (weight / stiffnesses).sum())


def nodes_at(rod: PlanarRod, arc_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns positions and tangent angles of the unloaded shaft.

    Args:
        rod: the rod.
        arc_m: (k,) arc lengths, rising from 0.

    Returns:
        (k, 2) positions in metres and (k,) angles in rad, base frame.
    """
    # Gauss-Legendre quadrature of the tangent over each piece.
    gauss_nodes, weights = np.polynomial.legendre.leggauss(5)
    step = np.diff(arc_m)
    inside = arc_m[:-1, None] + 0.5 * step[:, None] * (1 + gauss_nodes)
    angle = _angle_at(rod, inside.ravel()).reshape(inside.shape)
    steps_m = 0.5 * step[:, None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], axis=1)
    return np.vstack([np.zeros((1, 2)), np.cumsum(steps_m, axis=0)]), _angle_at(rod, arc_m)


def first_share(rod: PlanarRod, fx: float, fy: float, moment_nm: float) -> float:
    """Returns the share of the load that bends the rod by a radian or less.

    Args:
        rod: the rod.
        fx: force along x in N.
        fy: force along y in N.
        moment_nm: moment about z.

    Returns:
        The share, 0 to 1.
    """
    bend_rad = (math.hypot(fx, fy) * rod.length_m**2 + abs(moment_nm) * rod.length_m) / rod.bending_stiffness_nm2
    return 1.0 / max(1.0, math.ceil(bend_rad))
