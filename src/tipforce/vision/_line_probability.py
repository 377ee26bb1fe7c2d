"""The probability that a line of the locator is right: a line that is wrong but taken for right does most harm."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .locator import Located

MAX_LOGIT = 6.0
"""Larger logits say no more."""


class LineFeatures(NamedTuple):
    """Features that separate a right line from a wrong one."""

    right: float
    """Logit of the second network that the strip is the catheter's."""
    mass: float
    """Logarithm of the mean mass of the rough points."""
    present: float
    """Logit that a catheter is in the image."""
    spread: float
    """Logarithm of the median error of the offsets."""
    tip_peak: float
    """Logarithm of the peak of the tip, where the tip is seen."""
    bend: float
    """Logarithm of the largest curvature."""
    misfit: float
    """Median distance of the rough points from the line, in diameters."""


INTERCEPT = -12.301
WEIGHTS = LineFeatures(0.105, 4.98, 1.37, -2.14, 4.24, -2.63, -1.69)
"""Weights of a logistic regression on simulated sessions that were not used in training: docs/results/locator.md."""

PRIOR_STD = 1.5
"""Standard deviation of ``log_odds`` before a line of the fine-tuned detector is judged."""
NEWTON_STEPS = 20


def line_features(line: Located) -> LineFeatures:
    """Returns the features of ``line``."""
    return LineFeatures(
        float(np.clip(line.right, -MAX_LOGIT, MAX_LOGIT)),
        math.log(max(line.mass, 0.05)),
        float(np.clip(math.log(line.present / max(1.0 - line.present, 1e-9)), -MAX_LOGIT, MAX_LOGIT)),
        math.log(max(line.spread, 0.01)),
        math.log(max(line.tip_peak, 0.05)) * line.tip_seen,
        math.log(max(line.bend, 0.5)),
        min(line.misfit, 2.0),
    )


def probability(line: Located, log_odds: float = 0.0) -> float:
    """Returns the probability that ``line`` is right.

    Args:
        line: a line of the locator.
        log_odds: by this much a fine-tuned detector's lines are right more often (logit) than those of tipforce's own.
    """
    return 1.0 / (1.0 + math.exp(-min(max(line_log_odds(line) + log_odds, -30.0), 30.0)))


def line_log_odds(line: Located) -> float:
    """Returns the logit of the probability that ``line`` of tipforce's own networks is right."""
    return INTERCEPT + sum(weight * sign for weight, sign in zip(WEIGHTS, line_features(line), strict=True))


def fitted_log_odds(scores: Sequence[float], right: Sequence[bool]) -> float:
    """Returns the ``log_odds`` of a fine-tuned detector from lines in annotated images that it was not trained on.

    It is the most probable value where little is known beforehand: a normal distribution around 0 with the standard
    deviation `PRIOR_STD`. Two right lines that had a probability of 0.5 raise it by 1.1, without a line it is 0.

    Args:
        scores: `line_log_odds` of each line.
        right: whether it is right.
    """
    found, wanted, given = 0.0, np.asarray(right, np.float64), np.asarray(scores, np.float64)
    for _ in range(NEWTON_STEPS):
        expected = 1.0 / (1.0 + np.exp(-np.clip(given + found, -30.0, 30.0)))
        slope = float((wanted - expected).sum()) - found / PRIOR_STD**2
        found += slope / (float((expected * (1.0 - expected)).sum()) + PRIOR_STD**-2)
    return found
