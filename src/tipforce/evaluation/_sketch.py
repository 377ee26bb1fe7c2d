"""How a method saw a sample: its curve over the picture, or the curve that ready-made coefficients stand for."""

import numpy as np

from ..estimators import Estimator, ShowsShape
from ..types import FloatArray, Image, Observation, SessionInfo, ShapeFeatures
from ..vision import draw_shape

__all__ = ["curve_of_features", "picture_of"]


def picture_of(estimator: Estimator, observation: Observation, image: Image, info: SessionInfo) -> Image:
    """``image`` with what ``estimator`` saw in it; the bare picture for a method that looks for no shape."""
    if not isinstance(estimator, ShowsShape):
        return image
    sighting, curve_px = estimator.look(observation, info)
    return draw_shape(image, sighting, curve_px=curve_px)


def curve_of_features(view: ShapeFeatures, points: int = 48) -> FloatArray | None:
    """(points, 2): y(x) for x in 0..1, in the file's own unit, where the names are powers ``A1`` (highest) ... ``A5``.

    Coefficients without the constant A5 start at the base's origin. None for other features.
    """
    power = {"A1": 4, "A2": 3, "A3": 2, "A4": 1, "A5": 0}
    if tuple(view.names) not in (tuple(power), tuple(power)[:4]):
        return None
    x = np.linspace(0.0, 1.0, points)
    y = sum((float(value) * x ** power[name] for name, value in zip(view.names, view.values, strict=True)), 0.0 * x)
    return np.column_stack([x, y])
