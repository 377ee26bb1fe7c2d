"""Posterior covariance of unknowns that are measured linearly: the Bayesian Cramer-Rao bound at each instant."""

import math

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from ..types import FloatArray, frozen

_CHUNK_INSTANTS = 256


def posterior_covariance(slopes: FloatArray, prior: FloatArray, wanted: int) -> FloatArray:
    """Returns the covariance of the first ``wanted`` unknowns at each of m instants, independently of the others.

    The result is the inverse of information = slopes' slopes + inverse of the prior (van Trees 1968). It is exact for
    Gaussian unknowns that are measured linearly; for others it is the bound of an estimator that knows the point at
    which the slopes were computed.

    Args:
        slopes: (m, rows, unknowns) derivatives of the measurements, divided by their noise, so that every row has an
            independent error of standard deviation 1.
        prior: (unknowns, unknowns) covariance before the measurement.
        wanted: number of unknowns in the result.

    Returns:
        (m, wanted, wanted) covariances.

    Raises:
        ValueError: ``prior`` is not positive definite.

    >>> slopes = np.array([[[3.0, 0.0]], [[0.0, 0.0]]])
    >>> posterior_covariance(slopes, np.eye(2), 1).ravel()  # 1 / (9 + 1), and the prior
    array([0.1, 1. ])
    """
    # With prior = root root', the covariance is root (1 + (slopes root)' slopes root)^-1 root'.
    slopes = np.asarray(slopes, np.float64)
    root = _root(frozen("prior", prior, (slopes.shape[2], slopes.shape[2])))
    out = np.empty((len(slopes), wanted, wanted))
    for begin in range(0, len(slopes), _CHUNK_INSTANTS):
        scaled = slopes[begin : begin + _CHUNK_INSTANTS] @ root
        information = np.swapaxes(scaled, 1, 2) @ scaled + np.eye(root.shape[1])
        rows = np.broadcast_to(root[:wanted].T, (len(scaled), root.shape[1], wanted))
        half_factor = np.linalg.solve(np.linalg.cholesky(information), rows)
        out[begin : begin + _CHUNK_INSTANTS] = np.swapaxes(half_factor, 1, 2) @ half_factor
    return out


def posterior_covariance_along(
    slopes: FloatArray, prior: FloatArray, wanted: int, time_s: FloatArray, memory_s: FloatArray
) -> FloatArray:
    """Returns the covariance of the first ``wanted`` unknowns from all measurements up to each instant.

    It is the recursion of Tichavsky, Muravchik and Nehorai (1998): past unknowns are eliminated immediately, so that
    the cost of an instant does not depend on the number of earlier ones. Unknowns with correlated priors must have the
    same memory.

    Args:
        slopes: (m, rows, unknowns), see `posterior_covariance`.
        prior: (unknowns, unknowns) covariance before the measurement.
        wanted: number of unknowns in the result.
        time_s: (m,) instants.
        memory_s: (unknowns,) correlation time of each unknown, a stationary Gauss-Markov process (Ornstein-Uhlenbeck).
            Infinite: it is constant; 0: it is drawn anew at each instant.

    Returns:
        (m, wanted, wanted) covariances.

    Raises:
        ValueError: ``prior`` is not positive definite.

    >>> same = posterior_covariance_along(np.ones((3, 1, 1)), np.eye(1), 1, np.arange(3.0), np.array([np.inf]))
    >>> (1 / same).ravel().round(9)  # information adds up
    array([2., 3., 4.])
    """
    slopes = np.asarray(slopes, np.float64)
    m, _, count = slopes.shape
    prior, times = frozen("prior", prior, (count, count)), frozen("time_s", time_s, (m,))
    memory = frozen("memory_s", memory_s, (count,))
    root, eye = _root(prior), np.eye(count)
    out = np.empty((m, wanted, wanted))
    covariance = prior
    for row in range(m):
        if row:
            keep = np.array([_kept(times[row] - times[row - 1], each) for each in memory.tolist()])
            # An unknown keeps a share of its deviation; its variance returns towards that of the prior.
            share = np.outer(keep, keep)
            root = _root(share * covariance + (1.0 - share) * prior)
        scaled = slopes[row] @ root
        information_root = cholesky(scaled.T @ scaled + eye, lower=True, check_finite=False)
        half_factor = solve_triangular(information_root, root.T, lower=True, check_finite=False)
        covariance = half_factor.T @ half_factor
        out[row] = covariance[:wanted, :wanted]
    return out


def _kept(step_s: float, memory_s: float) -> float:
    """Returns the share of an unknown's deviation that remains after ``step_s``."""
    return math.exp(-step_s / memory_s) if memory_s > 0 else 0.0


def _root(covariance: FloatArray) -> FloatArray:
    """Returns the lower triangular matrix whose product with its transpose is the covariance."""
    # Scaled to one on the diagonal: the units of the unknowns differ by ten powers of ten.
    std = np.sqrt(np.diag(covariance))
    if not (std > 0).all():
        raise ValueError("every unknown needs a prior: a standard deviation above 0; leave out unknowns of exact value")
    try:
        return std[:, None] * cholesky(covariance / np.outer(std, std), lower=True, check_finite=False)
    except LinAlgError as error:
        raise ValueError("the covariance of the unknowns is not positive definite") from error
