"""Intervals in standard deviations, of methods that state a covariance with each force."""

import math

import numpy as np
import numpy.typing as npt

from ...types import BoolArray, FloatArray
from ._conformal import Interval, interval_from_errors

GAUSS_90 = 1.6448536269514722
"""Half the 90 % interval of a Gaussian, in standard deviations."""


def gaussian_interval(known: BoolArray, basis: str) -> Interval:
    """Returns the 90 % interval of a Gaussian, which has not been compared with forces.

    Args:
        known: (3,) which components it is for.
        basis: basis of the interval in words.
    """
    half = np.where(known, GAUSS_90, np.nan)
    covariance = np.where(np.eye(3, dtype=np.bool_) & known, 1.0, np.where(np.outer(known, known), 0.0, np.nan))
    return Interval(half, GAUSS_90, covariance, False, basis, 0, 0)


def normalised_interval(
    known: BoolArray,
    predicted: FloatArray,
    covariance: FloatArray,
    truth: FloatArray,
    session: npt.NDArray[np.str_],
    sampling: str,
) -> Interval:
    """Returns the intervals as `conformal_interval` does, in standard deviations.

    Args:
        known: (3,) which components are estimated.
        predicted: (n, t) estimated forces, N.
        covariance: (n, t, t) their covariances, N^2; the errors are divided by their standard deviations.
        truth: (n, t) measured forces, N.
        session: (n,) sessions.
        sampling: how the samples were drawn; empty: whole sessions were held out.
    """
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    unit = np.array([magnitude_sigma(f, c) for f, c in zip(predicted, covariance, strict=True)])
    estimate, force = np.linalg.norm(predicted, axis=1), np.linalg.norm(truth, axis=1)
    components = (predicted - truth) / sigma
    return interval_from_errors(
        known, components, estimate, force, unit, session, held_out=not sampling, sampling=sampling
    )


def magnitude_sigma(force: FloatArray, covariance: FloatArray) -> float:
    """Returns the standard deviation of the magnitude of a force: that of the component along the force.

    A force near zero has no direction: the result changes smoothly to the mean over all directions.

    Args:
        force: (t,) components in newtons.
        covariance: (t, t) their covariance in N^2.

    Returns:
        The standard deviation in newtons.
    """
    mean_variance = float(np.trace(covariance)) / len(force)
    square = float(force @ force) + mean_variance
    weighted = float(force @ covariance @ force) + mean_variance**2
    return math.sqrt(weighted / square)
