"""The probability that a detected centreline is right: a line that is wrong but taken for right does most harm."""

import math

_INTERCEPT = -2.73
_SEEN, _SEEN_END, _FLANKS, _FRONT, _UNKNOWN, _DIFFERENCE, _SCATTER = -5.69, -0.07, -2.04, -0.13, 8.37, 4.40, 3.19
"""Weights of a logistic regression on simulated sessions: docs/results/vision.md says which."""
_FAINT, _PLAIN = 0.05, 1.0
"""Contrasts at the end below and above these shares of that of the line say no more."""
_USUAL, _LARGE = 5.0, 20.0
"""Difference in grey levels from the template where that was not compared, and the unit of differences."""
_SMOOTH = 0.026
"""Unit of the scatter of the flanks about the curve: this share of the diameter."""


def probability_right(
    seen: float, seen_end: float, flanks: float, front: float, *, length_known: bool, difference: float, scatter: float
) -> float:  # fmt: skip
    """Returns the probability (0 to 1) that the tip and the line are where they were detected.

    Args:
        seen: share of the line on which both flanks are visible.
        seen_end: the same of the last 16 radii.
        flanks: contrast of the flanks before the tip in shares of that of the line.
        front: contrast of the front of the tip, likewise.
        length_known: the length was learnt in images, not only stated.
        difference: of the tip from its template in grey levels; 0 where that was not compared.
        scatter: distance of the flanks found from a smooth curve, in diameters.
    """
    wrong = (
        _INTERCEPT
        + _SEEN * seen
        + _SEEN_END * seen_end
        + _FLANKS * math.log(min(max(flanks, _FAINT), _PLAIN))
        + _FRONT * math.log(min(max(front, _FAINT), _PLAIN))
        + (0.0 if length_known else _UNKNOWN)
        + _DIFFERENCE * (difference or _USUAL) / _LARGE
        + _SCATTER * min(scatter / _SMOOTH, 2.0)
    )
    return 1.0 / (1.0 + math.exp(min(wrong, 50.0)))
