"""The world of a simulated bench: catheter, tissue, stage, force sensor, clocks. Knows nothing of pictures."""

from ._axis import Axis, AxisLimits
from ._course import LEAD_S, STEP_S, Course, Motion, Rig
from ._draw import Device, Draw
from ._lines import smooth_lines
from ._sensor import Load, SensorLog, read_sensor
from ._session import Session, run_session

__all__ = [
    "LEAD_S",
    "STEP_S",
    "Axis",
    "AxisLimits",
    "Course",
    "Device",
    "Draw",
    "Load",
    "Motion",
    "Rig",
    "SensorLog",
    "Session",
    "read_sensor",
    "run_session",
    "smooth_lines",
]
