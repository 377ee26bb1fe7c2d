"""The probability that a line of the locator is right: a line that is wrong but taken for right does most harm."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._locate import Located

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
    ends: float
    """Distance of the rough ends from those of the line, in lengths."""


MAX_ENDS_APART = 0.2
"""Ends that are further apart, in lengths, say no more."""
MAX_SCORE = 3.0
"""A feature further from the mean, in standard deviations, says no more."""
# BEGIN: printed by python -m bench.locator.probability
MEANS = np.array([3.02, -0.375, 5.69, -3.61, -0.163, 0.098, 0.148, 0.0365])
SPREADS = np.array([2.14, 0.305, 1.02, 0.633, 0.165, 0.81, 0.176, 0.0367])
WEIGHTS = np.array([
    1.53, 0.935, 0.919, 0.459, -0.81, 0.187, -0.22, -0.364, -0.456,
])  # fmt: skip
XRAY_LOG_ODDS, MARKED_LOG_ODDS = -1.1, 0.602
# END
"""Weights of a logistic regression on the features, standardised, the constant first, and the logits by which lines are
right more often in X-ray images, and where a user has marked the base: simulated sessions and composed scenes that were
not used in training, docs/results/locator.md."""

UNMARKED_XRAY_LOG_ODDS = -0.8
"""Logit that is added in X-ray images where no base is marked: a line along another instrument has the features of a
right one. Chosen with an earlier line network on 74 sessions of `fluoro` and `biplane`, of which 9 show another
instrument in most frames."""

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
        min(line.ends_apart, MAX_ENDS_APART),
    )


def standardised(features: FloatArray, means: FloatArray = MEANS, spreads: FloatArray = SPREADS) -> FloatArray:
    """Returns (n, 9): 1, and the features in standard deviations from their means.

    Args:
        features: (n, 8) features.
        means: (8,) their means.
        spreads: (8,) their standard deviations.
    """
    scores = np.clip((features - means) / spreads, -MAX_SCORE, MAX_SCORE)
    return np.hstack([np.ones((len(scores), 1)), scores])


def probability(line: Located, log_odds: float = 0.0) -> float:
    """Returns the probability that ``line`` is right.

    Args:
        line: a line of the locator.
        log_odds: logit by which lines of this session are right more often: of its detector, X-ray, a marked base.
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
