"""The direction of the force in a session: it stays while the catheter presses on one place of the tissue.

A push along the tip's axis explains a line as well as no force, but few directions of an even prior are along the axis:
its probability alone would call such a push free. Other frames of the same contact, above all those with a larger
force, show the direction.
"""

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ...types import FloatArray
from ._mixture import DIRECTIONS_RAD
from ._walk import DIRECTIONS

_KERNEL_BINS = 1.4
"""Standard deviation with which a direction is blurred: 0.1 rad."""
_FRAMES_LEARNT = 0.5
"""All frames before count as this number of frames: the frame itself has most of their errors. 0.5, 1 and 2 were tried
on seeds 103000 and 104000: with 1 the intervals of pushes within 20 degrees of the axis held 82 % instead of 86."""
_OTHER_SHARE = 0.1
"""Probability that the direction has nothing to do with the one before; 0.05, 0.1, 0.2 and 0.3 were tried there."""
CENTRES_RAD = (np.arange(DIRECTIONS) + 0.5) * (2.0 * math.pi / DIRECTIONS) - math.pi
"""(DIRECTIONS,): middle of each bin."""


class DirectionMemory:
    """Likelihood of the force's direction by the last frames in contact, for each of ``bins`` directions."""

    def __init__(self, bins: int) -> None:
        self._log_likelihood, self._weight = np.zeros(bins), 0.0

    def add(self, likelihood: FloatArray, elapsed: float) -> None:
        """Adds a frame in contact.

        Args:
            likelihood: (bins,) of each direction in this frame; a common factor does not count.
            elapsed: time since the last frame that was added, in the time for which a direction is remembered.
        """
        highest = float(likelihood.max())
        if not 0.0 < highest < math.inf:
            return
        self._weight = math.exp(-elapsed) * self._weight + 1.0
        newest = np.log((1.0 - _OTHER_SHARE) * likelihood / highest + _OTHER_SHARE)
        self._log_likelihood += (newest - self._log_likelihood) / self._weight

    def over_prior(self, prior: FloatArray) -> FloatArray:
        """Returns the density (bins,) of the next frame's direction over its prior (bins,), up to a factor."""
        if self._weight == 0.0:
            return np.ones(len(prior))
        density = np.exp(_FRAMES_LEARNT * self._log_likelihood)
        return (1.0 - _OTHER_SHARE) * density / ((density @ prior) / prior.sum()) + _OTHER_SHARE


class SessionDirection(DirectionMemory):
    """The direction of the force, in the frame of the clamp, by the last frames in contact."""

    def __init__(self) -> None:
        super().__init__(DIRECTIONS)

    def learn(self, shares: FloatArray, elapsed: float) -> None:
        """Learns from a frame in contact.

        Args:
            shares: (DIRECTIONS,) likelihood of each direction in this frame; a common factor does not count.
            elapsed: see `add`.
        """
        self.add(gaussian_filter1d(shares, _KERNEL_BINS, mode="wrap"), elapsed)

    def density(self, tip_rad: float) -> FloatArray:
        """Returns the density (DIRECTIONS,) of the force's direction in the next frame, over an even one.

        Args:
            tip_rad: direction of the tip's axis in the frame of the clamp; forces push at the tip.
        """
        possible = -np.cos(CENTRES_RAD - tip_rad) > math.cos(0.5 * DIRECTIONS_RAD)
        return self.over_prior(possible.astype(np.float64))
