"""The posterior bound: against dense inversion, by what more knowledge does, and for what has no memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.mechanics import posterior_covariance, posterior_covariance_along

MEMORY = np.array([0.0, 0.0, 3.0, np.inf, np.inf, 20.0])


def case(seed, instants=12, rows=5, unknowns=6):
    """Slopes, a correlated prior in units ten powers of ten apart, and uneven times."""
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-5, 5, unknowns)
    root = np.diag(rng.uniform(0.5, 2.0, unknowns))
    root[4, 3], root[1, 0] = 0.7, -0.6  # unknowns of the same memory may be correlated
    prior = units[:, None] * (root @ root.T) * units
    slopes = rng.normal(0, 3.0, (instants, rows, unknowns)) / units
    return slopes, prior, np.cumsum(rng.uniform(0.01, 2.0, instants))


def dense(slopes, prior, time_s, memory_s, wanted):
    """Every instant's unknowns as one long vector, inverted whole, with the frames until then."""
    m, _, count = slopes.shape
    gap = np.abs(time_s[:, None] - time_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        kept = np.where(memory_s > 0, np.exp(-gap[..., None] / memory_s), 0.0)
    kept[np.arange(m), np.arange(m)] = 1.0
    out = []
    size = np.sqrt(np.diag(prior))
    for last in range(m):
        n = last + 1
        full = np.empty((n, count, n, count))
        for i in range(n):
            for j in range(n):
                full[i, :, j] = np.sqrt(np.outer(kept[i, j], kept[i, j])) * prior / np.outer(size, size)
        full = full.reshape(n * count, n * count)
        shown = np.zeros((n, slopes.shape[1], n, count))
        for i in range(n):
            shown[i, :, i] = slopes[i] * size
        shown = shown.reshape(-1, n * count)
        seen = shown @ full
        found = full - seen.T @ np.linalg.solve(np.eye(len(shown)) + seen @ shown.T, seen)
        here = found[last * count : last * count + wanted, last * count : last * count + wanted]
        out.append(here * np.outer(size[:wanted], size[:wanted]))
    return np.array(out)


@pytest.mark.parametrize("seed", range(5))
def test_the_recursion_is_the_inverse_of_the_whole_matrix(seed):
    slopes, prior, time_s = case(seed)
    size = np.sqrt(np.diag(prior))
    scale = np.outer(size, size)
    found = posterior_covariance_along(slopes, prior, 6, time_s, MEMORY)
    np.testing.assert_allclose(found / scale, dense(slopes, prior, time_s, MEMORY, 6) / scale, rtol=1e-9, atol=1e-9)


def test_without_memory_every_instant_stands_alone():
    slopes, prior, time_s = case(1)
    alone = posterior_covariance(slopes, prior, 3)
    np.testing.assert_allclose(posterior_covariance_along(slopes, prior, 3, time_s, np.zeros(6)), alone, rtol=1e-9)
    information = np.swapaxes(slopes, 1, 2) @ slopes + np.linalg.inv(prior)
    np.testing.assert_allclose(alone, np.linalg.inv(information)[:, :3, :3], rtol=1e-8)


def larger(one, two):
    """Whether ``one`` - ``two`` is positive semidefinite, to rounding, at every instant."""
    size = np.sqrt(np.diagonal(one, axis1=1, axis2=2))
    apart = (one - two) / (size[:, :, None] * size[:, None])
    return (np.linalg.eigvalsh(apart) > -1e-7).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.01, 0.99))
def test_more_information_never_raises_the_bound(seed, share):
    slopes, prior, time_s = case(seed)
    each = posterior_covariance(slopes, prior, 6)
    along = posterior_covariance_along(slopes, prior, 6, time_s, MEMORY)
    assert larger(each, along), "frames before this one"
    assert larger(each, posterior_covariance(slopes, share * prior, 6)), "narrower priors"
    assert larger(along, posterior_covariance_along(slopes, share * prior, 6, time_s, MEMORY))
    fewer = slopes.copy()
    fewer[: len(slopes) // 2, 1:] = 0.0
    assert larger(posterior_covariance_along(fewer, prior, 6, time_s, MEMORY), along), "more rows"


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(-np.pi, np.pi))
def test_turning_the_frame_turns_the_bound(seed, angle):
    slopes, _, time_s = case(seed)
    prior = np.diag([4.0, 4.0, 1.0, 1.0, 1.0, 1.0])  # the same in all directions
    turn = np.eye(6)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    slopes = slopes / np.abs(slopes).max(axis=(0, 1))
    for found, turned in (
        (posterior_covariance(slopes, prior, 2), posterior_covariance(slopes @ turn.T, prior, 2)),
        (
            posterior_covariance_along(slopes, prior, 2, time_s, MEMORY),
            posterior_covariance_along(slopes @ turn.T, prior, 2, time_s, MEMORY),
        ),
    ):
        np.testing.assert_allclose(turned, turn[:2, :2] @ found @ turn[:2, :2].T, rtol=1e-8, atol=1e-10)


def test_what_drifts_is_forgotten_and_what_stays_is_not():
    slopes = np.zeros((200, 1, 2))
    slopes[:100] = 10.0 * np.array([[1.0, 0.0], [0.0, 1.0]])[np.arange(100) % 2][:, None]
    found = posterior_covariance_along(slopes, np.eye(2), 2, np.arange(200.0), np.array([10.0, np.inf]))
    assert found[99, 0, 0] < 0.5
    assert found[199, 0, 0] == pytest.approx(1.0, abs=1e-3)
    assert found[199, 1, 1] == pytest.approx(found[99, 1, 1])


def test_an_unknown_without_a_width_is_refused():
    with pytest.raises(ValueError, match="needs a prior"):
        posterior_covariance(np.ones((1, 1, 2)), np.diag([1.0, 0.0]), 1)
    with pytest.raises(ValueError, match="not positive definite"):
        posterior_covariance(np.ones((1, 1, 2)), np.array([[1.0, 2.0], [2.0, 1.0]]), 1)
