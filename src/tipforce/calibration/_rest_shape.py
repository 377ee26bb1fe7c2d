"""The curvature of the shaft along its length without load, from detected lines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..estimators.session import MODES, LineError, NoiseSettings, noise_unit_m, rod_model
from ..mechanics.planar import Line
from ..types import FloatArray, SessionInfo
from ._quantity import Quantity, combined

KNOTS = 7
"""Number of values along the flexible part; the curvature is linear between them, which smooths it."""
MIN_FRAMES = 10
MAX_STD_PER_M = 5.0
"""A shape that is known worse than this somewhere is not written."""
MIN_SHAPE_STDS = 3.0
"""A shape that nowhere differs from an arc by this number of its standard errors is not written."""


@dataclass(frozen=True, slots=True, eq=False)
class RestShape:
    """Curvature of the unloaded shaft with the knob at 0.

    Attributes:
        curvature_per_m: (`KNOTS`,) at even distances from base to tip.
        std_per_m: (`KNOTS`,) standard errors.
        frames: number of frames.
    """

    curvature_per_m: FloatArray
    std_per_m: FloatArray
    frames: int


def fit_rest_shape(
    info: SessionInfo, lines: Sequence[Line], knob_curvature_per_m: FloatArray, scale_m_per_px: float
) -> RestShape:
    """Finds the curvature that the knob does not explain: mean over frames without load.

    The direction of the line, as a function of the distance from the clamp, is fitted by a curvature that is linear
    between `KNOTS` values (least squares), and constant on the rigid tip. The standard error contains the scatter of
    the frames and the error of the line that stays for a session.

    Args:
        info: the session metadata, with the length of the flexible part.
        lines: n lines without load.
        knob_curvature_per_m: (n,) curvature that the knob sets, 1/m.
        scale_m_per_px: scale of the lines.

    Returns:
        The shape.

    Raises:
        InputError: there are fewer than `MIN_FRAMES` lines.
    """
    if len(lines) < MIN_FRAMES:
        raise InputError(f"the rest shape needs {MIN_FRAMES} frames without contact, got {len(lines)}")
    model = rod_model(info, KNOTS - 1)
    unit_m = noise_unit_m(model, scale_m_per_px)
    modes_m = LineError.of(NoiseSettings(), MODES).modes[:-1] * unit_m
    curvatures: list[FloatArray] = []
    line_covariance = np.zeros((KNOTS, KNOTS))
    for line, knob_per_m in zip(lines, knob_curvature_per_m.tolist(), strict=True):
        distance_m = model.flexible_m + model.rigid_m - line.from_tip
        angle_rad = np.unwrap(np.arctan2(-line.normals[:, 0], line.normals[:, 1]))
        # unknowns: angle at the clamp, which is not used further, and the knots' curvatures, which turn the line
        design = _turns(distance_m, model.flexible_m)
        curvature_by_angle = np.linalg.pinv(np.column_stack([np.ones(len(design)), design]))[1:]
        curvatures.append(curvature_by_angle @ angle_rad - knob_per_m)
        shape_error = curvature_by_angle @ np.gradient(modes_m, distance_m, axis=0)
        line_covariance += shape_error @ shape_error.T / len(lines)
    values = np.array(curvatures)
    scatter = values.var(axis=0, ddof=1) / len(values)
    return RestShape(values.mean(axis=0), np.sqrt(scatter + np.diag(line_covariance)), len(values))


def _turns(distance_m: FloatArray, flexible_m: float) -> FloatArray:
    """Returns the angles (points, `KNOTS`) at ``distance_m`` (points,) of a unit curvature at each knot, rad."""
    # a unit curvature at a knot decreases linearly to 0 at both neighbours; the trapezoidal rule integrates it
    fine = np.linspace(0.0, flexible_m, 40 * (KNOTS - 1) + 1)
    hats = np.stack([np.interp(fine, np.linspace(0.0, flexible_m, KNOTS), row) for row in np.eye(KNOTS)], axis=1)
    steps = 0.5 * (hats[1:] + hats[:-1]) * (fine[1] - fine[0])
    turns = np.vstack([np.zeros(KNOTS), np.cumsum(steps, axis=0)])
    return np.stack([np.interp(distance_m, fine, column) for column in turns.T], axis=1)


def rest_quantity(shapes: Sequence[RestShape], info: SessionInfo) -> Quantity:
    """Returns the rest shape as a row of the table.

    Args:
        shapes: the shapes of at least one session.
        info: the session metadata.
    """
    pairs = [
        combined([each.curvature_per_m[k] for each in shapes], [each.std_per_m[k] for each in shapes])
        for k in range(KNOTS)
    ]
    value, std = np.array(pairs).T
    before = info.catheter.rest_curvature_per_m
    mean, worst, arc = float(value.mean()), float(std.max()), float(np.average(value, weights=std**-2))
    doubt = ""
    if worst > MAX_STD_PER_M:
        doubt = "the lines determine it too little"
    elif float(np.max(np.abs(value - arc) / std)) < MIN_SHAPE_STDS and not before:
        doubt = "not distinguishable from an arc"
    # decimals that show two digits of the largest standard error
    digits = max(0, 1 - math.floor(math.log10(worst)))
    return Quantity(
        "rest curvature, mean", mean, worst, "1/m", sum(each.frames for each in shapes),
        "catheter.rest_curvature_per_m", float(np.mean(before)) if before else None, not doubt, doubt,
        stated=[round(each, digits) for each in value.tolist()],
    )  # fmt: skip
