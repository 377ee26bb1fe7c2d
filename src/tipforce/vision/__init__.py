"""Seeing the catheter: frame -> mask -> ordered centreline -> base frame -> coefficients."""

from ._classic import ClassicChain, ClassicSteps
from ._draw import contact_sheet, draw_estimate, draw_sighting, shaft_mask
from ._features import NoFeatures, ShapeFeatureSettings, feature_names, fitted_curve, shape_features
from ._figures import figure_17, figure_18
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
    "contact_sheet",
    "draw_estimate",
    "draw_sighting",
    "feature_names",
    "figure_17",
    "figure_18",
    "fitted_curve",
    "shaft_mask",
    "shape_features",
]
