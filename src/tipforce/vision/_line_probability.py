"""The probability that a line of the locator is right: a line that is wrong but taken for right does most harm."""

import math
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


def probability(line: Located) -> float:
    """Returns the probability that ``line`` is right."""
    score = INTERCEPT + sum(weight * sign for weight, sign in zip(WEIGHTS, line_features(line), strict=True))
    return 1.0 / (1.0 + math.exp(-min(max(score, -30.0), 30.0)))
