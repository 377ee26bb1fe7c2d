"""Forces by the rod's mechanics: one frame, and all frames so far."""

from ._calibration import LEAST_STD_N, Widths, errors_over_reach, without_widths
from ._detection import Detected, Detection
from ._facts import RodFacts
from ._knowledge import (
    MODES,
    STIFFNESS_LEFT_OUT,
    Knowledge,
    LineError,
    knob_gain_std,
    noise_unit_m,
    rod_model,
    stated_stds,
)
from ._lines import POINTS, LineFrame, StatedErrors
from ._noise_level import NoiseLevel
from ._outcome import too_noisy, unexplained
from ._posterior import Mixed
from ._settings import (
    ConstantPriors,
    LineSettings,
    NoiseSettings,
    PriorSettings,
    RodFitSettings,
    RodPriors,
    RodSettings,
    RodTrackSettings,
)
from .rod import HistoryRodEstimator, Rod, RodEstimator, actuation_out_of_range, late_frame
from .rod_track import RodTrack

__all__ = [
    "LEAST_STD_N",
    "MODES",
    "POINTS",
    "STIFFNESS_LEFT_OUT",
    "ConstantPriors",
    "Detected",
    "Detection",
    "HistoryRodEstimator",
    "Knowledge",
    "LineError",
    "LineFrame",
    "LineSettings",
    "Mixed",
    "NoiseLevel",
    "NoiseSettings",
    "PriorSettings",
    "Rod",
    "RodEstimator",
    "RodFacts",
    "RodFitSettings",
    "RodPriors",
    "RodSettings",
    "RodTrack",
    "RodTrackSettings",
    "StatedErrors",
    "Widths",
    "actuation_out_of_range",
    "errors_over_reach",
    "knob_gain_std",
    "late_frame",
    "noise_unit_m",
    "rod_model",
    "stated_stds",
    "too_noisy",
    "unexplained",
    "without_widths",
]
