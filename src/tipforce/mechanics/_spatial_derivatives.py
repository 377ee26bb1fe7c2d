"""How the centreline of an equilibrium in space moves with the load, the rod and its base."""

import numpy as np

from ..types import FloatArray
from ._sensitivity import Derivatives
from ._spatial_assembly import add_pull, assemble
from ._spatial_free import SpatialShape
from ._spatial_newton import newton_step, solve_factorised
from ._spatial_parts import NO_TOUCH, Elastic, Load, elastic_of, line_of, make_work

__all__ = ["spatial_derivatives"]


def spatial_derivatives(shape: SpatialShape, arc_m: FloatArray, way_m: FloatArray) -> Derivatives:
    """As `derivatives`; ``way_m`` (points, segments + 1): how far each element is walked to the places ``arc_m``."""
    rod, q = shape.rod, np.array(shape.quaternions)
    elastic, work = elastic_of(rod, rod.rigid_length_m), make_work(rod.segments + 1, 0)
    load = Load(np.array(shape.force_n), np.array(shape.moment_nm), line_of(rod, shape.distributed_n_per_m))
    none = Load(np.zeros(3), np.zeros(3), np.zeros_like(load.line))
    sides = np.zeros((14, 3 * len(q)))  # -dg/dp: force, moment, pre-curvature (3 each), EI, GJ, turn of the clamp (3)

    def gradient(changed: Elastic) -> FloatArray:
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
        add_pull(q, elastic, Load(back[0], back[1], back[2]), sides[11 + axis])
    sides[9] = (here - gradient(elastic._replace(bend=2 * elastic.bend))) / rod.bending_stiffness_nm2
    sides[10] = (here - gradient(elastic._replace(twist=2 * elastic.twist))) / rod.gj_nm2
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
