"""Error of the stated pose of the second view relative to the first one.

A wrong pose of a view shows the same image as a rod that is turned and shifted in front of it. The first view is exact:
a motion of both views together is one of the base.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from ...types import FloatArray, SessionInfo
from ._cameras import Reference, axes_of_image, turns

POSE_ERRORS = 6
"""Unknowns of the pose: turn about the origin of the projections' frame, and shift."""
_SHOWN_SHARE = 0.01
"""A direction of the pose counts as shown by the lines where they explain this share of its prior variance."""


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """Prior of the error, in the axes of the projections' frame.

    Attributes:
        turn_rad: (3, 3) root of the covariance of the turn: it times three independent unknowns is the turn.
        shift_m: (3, 3) the same of the shift.
    """

    turn_rad: FloatArray
    shift_m: FloatArray

    @classmethod
    def of(cls, info: SessionInfo, views: tuple[str, ...]) -> "PosePrior | None":
        """Returns the prior that the session metadata state; None where there is one view, or nothing is stated.

        The metadata state standard deviations about the axes of each view's image. The errors of both views add up to
        the error of the second view relative to the first.

        Args:
            info: the session metadata.
            views: names of the views.
        """
        if len(views) < 2:
            return None
        turn, shift = np.zeros((3, 3)), np.zeros((3, 3))
        for view in views:
            stated = info.view(view)
            if stated.projection is None:
                return None
            axes = axes_of_image(np.array(stated.projection, np.float64))
            turn += (axes * np.radians(stated.pose_uncertainty_deg or (0.0,) * 3) ** 2) @ axes.T
            shift += (axes * np.array(stated.pose_uncertainty_m or (0.0,) * 3) ** 2) @ axes.T
        if not turn.any() and not shift.any():
            return None
        return cls(_root(turn), _root(shift))


def _root(covariance: FloatArray) -> FloatArray:
    """Returns a matrix that gives the covariance, times its own transpose."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def probability_of(mean: FloatArray, covariance: FloatArray) -> float:
    """Returns the probability that the stated pose is off by so much, if its stated uncertainty holds.

    Args:
        mean: (`POSE_ERRORS`,) posterior mean of the unknowns, whose prior is standard normal.
        covariance: (`POSE_ERRORS`, `POSE_ERRORS`) their posterior covariance.
    """
    variances, directions = np.linalg.eigh(covariance)
    shown = variances < 1.0 - _SHOWN_SHARE
    if not shown.any():
        return 1.0
    error = mean @ directions[:, shown]
    # before the data, the posterior mean varies by the part of the prior's variance that the data explain
    return float(chi2.sf(float((error**2 / (1.0 - variances[shown])).sum()), int(shown.sum())))


@dataclass(frozen=True, slots=True, eq=False)
class PlacedRod:
    """Pose of the base in the reference frame at ``count`` points of the unknowns.

    Attributes:
        position: (count, 3) m.
        turn: (count, 3, 3).
        turn_slopes: (count, turns, 3, 3) derivatives of ``turn``.
    """

    position: FloatArray
    turn: FloatArray
    turn_slopes: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PoseError:
    """The error of the second view's pose in a session.

    Attributes:
        prior: its prior.
        reference: frame in which the base is found.
    """

    prior: PosePrior
    reference: Reference

    def seen(self, error: FloatArray, placed: PlacedRod) -> tuple[PlacedRod, FloatArray]:
        """Returns the rod in front of a view with this error, and the derivatives of its position.

        Args:
            error: (count, `POSE_ERRORS`) unknowns of the pose.
            placed: the rod.

        Returns:
            The rod, whose derivatives of the turn are those by the base's angles and by the unknowns of the turn; and
            (count, `POSE_ERRORS` + 3, 3) derivatives of its position by the unknowns of the pose, and by the position
            of ``placed``.
        """
        # pose_turn and position: in the frame of the projections; turn: in the reference frame, whose axes are ``axes``
        axes, origin = self.reference.axes, self.reference.origin_m
        pose_turn, slopes = turns(error[:, :3] @ self.prior.turn_rad.T)
        slopes = np.einsum("prab,rk->pkab", slopes, self.prior.turn_rad)
        position = origin + placed.position @ axes.T
        pose_slopes = axes.T @ slopes  # (count, 3, 3, 3)
        moved = (pose_turn @ position[:, :, None])[:, :, 0] + error[:, 3:] @ self.prior.shift_m.T - origin
        turn = axes.T @ pose_turn @ axes
        by_turn = np.einsum("pkab,pb->pka", pose_slopes, position)
        by_shift = np.tile((axes.T @ self.prior.shift_m).T, (len(error), 1, 1))
        position_slopes = np.concatenate([by_turn, by_shift, turn.transpose(0, 2, 1)], axis=1)
        turn_slopes = np.concatenate([turn[:, None] @ placed.turn_slopes, pose_slopes @ axes @ placed.turn[:, None]], 1)
        return PlacedRod(moved @ axes, turn @ placed.turn, turn_slopes), position_slopes
