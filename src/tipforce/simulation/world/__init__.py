"""The world of a simulated bench: catheter, tissue, stage, force sensor, clocks. Knows nothing of pictures."""

from ._bench_model import Rig, build_rig, smooth_lines
from ._drives import Axis, AxisModel, Drive
from ._force_sensor import ForceSensor, Load, SensorLog, read_sensor
from ._motion_profile import APPROACH_S, LEAD_S, STEP_S, Motion, instants_until
from ._motion_solver import FINE, SWIFT, Pace
from ._parameters import Device, Draw
from ._session import Session, refuse_short, run_session
from ._trajectory import Course, CourseRun
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
