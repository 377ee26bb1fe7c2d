"""Probability that a force is above a value, from an estimate."""

import math
from statistics import NormalDist

import numpy as np

from ..types import ForceEstimate

STANDARD_DEVIATIONS_TO_END = NormalDist().inv_cdf(0.95)
"""Standard deviations from the middle to each end of a 90 % interval."""


def probability_above(estimate: ForceEstimate, force_n: float) -> float:
    """Returns the probability that the magnitude of the force is above ``force_n``.

    The magnitude is modelled by two halves of normal distributions with 5 % beyond each end of its 90 % interval. A
    lower end that was cut at 0 has no information; the lower half is then as wide as the upper one. Without an interval
    the standard deviation is that of the covariance along the force.

    Args:
        estimate: estimate of one instant.
        force_n: the value, N, above 0.

    Returns:
        0 to 1; NaN where the estimate is not valid, or holds neither a bounded interval nor a covariance.
    """
    if not estimate.valid:
        return math.nan
    magnitude = estimate.magnitude_n
    low, high = estimate.magnitude_interval_n.tolist()
    if math.isfinite(low) and math.isfinite(high):
        upper = max(high - magnitude, 0.0) / STANDARD_DEVIATIONS_TO_END
        lower = (
            max(magnitude - low, 0.0) / STANDARD_DEVIATIONS_TO_END
            if low > 0.0
            else max(upper, magnitude / STANDARD_DEVIATIONS_TO_END)
        )
    else:
        upper = lower = _deviation_n(estimate)
    sigma = upper if force_n >= magnitude else lower
    if not sigma > 0.0:
        return math.nan if math.isnan(sigma) else float(magnitude > force_n)
    return 0.5 * math.erfc((force_n - magnitude) / (sigma * math.sqrt(2.0)))


def _deviation_n(estimate: ForceEstimate) -> float:
    """Returns the standard deviation of the magnitude to first order; NaN where the covariance is unknown."""
    known = estimate.known
    covariance = estimate.covariance_n2[np.ix_(known, known)]
    if not known.any() or not np.isfinite(covariance).all():
        return math.nan
    force = estimate.force_n[known]
    size = float(np.linalg.norm(force))
    variance = force @ covariance @ force / size**2 if size > 0.0 else np.linalg.eigvalsh(covariance)[-1]
    return math.sqrt(max(0.0, float(variance)))
