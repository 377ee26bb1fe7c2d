"""Shapes of the rod in space for many sets of its parameters, with their derivatives.

At an equilibrium the gradient of the energy vanishes. Its derivative by a parameter, solved with the Hessian of
Newton's last step, gives the turns of all elements by that parameter.
"""

import numpy as np

from ...types import BoolArray, FloatArray, IntArray
from ._compile import compiled
from ._energy import add_pull, assemble
from ._newton import copy_turns, relax, solve
from ._rod import SpatialRod
from ._state import NO_TOUCH, Elastic, Load, Touch, Work, elastic_of, make_work

PARAMETERS = (
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "curvature_y_per_m",
    "curvature_z_per_m",
    "stiffness",
    "proximal_stiffness",
    "length",
    "stiffening_m2",
)
"""Parameters of a shape: force on the tip, uniform curvature without load, relative changes of the bending stiffness,
of that of the third next to the clamp, and of the flexible length, and 1 / (stiffening curvature)^2."""
_COUNT = len(PARAMETERS)
_FORCE, _CURVATURE = 3, 3
_STIFFNESS, _PROXIMAL, _LENGTH, _STIFFENING = 5, 6, 7, 8
_TOLERANCE = 1e-8
"""Residual moment relative to EI / (length of the shaft): the nodes are then exact to a nanometre."""
_DIFFERENCES = (1e-3, 1e-3, 0.0, 1e-5, 1e-5, 1e-8)
"""Steps of the differences by the parameters behind the force, in their units: the gradient is nearly linear. The
stiffness has none: the elastic moments are proportional to it."""
_MOST_BEND_RAD = 0.5
"""Largest angle of a joint of an unloaded rod."""


@compiled
def _fill_elastic(parameters: FloatArray, nominal: Elastic, out: Elastic) -> Elastic:
    """Computes the values of a rod.

    Args:
        parameters: see `PARAMETERS`.
        nominal: values of the nominal rod.
        out: arrays that are written; ``memory`` is left as it is.

    Returns:
        The values; their arrays are those of ``out``.
    """
    count = nominal.span.size
    longer, stiffer = 1.0 + parameters[_LENGTH], 1.0 + parameters[_STIFFNESS]
    for i in range(count):
        factor = stiffer
        if 3 * i < count - 1:  # the third of the segments next to the clamp
            factor *= 1.0 + parameters[_PROXIMAL]
        out.span[i] = longer * nominal.span[i]
        out.ei[i] = factor * nominal.ei[i]
        out.gj[i] = factor * nominal.gj[i]
        out.rest[i, 0] = nominal.rest[i, 0]
        out.rest[i, 1] = nominal.rest[i, 1] + parameters[_CURVATURE]
        out.rest[i, 2] = nominal.rest[i, 2] + parameters[_CURVATURE + 1]
        out.reach[i] = longer * nominal.reach[i] if i < count - 1 else nominal.reach[i]
    return Elastic(
        out.span, out.ei, out.gj, out.rest, parameters[_STIFFENING], out.reach, out.memory, out.maxwell, out.small
    )


@compiled
def _add_gradient_slopes(
    q: FloatArray,
    parameters: FloatArray,
    nominal: Elastic,
    rod: Elastic,
    load: Load,
    touch: Touch,
    work: Work,
    spare: Elastic,
    moved: FloatArray,
    rest: FloatArray,
    slopes: FloatArray,
) -> None:
    """Computes minus the derivatives (9, 3k) of the energy's gradient by each parameter into ``slopes``.

    They are exact for the force and the stiffness, and differences for the others. ``rod``: the rod with
    ``parameters``; ``spare``: arrays for another one; ``moved`` (9,), ``rest`` (3k,): buffers. ``work.gradient`` and
    ``work.hessian`` are overwritten.
    """
    size = slopes.shape[1]
    unit = Load(np.zeros(3), np.zeros(3), load.line)
    for k in range(_FORCE):
        for r in range(size):
            slopes[k, r] = 0.0
        for j in range(3):
            unit.force[j] = 1.0 if j == k else 0.0
        add_pull(q, rod, unit, slopes[k])
    for r in range(size):  # at the equilibrium the elastic moments are those of the force
        pull = 0.0
        for k in range(_FORCE):
            pull += load.force[k] * slopes[k, r]
        slopes[_STIFFNESS, r] = -pull / (1.0 + parameters[_STIFFNESS])
        rest[r] = work.gradient[r]
    for k in range(_FORCE, _COUNT):
        if k == _STIFFNESS:
            continue
        step = _DIFFERENCES[k - _FORCE]
        for j in range(_COUNT):
            moved[j] = parameters[j]
        moved[k] += step
        assemble(q, _fill_elastic(moved, nominal, spare), load, touch, work)
        for r in range(size):
            slopes[k, r] = (rest[r] - work.gradient[r]) / step


@compiled
def _nodes(q: FloatArray, reach: FloatArray, longer: float, rigid_m: float, nodes: FloatArray) -> None:
    """Computes ``nodes`` (k + 1, 3) in m from the orientations ``q`` (k, 4): clamp, ends of the segments, tip.

    ``reach`` (k,): lengths of the nominal elements, ``longer`` times which are the true ones; ``rigid_m``: electrode.
    """
    last = q.shape[0] - 1
    for axis in range(3):
        nodes[0, axis] = 0.0
    for i in range(last + 1):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        size = longer * reach[i] if i < last else rigid_m
        nodes[i + 1, 0] = nodes[i, 0] + size * (1.0 - 2.0 * (y * y + z * z))
        nodes[i + 1, 1] = nodes[i, 1] + size * 2.0 * (x * y + w * z)
        nodes[i + 1, 2] = nodes[i, 2] + size * 2.0 * (x * z - w * y)


@compiled
def _add_node_slopes(
    q: FloatArray, reach: FloatArray, longer: float, rigid_m: float, turns: FloatArray, slopes: FloatArray
) -> None:
    """Computes ``slopes`` (k + 1, 3, 9) of the nodes by the parameters from ``turns`` (9, 3k), those of the elements.

    An element of length l that turns by w, in its own frame, moves its end by l w x (1, 0, 0). See `_nodes`.
    """
    last = q.shape[0] - 1
    for k in range(_COUNT):
        for axis in range(3):
            slopes[0, axis, k] = 0.0
        for i in range(last + 1):
            w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            size = longer * reach[i] if i < last else rigid_m
            along_y, along_z = size * turns[k, 3 * i + 2], -size * turns[k, 3 * i + 1]
            dx = along_y * 2.0 * (x * y - w * z) + along_z * 2.0 * (x * z + w * y)
            dy = along_y * (1.0 - 2.0 * (x * x + z * z)) + along_z * 2.0 * (y * z - w * x)
            dz = along_y * 2.0 * (y * z + w * x) + along_z * (1.0 - 2.0 * (x * x + y * y))
            if k == _LENGTH and i < last:
                dx += reach[i] * (1.0 - 2.0 * (y * y + z * z))
                dy += reach[i] * 2.0 * (x * y + w * z)
                dz += reach[i] * 2.0 * (x * z - w * y)
            slopes[i + 1, 0, k] = slopes[i, 0, k] + dx
            slopes[i + 1, 1, k] = slopes[i, 1, k] + dy
            slopes[i + 1, 2, k] = slopes[i, 2, k] + dz


@compiled
def _solve_shapes(
    parameters: FloatArray,
    parents: IntArray,
    quaternions: FloatArray,
    nominal: Elastic,
    changed: Elastic,
    spare: Elastic,
    touch: Touch,
    rigid_m: float,
    work: Work,
    nodes: FloatArray,
    slopes: FloatArray,
    stable: BoolArray,
) -> None:
    """Solves all shapes and their derivatives; for most arguments and the results see `SpatialShapes.solve`.

    ``nominal``: values of the nominal rod; ``changed``, ``spare``: arrays for the values of other rods; ``touch``: no
    wall; ``rigid_m``: length of the electrode; ``work``: buffers of Newton's method.
    """
    load = Load(np.zeros(3), np.zeros(3), np.zeros((nominal.span.size, 3)))
    moved, rest = np.zeros(_COUNT), np.zeros(3 * nominal.span.size)
    turns = np.zeros((_COUNT, 3 * nominal.span.size))
    for p in range(parameters.shape[0]):
        own, q = parameters[p], quaternions[p]
        if parents[p] >= 0:
            copy_turns(quaternions[parents[p]], q)
        for j in range(3):
            load.force[j] = own[j]
        rod = _fill_elastic(own, nominal, changed)
        out = relax(q, rod, load, touch, work, _TOLERANCE)
        stable[p] = out.converged and out.stable
        longer = 1.0 + own[_LENGTH]
        _nodes(q, nominal.reach, longer, rigid_m, nodes[p])
        if not stable[p]:
            continue
        _add_gradient_slopes(q, own, nominal, rod, load, touch, work, spare, moved, rest, turns)
        for k in range(_COUNT):
            solve(work.band, work.tail, turns[k])
        _add_node_slopes(q, nominal.reach, longer, rigid_m, turns, slopes[p])


class SpatialShapes:
    """Shapes of one rod under forces at its tip, for many sets of `PARAMETERS`.

    Args:
        rod: the nominal rod; its stiffening counts no more, `PARAMETERS` has its own.
        lever_m: distance of the loaded point beyond the end of the shaft: the middle of the tip's dome.
    """

    def __init__(self, rod: SpatialRod, lever_m: float) -> None:
        self.rod = rod
        self._nominal = elastic_of(rod, lever_m)
        # buffers: the rod with the parameters of one shape, and with parameters changed a little for derivatives
        self._changed, self._spare = elastic_of(rod, lever_m), elastic_of(rod, lever_m)
        self._work = make_work(rod.segments + 1, 0)

    def unloaded(self, count: int) -> FloatArray:
        """Returns orientations (count, segments + 1, 4) of the nominal rod without load."""
        return np.tile(self.rod.unloaded_quaternions, (count, 1, 1))

    def is_possible(self, parameters: FloatArray) -> BoolArray:
        """Returns whether a rod has such parameters.

        Args:
            parameters: (count, 9) see `PARAMETERS`.

        Returns:
            (count,) False where a length or stiffness is not positive, or a curvature is beyond the stiffening law.
        """
        # Lengths and stiffnesses above 10 % of the nominal ones; the limit 3: see `SpatialRod.check_stiffening`.
        curvature = np.hypot(parameters[:, _CURVATURE], parameters[:, _CURVATURE + 1])
        joint_m = self.rod.flexible_length_m / self.rod.segments
        possible = (parameters[:, _STIFFNESS : _LENGTH + 1] > -0.9).all(axis=1) & (curvature * joint_m < _MOST_BEND_RAD)
        stiffening = parameters[:, _STIFFENING]
        return possible & np.isfinite(parameters).all(axis=1) & (stiffening >= 0.0) & (curvature**2 * stiffening < 3.0)

    def solve(
        self, parameters: FloatArray, quaternions: FloatArray, parents: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Solves the shapes, each next to the shape from which it starts.

        Args:
            parameters: (count, 9) see `PARAMETERS`.
            quaternions: (count, segments + 1, 4) unit quaternions (w, x, y, z) that turn a segment's frame into the
                base frame: those of the starts; the results replace them.
            parents: (count,) index of an earlier shape of this call whose result is the start; -1 where
                ``quaternions`` is.

        Returns:
            Nodes (count, segments + 2, 3) in m, base frame: clamp, ends of the segments, tip; their derivatives (count,
            segments + 2, 3, 9) by the parameters; and whether each shape is a stable equilibrium. The derivatives of
            others are zero.
        """
        count, nodes = len(parameters), self.rod.segments + 2
        points, slopes = np.zeros((count, nodes, 3)), np.zeros((count, nodes, 3, _COUNT))
        stable = np.zeros(count, np.bool_)
        origin = np.full(count, -1) if parents is None else parents
        _solve_shapes(
            parameters, origin, quaternions, self._nominal, self._changed, self._spare, NO_TOUCH,
            self.rod.rigid_length_m, self._work, points, slopes, stable,
        )  # fmt: skip
        return points, slopes, stable
