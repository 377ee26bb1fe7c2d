"""From the geometry of the contact to the force: the session learns the tissue's law.

A network reads how deep the tip presses into the tissue (`ContactReading`), and knows neither stiffness nor tissue. The
law of the tissue is one of three (linear, Hertz, exponential) with one of many stiffnesses; each of these hypotheses
has a probability, which grows where the depths agree with the forces that the shaft shows well. The depth then shows
the force along the chord, of which the shape shows little.

The session also learns whether its tissue is visible. An image of a visible tissue that is not touched shows that there
is no contact; an image without a visible tissue shows nothing.
"""

import math

import numpy as np
from scipy.special import erf, i0e

from ...types import FloatArray
from ...vision.contact import DEPTH_M, ContactReading
from ._mixture import DIRECTIONS_RAD, EVEN_DIRECTIONS, Evidence
from ._settings import ContactSettings

_STIFFNESSES = 36
_LAW_DEPTH_M = 2e-3
"""The stiffness of a law is that of its secant at this depth."""
_FORCES = 161
"""Number of forces at which the density of a depth is tabulated."""
_LEAST_STRENGTH = 1e-6
_STUDENT = 4.0
"""Degrees of freedom of the depth's error, whose distribution is Student's: outliers are frequent."""


def _depths(force_n: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Returns the depths (3, stiffnesses, forces) of forces by the three laws, m."""
    ratio = force_n / (stiffness[:, None] * _LAW_DEPTH_M)
    return _LAW_DEPTH_M * np.stack([ratio, ratio ** (2.0 / 3.0), np.log1p((math.e - 1.0) * ratio)])


class Tissue:
    """The probabilities of the laws of a session's tissue.

    Args:
        settings: the settings.
        largest_n: the prior of the force ends here.
        stated_n_per_m: stiffness that the metadata states; None: none.

    Attributes:
        force_n: (n,) forces at which the density of a depth is tabulated.
    """

    def __init__(self, settings: ContactSettings, largest_n: float, stated_n_per_m: float | None) -> None:
        self._settings = settings
        self._stiffness = np.geomspace(settings.softest_n_per_m, settings.stiffest_n_per_m, _STIFFNESSES)
        log_prior = np.zeros((3, _STIFFNESSES))  # three laws, each as probable as the others
        if stated_n_per_m is not None:  # a log-normal prior about the stated stiffness
            log_prior -= 0.5 * (np.log(self._stiffness / stated_n_per_m) / settings.stated_stiffness) ** 2
        self._log_prior, self._log_likelihood, self._frames = log_prior, np.zeros(log_prior.shape), 0
        self._shares = _normalised(log_prior)
        self._visible = settings.visible_share
        self.force_n = np.linspace(0.0, largest_n, _FORCES)
        self._expected, self._spread = self._depth_of(self.force_n)

    @property
    def stiffness_n_per_m(self) -> tuple[float, float]:
        """Mean stiffness, and the standard deviation of its logarithm."""
        share, log = self._shares.sum(axis=0), np.log(self._stiffness)
        mean = float(share @ log)
        return math.exp(mean), math.sqrt(float(share @ (log - mean) ** 2))

    def contact_log_odds(self, reading: ContactReading) -> float:
        """Returns the logarithm of the Bayes factor of contact."""
        unseen = 1.0 - self._visible
        return math.log(self._visible * reading.touched + unseen) - math.log(self._visible * reading.clear + unseen)

    def look(self, reading: ContactReading, weight: float) -> None:
        """Learns from an image whether the tissue is visible in this session, with or without contact.

        Args:
            reading: the reading.
            weight: share of the image's information that is new, at most 1: images soon after each other are alike.
        """
        largest, least = self._settings.largest_log_odds, 1.0 - self._settings.largest_visible_share
        log_factor = math.log(0.5 * (reading.touched + reading.clear))  # Bayes factor of "visible"
        odds = self._visible / (1.0 - self._visible)
        odds *= math.exp(min(1.0, weight) * max(-largest, min(largest, log_factor)))
        self._visible = min(1.0 - least, max(least, odds / (1.0 + odds)))

    def _depth_of(self, force_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns mean and standard deviation of ``asinh(depth / DEPTH_M)``, each (3 laws, stiffnesses, forces)."""
        ratio = _depths(force_n, self._stiffness) / DEPTH_M
        return np.arcsinh(ratio), self._settings.law_error * ratio / np.sqrt(1.0 + ratio**2)

    def density(self, reading: ContactReading) -> FloatArray:
        """Returns the likelihood (forces,) of the read depth at each of ``force_n``, divided by its mean.

        It is averaged over all laws and stiffnesses with their probabilities.
        """
        likelihood = _student(reading, self._expected, self._spread)
        density = np.einsum("ls,lsf->f", self._shares, likelihood)
        mean = float(density.mean())
        return density / mean if mean > 0.0 else np.ones_like(density)

    def learn(self, reading: ContactReading, force_n: FloatArray, shares: FloatArray) -> None:
        """Learns the law from a frame in which the shaft shows the force; no law is ever given up.

        The errors of the shape are much the same in all frames of a session. So the frames are not independent: all of
        them together count as ``frames_learnt``, by the mean logarithm of their likelihood.

        Args:
            reading: the depth.
            force_n: (k,) possible forces by the shape alone, N.
            shares: (k,) their probabilities.
        """
        expected, spread = self._depth_of(force_n)
        likelihood = _student(reading, expected, spread) @ shares
        highest, settings = float(likelihood.max()), self._settings
        if highest <= 0.0 or not math.isfinite(highest):
            return
        self._frames += 1
        self._log_likelihood += np.log(
            (1.0 - settings.unreliable_share) * likelihood / highest + settings.unreliable_share
        )
        self._shares = _normalised(self._log_prior + settings.frames_learnt * self._log_likelihood / self._frames)


def _normalised(log_shares: FloatArray) -> FloatArray:
    """Returns the probabilities whose logarithms are ``log_shares`` up to a constant."""
    shares = np.exp(log_shares - log_shares.max())
    return np.asarray(shares / shares.sum(), np.float64)


def _student(reading: ContactReading, expected: FloatArray, spread: FloatArray) -> FloatArray:
    variance = reading.depth_std**2 + spread**2
    error = (reading.depth - expected) ** 2 / (_STUDENT * variance)
    return np.asarray((1.0 + error) ** (-0.5 * (_STUDENT + 1.0)) / np.sqrt(variance), np.float64)


def evidence_of(reading: ContactReading, tip_rad: float, tissue: Tissue, settings: ContactSettings) -> Evidence:
    """Returns the evidence on the force that a reading of the tip's image adds to the shape of the line.

    Args:
        reading: the reading.
        tip_rad: direction of the tip's axis in the frame of the clamp, whose y axis points up in the image.
        tissue: the law of the tissue.
        settings: weights.
    """
    log_odds = settings.odds_share * tissue.contact_log_odds(reading)
    limit, towards_rad = settings.largest_log_odds, tip_rad - reading.turn_rad  # the image's angles turn the other way
    # 1 / concentration is a variance: that of the reading, and that between its direction and the force
    strengths = 1.0 / (1.0 / max(reading.strength, _LEAST_STRENGTH) + np.square(settings.direction_errors_rad))
    # a tissue pushes: heights are densities over an even one in the directions of a push; the erf is the share of the
    # distribution in these, as of a Gaussian
    share_inside = np.maximum(0.5, erf(0.5 * DIRECTIONS_RAD * np.sqrt(0.5 * strengths)))
    heights = DIRECTIONS_RAD / (2.0 * math.pi) / i0e(strengths) / share_inside
    return Evidence(
        max(-limit, min(limit, log_odds)), math.cos(towards_rad), math.sin(towards_rad), strengths, heights,
        tissue.density(reading), settings.unreliable_share, EVEN_DIRECTIONS,
    )  # fmt: skip
