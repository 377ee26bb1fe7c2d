"""The force from a line: exact derivatives, and what the posterior promises."""

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import PlanarRod
from tipforce.mechanics.planar import UNKNOWNS, Line, Model, fit_line, make_work, predict_line

POINTS = 22
COUNT = len(UNKNOWNS)
MODEL = Model(40, 0.04, 0.008, 4.3e-4, np.ones(41), 0.0, np.zeros(41))
FROM_TIP = np.linspace(0.046, 0.0, POINTS)
NONE = np.zeros((POINTS + 1, 0))
STD = np.array([0.15, 0.15, 0.3, 0.02, 0.05, 5e-5, 0.01, 0.006, 5e-3, 5e-3, 0.02, 0.05, 0.05, 0.3, 0.02])
NOISE = np.append(np.full(POINTS, 1e-5), 1e-4)


def line_of(force: tuple[float, float], curvature: float, errors: np.ndarray | None = None) -> Line:
    """The line of a rod under ``force``, across itself and at its tip along itself off by ``errors`` (POINTS + 1,)."""
    rod = PlanarRod(0.04, 4.3e-4, 0.008, precurvature_per_m=curvature, segments=40)
    points = solve_static(rod, np.array(force)).centreline_m(0.048 - FROM_TIP)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    if errors is not None:
        points = points + errors[:-1, None] * normals
        points[-1] += errors[-1] * along[-1]
    return Line(points, normals, FROM_TIP, np.array([0.064, 0.0]), np.array([-0.1, 0.05]))


def prior(curvature: float) -> tuple[np.ndarray, np.ndarray]:
    mean = np.zeros(COUNT)
    mean[2] = curvature
    return mean, np.diag(STD**-2)


CREPT = np.linspace(2.0, 0.0, MODEL.segments + 1)


@pytest.mark.parametrize("held", [{}, {"crept_per_m": CREPT}])
@pytest.mark.parametrize("from_clamp", [False, True])
@pytest.mark.parametrize("force", [(0.0, 0.0), (-0.1, 0.12), (-0.25, -0.05)])
def test_slopes_are_the_derivatives_of_the_prediction(
    force: tuple[float, float], from_clamp: bool, held: dict[str, np.ndarray]
) -> None:
    line, work = line_of((-0.1, 0.1), 5.3)._replace(from_clamp=from_clamp, **held), make_work(MODEL, POINTS, COUNT)
    at = prior(5.3)[0] + 0.3 * STD
    at[:2] = force
    assert predict_line(at, MODEL, line, NONE, work, True) == (True, True)
    slopes = work.slopes.copy()
    for k in range(COUNT):
        ends = []
        for way in (1.0, -1.0):
            moved = at.copy()
            moved[k] += way * 1e-2 * STD[k]
            predict_line(moved, MODEL, line, NONE, work, False)
            ends.append(work.residual.copy())
        numeric = (ends[1] - ends[0]) / (2e-2 * STD[k])
        # the sag of an element's arc is left out of the slopes: a thousandth
        assert np.abs(numeric - slopes[:, k]).max() <= 2e-3 * np.abs(numeric).max() + 1e-7 / STD[k], UNKNOWNS[k]


@pytest.mark.parametrize("force", [(-0.1, 0.1), (-0.2, 0.02), (-0.05, -0.08)])
def test_the_force_is_found_within_its_stated_covariance(force: tuple[float, float]) -> None:
    """Over drawn noise and drawn pre-curvature the squared error over its covariance has a mean of two."""
    rng, work, covariance = np.random.default_rng(0), make_work(MODEL, POINTS, COUNT), np.zeros((COUNT, COUNT))
    squares = []
    for _ in range(40):
        mean, information = prior(5.3)
        information[:2, :2] = 1e-6 * np.eye(2)  # the line alone, for a force that is given
        line = line_of(force, 5.3 + 0.3 * rng.standard_normal(), NOISE * rng.standard_normal(POINTS + 1))
        for known in range(3, COUNT):
            information[known, known] = 1e8 / STD[known] ** 2
        q = mean.copy()
        found = fit_line(
            q, mean, information, MODEL, line, NONE, np.diag(1.0 / NOISE), 4.0, 30, True, work, covariance
        )  # fmt: skip
        assert found.converged
        assert found.stable
        error = q[:2] - force
        squares.append(error @ np.linalg.solve(covariance[:2, :2], error))
    assert 1.2 < np.mean(squares) < 3.2


def test_a_push_along_a_straight_rod_is_left_open() -> None:
    """Of a straight rod the lateral force is known, the axial one not: the prior's width is left of it."""
    mean, information = prior(0.0)
    work, covariance, q = make_work(MODEL, POINTS, COUNT), np.zeros((COUNT, COUNT)), mean.copy()
    line = line_of((-0.1, 0.0), 0.0)
    fit_line(q, mean, information, MODEL, line, NONE, np.diag(1.0 / NOISE), 4.0, 30, True, work, covariance)
    axial, lateral = np.sqrt(np.diag(covariance))[:2]
    assert axial > 0.9 * STD[0]
    assert lateral < 0.15 * STD[1]


def test_a_few_wrong_points_do_not_carry_the_fit_away() -> None:
    mean, information = prior(5.3)
    errors = np.zeros(POINTS + 1)
    errors[9:11] = 2e-4
    forces = []
    for limit in (4.0, 1e9):
        work, covariance, q = make_work(MODEL, POINTS, COUNT), np.zeros((COUNT, COUNT)), mean.copy()
        line, whiten = line_of((-0.1, 0.1), 5.3, errors), np.diag(1.0 / NOISE)
        fit_line(q, mean, information, MODEL, line, NONE, whiten, limit, 60, True, work, covariance)
        forces.append(q[:2])
    robust, plain = (np.hypot(*(force - (-0.1, 0.1))) for force in forces)
    assert robust < 0.7 * plain


def test_without_a_visible_tip_the_force_does_not_depend_on_where_the_line_ends() -> None:
    """The line of a hidden tip ends where the tip is taken to be: 3 mm too early here."""
    force = (-0.08, 0.12)
    rows = np.append(np.arange(POINTS) < 17, False)
    found = []
    for cut_m in (0.0, 3e-3):
        mean, information = prior(5.3)
        information[:2, :2] = 1e-6 * np.eye(2)
        for known in set(range(2, COUNT)) - {UNKNOWNS.index("base_x_m")}:
            information[known, known] = 1e8 / STD[known] ** 2
        line, work, q = line_of(force, 5.3), make_work(MODEL, POINTS, COUNT), mean.copy()
        line = line._replace(from_tip=line.from_tip - cut_m, from_clamp=True)
        whiten = np.diag(rows / NOISE)
        fit_line(q, mean, information, MODEL, line, NONE, whiten, 4.0, 60, True, work, np.zeros((COUNT, COUNT)))
        found.append(q[:2].copy())
    assert found[0] == pytest.approx(force, abs=5e-3)
    assert found[1] == pytest.approx(found[0], abs=1e-6)
