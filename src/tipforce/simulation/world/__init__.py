"""The world of a simulated bench: catheter, tissue, stage, force sensor, clocks. Knows nothing of pictures."""

from ._axis import Axis, AxisModel, Drive
from ._course import Course, CourseRun
from ._draw import Device, Draw
from ._lines import smooth_lines
from ._rig import Rig, build_rig
from ._sensor import ForceSensor, Load, SensorLog, read_sensor
from ._session import Session, refuse_short, run_session
from ._solve import FINE, SWIFT, Pace
from ._tune import APPROACH_S, LEAD_S, STEP_S, Motion, instants_until
from .settings import WorldSettings

__all__ = [
    "APPROACH_S",
    "FINE",
    "LEAD_S",
    "STEP_S",
    "SWIFT",
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
    "Pace",
    "Rig",
    "SensorLog",
    "Session",
    "WorldSettings",
    "build_rig",
    "instants_until",
    "read_sensor",
    "refuse_short",
    "run_session",
    "smooth_lines",
]
