"""Converts an observation to the inputs of a regression: shape numbers, then actuation."""

from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...geometry import angle_matrix, arc_length, turning_angles
from ...types import DetectedShape, FloatArray, Image, Observation, ShapeFeatures, Status
from ...vision import NoFeatures, SessionDetector, ShapeFeatureSettings, feature_names, shape_features
from .._reading import Abstention, read_actuation, read_view
from ._settings import AngleSettings, ShapeRegressorSettings

_CURVE_POINTS = 65


class Inputs:
    """Reads the observations of one session.

    Args:
        settings: settings of the regression.
        actuation: names of the actuation, in order.
        detector: detector of the session.
        shape_names: names that ready-made shape numbers must have, in order; None while training.
    """

    def __init__(
        self,
        settings: ShapeRegressorSettings,
        actuation: Sequence[str],
        detector: SessionDetector,
        shape_names: Sequence[str] | None = None,
    ) -> None:
        self._settings, self._view = settings, settings.vision.view
        self._actuation, self._detector = tuple(actuation), detector
        self.shape: DetectedShape | None = None
        """Shape in the last image that was read."""
        self._angle_features = None  # numbers of the angle series, which come after the other shape numbers
        if settings.angles is not None:
            self._angle_features = ShapeFeatureSettings(kind="legendre", degree=settings.angles.degree)
        self._shape_names = None if shape_names is None else tuple(shape_names)

    def names(self, view: Image | ShapeFeatures) -> tuple[str, ...]:
        """Returns the names of the shape numbers of ``view``; the angle series comes after the others."""
        names = view.names if isinstance(view, ShapeFeatures) else feature_names(self._settings.features)
        if self._angle_features is None:
            return tuple(names)
        return (*names, *(f"angle {name}" for name in feature_names(self._angle_features)))

    def read(self, observation: Observation) -> FloatArray | Abstention:
        """Returns (k,) shape numbers and actuation, or the reason why there are none."""
        self.shape = None
        view = read_view(observation, self._view, "vision.view")
        if isinstance(view, Abstention):
            return view
        values = self._table(view) if isinstance(view, ShapeFeatures) else self._image(view)
        if isinstance(values, Abstention):
            return values
        drives = read_actuation(observation, self._actuation)
        return drives if isinstance(drives, Abstention) else np.concatenate([values, drives])

    def _image(self, image: Image) -> FloatArray | Abstention:
        """Returns the shape numbers of the catheter in an image, or the reason why there are none."""
        self.shape = detected = self._detector.detect(image)
        if not detected.found:
            return Abstention(detected.status, detected.detail)
        values = shape_features(detected, self._settings.features)
        if isinstance(values, NoFeatures):
            return Abstention(values.status, values.detail)
        if self._angle_features is not None:
            more = shape_features(detected, self._angle_features)
            if isinstance(more, NoFeatures):
                return Abstention(more.status, more.detail)
            values = np.concatenate([values, more])
        return values

    def _table(self, view: ShapeFeatures) -> FloatArray | Abstention:
        """Returns ready-made shape numbers, with the angle series where it is used, or the reason of an abstention."""
        if self._shape_names is not None and self.names(view) != self._shape_names:
            return Abstention(
                Status.MISSING_INPUT,
                f"the shape is given as {', '.join(view.names)}, but this model was trained with "
                f"{', '.join(self._shape_names)}",
            )
        if not np.isfinite(view.values).all():
            return Abstention(Status.NO_CATHETER, "the shape numbers of this sample are not finite")
        if self._settings.angles is None:
            return view.values
        more = angles_of_polynomial(view.values, self._settings.features, self._settings.angles)
        return np.concatenate([view.values, more])


def angles_of_polynomial(coefficients: FloatArray, features: ShapeFeatureSettings, angles: AngleSettings) -> FloatArray:
    """Returns the angle series of a curve that is given as a polynomial.

    Args:
        coefficients: coefficients of y(x), highest power first.
        features: settings of the polynomial.
        angles: settings of the series; its ``length`` is the arc length from x = 0.

    Returns:
        (degree + 1,) series in rad.

    Raises:
        InputError: the settings do not describe the coefficients.
    """
    expected = features.degree + features.constant
    if features.kind != "polynomial" or len(coefficients) != expected:
        raise InputError(
            f"the data have {len(coefficients)} shape numbers, but features.kind={features.kind}, "
            f"features.degree={features.degree}, features.constant={str(features.constant).lower()} describe "
            f"{expected}: set them as the numbers were made, or leave angles out"
        )
    if angles.length is None:
        raise InputError("an angle series of ready-made polynomials needs the setting angles.length, in their unit")
    # a fine curve over x, which reaches the length at the latest at x = length; then points uniform in arc length
    x = np.linspace(0.0, angles.length, 4 * _CURVE_POINTS)
    y = np.polyval(coefficients if features.constant else np.append(coefficients, 0.0), x)
    arc = arc_length(np.column_stack([x, y]))
    even_arc = np.linspace(0.0, angles.length, _CURVE_POINTS)
    points = np.column_stack([np.interp(even_arc, arc, x), np.interp(even_arc, arc, y)])
    return angle_matrix(_CURVE_POINTS, angles.degree) @ turning_angles(points, 1.0, 0.0)
