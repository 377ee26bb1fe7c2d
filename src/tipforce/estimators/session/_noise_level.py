"""How much larger than stated a session's line noise is, learnt from how well the rod explains the lines.

The noise of a detected centreline differs between sessions by more than any constant allows: on `generalise` from a
third of the stated value to ten times as much (blur, light, background, hidden stretches). If the level is too small,
forces and constants explain the noise instead: the estimates are then wrong, with narrow intervals.
"""

import math

from ._settings import NoiseSettings

_USUAL_MISFIT = 0.15
"""Mean square misfit up to which the noise is as stated: 0.07 to 0.2 in sessions of `bench-2021`, whose errors last
longer than their model says, so that the stated ones are large."""
_CLIP = 6.0
"""Largest ratio of a frame's variance to the previous one with which it counts: an outlier is not the level."""


class NoiseLevel:
    """``factor``, at least 1: the noise across the line over the stated noise, as standard deviations.

    Each misfit is an estimate of the variance. Their average forgets with the time constant ``memory_s``; the stated
    level counts in it as ``level_frames`` frames (mode of a scaled inverse chi-squared distribution).
    """

    def __init__(self, settings: NoiseSettings, memory_s: float) -> None:
        self._settings, self._memory_s = settings, memory_s
        self._weight = self._sum = 0.0
        self.factor = 1.0

    def add(self, misfit: float, elapsed_s: float) -> None:
        """Changes ``factor`` by the misfit of one more line.

        Args:
            misfit: mean square of the line's residuals, in the variances of the noise at the present ``factor``.
            elapsed_s: time since the line before.
        """
        line_variance = self.factor**2 * min(_CLIP, misfit / _USUAL_MISFIT)
        keep = math.exp(-elapsed_s / self._memory_s)
        self._weight, self._sum = keep * self._weight + 1.0, keep * self._sum + line_variance
        stated_frames = self._settings.level_frames  # weight of the stated level, whose variance is 1
        level = math.sqrt(max(1.0, (self._sum + stated_frames) / (self._weight + stated_frames)))
        self.factor = _in_steps(level)


def noisier(level: float, misfit: float) -> float:
    """Returns the level of the noise at which a line would have the usual misfit, from its ``misfit`` at ``level``."""
    return _in_steps(level * math.sqrt(max(1.0, misfit / _USUAL_MISFIT)))


def _in_steps(level: float) -> float:
    """Returns the level in steps of a twentieth: the noise is computed again at each step."""
    step = math.log(1.05)
    return math.exp(step * round(math.log(level) / step))
