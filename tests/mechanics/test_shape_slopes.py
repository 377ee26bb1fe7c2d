"""Shapes of the rod in space with their derivatives: against the solver of single shapes, and differences."""

import numpy as np
import pytest

from tipforce.mechanics import SpatialRod, solve_static_spatial
from tipforce.mechanics.spatial import PARAMETERS, SpatialShapes

STIFFENING_M2 = 40.0**-2


def rod(curvature_y: float = 0.0, curvature_z: float = 0.0, stiffness: float = 1.0, length: float = 1.0) -> SpatialRod:
    return SpatialRod(
        0.045 * length,
        5e-4 * stiffness,
        0.008,
        precurvature_per_m=np.array([0.0, curvature_y, curvature_z]),
        stiffening_curvature_per_m=STIFFENING_M2**-0.5,
        segments=24,
    )


@pytest.fixture(scope="module")
def shapes() -> SpatialShapes:
    return SpatialShapes(rod(), 0.008)


def parameters(*force_n: float, bend: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    return np.array([*force_n, *bend, 0.0, 0.0, 0.0, STIFFENING_M2])


def test_shapes_are_those_of_the_solver_of_single_shapes(shapes: SpatialShapes) -> None:
    rows = np.array([parameters(-0.1, 0.05, 0.08, bend=(2.0, 9.0)), parameters(-0.3, -0.15, 0.2, bend=(-4.0, 3.0))])
    rows[1, PARAMETERS.index("stiffness")], rows[1, PARAMETERS.index("length")] = 0.1, -0.03
    nodes, _, stable = shapes.solve(rows, shapes.unloaded(2))
    assert stable.all()
    for row, found, others in zip(rows, nodes, ((1.0, 1.0), (1.1, 0.97)), strict=True):
        alone = solve_static_spatial(rod(row[3], row[4], *others), row[:3])
        assert np.abs(alone.rod.nodes_m(alone.quaternions) - found).max() < 1e-8


def test_derivatives_are_those_of_differences(shapes: SpatialShapes) -> None:
    here = parameters(-0.15, 0.1, -0.12, bend=(3.0, 12.0))
    steps = np.array([1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-4, 1e-4, 1e-4, 1e-6])
    rows = np.concatenate([[here], here + np.diag(steps), here - np.diag(steps)])
    quaternions = shapes.unloaded(len(rows))
    nodes, slopes, stable = shapes.solve(rows, quaternions)
    assert stable.all()
    count = len(PARAMETERS)
    for k in range(count):
        expected = (nodes[1 + k] - nodes[1 + count + k]) / (2.0 * steps[k])
        assert np.allclose(slopes[0, :, :, k], expected, atol=1e-4 * np.abs(expected).max()), PARAMETERS[k]


def test_a_shape_starts_from_an_earlier_one(shapes: SpatialShapes) -> None:
    rows = np.array([parameters(0.0, 0.1, 0.1), parameters(-0.02, 0.12, 0.1)])
    quaternions = shapes.unloaded(2)
    quaternions[1] = np.nan
    nodes, _, stable = shapes.solve(rows, quaternions, np.array([-1, 0]))
    alone = solve_static_spatial(rod(), rows[1, :3])
    assert stable.all()
    assert np.abs(alone.rod.nodes_m(alone.quaternions) - nodes[1]).max() < 1e-8


def test_rods_that_do_not_exist_are_found(shapes: SpatialShapes) -> None:
    rows = np.tile(parameters(0.0, 0.0, 0.0), (4, 1))
    rows[1, PARAMETERS.index("stiffness")] = -1.5
    rows[2, PARAMETERS.index("curvature_z_per_m")] = 80.0
    rows[3, PARAMETERS.index("stiffening_m2")] = -1e-4
    assert shapes.is_possible(rows).tolist() == [True, False, False, False]
