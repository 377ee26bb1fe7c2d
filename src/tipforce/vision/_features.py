"""Shape features: numbers that a force is estimated from. Thesis eq. (2), and a set that exists for every shape."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InputError
from ..geometry import angle_matrix, curve_from_angle, fit_polynomial, turning_angles
from ..types import BasePose, CentrelinePx, DetectedShape, FloatArray, Status


class ShapeFeatureSettings(BaseModel):
    """Which numbers describe a shape."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["polynomial", "legendre"] = "polynomial"
    """`polynomial`: y(x) in pixels of the base frame, thesis eq. (2). `legendre`: tangent angle over arc length in rad,
    which exists for every shape."""
    degree: Annotated[int, Field(ge=1, le=8)] = 4
    """Degree of the polynomial or of the series."""
    constant: bool = True
    """`polynomial`: with the constant A5, else the curve starts at the base's origin. `legendre`: with the mean angle,
    else the features do not change when the image is rotated."""


@dataclass(frozen=True, slots=True)
class NoFeatures:
    """Reason why a shape has no features of the requested kind.

    Attributes:
        status: status of the detection or of the features.
        detail: the reason in words.
    """

    status: Status
    detail: str


def feature_names(settings: ShapeFeatureSettings) -> tuple[str, ...]:
    """Returns the name of each feature, as in thesis eq. (2) and as "L0", "L1", ... for the angle series.

    >>> feature_names(ShapeFeatureSettings())
    ('A1', 'A2', 'A3', 'A4', 'A5')
    >>> feature_names(ShapeFeatureSettings(kind="legendre", degree=2, constant=False))
    ('L1', 'L2')
    """
    if settings.kind == "polynomial":
        return tuple(f"A{k + 1}" for k in range(settings.degree + settings.constant))
    return tuple(f"L{k}" for k in range(0 if settings.constant else 1, settings.degree + 1))


def shape_features(shape: DetectedShape, settings: ShapeFeatureSettings) -> FloatArray | NoFeatures:
    """Computes the features of a detected shape.

    A polynomial is refused with ``not_a_function`` where the shape bends past 90 degrees: several y belong to one x.

    Args:
        shape: the detected shape.
        settings: kind and degree of the features.

    Returns:
        (k,) features as named by `feature_names`; `NoFeatures` where there are none.

    Raises:
        InputError: the centreline has too few points for the degree of a series.
    """
    centreline, base = shape.centreline, shape.base
    if centreline is None or base is None:
        return NoFeatures(shape.status, shape.detail)
    if settings.kind == "legendre":
        return _legendre(centreline, base, settings)
    cos, sin = math.cos(base.angle_rad), math.sin(base.angle_rad)
    if shape.fitted_px is None:
        values, bend = _polynomial(
            centreline.points, base.origin_px, cos, sin, settings.degree, settings.constant, True, 0.0
        )
    else:
        # One point a column: at the slanted end of a shaft the means of the columns may step back by half its diameter.
        values, bend = _polynomial(
            shape.fitted_px, base.origin_px, cos, sin, settings.degree, settings.constant, False,
            0.5 * shape.diameter_px,
        )  # fmt: skip
    if bend >= 0.0:
        share = round(100.0 * bend)
        return NoFeatures(
            Status.NOT_A_FUNCTION,
            f"the shape bends past 90 degrees at {share} % of its length: no polynomial y(x) describes it "
            "(the legendre features do)",
        )
    return values


@njit(cache=True, nogil=True)
def _polynomial(
    points: FloatArray,
    origin: FloatArray,
    cos: float,
    sin: float,
    degree: int,
    constant: bool,
    whole: bool,
    tolerance: float,
) -> tuple[FloatArray, float]:
    """Returns coefficients, highest power first, and the share of points after which x' decreases (-1: never)."""
    n = points.shape[0]
    x, y = np.empty(n), np.empty(n)
    reach = -np.inf
    for i in range(n):
        u, v = points[i, 0] - origin[0], points[i, 1] - origin[1]
        x[i] = cos * u - sin * v
        y[i] = -sin * u - cos * v
        if x[i] < reach - tolerance or (whole and x[i] == reach):
            return x[:0], i / n
        reach = max(reach, x[i])
    fitted = fit_polynomial(x, y, degree, constant)
    return (fitted if constant else fitted[:-1].copy()), -1.0


def _legendre(centreline: CentrelinePx, base: BasePose, settings: ShapeFeatureSettings) -> FloatArray:
    points = centreline.points
    if len(points) < settings.degree + 2:
        raise InputError(
            f"an angle series of degree {settings.degree} needs at least {settings.degree + 2} points of the "
            f"centreline, got {len(points)}: set vision.points={settings.degree + 2}"
        )
    # In the image v points down: the angle against the base tangent (cos, -sin), with the opposite sign.
    angles = turning_angles(points, math.cos(base.angle_rad), -math.sin(base.angle_rad))
    values = -(angle_matrix(len(points), settings.degree) @ angles)
    return values if settings.constant else values[1:]


def fitted_curve(
    shape: DetectedShape, settings: ShapeFeatureSettings, values: FloatArray, points: int = 64
) -> FloatArray:
    """Returns the curve that features describe, for drawing.

    Args:
        shape: the detected shape.
        settings: kind of the features, a polynomial or a Legendre series of the tangent angle, and whether its constant
            term is one of them.
        values: (k,) features of the shape.
        points: number of points to return.

    Returns:
        (points, 2) image points u, v in px.

    Raises:
        ValueError: the shape has no centreline.
    """
    if shape.centreline is None or shape.base is None:
        raise ValueError(f"no centreline to fit a curve to: {shape.status}")
    local = shape.base.to_base(shape.centreline.points)
    if settings.kind == "polynomial":
        x = np.linspace(local[0, 0], local[:, 0].max(), points)
        y = np.polyval(values if settings.constant else np.append(values, 0.0), x)
        return shape.base.to_image(np.column_stack([x, y]))
    from_base_axis_rad = turning_angles(np.ascontiguousarray(local), cos=1.0, sin=0.0)
    mean_angle = float(np.mean(from_base_axis_rad))
    series = values if settings.constant else np.append(mean_angle, values)
    length = float(np.sum(np.hypot(*np.diff(local, axis=0).T)))
    curve = curve_from_angle(series, length, points)
    # The series has no position: shift it so that the two curves have the same centre.
    spread = np.linspace(0, points - 1, len(local))
    same = np.column_stack([np.interp(spread, np.arange(points), curve[:, k]) for k in range(2)])
    return shape.base.to_image(curve + (local - same).mean(axis=0))
