"""The probability that a line of the locator is right: a line that is wrong but taken for right does most harm."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..types import FloatArray
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


MAX_SCORE = 3.0
"""A feature further from the mean, in standard deviations, says no more."""
# BEGIN: printed by python -m bench.locator.probability
MEANS = np.array([3.73, -0.338, 5.86, -3.7, -0.125, 0.0948, 0.154])
SPREADS = np.array([1.82, 0.226, 0.746, 0.545, 0.152, 0.817, 0.183])
WEIGHTS = np.array([
    2.22, 0.813, 0.483, 0.409, -0.278, 0.0171, -1.08, -0.392, -0.0667, -0.00505, 0.0809, 0.105,
    0.134, -0.282, 0.0234, 0.0294, -0.044, 0.0513, -0.291, 0.122, -0.158, -0.0669, 0.202, 0.214,
    0.0796, -0.0551, -0.132, -0.155, 0.0408, 0.0749, -0.197, -0.297, 0.22, 0.0113, -0.505, 0.17,
])  # fmt: skip
XRAY_LOG_ODDS = -1.28
# END
"""Weights of a logistic regression on the features, standardised, and their products, and the logit by which lines in
X-ray images are right less often: simulated sessions and composed scenes that were not used in training,
docs/results/locator.md."""

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


def standardised(features: FloatArray, means: FloatArray = MEANS, spreads: FloatArray = SPREADS) -> FloatArray:
    """Returns (n, k): 1, the standardised features, and the products of each two of them.

    Args:
        features: (n, 7) features.
        means: (7,) their means.
        spreads: (7,) their standard deviations.
    """
    scores = np.clip((features - means) / spreads, -MAX_SCORE, MAX_SCORE)
    rows, columns = np.triu_indices(scores.shape[1])
    return np.hstack([np.ones((len(scores), 1)), scores, scores[:, rows] * scores[:, columns]])


def probability(line: Located, log_odds: float = 0.0) -> float:
    """Returns the probability that ``line`` is right.

    Args:
        line: a line of the locator.
        log_odds: logit by which lines of this session are right more often: of its detector, and of X-ray.
    """
    return 1.0 / (1.0 + math.exp(-min(max(line_log_odds(line) + log_odds, -30.0), 30.0)))


def line_log_odds(line: Located) -> float:
    """Returns the logit of the probability that ``line`` of tipforce's own networks is right."""
    return float((standardised(np.array([line_features(line)])) @ WEIGHTS)[0])


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
