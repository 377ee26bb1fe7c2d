"""Calibrates a bench from its own recordings: sensor pose, moving mass, knob map, stiffness, tissue, and its camera."""

from ._calibrate import Calibration, SessionResult, calibrate_sessions
from ._camera import BoardResult, BoardSettings, calibrate_board, scale_from_diameter, scale_from_ruler
from ._knob import KnobFit, fit_knob
from ._quantity import Quantity, combined
from ._rod_fit import RodFit, fit_rod, line_forces
from ._session import CalibrationSession, read_session
from ._tissue import TissueFit, fit_tissue

__all__ = [
    "BoardResult",
    "BoardSettings",
    "Calibration",
    "CalibrationSession",
    "KnobFit",
    "Quantity",
    "RodFit",
    "SessionResult",
    "TissueFit",
    "calibrate_board",
    "calibrate_sessions",
    "combined",
    "fit_knob",
    "fit_rod",
    "fit_tissue",
    "line_forces",
    "read_session",
    "scale_from_diameter",
    "scale_from_ruler",
]
