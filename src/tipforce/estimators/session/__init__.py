"""One model of a session: constants, slow states and forces, with the posterior of the force integrated.

Methods: `rod` (one frame) and `rod-track` (all frames so far).
"""

from ._abstention import actuation_out_of_range, late_frame, too_noisy, unexplained
from ._calibration import LEAST_STD_N, Widths, errors_over_reach, without_widths
from ._detection import Detected, Detection
from ._direction import DirectionMemory
from ._facts import RodFacts
from ._filter import SessionFilter
from ._knowledge import STIFFNESS_LEFT_OUT, Knowledge, knob_gain_std, noise_unit_m, rod_model, stated_stds
from ._limits import ForceLimits, Limit, LimitsTally
from ._line_error import LINE_PX, MODES, XRAY_FRESH_PX, XRAY_LASTING_PX, LineError
from ._lines import POINTS, LineFrame, StatedErrors
from ._mixture import DIRECTIONS_RAD, MOST_PULL, Mixed
from ._noise_level import NoiseLevel
from ._posterior import Posterior
from ._settings import (
    ContactSettings,
    NoiseSettings,
    OverTimeSettings,
    PriorSettings,
    RodPriors,
    RodSettings,
    RodTrackSettings,
)
from ._state import LEAST_PLAY_DEG2, turn_knob
from .rod import Rod, RodTrack, RodTrackStream

__all__ = [
    "DIRECTIONS_RAD",
    "LEAST_PLAY_DEG2",
    "LEAST_STD_N",
    "LINE_PX",
    "MODES",
    "MOST_PULL",
    "POINTS",
    "STIFFNESS_LEFT_OUT",
    "XRAY_FRESH_PX",
    "XRAY_LASTING_PX",
    "ContactSettings",
    "Detected",
    "Detection",
    "DirectionMemory",
    "ForceLimits",
    "Knowledge",
    "Limit",
    "LimitsTally",
    "LineError",
    "LineFrame",
    "Mixed",
    "NoiseLevel",
    "NoiseSettings",
    "OverTimeSettings",
    "Posterior",
    "PriorSettings",
    "Rod",
    "RodFacts",
    "RodPriors",
    "RodSettings",
    "RodTrack",
    "RodTrackSettings",
    "RodTrackStream",
    "SessionFilter",
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
    "turn_knob",
    "unexplained",
    "without_widths",
]
