"""The pose of a view from a phantom: beads at known positions, and the pixels at which an image shows them."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ..errors import InputError
from ..geometry import CameraModel, Pose
from ..types import FloatArray

MIN_BEADS = 8
"""Six determine a view; two more show whether one is marked wrongly."""
BEAD_STD_PX = 0.3
"""Smallest standard deviation of a marked bead."""
MAX_RESIDUAL_PX = 3.0
"""A bead that is farther from its fitted pixel is marked wrongly, or has another bead's position."""
MAX_LINEAR_SKEW = 0.5
"""Largest cosine between the axes of the pixels in the linear solution, which noise skews."""
MIN_DEPTH_SHARE = 0.05
"""Least extent of the beads in their thinnest direction, over that in their longest one: a plane does not determine a
view."""


@dataclass(frozen=True, slots=True, eq=False)
class BeadView:
    """A view from the beads of a phantom.

    Attributes:
        camera: the camera, in the phantom's frame.
        stds: (6,) standard deviations: turn about the phantom's origin in rad, shift in m, along the camera's axes; the
            last one is that of the distance for the focal length found, which is the scale's.
        residual_px: RMS distance of the beads from their fitted pixels.
        beads: number of beads.
    """

    camera: CameraModel
    stds: FloatArray
    residual_px: float
    beads: int


def calibrate_beads(points_m: FloatArray, pixels: FloatArray, where: str) -> BeadView:
    """Finds the camera of a view with square pixels and without distortion.

    The linear solution (Hartley and Zisserman, 7.1) is refined in the image.

    Args:
        points_m: (n, 3) positions of the beads in the phantom's frame, whose origin is near their middle.
        pixels: (n, 2) their pixels.
        where: the file and view, for messages.

    Returns:
        The camera.

    Raises:
        InputError: there are too few beads, they are in a plane, or one does not fit.
    """
    if len(points_m) < MIN_BEADS:
        raise InputError(f"{where}: has {len(points_m)} beads, and {MIN_BEADS} are needed to find the pose")
    middle = points_m.mean(axis=0)
    extents = np.linalg.svd(points_m - middle, compute_uv=False)
    if extents[2] < MIN_DEPTH_SHARE * extents[0]:
        raise InputError(
            f"{where}: the beads are nearly in a plane, which does not determine the pose; mark beads at several depths"
        )
    start = _linear(points_m, pixels, where)
    signs = np.sign(start.focal_px)
    initial_rotation = start.camera_from_world.rotation
    focal = float(np.mean(np.abs(start.focal_px)))

    # unknowns (9,): focal length and centre in px, turn from the linear solution in rad, translation in m
    def camera(unknowns: FloatArray) -> CameraModel:
        turn = Pose.from_axis_angle(unknowns[3:6], np.zeros(3)).rotation
        return CameraModel(
            signs * unknowns[0], unknowns[1:3], camera_from_world=Pose(turn @ initial_rotation, unknowns[6:9])
        )

    def residuals(unknowns: FloatArray) -> FloatArray:
        return (camera(unknowns).project(points_m) - pixels).ravel()

    initial = np.concatenate([[focal], start.centre_px, np.zeros(3), start.camera_from_world.translation_m])
    scales = np.concatenate([[focal], [focal] * 2, np.ones(3), [initial[8]] * 3])
    fit = least_squares(residuals, initial, x_scale=np.abs(scales), method="trf")
    fitted = np.asarray(fit.x, np.float64)
    residual_uv = residuals(fitted).reshape(-1, 2)
    distance_px = np.linalg.norm(residual_uv, axis=1)
    worst = int(distance_px.argmax())
    if distance_px[worst] > MAX_RESIDUAL_PX:
        raise InputError(
            f"{where}: bead {worst + 1} is {distance_px[worst]:.1f} px from the pixel that fits the other beads, "
            f"{MAX_RESIDUAL_PX:g} px are allowed: check its pixel and its position"
        )
    # two less than the degrees of freedom: the variance itself is uncertain with so few beads (Student)
    variance = max(BEAD_STD_PX**2, float((residual_uv**2).sum()) / (residual_uv.size - len(fitted) - 2))
    covariance = variance * np.linalg.pinv(fit.jac.T @ fit.jac)
    # ``to_stds`` (6, 9) converts errors of the unknowns to those of `BeadView.stds`:
    # a longer focal length at a larger distance gives the same image: only the distance over the focal length counts
    to_stds = np.zeros((6, 9))
    to_stds[:3, 3:6], to_stds[3:, 6:9] = np.eye(3), np.eye(3)
    to_stds[5, 0] = -fitted[8] / fitted[0]
    # so do a shifted centre and a shifted phantom
    to_stds[3, 1], to_stds[4, 2] = signs[0] * fitted[8] / fitted[0], fitted[8] / fitted[0]
    stds = np.sqrt(np.diag(to_stds @ covariance @ to_stds.T))
    return BeadView(camera(fitted), stds, math.sqrt(float(np.mean(distance_px**2))), len(points_m))


def _linear(points_m: FloatArray, pixels: FloatArray, where: str) -> CameraModel:
    """Returns the camera of the direct linear transformation (Hartley and Zisserman, 7.1).

    Positions and pixels are first centred and scaled to a mean distance of sqrt(dimensions), which conditions the
    equations; the projection is then converted back.
    """
    centres = points_m.mean(axis=0), pixels.mean(axis=0)
    scales = [
        math.sqrt(values.shape[1]) / float(np.linalg.norm(values - centre, axis=1).mean())
        for values, centre in zip((points_m, pixels), centres, strict=True)
    ]
    world, image = (
        (values - centre) * scale for values, centre, scale in zip((points_m, pixels), centres, scales, strict=True)
    )
    rows: list[FloatArray] = []
    for (x, y, z), (u, v) in zip(world, image, strict=True):
        point = np.array([x, y, z, 1.0])
        rows += [np.concatenate([point, np.zeros(4), -u * point]), np.concatenate([np.zeros(4), point, -v * point])]
    scaled_projection = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 4)
    scaled_from_world = np.eye(4)
    scaled_from_world[:3, :3] *= scales[0]
    scaled_from_world[:3, 3] = -scales[0] * centres[0]
    image_from_scaled = np.array(
        [[1 / scales[1], 0.0, centres[1][0]], [0.0, 1 / scales[1], centres[1][1]], [0.0, 0.0, 1.0]]
    )
    projection = image_from_scaled @ scaled_projection @ scaled_from_world
    try:
        return CameraModel.from_projection(projection, max_skew=MAX_LINEAR_SKEW)
    except ValueError as error:
        raise InputError(f"{where}: the beads fit no view ({error}); check their pixels and positions") from None
