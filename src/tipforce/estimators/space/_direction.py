"""The direction of the force in space by the last frames in contact; see `session.DirectionMemory`."""

import math

import numpy as np

from ...types import FloatArray
from ..session import DIRECTIONS_RAD, DirectionMemory

_BINS = 300
_BLUR_RAD = 0.2
"""Standard deviation with which a direction is blurred: the distance of neighbouring bins."""
_LEAST_SHARE = 1e-4
"""Forces with a smaller share of the largest weight do not count."""
_LEAST_SINE = 0.1
"""The prior is even in the angle to the tip's axis. As a density over the sphere it ends near the axis at this sine."""


def _even_directions(count: int) -> FloatArray:
    """Returns (count, 3) unit vectors, evenly over the sphere (Fibonacci lattice)."""
    number = np.arange(count) + 0.5
    z = 1.0 - 2.0 * number / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * number
    across = np.sqrt(1.0 - z**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


_CENTRES = _even_directions(_BINS)


class SpaceDirection(DirectionMemory):
    """The direction of the force, in the frame of the base, by the last frames in contact."""

    def __init__(self) -> None:
        super().__init__(_BINS)

    def learn(self, force_n: FloatArray, likelihood: FloatArray, elapsed: float) -> None:
        """Learns from a frame in contact.

        Args:
            force_n: (n, 3) forces.
            likelihood: (n,) their likelihoods, for the direction of each alone.
            elapsed: time since the last frame that taught, in the time for which a direction is remembered.
        """
        use = likelihood > _LEAST_SHARE * likelihood.max()
        units = force_n[use] / np.maximum(np.linalg.norm(force_n[use], axis=1), 1e-9)[:, None]
        self.add(likelihood[use] @ np.exp((units @ _CENTRES.T - 1.0) / _BLUR_RAD**2), elapsed)

    def density(self, force_n: FloatArray, tip_axis: FloatArray) -> FloatArray:
        """Returns (n,): the density of the directions of ``force_n`` (n, 3) in the next frame, over their prior.

        Args:
            force_n: forces.
            tip_axis: (3,) unit vector along the tip; forces push at the tip.
        """
        cosine = -_CENTRES @ tip_axis
        prior = (cosine > math.cos(0.5 * DIRECTIONS_RAD)) / np.maximum(np.sqrt(1.0 - cosine**2), _LEAST_SINE)
        return self.over_prior(prior)[np.argmax(force_n @ _CENTRES.T, axis=1)]
