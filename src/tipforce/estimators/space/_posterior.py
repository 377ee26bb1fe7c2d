"""Posterior of the force in space from the lines of one instant.

Unknown are the force, with a flat prior, and the constants, with a Gaussian one. Along the direction that the shapes
show least, and along a second one where they show it little, the force is fixed at the nodes of a grid. At each node
the rest is fitted by Gauss-Newton and integrated by Laplace's approximation. All nodes are fitted together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...mechanics.spatial import SpatialShapes
from ...types import FloatArray, IntArray
from ..session import MOST_PULL
from ._cameras import ViewLine, turns
from ._constants import BEND_Y, BEND_Z, FORCE, GAIN, LEVER, PLAY, POSITION, SHAPE, STIFFNESS, TURN, errors_of_view
from ._projection import RATES, residuals
from ._view_pose import POSE_ERRORS, PlacedRod, PoseError

_START_N = 0.3
"""Standard deviation of each component of the force in the fit from which the grid is laid out."""
_PULL_N = 5e-3
"""Standard deviation of a force that pulls at the tip more than friction does, in that fit: tissue pushes."""
_FIT_STEPS, _NODE_STEPS = 40, 4
_MOST_DAMPING = 1e6
_LEAST_GAIN, _MOST_GAIN = 2e-3, 0.1
"""Decrease of the cost in a step with which a fit ends, and with which it counts where no step is left: along the
direction that is shown least the minimum is flat, and the grid goes there."""
_SMALL_GAP = 0.01
"""Squared distance to the minimum, in standard deviations, at which a fit ends."""
_NODE_GAP, _MOST_GAP = 0.1, 1.0
"""The same of a node: where all nodes are fitted, and beyond which one is left out."""
_NODE_STD = 0.8
"""Distance of the nodes over the standard deviation at the best fit, within the limits that follow."""
_SHORTEST_N, _LONGEST_N = 2e-3, (0.04, 0.06)
_LONG, _SHORT = 9, 5
"""Nodes to either side along the direction that is shown least, and along the second one."""
_DEPTH = 12.0
"""A node whose density is lower than the highest by exp(-this) is left out."""
_LITTLE_N = 0.03
"""Standard deviation from which the second direction has a grid, too."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """The line of one view.

    Attributes:
        place: place of the view among those of the session.
        line: the line.
        camera: (3, 4) projection from the reference frame of the base to pixels.
        whiten: (points + 1, points + 1) makes the residuals white; zero rows where a point is hidden.
        error_slopes: (points + 1, errors) derivatives of the residuals by the errors of the view.
        rows: number of measurements.
        age_s: time since the image of the line; 0: it shows this instant.
        pose: error of the view's pose, whose unknowns are the last ones; None: the pose is exact.
    """

    place: int
    line: ViewLine
    camera: FloatArray
    whiten: FloatArray
    error_slopes: FloatArray
    rows: int
    age_s: float = 0.0
    pose: PoseError | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """All that the posterior of one instant needs.

    Attributes:
        shapes: the rod.
        measurements: lines of this instant.
        mean: (unknowns,) mean of the constants.
        information: (unknowns, unknowns) inverse of their covariance; zero for the force.
        gain_per_m_deg: curvature for a degree of the knob.
        knob_deg: reading of the knob.
        lever_per_m_n: curvature per newton by one standard deviation of the lever.
        advance_m: advance of the clamp.
        huber: see the settings.
    """

    shapes: SpatialShapes
    measurements: Sequence[Measurement]
    mean: FloatArray
    information: FloatArray
    gain_per_m_deg: float
    knob_deg: float
    lever_per_m_n: float
    advance_m: float
    huber: float

    @property
    def rows(self) -> int:
        """Number of measurements."""
        return sum(each.rows for each in self.measurements)


@dataclass(frozen=True, eq=False)
class Linear:
    """Normal equations at ``count`` points of the unknowns.

    Attributes:
        cost: (count,) minus the logarithm of the density, up to a constant; infinite where there is no such shape.
        chi2: (count,) squares of the whitened residuals.
        matrix: (count, unknowns, unknowns) information.
        side: (count, unknowns) minus the gradient of the cost.
        tip_axis: (count, 3) axis of the tip, base frame.
    """

    cost: FloatArray
    chi2: FloatArray
    matrix: FloatArray
    side: FloatArray
    tip_axis: FloatArray


def _parameters(problem: Problem, q: FloatArray) -> FloatArray:
    """Returns the parameters (count, `SHAPE`) of the rod at points (count, unknowns) of the unknowns.

    The knob, and the lever of the force at the tip, have the effect of a curvature: they add to that of the rod.
    """
    parameters = q[:, :SHAPE].copy()
    lever_per_m = problem.lever_per_m_n * np.linalg.norm(q[:, :FORCE], axis=1)
    parameters[:, BEND_Y] += lever_per_m * q[:, LEVER]
    parameters[:, BEND_Z] += lever_per_m * q[:, LEVER + 1]
    parameters[:, BEND_Z] += problem.gain_per_m_deg * (problem.knob_deg * (1.0 + q[:, GAIN]) + q[:, PLAY])
    return parameters


def force_slopes(problem: Problem, view: Measurement, q: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Returns the derivatives (points + 1, 3) of a line's residuals by the force, in px/N.

    Args:
        problem: lines and prior.
        view: the line.
        q: (unknowns,) a point of the unknowns.
        quaternions: (elements, 4) start of the shape; it is not changed.
    """
    nodes, node_slopes, _ = problem.shapes.solve(_parameters(problem, q[None]), quaternions[None].copy())
    turn, turn_slopes = turns(q[None, TURN : TURN + 3])
    position = q[None, POSITION : POSITION + 3] + problem.advance_m * turn[:, :, 0]
    rows = len(view.line.points) + 1
    residual, slopes = np.empty((1, rows)), np.empty((1, rows, RATES))
    residuals(
        nodes, node_slopes, position, turn, turn_slopes, view.camera, view.line.points, view.line.normals,
        residual, slopes,
    )  # fmt: skip
    return slopes[0, :, :FORCE]


def _view_residuals(
    problem: Problem, view: Measurement, q: FloatArray, rod: PlacedRod, nodes: FloatArray, node_slopes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns the residuals of one view, px, and their derivatives by all unknowns.

    The derivatives by the rod's shape and base come from `residuals`; those by knob, lever, pose and errors of the view
    follow by the chain rule.

    Args:
        problem: lines and prior.
        view: the line.
        q: (count, unknowns) points of the unknowns.
        rod: pose of the base.
        nodes: (count, nodes, 3) nodes of the rod in the base frame, m.
        node_slopes: (count, nodes, 3, 9) their derivatives by the parameters of the shape.

    Returns:
        (count, points + 1) and (count, points + 1, unknowns).
    """
    (count, size), rows = q.shape, len(view.line.points) + 1
    placed, pose_slopes = (rod, None) if view.pose is None else view.pose.seen(q[:, -POSE_ERRORS:], rod)
    residual, shape_slopes = np.empty((count, rows)), np.empty((count, rows, TURN + placed.turn_slopes.shape[1]))
    residuals(
        nodes, node_slopes, placed.position, placed.turn, placed.turn_slopes, view.camera, view.line.points,
        view.line.normals, residual, shape_slopes,
    )  # fmt: skip
    slopes = np.zeros((count, rows, size))
    if pose_slopes is not None:  # an error of the pose moves the rod in front of the view, and turns it
        by_position = shape_slopes[:, :, POSITION:TURN] @ pose_slopes.transpose(0, 2, 1)
        slopes[:, :, -POSE_ERRORS:] = by_position[:, :, :POSE_ERRORS]
        slopes[:, :, -POSE_ERRORS : size - 3] += shape_slopes[:, :, RATES:]
        shape_slopes = np.concatenate(
            [shape_slopes[:, :, :POSITION], by_position[:, :, POSE_ERRORS:], shape_slopes[:, :, TURN:RATES]], axis=2
        )
    slopes[:, :, :RATES] = shape_slopes
    slopes[:, :, GAIN] = problem.gain_per_m_deg * problem.knob_deg * shape_slopes[:, :, BEND_Z]
    slopes[:, :, PLAY] = problem.gain_per_m_deg * shape_slopes[:, :, BEND_Z]
    force_n, lever = np.linalg.norm(q[:, :FORCE], axis=1), problem.lever_per_m_n
    direction = q[:, :FORCE] / np.maximum(force_n, 1e-9)[:, None]
    for k, bend in enumerate((BEND_Y, BEND_Z)):  # the lever acts as a curvature, which grows with the force
        slopes[:, :, LEVER + k] = lever * force_n[:, None] * shape_slopes[:, :, bend]
        per_n = lever * q[:, LEVER + k, None] * shape_slopes[:, :, bend]
        slopes[:, :, :FORCE] += per_n[:, :, None] * direction[:, None, :]
    view_errors = errors_of_view(view.place)
    slopes[:, :, view_errors] = view.error_slopes
    return residual + q[:, view_errors] @ view.error_slopes.T, slopes


def linearise(
    problem: Problem, q: FloatArray, quaternions: FloatArray, parents: IntArray | None = None, *, contact: bool = True
) -> Linear:
    """Computes cost and normal equations (Gauss-Newton) of prior and lines at several points of the unknowns.

    Huber's loss limits outliers of the lines.

    Args:
        problem: lines and prior.
        q: (count, unknowns) points.
        quaternions: (count, elements, 4) starts of the shapes; then the shapes.
        parents: see `SpatialShapes.solve`.
        contact: whether the force is an unknown with a flat prior.
    """
    count = len(q)
    parameters = _parameters(problem, q)
    possible = problem.shapes.is_possible(parameters)
    # all points are solved together: an impossible one takes other parameters here, and an infinite cost below
    parameters[~possible] = parameters[possible][0] if possible.any() else 0.0
    nodes, node_slopes, stable = problem.shapes.solve(parameters, quaternions, parents)
    turn, turn_slopes = turns(q[:, TURN : TURN + 3])
    rod = PlacedRod(q[:, POSITION : POSITION + 3] + problem.advance_m * turn[:, :, 0], turn, turn_slopes)
    from_mean = q - problem.mean
    matrix = np.tile(problem.information, (count, 1, 1))
    side = -from_mean @ problem.information
    cost = -0.5 * np.einsum("pk,pk->p", side, from_mean)
    chi2 = np.zeros(count)
    for view in problem.measurements:
        residual, slopes = _view_residuals(problem, view, q, rod, nodes, node_slopes)
        white = residual @ view.whiten.T
        magnitude = np.abs(white)
        within = magnitude <= problem.huber
        cost += np.where(within, 0.5 * white**2, problem.huber * (magnitude - 0.5 * problem.huber)).sum(axis=1)
        chi2 += (white**2).sum(axis=1)
        weight = np.sqrt(np.where(within, 1.0, problem.huber / np.maximum(magnitude, 1e-9)))
        whitened = (view.whiten @ slopes) * weight[:, :, None]
        transposed = whitened.transpose(0, 2, 1)
        matrix += transposed @ whitened
        side -= (transposed @ (weight * white)[:, :, None])[:, :, 0]
    if contact:  # the shapes show force over stiffness: a flat prior of the force would prefer stiff rods
        side[:, STIFFNESS] -= 1.0 / (1.0 + q[:, STIFFNESS])
        cost += np.log1p(q[:, STIFFNESS])
    cost[~(possible & stable)] = math.inf
    axis = nodes[:, -1] - nodes[:, -2]
    return Linear(cost, chi2, matrix, side, axis / np.linalg.norm(axis, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Fit:
    """The best point.

    Attributes:
        q: (unknowns,) it.
        quaternions: (elements, 4) its shape.
        cost: see `Linear`.
        chi2: see `Linear`.
        matrix: (unknowns, unknowns) information without the limit on forces that pull; unit rows for held unknowns.
        tip_axis: (3,) axis of the tip.
        ok: whether it is a minimum.
    """

    q: FloatArray
    quaternions: FloatArray
    cost: float
    chi2: float
    matrix: FloatArray
    tip_axis: FloatArray
    ok: bool

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant of the information."""
        return float(np.linalg.slogdet(self.matrix)[1])


def fit(problem: Problem, start: FloatArray, quaternions: FloatArray, *, contact: bool) -> Fit:
    """Finds the unknowns with the smallest cost by Levenberg-Marquardt, with a force or without.

    With a force, a wide Gaussian about no force (`_START_N`) and a limit on pulls (`_PULL_N`) keep the fit in reach.

    Args:
        problem: lines and prior.
        start: (unknowns,) start.
        quaternions: (elements, 4) start of the shape; it is not changed.
        contact: whether there is a force.
    """
    q, shape = start.copy(), quaternions.copy()
    if not contact:
        q[:FORCE] = 0.0
    force_information = np.full(FORCE, _START_N**-2 if contact else 0.0)

    def evaluate(point: FloatArray, shape: FloatArray) -> tuple[float, Linear, FloatArray]:
        """Returns cost, equations, and the information that the limit on pulls adds to the matrix."""
        linear = linearise(problem, point[None], shape[None], contact=contact)
        matrix, side = linear.matrix[0], linear.side[0]
        pull, pull_information = 0.0, np.zeros((len(q), len(q)))
        if contact:
            matrix[range(FORCE), range(FORCE)] += force_information
            side[:FORCE] -= force_information * point[:FORCE]
            size_n = max(float(np.linalg.norm(point[:FORCE])), 1e-9)
            axis = linear.tip_axis[0] - MOST_PULL / size_n * point[:FORCE]  # friction may pull
            pull = max(0.0, float(axis @ point[:FORCE])) / _PULL_N
            pull_information[:FORCE, :FORCE] = np.outer(axis, axis) / _PULL_N**2 if pull else 0.0
            side[:FORCE] -= pull / _PULL_N * axis
        else:
            hold(matrix, side, 0, FORCE)
        cost = float(linear.cost[0] + 0.5 * force_information @ point[:FORCE] ** 2 + 0.5 * pull**2)
        return cost, linear, pull_information

    cost, linear, pull_information = evaluate(q, shape)
    damping, decrease = 0.0, math.inf
    for _ in range(_FIT_STEPS):
        if not math.isfinite(cost):
            break
        matrix = linear.matrix[0] + pull_information
        step = _solve(matrix + damping * np.diag(np.diag(matrix)), linear.side[0])
        gap = float(step @ linear.side[0])
        if gap < _SMALL_GAP and damping < 1e-2:
            decrease = gap
            break
        trial_shape = shape.copy()
        trial_cost, trial_linear, trial_pull = evaluate(q + step, trial_shape)
        if trial_cost <= cost + 1e-9:
            last_decrease, decrease = decrease, cost - trial_cost
            q, shape, cost, linear, pull_information = q + step, trial_shape, trial_cost, trial_linear, trial_pull
            damping = 0.0 if damping < 1e-3 else 0.2 * damping
            if max(last_decrease, decrease) < _LEAST_GAIN:
                break
        else:
            damping = max(1e-2, 6.0 * damping)
            if damping > _MOST_DAMPING:
                decrease = 0.0
                break
    ok = math.isfinite(cost) and decrease < _MOST_GAIN
    return Fit(q, shape, cost, float(linear.chi2[0]), linear.matrix[0], linear.tip_axis[0], ok)


def hold(matrix: FloatArray, side: FloatArray, first: int, last: int) -> None:
    """Holds the unknowns ``first`` to ``last`` in place: unit rows (..., unknowns, unknowns), no gradient."""
    matrix[..., first:last, :] = 0.0
    matrix[..., :, first:last] = 0.0
    for k in range(first, last):
        matrix[..., k, k] = 1.0
    side[..., first:last] = 0.0


def _solve(matrix: FloatArray, side: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, side[..., None])[..., 0], np.float64)


@dataclass(frozen=True, eq=False)
class Nodes:
    """The fitted nodes of a grid.

    Attributes:
        basis: (3, 3) directions of the force in columns, the one that is shown least last.
        held: number of the last directions that have a grid.
        spacing: length (held = 1), or area (held = 2), of a node in N or N^2.
        q: (count, unknowns) the nodes.
        cost: (count,) at each node.
        covariance: (count, unknowns, unknowns) with the held directions fixed; the force in base axes.
        log_weight: (count,) logarithm of the density, integrated over all unknowns that are not held.
        tip_axis: (count, 3) axis of the tip.
    """

    basis: FloatArray
    held: int
    spacing: float
    q: FloatArray
    cost: FloatArray
    covariance: FloatArray
    log_weight: FloatArray
    tip_axis: FloatArray


def lay_grid(problem: Problem, best: Fit, largest_n: float) -> Nodes | None:
    """Fits the nodes of a grid of forces about the best fit.

    The grid is along the direction of the force that the lines show least, and along a second one where its standard
    deviation is large, too. There the force is fixed ("held") at each node; all other unknowns are fitted.

    Args:
        problem: lines and prior.
        best: the best fit with a force.
        largest_n: nodes with a larger force are left out.

    Returns:
        The nodes; None where none fits.
    """
    covariance = np.linalg.inv(best.matrix)[:FORCE, :FORCE]
    variances, basis = np.linalg.eigh(0.5 * (covariance + covariance.T))  # the largest last
    std = np.sqrt(np.maximum(variances, 1e-12))
    held = 2 if std[1] > _LITTLE_N else 1
    step = np.clip(_NODE_STD * std[::-1][:held], _SHORTEST_N, _LONGEST_N[:held])
    counts = (_LONG,) if held == 1 else (_LONG, _SHORT)
    grid = np.stack(np.meshgrid(*[np.arange(-n, n + 1) for n in counts], indexing="ij"), axis=-1).reshape(-1, held)
    grid = grid[np.argsort(np.abs(grid).sum(axis=1), kind="stable")]  # from the middle outward: parents come first
    # a start of each node: the other unknowns follow the held force as the minimum of the quadratic cost does
    matrix = _turned(best.matrix.copy(), basis)
    rest = np.ones(len(best.q), np.bool_)
    fixed = np.arange(FORCE - 1, FORCE - 1 - held, -1)
    rest[fixed] = False
    follow = np.linalg.solve(matrix[np.ix_(rest, rest)], -matrix[np.ix_(rest, fixed)])
    held_n = grid * step
    change = np.zeros((len(grid), len(best.q)))
    change[:, fixed] = held_n
    change[:, rest] = held_n @ follow.T
    change[:, :FORCE] = change[:, :FORCE] @ basis.T
    q = best.q + change
    inside = np.linalg.norm(q[:, :FORCE], axis=1) <= largest_n
    q, grid = q[inside], grid[inside]
    if not len(q):
        return None
    index = {tuple(position): k for k, position in enumerate(grid.tolist())}
    parents = np.array([_parent(position, index) for position in grid.tolist()])
    quaternions = np.tile(best.quaternions, (len(q), 1, 1))
    matrix, gap, cost, axis = np.empty(0), np.empty(0), np.empty(0), np.empty(0)
    starts: IntArray | None = parents
    for _ in range(_NODE_STEPS):
        linear = linearise(problem, q, quaternions, starts)
        matrix, side = _turned(linear.matrix, basis), linear.side  # the force in the axes of the grid
        side[:, :FORCE] = side[:, :FORCE] @ basis
        hold(matrix, side, FORCE - held, FORCE)
        newton = np.zeros_like(q)
        possible = np.isfinite(linear.cost)
        newton[possible] = _solve(matrix[possible], side[possible])
        gap = np.einsum("pk,pk->p", newton, side)
        cost = np.where(possible, linear.cost - 0.5 * gap, math.inf)
        kept = cost < cost.min() + _DEPTH  # the others have a negligible density
        newton[:, :FORCE] = newton[:, :FORCE] @ basis.T
        q, quaternions, starts = q[kept] + newton[kept], quaternions[kept], None
        matrix, gap, cost, axis = matrix[kept], gap[kept], cost[kept], linear.tip_axis[kept]
        if not len(q) or gap.max() < _NODE_GAP:
            break
    fits = gap < _MOST_GAP
    if not fits.any():
        return None
    covariance = np.asarray(np.linalg.inv(matrix[fits]), np.float64)
    covariance[:, fixed, fixed] = 0.0
    return Nodes(
        basis, held, float(np.prod(step)), q[fits], cost[fits], _turned(covariance, basis.T),
        -cost[fits] - 0.5 * np.linalg.slogdet(matrix[fits])[1], axis[fits],
    )  # fmt: skip


def _turned(matrix: FloatArray, basis: FloatArray) -> FloatArray:
    """Turns the force's part of information or covariance (..., unknowns, unknowns), in place, and returns it.

    Args:
        matrix: in the axes from which ``basis`` turns.
        basis: (3, 3) new axes in columns.
    """
    matrix[..., :FORCE, :] = basis.T @ matrix[..., :FORCE, :]
    matrix[..., :FORCE] = matrix[..., :FORCE] @ basis
    return matrix


def _parent(place: list[int], index: dict[tuple[int, ...], int]) -> int:
    """Returns the index of a node's neighbour toward the middle, from whose shape the node's fit starts; -1: none.

    ``place`` is the node's position in the grid, counted from the middle; ``index`` maps positions to indices.
    """
    nearer = list(place)
    for k in range(len(place)):
        if place[k]:
            nearer[k] = place[k] - (1 if place[k] > 0 else -1)
            return index.get(tuple(nearer), -1)
    return -1
