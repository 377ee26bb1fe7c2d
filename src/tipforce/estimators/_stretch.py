"""Large forces that an estimator draws to the usual ones, stretched back.

Least squares makes an estimate that is right on the mean of what it looks like: where it is unsure it is drawn to the
forces that occur most, and a large force is read too small. On sessions apart the estimate is a line over the true
force, whose slope is below 1; the inverse of that line (classical calibration: Eisenhart, "The interpretation of
certain regression methods", Annals of Mathematical Statistics 10 (1939), 162-186) takes the mean error from the large
forces.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import FloatArray

_TOUCHING_N = 0.03
"""Beyond the noise of a force sensor."""
_LEAST_SESSIONS, _LEAST_FRAMES = 10, 200
_SHARES = (1.0, 0.75, 0.5, 0.25)
_LEAST_SLOPE = 0.5
_NOTHING_N = 1e-9


@dataclass(frozen=True, slots=True)
class Stretch:
    """A magnitude grows by ``gain`` times what it has above ``from_n`` newtons; smaller ones stay.

    >>> Stretch(0.1, 0.05).ratio(np.array([0.04, 0.25])).round(3).tolist()
    [1.0, 1.08]
    """

    gain: float
    from_n: float

    def ratio(self, magnitude_n: FloatArray) -> FloatArray:
        """The stretched magnitudes over ``magnitude_n``, of any shape."""
        return 1.0 + self.gain * np.maximum(0.0, 1.0 - self.from_n / np.maximum(magnitude_n, _NOTHING_N))


NO_STRETCH = Stretch(0.0, 0.0)


def fit_stretch(estimate_n: FloatArray, truth_n: FloatArray, session: npt.NDArray[np.str_]) -> Stretch:
    """The stretch of an estimator, from its magnitudes (n,) and the true ones (n,) in sessions (n,) that it never saw.

    The inverse of the line, or 3/4, 1/2 or 1/4 of it: the largest of these that does not enlarge the mean error of the
    frames that touch (above 30 mN), each session judged by the line of the others. None where none does so, and with
    fewer than 10 sessions or 200 such frames.
    """
    touching = truth_n > _TOUCHING_N
    estimate_n, truth_n, session = estimate_n[touching], truth_n[touching], session[touching]
    names = np.unique(session)
    if len(names) < _LEAST_SESSIONS or len(session) < _LEAST_FRAMES:
        return NO_STRETCH
    errors = np.zeros(len(_SHARES))
    for name in names:
        own = session == name
        line = _line(estimate_n[~own], truth_n[~own])
        for k, share in enumerate(_SHARES):
            errors[k] += np.abs(estimate_n[own] * _part(line, share).ratio(estimate_n[own]) - truth_n[own]).sum()
    free = np.flatnonzero(errors <= np.abs(estimate_n - truth_n).sum())
    return _part(_line(estimate_n, truth_n), _SHARES[free[0]]) if len(free) else NO_STRETCH


def _line(estimate_n: FloatArray, truth_n: FloatArray) -> Stretch:
    """The whole stretch: the inverse of the line of the estimate over the truth, above where they are the same."""
    slope, offset = np.polyfit(truth_n, estimate_n, 1).tolist()
    if slope >= 1.0:
        return NO_STRETCH
    return Stretch(1.0 / max(slope, _LEAST_SLOPE) - 1.0, max(0.0, offset / (1.0 - slope)))


def _part(whole: Stretch, share: float) -> Stretch:
    return Stretch(share * whole.gain, whole.from_n)
