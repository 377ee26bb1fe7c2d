"""Constants and slow states of a session: their Gaussian, and how it changes with time and with the knob."""

import math
from collections.abc import Sequence

import numpy as np

from ...mechanics.spatial import PARAMETERS
from ...types import FloatArray, SessionInfo
from ..session import LEAST_PLAY_DEG2, MODES, knob_gain_std, turn_knob
from ._settings import SpaceSettings
from ._view_pose import POSE_ERRORS

FORCE = 3
BEND_Y, BEND_Z, STIFFNESS = 3, 4, 5
SHAPE = len(PARAMETERS)
POSITION, TURN = SHAPE, SHAPE + 3
GAIN, LEVER, PLAY = SHAPE + 6, SHAPE + 7, SHAPE + 9
FIRST_VIEW = SHAPE + 10
VIEW_ERRORS = 6
"""Errors of a view's projection: shift along u and v, scale, turn, stretch and shear."""
PER_VIEW = VIEW_ERRORS + MODES
"""Unknowns of a view: errors of its projection, and lasting errors of its line."""
DEPTH = (BEND_Y, POSITION + 2, TURN, TURN + 1)
"""Unknowns in the depth of the first view, which that view alone shows up to their sign."""
_LEAST_LENGTH_STD, _LEAST_TILT_DEG = 1e-4, 0.1
"""Smaller stated uncertainties (the first is relative) are taken for these: the covariance must have an inverse."""


def errors_of_view(place: int) -> slice:
    """Returns the unknowns of the ``place``-th view."""
    return slice(FIRST_VIEW + place * PER_VIEW, FIRST_VIEW + (place + 1) * PER_VIEW)


class Constants:
    """Mean and covariance of all unknowns: force (rows zero), shape, base, knob, lever, play, and errors of each view.

    Args:
        settings: the settings.
        info: the session metadata.
        views: names of the views.
        knob_deg: first reading of the knob; NaN: not known.
        several: whether the first instant showed more than one view: then the base's direction is known there.
        open_pose: whether the error of the second view's pose is unknown, too; its unknowns are the last ones.
    """

    def __init__(
        self,
        settings: SpaceSettings,
        info: SessionInfo,
        views: Sequence[str],
        knob_deg: float,
        *,
        several: bool,
        open_pose: bool = False,
    ) -> None:
        """Sets the Gaussian before the first instant: stated uncertainties count more than those of the settings."""
        prior, actuation = settings.prior, info.actuation
        self._settings = settings
        gain = actuation.knob_gain_per_m_deg
        known = gain is not None and actuation.curvature_per_m(knob_deg) is not None
        self.gain_per_m_deg = gain if gain is not None and known else 0.0
        self.knob_deg = knob_deg if known else 0.0
        self._play_deg = prior.knob_play_deg if actuation.knob_play_deg is None else actuation.knob_play_deg
        count = FIRST_VIEW + len(views) * PER_VIEW + (POSE_ERRORS if open_pose else 0)
        self.mean, std = np.zeros(count), np.ones(count)  # 1: the unit of the lever, and of errors of line and pose
        self.mean[BEND_Z] = (actuation.knob_offset_per_m or 0.0) if known else 0.0
        self.mean[SHAPE - 1] = prior.stiffening_m2
        stiffness, length = info.catheter.bending_stiffness_uncertainty, info.catheter.flexible_length_uncertainty
        std[:FORCE] = 0.0
        std[BEND_Y] = prior.out_of_plane_per_m
        std[BEND_Z] = prior.curvature_per_m if known else prior.unknown_curvature_per_m
        std[PLAY] = math.sqrt(max(LEAST_PLAY_DEG2, self._play_deg**2 / 12.0))
        std[STIFFNESS] = prior.stiffness if stiffness is None else math.hypot(stiffness, prior.stiffness_left_out)
        std[STIFFNESS + 1] = prior.proximal_stiffness
        std[STIFFNESS + 2] = prior.length if length is None else max(length, _LEAST_LENGTH_STD)
        std[SHAPE - 1] = prior.stiffening_std_m2
        std[POSITION : POSITION + 3] = prior.base_position_m
        tilt = info.view(views[0]).tilt_uncertainty_deg
        roll_deg = prior.base_roll_deg if tilt is None else max(tilt, _LEAST_TILT_DEG)
        tilt_deg = prior.base_tilt_deg if tilt is None else max(tilt, _LEAST_TILT_DEG)
        if several:
            tilt_deg = prior.base_angle_deg
        std[TURN : TURN + 3] = np.radians([roll_deg, tilt_deg, prior.base_angle_deg])
        std[GAIN] = knob_gain_std(prior, actuation)
        for place, view in enumerate(views):
            std[errors_of_view(place)][:VIEW_ERRORS] = _view_stds(settings, info, view, first=place == 0)
        self.covariance = np.diag(std**2)

    def predict(self, elapsed_s: float, knob_deg: float) -> None:
        """Changes the Gaussian by the time that passed, and by the knob's turn.

        Args:
            elapsed_s: time since the last prediction.
            knob_deg: reading of the knob; NaN: it stays.
        """
        settings, variance = self._settings, np.zeros(len(self.mean))  # variance that is added
        knob_curvature_per_m = self.gain_per_m_deg * abs(self.knob_deg)
        drift_share = min(1.0, elapsed_s / settings.knob_drift_s)
        variance[BEND_Z] = 2.0 * (settings.knob_drift * knob_curvature_per_m) ** 2 * drift_share
        if self.gain_per_m_deg and not math.isnan(knob_deg):
            turn_knob(self.mean, self.covariance, PLAY, knob_deg - self.knob_deg, self._play_deg)
            self.knob_deg = knob_deg
        variance[BEND_Y : BEND_Z + 1] += settings.curvature_walk_per_m**2 * elapsed_s
        variance[POSITION : POSITION + 3] = settings.base_walk_m**2 * elapsed_s
        variance[TURN : TURN + 3] = math.radians(settings.base_walk_deg) ** 2 * elapsed_s
        keeps = np.ones(len(self.mean))  # lever and errors of the lines decay to 0, with variance 1
        keeps[LEVER : LEVER + 2] = math.exp(-elapsed_s / settings.friction_s)
        for start in range(FIRST_VIEW + VIEW_ERRORS, len(keeps), PER_VIEW):
            keeps[start : start + MODES] = math.exp(-elapsed_s / settings.line_error_s)
        self.mean *= keeps
        self.covariance *= np.outer(keeps, keeps)
        self.covariance[np.diag_indices(len(keeps))] += variance + 1.0 - keeps**2

    def learn(self, mean: FloatArray, covariance: FloatArray, held: Sequence[int]) -> None:
        """Replaces the Gaussian of the constants by the posterior of an instant.

        Args:
            mean: (unknowns,) its mean.
            covariance: (unknowns, unknowns) its covariance.
            held: unknowns whose own Gaussian stays as it was. The others keep the posterior's regression on them.
        """
        mean, covariance, kept = mean.copy(), covariance.copy(), list(held)
        rest = [k for k in range(FORCE, len(mean)) if k not in kept]
        if kept:
            held_block, cross_block = np.ix_(kept, kept), np.ix_(rest, kept)
            regression = np.linalg.solve(covariance[held_block], covariance[cross_block].T).T
            conditional = covariance[np.ix_(rest, rest)] - regression @ covariance[cross_block].T
            mean[rest] += regression @ (self.mean[kept] - mean[kept])
            mean[kept] = self.mean[kept]
            covariance[held_block] = self.covariance[held_block]
            covariance[cross_block] = regression @ covariance[held_block]
            covariance[np.ix_(kept, rest)] = covariance[cross_block].T
            covariance[np.ix_(rest, rest)] = conditional + regression @ covariance[held_block] @ regression.T
        mean[:FORCE] = 0.0
        covariance[:FORCE] = covariance[:, :FORCE] = 0.0
        self.mean, self.covariance = mean, covariance


def _view_stds(settings: SpaceSettings, info: SessionInfo, view: str, *, first: bool) -> FloatArray:
    """Returns the standard deviations (`VIEW_ERRORS`,) of the errors of a projection: two in px, four relative.

    The distance of the second view is an unknown of its pose. That of the first one is part of its scale.
    """
    prior, stated = settings.prior, info.view(view)
    shift, stretch = prior.view_shift_px, prior.view_stretch
    scale = stated.metres_per_px_uncertainty
    if stated.projection is None:
        scale = prior.view_scale if scale is None else scale
        return np.array([shift, shift, scale, stretch, stretch, stretch])
    projection = np.array(stated.projection, np.float64)
    by_distance = 0.0  # relative error of the scale by that of the camera's distance
    if stated.pose_uncertainty_m is not None:
        by_distance = stated.pose_uncertainty_m[2] * float(np.linalg.norm(projection[2, :3])) / abs(projection[2, 3])
    scale = by_distance if scale is None else max(scale, by_distance)
    if not first:
        scale = math.sqrt(scale**2 - by_distance**2)
    return np.array([shift, shift, math.hypot(stretch, scale), stretch, stretch, stretch])


def error_slopes(points: FloatArray, normals: FloatArray, middle_px: FloatArray, modes: FloatArray) -> FloatArray:
    """Returns the derivatives (points + 1, `PER_VIEW`) of a view's residuals by its errors.

    A residual is a displacement across the line in px; the last one is that of the tip along the line.

    Args:
        points: (points, 2) of the line in px.
        normals: (points, 2) its unit normals.
        middle_px: (2,) the middle of the image.
        modes: (points + 1, `MODES`) lasting errors of the line, px.
    """
    u, v = (np.vstack([points, points[-1:]]) - middle_px).T
    last = normals[-1]
    measured = np.vstack([normals, [last[1], -last[0]]])  # direction of each residual
    zero, one = np.zeros_like(u), np.ones_like(u)
    # shift along u and v, scale, turn, stretch, shear: displacements (6, 2, points + 1) for errors of 1
    displacements = np.array([[one, zero], [zero, one], [u, v], [-v, u], [u, -v], [v, u]])
    return np.concatenate([np.einsum("kan,na->nk", displacements, measured), modes], axis=1)
