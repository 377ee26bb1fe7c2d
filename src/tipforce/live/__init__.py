"""Live estimation: a source pushes frames, an estimator estimates, and each sink gets the estimates at its own pace."""

from ._engine import Engine
from ._loop import LoopCommands, LoopRun, LoopState, LoopStatus
from ._paced import PacedSource
from ._report import LiveReport
from ._settings import LiveSettings
from ._sinks import Sink
from ._update import CAMERA_STATES, CameraState, LiveHealth, LiveUpdate, SinkHealth, Zero
from ._watchdog import CameraWatch, Fault

__all__ = [
    "CAMERA_STATES",
    "CameraState",
    "CameraWatch",
    "Engine",
    "Fault",
    "LiveHealth",
    "LiveReport",
    "LiveSettings",
    "LiveUpdate",
    "LoopCommands",
    "LoopRun",
    "LoopState",
    "LoopStatus",
    "PacedSource",
    "Sink",
    "SinkHealth",
    "Zero",
]
