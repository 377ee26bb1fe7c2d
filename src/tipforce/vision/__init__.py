"""Detection of the catheter: image -> ordered centreline -> base frame -> shape features."""

from ..types import DetectedShape
from ._advice import Advice, Candidate, advise, likely_objects, with_advice
from ._against_knob import bends_against_knob
from ._annotation import Annotation
from ._auto_calibrate import auto_calibrate, is_resolved
from ._clamp import INWARD, image_from_clamp
from ._classic import ClassicDetector, ClassicSteps
from ._detector import DetectorKind, ShapeDetector, detector_kind
from ._draw import contact_sheet, draw_estimate, draw_objects, draw_shape, shaft_mask
from ._features import NoFeatures, ShapeFeatureSettings, feature_names, fitted_curve, shape_features
from ._inspect import Inspection, InspectSettings, Reasons, Tally, inspect_image
from ._session_calibration import RESOLVED_AFTER_IMAGES, SessionCalibration, SessionDetector
from ._session_size import for_session
from ._settings import BaseSide, Polarity, ResolvedVision, VisionSettings
from ._thesis_figures import figure_17, figure_18
from .locator import fitted_log_odds, line_log_odds
from .tracer import Tracer

__all__ = [
    "INWARD",
    "RESOLVED_AFTER_IMAGES",
    "Advice",
    "Annotation",
    "BaseSide",
    "Candidate",
    "ClassicDetector",
    "ClassicSteps",
    "DetectedShape",
    "DetectorKind",
    "InspectSettings",
    "Inspection",
    "NoFeatures",
    "Polarity",
    "Reasons",
    "ResolvedVision",
    "SessionCalibration",
    "SessionDetector",
    "ShapeDetector",
    "ShapeFeatureSettings",
    "Tally",
    "Tracer",
    "VisionSettings",
    "advise",
    "auto_calibrate",
    "bends_against_knob",
    "contact_sheet",
    "detector_kind",
    "draw_estimate",
    "draw_objects",
    "draw_shape",
    "feature_names",
    "figure_17",
    "figure_18",
    "fitted_curve",
    "fitted_log_odds",
    "for_session",
    "image_from_clamp",
    "inspect_image",
    "is_resolved",
    "likely_objects",
    "line_log_odds",
    "shaft_mask",
    "shape_features",
    "with_advice",
]
