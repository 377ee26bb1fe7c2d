"""How the centreline of an equilibrium moves with the load, the rod and its base, in the plane and in space."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from ..types import FloatArray
from ._arc import arc_m, way_m
from .planar import Shape
from .planar._newton import Load, elastic_of, hessian_bands
from .planar._statics import carried_n
from .spatial import SpatialShape
from .spatial._energy import add_pull, assemble
from .spatial._newton import newton_step, solve_factorised
from .spatial._state import NO_TOUCH, line_of, make_work
from .spatial._state import Elastic as SpatialElastic
from .spatial._state import Load as SpatialLoad
from .spatial._state import elastic_of as spatial_elastic_of


@dataclass(frozen=True, slots=True, eq=False)
class Derivatives:
    """First derivatives of a centreline, (points, D, parameters) each; D = 2 in the plane, 3 in space.

    ``force``: m/N, D of them. ``moment``: m/(N m), at the tip; in space about x, y and z. ``precurvature``: m per 1/m,
    the same all along the shaft; in space of the twist and about y and z of the material frame. ``stiffness``: m per
    N m^2 of the bending stiffness, in space of the torsional one too, their profile kept. ``base``: of the clamp's
    place (D, m/m) and of its rotation (m/rad, in space about x, y and z); the loads keep their directions meanwhile.

    ``arc_m`` (points,), ``centreline_m`` (points, D) and ``tip_axis`` (D,), a unit vector: where they hold.
    """

    arc_m: FloatArray
    centreline_m: FloatArray
    tip_axis: FloatArray
    force: FloatArray
    moment: FloatArray
    precurvature: FloatArray
    stiffness: FloatArray
    base: FloatArray


def derivatives(shape: Shape | SpatialShape, points: int | FloatArray) -> Derivatives:
    """Derivatives of ``shape.centreline_m(points)``, by the implicit function theorem: one banded solve.

    In equilibrium the gradient of the energy g(angles, p) is nothing: d angles / dp = -H^-1 dg/dp. Near a fold, and at
    the point of buckling, H is nearly singular and the derivatives grow without bound.

    Raises ValueError where the shape has not converged.

    >>> from tipforce.mechanics import Rod, solve_static
    >>> at_tip = derivatives(solve_static(Rod(0.05, 4.3e-4, segments=200), np.zeros(2)), np.array([0.05]))
    >>> (at_tip.force[0, 1, 1] / (0.05**3 / (3 * 4.3e-4))).round(4)  # the linear beam's L^3 / 3EI
    np.float64(1.0)
    """
    if not shape.converged:
        raise ValueError(f"a shape that has not converged has no derivatives (residual {shape.residual:.1e})")
    lengths = shape.rod.element_lengths_m
    arc = arc_m(lengths, points)
    way = way_m(lengths, arc)
    if isinstance(shape, SpatialShape):
        return _spatial(shape, arc, way)
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


def _spatial(shape: SpatialShape, arc_m: FloatArray, way_m: FloatArray) -> Derivatives:
    """``way_m`` (points, segments + 1): how far each element is walked to the places ``arc_m``."""
    rod, q = shape.rod, np.array(shape.quaternions)
    elastic, work = spatial_elastic_of(rod, rod.rigid_length_m), make_work(rod.segments + 1, 0)
    load = SpatialLoad(np.array(shape.force_n), np.array(shape.moment_nm), line_of(rod, shape.distributed_n_per_m))
    none = SpatialLoad(np.zeros(3), np.zeros(3), np.zeros_like(load.line))
    sides = np.zeros((14, 3 * len(q)))  # -dg/dp: force, moment, pre-curvature (3 each), EI, GJ, turn of the clamp (3)

    def gradient(changed: SpatialElastic) -> FloatArray:
        assemble(q, changed, load, NO_TOUCH, work)
        return work.gradient.copy()

    here = gradient(elastic)
    for axis, unit in enumerate(np.eye(3)):
        add_pull(q, elastic, none._replace(force=unit), sides[axis])
        add_pull(q, elastic, none._replace(moment=unit), sides[3 + axis])
        # The gradient is linear in the pre-curvature and in the stiffnesses: a difference is the derivative.
        sides[6 + axis] = here - gradient(elastic._replace(rest=elastic.rest + unit))
        # Turning the clamp is turning all, and the loads back.
        back = [np.cross(part, unit) for part in load]
        add_pull(q, elastic, SpatialLoad(back[0], back[1], back[2]), sides[11 + axis])
    sides[9] = (here - gradient(elastic._replace(ei=2 * elastic.ei))) / rod.bending_stiffness_nm2
    sides[10] = (here - gradient(elastic._replace(gj=2 * elastic.gj))) / rod.gj_nm2
    assemble(q, elastic, load, NO_TOUCH, work)
    newton_step(work, 0, 0, 0.0)
    for side in sides:
        solve_factorised(work, 0, side)

    frames = shape.frames
    turns = sides.reshape(14, len(q), 3)
    # An element's direction turns by w x (1, 0, 0) in its own frame.
    swings = frames[:, :, 1] * turns[:, :, 2:] - frames[:, :, 2] * turns[:, :, 1:2]
    moves = np.moveaxis(way_m @ swings, 0, -1)
    line = way_m @ frames[:, :, 0]
    turned = moves[:, :, 11:] + np.stack([np.cross(unit, line) for unit in np.eye(3)], axis=-1)
    return Derivatives(
        arc_m=arc_m,
        centreline_m=line,
        tip_axis=frames[-1, :, 0],
        force=moves[:, :, :3],
        moment=moves[:, :, 3:6],
        precurvature=moves[:, :, 6:9],
        stiffness=moves[:, :, 9:11],
        base=np.concatenate([np.broadcast_to(np.eye(3), (arc_m.size, 3, 3)), turned], axis=2),
    )
