"""The unloaded rod at any place along its shaft."""

import numpy as np

from ...types import FloatArray
from .._rod import Rod

__all__ = ["CATHETER_7F_M", "curvature_at", "mean_curvature", "mean_stiffness", "nodes_at", "stiffness_at"]

CATHETER_7F_M = 2.33e-3
"""Outer diameter of a 7F catheter."""


def curvature_at(rod: Rod, arc_m: FloatArray) -> FloatArray:
    """Pre-curvature at ``arc_m`` (k,) along the shaft, linear between the rod's joints."""
    joints = np.linspace(0.0, rod.flexible_length_m, rod.segments + 1)
    return np.interp(arc_m, joints, rod.precurvatures_per_m)


def _angle_at(rod: Rod, arc_m: FloatArray) -> FloatArray:
    """Tangent angle of the unloaded shaft at ``arc_m`` (k,), the exact integral of `curvature_at`."""
    joints = np.linspace(0.0, rod.flexible_length_m, rod.segments + 1)
    curvature = curvature_at(rod, joints)
    at_joints = np.append(0.0, np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(joints)))
    left = np.clip(np.searchsorted(joints, arc_m, side="right") - 1, 0, rod.segments - 1)
    return at_joints[left] + 0.5 * (curvature[left] + curvature_at(rod, arc_m)) * (arc_m - joints[left])


def mean_curvature(rod: Rod, edges_m: FloatArray) -> FloatArray:
    """Mean pre-curvature of each piece of the shaft between ``edges_m`` (k + 1,)."""
    return np.diff(_angle_at(rod, edges_m)) / np.diff(edges_m)


def stiffness_at(rod: Rod, arc_m: FloatArray) -> FloatArray:
    """EI for small curvature at ``arc_m`` (k,) along the shaft, linear between the rod's joints."""
    joints = np.linspace(0.0, rod.flexible_length_m, rod.segments + 1)
    return np.interp(arc_m, joints, rod.stiffnesses_nm2)


def mean_stiffness(rod: Rod) -> float:
    """One EI for the whole shaft, for models that know no other: as the rest shape has it, weighed by compliance.

    The slope of the moment at the pre-curvature; weights are those with which a piece's compliance moves the tip.
    """
    edges = np.linspace(0.0, rod.flexible_length_m, 4 * rod.segments + 1)
    arc = 0.5 * (edges[1:] + edges[:-1])
    slope = stiffness_at(rod, arc) * (1 + (curvature_at(rod, arc) / rod.stiffening_curvature_per_m) ** 2)
    weight = (rod.length_m - arc) ** 2
    return float(weight.sum() / (weight / slope).sum())


def nodes_at(rod: Rod, arc_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (k, 2) and tangent angles (k,) of the unloaded shaft at ``arc_m`` (k,), which begins with 0."""
    nodes, weights = np.polynomial.legendre.leggauss(5)
    step = np.diff(arc_m)
    inside = arc_m[:-1, None] + 0.5 * step[:, None] * (1 + nodes)
    angle = _angle_at(rod, inside.ravel()).reshape(inside.shape)
    ways = 0.5 * step[:, None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], axis=1)
    return np.vstack([np.zeros((1, 2)), np.cumsum(ways, axis=0)]), _angle_at(rod, arc_m)
