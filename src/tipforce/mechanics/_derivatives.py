"""How the centreline of an equilibrium moves with the load, the rod and its base."""

import numpy as np
from scipy.linalg import solve_banded

from ..types import FloatArray
from ._arc import arc_m, way_m
from ._free import Shape, carried_n
from ._newton import Load, elastic_of, hessian_bands
from ._sensitivity import Derivatives
from ._spatial_derivatives import spatial_derivatives
from ._spatial_free import SpatialShape

__all__ = ["derivatives"]


def derivatives(shape: Shape | SpatialShape, points: int | FloatArray) -> Derivatives:
    """Derivatives of ``shape.centreline_m(points)``, by the implicit function theorem: one banded solve.

    In equilibrium the gradient of the energy g(angles, p) is nothing: d angles / dp = -H^-1 dg/dp. Near a fold, and at
    the point of buckling, H is nearly singular and the derivatives grow without bound.

    Raises ValueError where the shape has not converged.

    >>> from tipforce.mechanics import Rod, bend
    >>> at_tip = derivatives(bend(Rod(0.05, 4.3e-4, segments=200), np.zeros(2)), np.array([0.05]))
    >>> (at_tip.force[0, 1, 1] / (0.05**3 / (3 * 4.3e-4))).round(4)  # the linear beam's L^3 / 3EI
    np.float64(1.0)
    """
    if not shape.converged:
        raise ValueError(f"a shape that has not converged has no derivatives (residual {shape.residual:.1e})")
    lengths = shape.rod.element_lengths_m
    arc = arc_m(lengths, points)
    way = way_m(lengths, arc)
    if isinstance(shape, SpatialShape):
        return spatial_derivatives(shape, arc, way)
    return _planar(shape, arc, way)


def _planar(shape: Shape, arc: FloatArray, way: FloatArray) -> Derivatives:
    rod, angles = shape.rod, shape.angles_rad
    elastic = elastic_of(rod, rod.rigid_length_m)
    fx, fy = shape.force_n.tolist()
    load = Load(fx, fy, shape.moment_nm, carried_n(rod, shape.distributed_n_per_m))
    diagonal, upper = hessian_bands(np.array(angles), elastic, load)
    n = angles.size
    bands = np.zeros((3, n))
    bands[0, 1:], bands[1], bands[2, :-1] = upper[:-1], diagonal, upper[:-1]

    cosine, sine = np.cos(angles), np.sin(angles)
    lengths = rod.element_lengths_m
    k = rod.curvatures_per_m(angles)
    stiffer = rod.stiffnesses_nm2 * (1.0 + (k / rod.stiffening_curvature_per_m) ** 2)
    pull = np.zeros((n, 6))  # -dg/dp for fx, fy, moment, pre-curvature, stiffness, turn of the clamp
    pull[:, 0], pull[:, 1] = -lengths * sine, lengths * cosine
    pull[-1, 2] = 1.0
    pull[:, 3] = _across_joints(stiffer)
    pull[:, 4] = -_across_joints(shape.moments_nm / rod.bending_stiffness_nm2)
    stiffening = 2.0 * k[0] * (k[0] - rod.precurvatures_per_m[0]) / rod.stiffening_curvature_per_m**2
    pull[0, 5] = (stiffer[0] + rod.stiffnesses_nm2[0] * stiffening) / (0.5 * lengths[0])
    turns = solve_banded((1, 1), bands, pull)

    moves = np.stack([-way @ (sine[:, None] * turns), way @ (cosine[:, None] * turns)], axis=1)
    base = np.concatenate([np.broadcast_to(np.eye(2), (arc.size, 2, 2)), moves[:, :, 5:]], axis=2)
    return Derivatives(
        arc_m=arc,
        centreline_m=way @ np.stack([cosine, sine], axis=1),
        tip_axis=np.array([cosine[-1], sine[-1]]),
        force=moves[:, :, :2],
        moment=moves[:, :, 2:3],
        precurvature=moves[:, :, 3:4],
        stiffness=moves[:, :, 4:5],
        base=base,
    )


def _across_joints(moment: FloatArray) -> FloatArray:
    """(n,) moments at the joints -> (n,): each element's, less that of the joint after it."""
    return moment - np.append(moment[1:], 0.0)
