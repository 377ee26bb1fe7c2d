"""Seeing the catheter: frame -> mask -> ordered centreline -> base frame -> coefficients."""

from ._classic import ClassicChain, ClassicSteps
from ._features import NoFeatures, ShapeFeatureSettings, feature_names, fitted_curve, shape_features
from ._settings import BaseSide, Polarity, VisionSettings
from ._sighting import Sighting

__all__ = [
    "BaseSide",
    "ClassicChain",
    "ClassicSteps",
    "NoFeatures",
    "Polarity",
    "ShapeFeatureSettings",
    "Sighting",
    "VisionSettings",
    "feature_names",
    "fitted_curve",
    "shape_features",
]
