"""Calibrates a bench from its own recordings: sensor pose, moving mass, knob map, stiffness, tissue, and its camera."""

from ._beads import BeadView, calibrate_beads
from ._board_pair import BoardPair, calibrate_board_pair
from ._calibrate import Calibration, SessionResult, calibrate_sessions
from ._camera import (
    PRINT_STD_SHARE,
    BoardResult,
    BoardSettings,
    calibrate_board,
    scale_from_diameter,
    scale_from_ruler,
    scale_from_shaft,
)
from ._knob import KnobFit, fit_knob
from ._quantity import Quantity, combined
from ._relative_pose import RelativePose, StatedPose, TipPairs, moved_camera, refine_relative_pose, relative_covariance
from ._rod_fit import RodFit, fit_rod, line_forces
from ._session import CalibrationSession, read_session
from ._tissue import TissueFit, fit_tissue
from ._view_tips import read_tip_pairs

__all__ = [
    "PRINT_STD_SHARE",
    "BeadView",
    "BoardPair",
    "BoardResult",
    "BoardSettings",
    "Calibration",
    "CalibrationSession",
    "KnobFit",
    "Quantity",
    "RelativePose",
    "RodFit",
    "SessionResult",
    "StatedPose",
    "TipPairs",
    "TissueFit",
    "calibrate_beads",
    "calibrate_board",
    "calibrate_board_pair",
    "calibrate_sessions",
    "combined",
    "fit_knob",
    "fit_rod",
    "fit_tissue",
    "line_forces",
    "moved_camera",
    "read_session",
    "read_tip_pairs",
    "refine_relative_pose",
    "relative_covariance",
    "scale_from_diameter",
    "scale_from_ruler",
    "scale_from_shaft",
]
