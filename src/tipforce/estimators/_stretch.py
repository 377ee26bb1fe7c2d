"""A correction of large forces, which an estimator reads too small.

A least-squares fit is right on the mean of the samples that look alike. Where the image is ambiguous, its estimate
therefore tends to the most frequent forces, and large forces are read too small. On separate sessions the estimate is
a line over the true force with a slope below 1. The inverse of that line (classical calibration: Eisenhart, "The
interpretation of certain regression methods", Annals of Mathematical Statistics 10 (1939), 162-186) removes the mean
error of large forces.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import FloatArray

MIN_CONTACT_N = 0.03
"""Forces above this are contact: the noise of a force sensor is smaller."""
MIN_SESSIONS, MIN_FRAMES = 10, 200
STRETCH_SHARES = (1.0, 0.75, 0.5, 0.25)
MIN_SLOPE = 0.5
MIN_MAGNITUDE_N = 1e-9


@dataclass(frozen=True, slots=True)
class Stretch:
    """Increases a magnitude by a share of its part above a threshold; smaller ones stay.

    Attributes:
        gain: the share.
        from_n: the threshold in newtons.

    >>> Stretch(0.1, 0.05).ratio(np.array([0.04, 0.25])).round(3).tolist()
    [1.0, 1.08]
    """

    gain: float
    from_n: float

    def ratio(self, magnitude_n: FloatArray) -> FloatArray:
        """Returns the ratio of the stretched magnitudes to ``magnitude_n``, for any shape."""
        return 1.0 + self.gain * np.maximum(0.0, 1.0 - self.from_n / np.maximum(magnitude_n, MIN_MAGNITUDE_N))


NO_STRETCH = Stretch(0.0, 0.0)


def fit_stretch(estimate_n: FloatArray, truth_n: FloatArray, session: npt.NDArray[np.str_]) -> Stretch:
    """Returns the stretch of an estimator from sessions that it was not trained on.

    It is the inverse of the line, or 3/4, 1/2 or 1/4 of it: the largest of these that does not increase the mean error
    of the frames in contact (above 30 mN), where the line of each session is fitted to the others. There is no stretch
    where all increase it, or with fewer than 10 sessions or 200 such frames.

    Args:
        estimate_n: (n,) estimated magnitudes.
        truth_n: (n,) true magnitudes.
        session: (n,) session of each.
    """
    touching = truth_n > MIN_CONTACT_N
    estimate_n, truth_n, session = estimate_n[touching], truth_n[touching], session[touching]
    names = np.unique(session)
    if len(names) < MIN_SESSIONS or len(session) < MIN_FRAMES:
        return NO_STRETCH
    errors = np.zeros(len(STRETCH_SHARES))
    for name in names:
        own = session == name
        line = _line(estimate_n[~own], truth_n[~own])
        for k, share in enumerate(STRETCH_SHARES):
            errors[k] += np.abs(estimate_n[own] * _part(line, share).ratio(estimate_n[own]) - truth_n[own]).sum()
    harmless = np.flatnonzero(errors <= np.abs(estimate_n - truth_n).sum())
    return _part(_line(estimate_n, truth_n), STRETCH_SHARES[harmless[0]]) if len(harmless) else NO_STRETCH


def _line(estimate_n: FloatArray, truth_n: FloatArray) -> Stretch:
    """Returns the whole stretch: the inverse of the line of the estimate over the truth, above their intersection."""
    slope, offset = np.polyfit(truth_n, estimate_n, 1).tolist()
    if slope >= 1.0:
        return NO_STRETCH
    return Stretch(1.0 / max(slope, MIN_SLOPE) - 1.0, max(0.0, offset / (1.0 - slope)))


def _part(whole: Stretch, share: float) -> Stretch:
    return Stretch(share * whole.gain, whole.from_n)
