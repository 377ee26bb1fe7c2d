"""The relative pose of two views, refined from the catheter itself.

The epipolar plane of a point has the same angle about the line through both pinholes in both images. Along a curve only
points that are recognised in both images constrain the pose: the tip. Any two curves that agree there are the images of
some curve in space, so the rest of the line adds nothing.

Views at the distance of a C-arm are nearly telecentric. Then the tip determines the shift across the epipolar lines,
and two of the turns as far as it moves. The angle between the views and the other shifts keep their stated values and
standard deviations.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from ..errors import InputError
from ..geometry import CameraModel, Pose, epipolar_angles
from ..types import FloatArray

MIN_FRAMES = 20
TIP_ALONG_STD_PX, TIP_ACROSS_STD_PX = 1.5, 0.5
"""Assumed standard deviations of a detected tip, along the catheter and across it."""
TIP_LASTING_STD_PX, LASTING_REACH_PX = 1.0, 15.0
"""Standard deviation of the distance along the catheter by which a detected tip is too short or too long, the same in
all frames in which it is at the same position, and the distance over which this changes. Without it 90 % intervals of a
turn held 7 % on one of three simulated sessions, whose tip in contact was off by 1.5 px."""
OPEN_TURN_DEG, OPEN_SHIFT_M = 5.0, 10e-3
"""Standard deviations of the prior of the fit that leaves the pose open."""
RESOLVED_SHARE = 0.5
"""A direction counts as determined where the tip explains more than this share of the variance of that prior."""
MAX_P_VALUE = 0.01
"""The catheter and a stated pose differ where so large a difference is less probable than this."""
_MAX_ITERATIONS = 20
MIN_SPREAD = 0.5
"""Smallest factor by which the scatter of the residuals reduces the assumed standard deviations of the tip."""
MIN_WEIGHT = 1e-4
MAX_STEP_RAD = 0.02
"""Largest turn in an iteration: at large steps the epipolar lines of all tips can fall together."""
_STEP = 1e-6
_CUT = 4.685
"""Tukey's constant: a residual of more standard deviations has no weight."""


@dataclass(frozen=True, slots=True, eq=False)
class TipPairs:
    """The tip in both views at the same instants.

    Attributes:
        tips_px: (n, 2, 2) frame, view, u and v.
        axes: (n, 2, 2) unit vectors of the catheter's direction at the tip, frame, view, u and v.
    """

    tips_px: FloatArray
    axes: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class StatedPose:
    """Cameras of two views as stated.

    Attributes:
        cameras: the first and the second camera, in one world.
        covariance: (6, 6) of the second pose relative to the first: its turn about the world's origin in rad, then its
            shift in m, both along the second camera's axes.
    """

    cameras: tuple[CameraModel, CameraModel]
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """The second camera's refined pose, where the first one's is exact.

    Attributes:
        camera: the second camera.
        change: (6,) its turn in rad and its shift in m from the stated pose.
        covariance: (6, 6) of ``change``.
        resolved: (6,) share of the prior variance that the tip explains, by component.
        chi_square: squared difference from the stated pose in standard deviations, in the determined directions.
        determined: number of these directions.
        p_value: probability of a difference so large where the stated standard deviations hold.
        rms_before_px: epipolar residual with the stated pose, in the second view.
        rms_px: the same with the refined pose.
        frames: number of frames.
    """

    camera: CameraModel
    change: FloatArray
    covariance: FloatArray
    resolved: FloatArray
    chi_square: float
    determined: int
    p_value: float
    rms_before_px: float
    rms_px: float
    frames: int

    @property
    def differs(self) -> bool:
        """Whether the catheter and the stated pose differ by more than their errors."""
        return self.p_value < MAX_P_VALUE


def relative_covariance(cameras: tuple[CameraModel, CameraModel], stds: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Returns the covariance of the second pose relative to the first.

    Args:
        cameras: the cameras of both views.
        stds: for each view (6,): turn in rad and shift in m along its axes.

    Returns:
        (6, 6): turn and shift along the second camera's axes.
    """
    turn = cameras[1].camera_from_world.rotation @ cameras[0].camera_from_world.rotation.T
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    return np.diag(stds[1] ** 2) + both @ np.diag(stds[0] ** 2) @ both.T


def refine_relative_pose(stated: StatedPose, tips: TipPairs) -> RelativePose:
    """Refines the pose of the second camera so that the tips of both views are in the same epipolar planes.

    A first fit with a wide prior gives the noise of the tips and the test of the stated pose. The second one gives
    the most probable pose under the stated one with its covariance. Where the tips differ from that by more, the
    covariance is doubled until the chi-square is at most its degrees of freedom.

    Args:
        stated: the cameras.
        tips: the tips.

    Returns:
        The refined pose.

    Raises:
        InputError: there are fewer than `MIN_FRAMES` frames.
    """
    if len(tips.tips_px) < MIN_FRAMES:
        raise InputError(
            f"the tip is detected in both views in {len(tips.tips_px)} frames, and {MIN_FRAMES} are needed to refine "
            "the pose of the views; see `tipforce inspect`"
        )
    open_std = np.array([*np.radians([OPEN_TURN_DEG] * 3), *[OPEN_SHIFT_M] * 3])
    open_prior = stated.covariance + np.diag(open_std**2)
    open_fit = _fit(stated, tips, open_prior, None)
    chi_square, determined = _difference(open_fit, open_prior, stated.covariance)
    p_value = float(chi2.sf(chi_square, determined)) if determined else 1.0
    prior = stated.covariance
    if p_value < MAX_P_VALUE:
        while _difference(open_fit, open_prior, prior)[0] > determined:
            prior = 2.0 * prior
    refined = _fit(stated, tips, prior, open_fit)
    before, after = _residuals(stated, tips, np.zeros(6)), _residuals(stated, tips, refined.change)
    rad_per_px = np.linalg.norm(_slopes(stated, tips, refined.change)[:, 1], axis=1)  # of the second view
    is_used = refined.weights > 0
    return RelativePose(
        moved_camera(stated.cameras[1], refined.change), refined.change, refined.covariance,
        1.0 - np.diag(refined.covariance) / np.diag(prior), chi_square, determined, p_value,
        float(np.sqrt(np.mean((before / rad_per_px)[is_used] ** 2))),
        float(np.sqrt(np.mean((after / rad_per_px)[is_used] ** 2))), len(before),
    )  # fmt: skip


def moved_camera(camera: CameraModel, change: FloatArray) -> CameraModel:
    """Returns a camera at another pose.

    Args:
        camera: the camera.
        change: (6,) turn about the world's origin in rad, then shift in m, both along the camera's axes.
    """
    pose = camera.camera_from_world
    turned = Pose.from_axis_angle(change[:3], np.zeros(3)).rotation @ pose.rotation
    return camera.seen_from(Pose(turned, pose.translation_m + change[3:]))


def _residuals(stated: StatedPose, tips: TipPairs, change: FloatArray) -> FloatArray:
    """Returns the (n,) difference of the epipolar angles, second minus first, in rad."""
    first, second = stated.cameras
    angles = epipolar_angles((first, moved_camera(second, change)), tips.tips_px)
    return (angles[:, 1] - angles[:, 0] + math.pi) % (2.0 * math.pi) - math.pi


def _slopes(stated: StatedPose, tips: TipPairs, change: FloatArray) -> FloatArray:
    """Returns the (n, 2, 2) derivatives of the angle of each view by its pixel, rad / px."""
    cameras = (stated.cameras[0], moved_camera(stated.cameras[1], change))
    slopes = np.empty((len(tips.tips_px), 2, 2))
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = 0.5
        ends = [epipolar_angles(cameras, tips.tips_px + sign * step) for sign in (1.0, -1.0)]
        slopes[:, :, axis] = ends[0] - ends[1]
    return slopes


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A fit: (6,) change, (6, 6) its covariance, (n,) weights of the frames, and the factor of the tips' scatter."""

    change: FloatArray
    covariance: FloatArray
    weights: FloatArray
    spread: float


def _fit(stated: StatedPose, tips: TipPairs, prior: FloatArray, noise_of: _Fit | None) -> _Fit:
    """Fits the change of the second pose: Gauss-Newton, with Tukey's weights against wrongly detected tips.

    Args:
        stated: the cameras.
        tips: the tips.
        prior: (6, 6) covariance of the change about 0.
        noise_of: the fit whose weights and scatter are taken; None: they are found.
    """
    prior_precision = np.linalg.inv(prior)
    slopes = _slopes(stated, tips, np.zeros(6))
    along = np.einsum("nvi,nvi->nv", slopes, tips.axes)
    across = np.sqrt(np.maximum((slopes**2).sum(axis=2) - along**2, 0.0))
    noise = np.sqrt(((TIP_ALONG_STD_PX * along) ** 2 + (TIP_ACROSS_STD_PX * across) ** 2).sum(axis=1))
    lasting = _lasting(tips, along)
    # covariance of each tip times the slope of the residual by it: times residual / variance, its most probable error
    tip_shift = slopes * TIP_ACROSS_STD_PX**2 + tips.axes * along[..., None] * (
        TIP_ALONG_STD_PX**2 - TIP_ACROSS_STD_PX**2
    )
    tip_shift *= np.array([-1.0, 1.0])[None, :, None]
    change, precision = np.zeros(6), prior_precision
    weights, spread = np.ones(len(noise)), 1.0
    for _ in range(_MAX_ITERATIONS):
        residual = _residuals(stated, tips, change)
        if noise_of is None:
            scaled = (residual - np.median(residual)) / noise
            spread = max(MIN_SPREAD, 1.4826 * float(np.median(np.abs(scaled))))
            weights = np.maximum(1.0 - (scaled / (_CUT * spread)) ** 2, 0.0) ** 2
        else:
            weights, spread = noise_of.weights, noise_of.spread
        # The slopes are taken at the tips that fulfil the constraint: those at the detected tips are correlated with
        # their noise, which turns the pose by degrees in directions that the tips do not determine.
        corrected = replace(tips, tips_px=tips.tips_px - tip_shift * (residual / noise**2)[:, None, None])
        # a unit covariance for the residuals: jitter of each frame, and errors that frames at one position share
        noise_root = np.linalg.cholesky(np.diag((noise * spread) ** 2 / np.maximum(weights, MIN_WEIGHT)) + lasting)
        jacobian = np.linalg.solve(noise_root, _derivatives(stated, corrected, change))
        precision = jacobian.T @ jacobian + prior_precision
        step = np.linalg.solve(
            precision, -jacobian.T @ np.linalg.solve(noise_root, residual) - prior_precision @ change
        )
        turn_size = float(np.abs(step[:3]).max())
        step *= min(1.0, MAX_STEP_RAD / turn_size) if turn_size > 0 else 1.0
        change = change + step
        if float(step @ precision @ step) < 1e-8:
            break
    return _Fit(change, np.asarray(np.linalg.inv(precision), np.float64), weights, spread)


def _lasting(tips: TipPairs, along: FloatArray) -> FloatArray:
    """Returns the (n, n) covariance of the residuals by errors of the tip that are the same at the same position.

    Args:
        tips: the tips.
        along: (n, 2) derivative of the angle of each view along the catheter, rad / px.
    """
    covariance = np.zeros((len(along), len(along)))
    for view in range(2):
        apart = np.linalg.norm(tips.tips_px[:, None, view] - tips.tips_px[None, :, view], axis=2)
        shape = np.exp(-0.5 * (apart / LASTING_REACH_PX) ** 2)
        covariance += TIP_LASTING_STD_PX**2 * np.outer(along[:, view], along[:, view]) * shape
    return covariance


def _derivatives(stated: StatedPose, tips: TipPairs, change: FloatArray) -> FloatArray:
    """Returns the (n, 6) derivatives of the residuals by the change."""
    columns: list[FloatArray] = []
    for size in np.diag(_STEP * np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])):
        ends = [_residuals(stated, tips, change + sign * size) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * float(size.sum())))
    return np.stack(columns, axis=1)


def _difference(free: _Fit, wide: FloatArray, stated: FloatArray) -> tuple[float, int]:
    """Returns the chi-square of a stated pose, and its degrees of freedom: the directions that the tips determine.

    Args:
        free: the fit under the prior ``wide``.
        wide: (6, 6) covariance of that prior.
        stated: (6, 6) covariance of the stated pose.
    """
    root = np.linalg.cholesky(wide)
    share_left = np.linalg.solve(root, np.linalg.solve(root, free.covariance).T)
    shares, vectors = np.linalg.eigh(np.eye(6) - 0.5 * (share_left + share_left.T))
    # directions in which the tips reduce the prior's variance, in units in which that prior is 1
    determined = vectors[:, shares > RESOLVED_SHARE]
    if not determined.shape[1]:
        return 0.0, 0
    # the fitted change is gain @ (true change) + noise, under the prior about 0
    gain = np.eye(6) - free.covariance @ np.linalg.inv(wide)
    covariance = gain @ stated @ gain.T + gain @ free.covariance
    to_determined = determined.T @ np.linalg.inv(root)
    change = to_determined @ free.change
    return float(change @ np.linalg.solve(to_determined @ covariance @ to_determined.T, change)), determined.shape[1]
