"""The probability that a located line is right."""

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._locate import Located


class Signs(NamedTuple):
    """Features that separate a right line from a wrong one; logarithms but for the first and the last.

    In order: logit of the second network; mean mass of the rough points; the offsets' median error, and the largest one
    before the tip; the peaks' probabilities of base and tip; how far the length is off the session's, in steps of 2 %.
    """

    right: float
    mass: float
    spread: float
    end_spread: float
    base_peak: float
    tip_peak: float
    length_off: float


_INTERCEPT = -0.38
_WEIGHTS = Signs(0.0993, 2.07, 0.0887, -0.858, 2.44, 6.32, -0.262)
"""Weights of a logistic regression on simulated sessions that were not used in training (docs/results/vision.md)."""
_MOST = 6.0
"""Larger logits say no more."""
_SUREST = 0.5


def consensus(found: Sequence[Located]) -> tuple[FloatArray, float]:
    """The base (2,) and the length in px that most of ``found``, lines of one session, agree on.

    The half in which the ends are least clear does not count.
    """
    surest = sorted(found, key=lambda each: -each.tip_peak * each.base_peak)[: math.ceil(_SUREST * len(found))]
    base = np.median([each.points[0] for each in surest], axis=0)
    return np.asarray(base, np.float64), statistics.median(each.length_px for each in surest)


def signs(located: Located, length_px: float) -> Signs:
    """``length_px``: of the catheter in most images of the session."""
    return Signs(
        float(np.clip(located.right, -_MOST, _MOST)),
        float(np.log(np.maximum(located.mass, 0.02)).mean()),
        math.log(max(located.spread, 0.01)),
        math.log(max(located.end_spread, 0.01)),
        math.log(max(located.base_peak, 0.05)),
        math.log(max(located.tip_peak, 0.05)),
        min(abs(located.length_px / length_px - 1.0) / 0.02, 4.0),
    )


def probability(signs: Signs) -> float:
    """Returns the probability that a line with these ``signs`` is right."""
    score = _INTERCEPT + sum(weight * sign for weight, sign in zip(_WEIGHTS, signs, strict=True))
    return 1.0 / (1.0 + math.exp(-min(max(score, -30.0), 30.0)))
