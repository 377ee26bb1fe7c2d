"""Seeing the catheter: frame -> mask -> ordered centreline -> base frame -> coefficients."""

from ._classic import ClassicChain, ClassicSteps
from ._draw import contact_sheet, draw_estimate, draw_sighting, shaft_mask
from ._features import NoFeatures, ShapeFeatureSettings, feature_names, fitted_curve, shape_features
from ._figures import figure_17, figure_18
from ._fine import FineTracer
from ._inspect import Inspection, InspectSettings, Reasons, Tally, inspect_picture
from ._nominal import in_session
from ._see import Vision
from ._settings import BaseSide, Polarity, VisionSettings
from ._settle import is_settled, settle
from ._sighting import Sighting

__all__ = [
    "BaseSide",
    "ClassicChain",
    "ClassicSteps",
    "FineTracer",
    "InspectSettings",
    "Inspection",
    "NoFeatures",
    "Polarity",
    "Reasons",
    "ShapeFeatureSettings",
    "Sighting",
    "Tally",
    "Vision",
    "VisionSettings",
    "contact_sheet",
    "draw_estimate",
    "draw_sighting",
    "feature_names",
    "figure_17",
    "figure_18",
    "fitted_curve",
    "in_session",
    "inspect_picture",
    "is_settled",
    "settle",
    "shaft_mask",
    "shape_features",
]
