import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics.planar._newton import (
    SCRATCH,
    TOLERANCE,
    Elastic,
    Load,
    assemble,
    energy_at,
    newton_step,
    relax_in,
    sincos,
)

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


def dense(theta, load=LOAD):
    """Gradient and Hessian of the kernel, written out."""
    n = theta.size
    work, cosine, sine = np.empty((5, n)), np.empty(n), np.empty(n)
    energy_at(theta, cosine, sine, ROD, load)
    assemble(theta, cosine, sine, ROD, load, work)
    return work[0].copy(), np.diag(work[1]) + np.diag(work[2][:-1], 1) + np.diag(work[2][:-1], -1)


def test_gradient_and_hessian_are_the_derivatives_of_the_energy():
    theta = np.linspace(0.02, 0.5, N)
    cosine, sine = np.empty(N), np.empty(N)
    gradient, hessian = dense(theta)
    for i in range(N):
        step = np.eye(N)[i] * 1e-5
        rise = energy_at(theta + step, cosine, sine, ROD, LOAD) - energy_at(theta - step, cosine, sine, ROD, LOAD)
        assert rise / 2e-5 == pytest.approx(gradient[i], abs=1e-9)
        slope = (dense(theta + step)[0] - dense(theta - step)[0]) / 2e-5
        np.testing.assert_allclose(slope, hessian[i], atol=1e-6)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.2, 1.0))
def test_a_step_solves_the_system_or_knows_that_it_is_not_definite(seed, firmness):
    rng = np.random.default_rng(seed)
    work = np.zeros((5, 9))
    work[:3] = rng.normal(size=(3, 9))
    work[1] += 2.0 * firmness
    full = np.diag(work[1]) + np.diag(work[2][:-1], 1) + np.diag(work[2][:-1], -1)
    lowest = np.linalg.eigvalsh(full)[0]
    step = np.empty(9)
    assert newton_step(work, 0.0, step) == (lowest > 0) or abs(lowest) < 1e-9
    shift = max(0.0, 0.1 - lowest)
    assert newton_step(work, shift, step)
    np.testing.assert_allclose((full + shift * np.eye(9)) @ step, -work[0], atol=1e-7)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_from_any_start_a_minimum_is_reached(seed):
    rng = np.random.default_rng(seed)
    theta = rng.normal(scale=1.0, size=N)
    load = LOAD._replace(fx=rng.uniform(-0.3, 0.3), fy=rng.uniform(-0.3, 0.3))
    outcome = relax_in(theta, ROD, load, TOLERANCE, np.empty((SCRATCH, N)))
    assert outcome.converged
    assert outcome.stable
    assert np.linalg.eigvalsh(dense(theta, load)[1])[0] > 0


def test_sines_and_cosines_are_the_librarys():
    angles = np.concatenate([np.linspace(-40, 40, 200_001), np.random.default_rng(0).normal(0, 1e4, 10_000)])
    cosine, sine = np.empty_like(angles), np.empty_like(angles)
    sincos(angles, cosine, sine)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=2.3e-16)
