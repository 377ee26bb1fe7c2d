"""The probability that a line of the locator is right: a line that is wrong but taken for right does most harm."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._locate import Located

MAX_PRESENT, MAX_RIGHT = 6.0, 8.0
"""Larger logits say no more: that a catheter is in the image, and that a part of the strip is the catheter's."""


class LineFeatures(NamedTuple):
    """Features that separate a right line from a wrong one."""

    right_base: float
    """Logit of the second network near the base that the strip is the catheter's."""
    right_body: float
    """The same between the ends."""
    right_tip: float
    """The same near the tip."""
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
# BEGIN camera: written by python -m bench.locator.probability
MEANS = np.array([4.81, 1.07, 3.44, -0.37, 5.71, -3.61, -0.16, 0.0597, 0.149, 0.0365])
SPREADS = np.array([4.23, 1.24, 4.19, 0.322, 1.05, 0.626, 0.156, 0.811, 0.174, 0.0378])
WEIGHTS = np.array([
    1.37, 0.337, 0.905, 0.0734, 1.03, 0.936, -0.739, 0.0905, -0.259, -0.639, -0.722,
])  # fmt: skip
MARKED_LOG_ODDS = 0.709
# END camera
"""Weights of a logistic regression on the features, standardised, the constant first, and the logit by which lines are
right more often where a user has marked the base: simulated sessions and composed scenes that were not used in
training, docs/results/locator.md."""
# BEGIN X-ray: written by python -m bench.locator.probability
XRAY_WEIGHTS = np.array([
    -0.419, 0.732, 0.914, 0.626, -0.082, 0.272, -1.45, 0.368, -0.944, -0.0658, -1.01,
])  # fmt: skip
# END X-ray
"""The same for lines in X-ray images, with the means and spreads above; sessions of `fluoro`, `biplane` and their
varied presets, docs/results/locator.md."""

PRIOR_STD = 1.5
"""Standard deviation of ``log_odds`` before a line of the fine-tuned detector is judged."""
NEWTON_STEPS = 20


def line_features(line: Located) -> LineFeatures:
    """Returns the features of ``line``.

    Values that differ by factors count by their logarithm. Each is limited where larger or smaller values are too rare
    to say more. The peak of a hidden tip says nothing, so it counts by the probability that the tip is seen.
    """
    return LineFeatures(
        _at_most(line.right_base, MAX_RIGHT),
        _at_most(line.right_body, MAX_RIGHT),
        _at_most(line.right_tip, MAX_RIGHT),
        math.log(max(line.mass, 0.05)),
        _at_most(math.log(line.present / max(1.0 - line.present, 1e-9)), MAX_PRESENT),
        math.log(max(line.spread, 0.01)),
        math.log(max(line.tip_peak, 0.05)) * line.tip_seen,
        math.log(max(line.bend, 0.5)),
        min(line.misfit, 2.0),
        min(line.ends_apart, MAX_ENDS_APART),
    )


def _at_most(logit: float, largest: float) -> float:
    """Returns ``logit``, but at most ``largest`` in magnitude."""
    return min(max(logit, -largest), largest)


def standardised(features: FloatArray, means: FloatArray = MEANS, spreads: FloatArray = SPREADS) -> FloatArray:
    """Returns (n, 11): 1, and the features in standard deviations from their means.

    Args:
        features: (n, 10) features.
        means: (10,) their means.
        spreads: (10,) their standard deviations.
    """
    scores = np.clip((features - means) / spreads, -MAX_SCORE, MAX_SCORE)
    return np.hstack([np.ones((len(scores), 1)), scores])


def probability(line: Located, log_odds: float = 0.0) -> float:
    """Returns the probability that ``line`` is right.

    Args:
        line: a line of the locator.
        log_odds: logit by which lines of this session are right more often: of its detector, of a marked base.
    """
    return 1.0 / (1.0 + math.exp(-min(max(line_log_odds(line) + log_odds, -30.0), 30.0)))


def line_log_odds(line: Located) -> float:
    """Returns the logit of the probability that ``line`` of tipforce's own networks is right."""
    weights = XRAY_WEIGHTS if line.xray else WEIGHTS
    return float((standardised(np.array([line_features(line)])) @ weights)[0])


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
