import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics.planar._newton import Elastic, Load, Springs, _assemble, _newton_step, energy_at, relax, sincos

N = 11
ROD = Elastic(
    h=0.004,
    lever=0.007,
    ei=np.linspace(4.6e-4, 4.3e-4, N),
    k0=np.linspace(3.0, 8.0, N),
    soft=1 / 40**2,
    scale=4.3e-4 / 0.04,
)
LOAD = Load(-0.1, 0.05, 1e-3, np.linspace([0.02, 0.0], [-0.05, 0.04], N))
SPRINGS = Springs(dx=0.8, dy=0.6, position=0.030, kn=120.0, kt=80.0, anchor=0.002, radius=0.00116)


def dense(theta, load=LOAD, springs=SPRINGS):
    """Gradient and Hessian as the kernel has them, written out."""
    n = theta.size
    work, cosine, sine = np.empty((8, n)), np.empty(n), np.empty(n)
    _, depth, slide = energy_at(theta, cosine, sine, ROD, load, springs)
    _assemble(theta, cosine, sine, ROD, load, springs, depth, slide, work)
    hessian = np.diag(work[1]) + np.diag(work[2][:-1], 1) + np.diag(work[2][:-1], -1)
    return work, work[0].copy(), hessian + np.outer(work[3], work[3]) + np.outer(work[4], work[4])


@pytest.mark.parametrize("kn", [0.0, 120.0])
def test_gradient_and_hessian_are_the_derivatives_of_the_energy(kn):
    springs, load = SPRINGS._replace(kn=kn), LOAD
    theta = np.linspace(0.02, 0.5, N)
    cosine, sine = np.empty(N), np.empty(N)

    def energy(angles):
        return energy_at(angles, cosine, sine, ROD, load, springs)[0]

    _, gradient, hessian = dense(theta, load, springs)
    for i in range(N):
        step = np.eye(N)[i] * 1e-5
        assert (energy(theta + step) - energy(theta - step)) / 2e-5 == pytest.approx(gradient[i], abs=1e-9)
        slope = (dense(theta + step, load, springs)[1] - dense(theta - step, load, springs)[1]) / 2e-5
        np.testing.assert_allclose(slope, hessian[i], atol=1e-6)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.2, 1.0))
def test_bordered_step_solves_the_system_or_knows_that_it_is_not_definite(seed, firmness):
    rng = np.random.default_rng(seed)
    work = np.zeros((8, 9))
    work[:5] = rng.normal(size=(5, 9))
    work[1] += 2.0 * firmness
    full = np.diag(work[1]) + np.diag(work[2][:-1], 1) + np.diag(work[2][:-1], -1)
    full += np.outer(work[3], work[3]) + np.outer(work[4], work[4])
    lowest = np.linalg.eigvalsh(full)[0]
    step = np.empty(9)
    assert _newton_step(work, 0.0, True, step) == (lowest > 0) or abs(lowest) < 1e-9
    shift = max(0.0, 0.1 - lowest)
    assert _newton_step(work, shift, True, step)
    np.testing.assert_allclose((full + shift * np.eye(9)) @ step, -work[0], atol=1e-7)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_from_any_start_a_minimum_is_reached(seed):
    rng = np.random.default_rng(seed)
    theta = rng.normal(scale=1.0, size=N)
    load = LOAD._replace(fx=rng.uniform(-0.3, 0.3), fy=rng.uniform(-0.3, 0.3))
    outcome = relax(theta, ROD, load, SPRINGS)
    assert outcome.converged
    assert outcome.stable
    assert np.linalg.eigvalsh(dense(theta, load)[2])[0] > 0


def test_sines_and_cosines_are_the_librarys():
    angles = np.concatenate([np.linspace(-40, 40, 200_001), np.random.default_rng(0).normal(0, 1e4, 10_000)])
    cosine, sine = np.empty_like(angles), np.empty_like(angles)
    sincos(angles, cosine, sine)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=2.3e-16)
