"""Constants and slow states of a session: their Gaussian, and how it changes with time and with the knob."""

import math

import numpy as np

from ...mechanics.planar import FORCE, UNKNOWNS, Line, Model
from ...types import FloatArray, SessionInfo
from ._knowledge import Knowledge, knob_gain_std
from ._line_error import MODES, LineError
from ._lines import POINTS
from ._settings import RodSettings, RodTrackSettings
from ._walk import EXTRA

CAMERA = 4
"""Errors of the image that stay for a session: stretch, shear, and the bend out of the plane along x and y."""
COUNT = len(UNKNOWNS) + MODES + CAMERA + EXTRA
"""Unknowns: of the rod, lasting errors of the line, errors of the image, then those of `Session`."""
ROD = len(UNKNOWNS)
K0, ANGLE, X, Y = (UNKNOWNS.index(name) for name in ("precurvature_per_m", "base_angle_rad", "base_x_m", "base_y_m"))
GAIN, PLAY, LEVER = COUNT - 3, COUNT - 2, COUNT - 1
LEAST_PLAY_DEG2 = 1e-4
"""Least variance of the position in the play."""
_PLAY_LEFT_OUT = 0.02
"""The end of the play is known to this share of the angle by which the knob turns."""


class SessionState:
    """``mean`` (COUNT,) and ``covariance`` (COUNT, COUNT); the rows of the force are zero.

    Args:
        settings: the settings.
        knowledge: knowledge of the constants beforehand.
        info: the session metadata.
        knob_deg: first reading of the knob; NaN: not known.
    """

    def __init__(self, settings: RodSettings, knowledge: Knowledge, info: SessionInfo, knob_deg: float) -> None:
        """Sets the Gaussian before the first line; amplitudes of errors and the lever have variance 1."""
        prior, actuation = settings.prior, info.actuation
        gain = actuation.knob_gain_per_m_deg
        has_knob = gain is not None and not math.isnan(knob_deg)
        self.gain_per_m_deg = gain if gain is not None and has_knob else 0.0
        self.knob_deg = knob_deg if has_knob else 0.0
        self._play_deg = prior.knob_play_deg if actuation.knob_play_deg is None else actuation.knob_play_deg
        mean, covariance = knowledge.for_session(settings, info, 0.0 if has_knob else math.nan)
        self.mean, self.covariance = np.zeros(COUNT), np.eye(COUNT)
        self.mean[FORCE:ROD], self.covariance[FORCE:ROD, FORCE:ROD] = mean, covariance
        self.covariance[:FORCE, :FORCE] = 0.0
        self.covariance[GAIN, GAIN] = knob_gain_std(prior, actuation) ** 2
        self.covariance[PLAY, PLAY] = max(LEAST_PLAY_DEG2, self._play_deg**2 / 12.0)
        if has_knob and not knowledge.sessions:  # the play has an unknown of its own
            self.covariance[K0, K0] = prior.precurvature_per_m**2

    def unloaded_curvature_per_m(self) -> tuple[float, float]:
        """Returns mean and standard deviation of the curvature without load, 1/m, by shaft, knob and play together."""
        gain = self.gain_per_m_deg
        slopes = np.zeros(COUNT)  # derivatives of this curvature by the unknowns
        slopes[K0], slopes[GAIN], slopes[PLAY] = 1.0, gain * self.knob_deg, gain
        mean = float(slopes @ self.mean) + gain * self.knob_deg
        return mean, math.sqrt(float(slopes @ self.covariance @ slopes))

    def rod_prior(self) -> tuple[FloatArray, FloatArray]:
        """Returns mean and covariance of the rod's unknowns without the force, for a fit that has no others.

        Such a fit has no unknowns for the knob: the pre-curvature contains the knob's curvature, with its variance.
        """
        mean, covariance = self.mean[FORCE:ROD].copy(), self.covariance[FORCE:ROD, FORCE:ROD].copy()
        curvature, std = self.unloaded_curvature_per_m()
        mean[0] = curvature
        covariance[0, 0] = max(covariance[0, 0], std**2)
        return mean, covariance

    def predict(self, settings: RodTrackSettings, elapsed_s: float, knob_deg: float, advanced_m: float) -> None:
        """Changes the state by the elapsed time, the knob's turn, and the advance of the clamp (Kalman prediction).

        Args:
            settings: speeds of the changes.
            elapsed_s: time since the state was last updated.
            knob_deg: reading of the knob; NaN: it stays.
            advanced_m: advance of the clamp in this time.
        """
        covariance = self.covariance
        knob_curvature_per_m = self.gain_per_m_deg * abs(self.knob_deg)
        drift_share = min(1.0, elapsed_s / settings.knob_drift_s)
        covariance[K0, K0] += 2.0 * (settings.knob_drift * knob_curvature_per_m) ** 2 * drift_share
        covariance[X, X] += settings.base_walk_m**2 * elapsed_s
        covariance[Y, Y] += settings.base_walk_m**2 * elapsed_s
        covariance[ANGLE, ANGLE] += math.radians(settings.base_walk_deg) ** 2 * elapsed_s
        if elapsed_s > 0.0:  # the reading of the advance and the image may be a little apart in time
            covariance[X, X] += (advanced_m * min(1.0, settings.advance_late_s / elapsed_s)) ** 2
        self._forget(slice(ROD, ROD + MODES), math.exp(-elapsed_s / settings.line_error_s))
        self._forget(slice(LEVER, COUNT), math.exp(-elapsed_s / settings.friction_s))
        if self.gain_per_m_deg and not math.isnan(knob_deg):
            turn_knob(self.mean, self.covariance, PLAY, knob_deg - self.knob_deg, self._play_deg)
            self.knob_deg = knob_deg

    def _forget(self, part: slice, keeps: float) -> None:
        """Lets unknowns decay toward 0 by the factor ``keeps``: Ornstein-Uhlenbeck processes with unit variance."""
        self.mean[part] *= keeps
        self.covariance[part] *= keeps
        self.covariance[:, part] *= keeps
        index = np.arange(COUNT)[part]
        self.covariance[index, index] += 1.0 - keeps**2


def turn_knob(mean: FloatArray, covariance: FloatArray, place: int, turned_deg: float, play_deg: float) -> None:
    """Changes the position of the mechanism in the knob's play, relative to the knob, by a turn of the knob.

    The mechanism stays where it is until the knob has crossed the play; then the knob drags it along. So its position
    relative to the knob moves back by the turn, and is clipped to the play.

    Args:
        mean: (unknowns,) mean of the unknowns, changed in place.
        covariance: (unknowns, unknowns) their covariance, changed in place.
        place: index of the position in the play, degrees.
        turned_deg: turn of the knob.
        play_deg: width of the play.
    """
    half_play_deg = 0.5 * play_deg
    if turned_deg == 0.0 or half_play_deg == 0.0:
        return
    variance = float(covariance[place, place])
    mean[place], clipped_variance, within = clipped_moments(float(mean[place]) - turned_deg, variance, half_play_deg)
    covariance[place] *= within
    covariance[:, place] *= within
    covariance[place, place] = max(LEAST_PLAY_DEG2, clipped_variance) + (_PLAY_LEFT_OUT * turned_deg) ** 2


def clipped_moments(mean: float, variance: float, half: float) -> tuple[float, float, float]:
    """Returns the moments of a Gaussian variable whose values beyond +- ``half`` are set to that limit.

    Args:
        mean: its mean.
        variance: its variance.
        half: half of the width to which it is clipped.

    Returns:
        Mean, variance, and the probability within the limits. This is also the factor by which the covariance with any
        other Gaussian variable shrinks (Stein's lemma).

    >>> clipped_moments(0.0, 1e-6, 1.0)
    (0.0, 1e-06, 1.0)
    """
    std = math.sqrt(variance)
    low, high = (-half - mean) / std, (half - mean) / std
    below, above = 0.5 * math.erfc(-low / math.sqrt(2.0)), 0.5 * math.erfc(high / math.sqrt(2.0))
    density_low, density_high = (math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi) for x in (low, high))
    within = 1.0 - below - above
    first = mean * within + std * (density_low - density_high) + half * (above - below)
    second = (mean**2 + variance) * within + 2.0 * mean * std * (density_low - density_high)
    second += variance * (low * density_low - high * density_high) + half**2 * (above + below)
    return first, max(0.0, second - first**2), within


def line_modes(error: LineError, unit_m: float) -> FloatArray:
    """Makes the modes of a session's lines.

    Args:
        error: error of the line.
        unit_m: metres of a pixel of ``error``.

    Returns:
        (POINTS + 1, MODES + CAMERA + EXTRA): lasting errors of the line, the rest zero.
    """
    modes = np.zeros((POINTS + 1, MODES + CAMERA + EXTRA))
    modes[:, :MODES] = error.modes * unit_m
    return modes


def fill_camera_modes(modes: FloatArray, line: Line, model: Model, settings: RodSettings) -> None:
    """Fills the columns of ``modes`` for the errors of the image (`CAMERA`), which depend on the line's position.

    They are the displacements of the line, m, by stretch and shear of the image, and by a bend out of the plane that
    moves the line along x and along y; each for one standard deviation.

    Args:
        modes: from `line_modes`; rows: the points, across the line, then the tip, along it.
        line: the line.
        model: the rod.
        settings: the settings.
    """
    prior = settings.prior
    last = line.normals[-1]
    measured = np.vstack([line.normals, [last[1], -last[0]]])  # directions in which the error of each row is measured
    from_middle = line.points - line.middle
    position = np.vstack([from_middle, from_middle[-1:]])
    # a line without its tip begins near the clamp, but ends anywhere
    length_m = line.points[0, 0] + line.from_tip[0] if line.from_clamp else model.flexible_m + model.rigid_m
    from_base_m = np.maximum(length_m - np.append(line.from_tip, 0.0), 0.0)
    depth = prior.depth_per_m * from_base_m**2
    modes[:, MODES] = prior.stretch * (measured[:, 0] * position[:, 0] - measured[:, 1] * position[:, 1])
    modes[:, MODES + 1] = prior.stretch * (measured[:, 0] * position[:, 1] + measured[:, 1] * position[:, 0])
    modes[:, MODES + 2], modes[:, MODES + 3] = depth * measured[:, 0], depth * measured[:, 1]
