import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tipforce.mechanics import SpatialRod
from tipforce.mechanics.spatial._energy import assemble, energy_at
from tipforce.mechanics.spatial._newton import TOLERANCE, factorise, newton_step, relax, solve, solve_factorised
from tipforce.mechanics.spatial._state import Load, Touch, elastic_of, make_work

SEGMENTS = 6
SIZE = 3 * (SEGMENTS + 1)


def turned(q, step):
    """Orientations after the turns ``step`` in the elements' own frames."""
    now = Rotation.from_quat(q, scalar_first=True) * Rotation.from_rotvec(step.reshape(-1, 3))
    return now.as_quat(scalar_first=True)


def bent_rod(seed, bend=0.4):
    """A rod with everything it can have, at random orientations."""
    rng = np.random.default_rng(seed)
    rod = SpatialRod(
        0.04, 4.3e-4, 0.008, None, np.array([3.0, 5.0, -4.0]), 40.0, rng.uniform(0.8, 1.2, SEGMENTS + 1), SEGMENTS
    )
    elastic = elastic_of(rod, 0.0068)._replace(memory=rng.normal(size=(SEGMENTS + 1, 3)), maxwell=0.03)
    load = Load(0.1 * rng.normal(size=3), np.zeros(3), 1e-3 * rng.normal(size=(SEGMENTS + 1, 3)))
    return elastic, load, turned(np.array(rod.unloaded_quaternions), rng.normal(scale=bend, size=SIZE))


def wall(hertz=0.0, kt=80.0, friction=-1.0, drag=(0.0, 0.0), side=30.0):
    axes = Rotation.from_rotvec([0.3, 2.0, -0.5]).as_matrix()
    return Touch(
        True, axes, -0.03, 0.00116, 120.0, hertz, 5.0, 1e-4, 2e-4,
        kt, np.array([1e-3, 2e-3]), np.array([2e-4, 1e-3, -3e-4]), np.array(drag), friction, side, 1e-3,
    )  # fmt: skip


def dense(q, rod, load, touch, work):
    """Gradient and Hessian as the kernel has them, written out."""
    _, rows, loose = assemble(q, rod, load, touch, work)
    hessian = np.zeros((SIZE, SIZE))
    for i in range(SIZE):
        for j in range(min(6, SIZE - i)):
            hessian[i, i + j] = hessian[i + j, i] = work.hessian[i, j]
    x, y, z = work.skew
    hessian[-3:, -3:] += np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    b = work.rows[:rows]
    return work.gradient.copy(), hessian + b.T @ work.firm[:rows, :rows] @ b, rows, loose


@pytest.mark.parametrize(
    "touch",
    [wall(), wall(hertz=22.0), wall()._replace(growth=500.0), wall(kt=0.0, drag=(0.02, -0.03)), wall(side=0.0)],
    ids=["tied", "hertz", "exponential", "drag", "bare"],
)
@pytest.mark.parametrize("bend", [0.4, 1.2])
def test_gradient_and_hessian_are_the_derivatives_of_the_energy(touch, bend):
    rod, load, q = bent_rod(0, bend)
    work, room = make_work(SEGMENTS + 1, SEGMENTS + 3), np.empty((SEGMENTS + 1, 3))
    gradient, hessian, rows, _ = dense(q, rod, load, touch, work)
    assert rows >= 1

    def energy(step):
        return energy_at(turned(q, step), rod, load, touch, room)

    unit = np.eye(SIZE)
    slopes = [(energy(1e-5 * e) - energy(-1e-5 * e)) / 2e-5 for e in unit]
    np.testing.assert_allclose(gradient, slopes, atol=1e-7)
    rng = np.random.default_rng(1)
    for _ in range(30):
        way = rng.normal(size=SIZE)
        second = (energy(2e-4 * way) - 2 * energy(0 * way) + energy(-2e-4 * way)) / 4e-8
        assert second == pytest.approx(way @ hessian @ way, rel=1e-4, abs=1e-3)


def test_under_a_dead_moment_the_jacobian_is_the_residuals_at_the_equilibrium():
    rod = SpatialRod(2.0, 2.0, torsional_stiffness_nm2=1.0, segments=SEGMENTS)
    elastic, load = (
        elastic_of(rod, 0.0),
        Load(np.array([0.1, 0.2, 0.1]), np.array([1.5, 0.3, 2.0]), np.zeros((SEGMENTS + 1, 3))),
    )
    work, nothing = make_work(SEGMENTS + 1, 1), wall()._replace(active=False)
    q = np.array(rod.unloaded_quaternions)
    for share in (0.25, 0.5, 0.75, 1.0):
        raised = Load(share * load.force, share * load.moment, load.line)
        assert relax(q, elastic, raised, nothing, work, TOLERANCE).converged
    _, jacobian, _, _ = dense(q, elastic, load, nothing, work)
    assert np.abs(jacobian - jacobian.T).max() > 0.1
    for i, unit in enumerate(np.eye(SIZE)):
        sides = [dense(turned(q, h * unit), elastic, load, nothing, work)[0] for h in (1e-5, -1e-5)]
        np.testing.assert_allclose((sides[0] - sides[1]) / 2e-5, jacobian[:, i], atol=1e-7)


@pytest.mark.parametrize("friction", [0.05, 50.0], ids=["slip", "stick"])
def test_coulombs_jacobian_is_the_residuals(friction):
    rod, load, q = bent_rod(0)
    load, touch = Load(load.force, load.moment, 0 * load.line), wall(friction=friction)._replace(place=-0.06)
    work = make_work(SEGMENTS + 1, SEGMENTS + 3)
    _, jacobian, _, loose = dense(q, rod, load, touch, work)
    assert loose == (2 if friction < 1 else 0)
    residual, tangent = dense(q, rod, load, touch, work)[0], np.zeros((SIZE, SIZE))
    for i, unit in enumerate(np.eye(SIZE)):
        sides = [dense(turned(q, h * unit), rod, load, touch, work)[0] for h in (1e-6, -1e-6)]
        tangent[:, i] = (sides[0] - sides[1]) / 2e-6
    # Away from an equilibrium the frames' own turn adds (g x .) / 2 to each block of the gradient's derivative.
    for k in range(SEGMENTS + 1):
        x, y, z = residual[3 * k : 3 * k + 3]
        tangent[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] -= 0.5 * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    np.testing.assert_allclose(tangent, jacobian, atol=2e-5)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 3.0), st.floats(0.0, 2.0))
def test_factors_solve_the_system_and_count_its_negative_eigenvalues(seed, shift, unsymmetric):
    rng = np.random.default_rng(seed)
    band, tail, skew = rng.normal(size=(12, 6)), np.empty((3, 3)), unsymmetric * rng.normal(size=3)
    full = np.zeros((12, 12))
    for i in range(12):
        for j in range(min(6, 12 - i)):
            full[i, i + j] = full[i + j, i] = band[i, j]
    eigenvalues = np.linalg.eigvalsh(full + shift * np.eye(12))
    negative = factorise(band, shift, skew, tail)
    if min(np.abs(band[:9, 0]).min(), np.abs(eigenvalues).min()) < 1e-3:
        return  # without pivoting a pivot next to nothing costs figures; Newton's method shifts such a matrix
    assert negative == np.sum(eigenvalues < 0)
    x, y, z = skew
    full[-3:, -3:] += np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    wanted = rng.normal(size=12)
    rhs = (full + shift * np.eye(12)) @ wanted
    solve(band, tail, rhs)
    if np.linalg.cond(full + shift * np.eye(12)) < 1e4:
        np.testing.assert_allclose(rhs, wanted, atol=1e-6)


@pytest.mark.parametrize("touch", [wall(), wall(friction=0.05), wall(kt=0.0)], ids=["tied", "slip", "free"])
@pytest.mark.parametrize("seed", range(5))
def test_bordered_step_solves_the_system_and_its_factors_can_be_used_again(touch, seed):
    rod, load, q = bent_rod(seed, 0.15)
    work = make_work(SEGMENTS + 1, SEGMENTS + 3)
    gradient, hessian, rows, loose = dense(q, rod, load, touch, work)
    negative = newton_step(work, rows, loose, 0.0)
    np.testing.assert_allclose(hessian @ work.step, -gradient, atol=1e-9)
    if loose == 0:
        assert negative == np.sum(np.linalg.eigvalsh(hessian) < 0)
    another = np.random.default_rng(seed).normal(size=SIZE)
    answer = another.copy()
    solve_factorised(work, rows, answer)
    np.testing.assert_allclose(hessian @ answer, another, atol=1e-9)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_from_any_start_a_minimum_is_reached(seed):
    rod, _, q = bent_rod(seed, 1.0)
    rng = np.random.default_rng(seed)
    load, touch = Load(rng.uniform(-0.3, 0.3, 3), np.zeros(3), np.zeros((SEGMENTS + 1, 3))), wall()
    work = make_work(SEGMENTS + 1, SEGMENTS + 3)
    outcome = relax(q, rod, load, touch, work, TOLERANCE)
    assert outcome.converged
    assert outcome.stable
    assert np.linalg.eigvalsh(dense(q, rod, load, touch, work)[1])[0] > 0
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-12)


def test_the_logarithm_keeps_its_figures_where_series_and_closed_form_meet():
    from tipforce.mechanics.spatial._energy import log_factors, log_scale

    for half in (0.1, 0.1409, 0.1419, 0.2, 1.0, 1.5):
        angle, sine2, cosine = 2 * half, math.sin(half) ** 2, math.cos(half)
        assert log_scale(sine2, cosine) == pytest.approx(angle / math.sin(half), rel=1e-14)
        kappa, fall = log_factors(angle**2, sine2, cosine)
        exact = (1 - half / math.tan(half)) / angle**2
        assert kappa == pytest.approx(exact, rel=1e-11)
        above, below = ((1 - (half + h) / math.tan(half + h)) / (2 * (half + h)) ** 2 for h in (1e-4, -1e-4))
        assert fall * angle == pytest.approx((above - below) / 4e-4, rel=1e-5)
