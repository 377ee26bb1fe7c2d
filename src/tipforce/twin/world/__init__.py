"""The world of a simulated bench: catheter, tissue, stage, force sensor, clocks. Knows nothing of pictures."""

from ._axis import Axis, AxisModel, Drive
from ._course import Course, CourseRun
from ._draw import Device, Draw
from ._lines import smooth_lines
from ._rig import Rig
from ._sensor import ForceSensor, Load, SensorLog, read_sensor
from ._session import Session, run_session
from ._tune import LEAD_S, STEP_S, Motion

__all__ = [
    "LEAD_S",
    "STEP_S",
    "Axis",
    "AxisModel",
    "Course",
    "CourseRun",
    "Device",
    "Draw",
    "Drive",
    "ForceSensor",
    "Load",
    "Motion",
    "Rig",
    "SensorLog",
    "Session",
    "read_sensor",
    "run_session",
    "smooth_lines",
]
