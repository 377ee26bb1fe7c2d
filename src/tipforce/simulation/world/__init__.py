"""The world of a simulated bench: catheter, tissue, stage, force sensor, clocks. It does not depend on the images."""

from ._bench_model import BenchModel, build_bench_model, smooth_centrelines
from ._drives import Axis, AxisModel, Drive
from ._force_sensor import ForceSensor, SensorLoad, SensorLog
from ._motion_profile import APPROACH_S, LEAD_S, STEP_S, Motion, instants_until
from ._motion_solver import FAST, FINE, Resolution
from ._parameters import DeviceProperties, SessionParameters
from ._session import Session, require_long_enough, run_session
from ._trajectory import Trajectory, TrajectoryIntegrator
from .settings import WorldSettings

__all__ = [
    "APPROACH_S",
    "FAST",
    "FINE",
    "LEAD_S",
    "STEP_S",
    "Axis",
    "AxisModel",
    "BenchModel",
    "DeviceProperties",
    "Drive",
    "ForceSensor",
    "Motion",
    "Resolution",
    "SensorLoad",
    "SensorLog",
    "Session",
    "SessionParameters",
    "Trajectory",
    "TrajectoryIntegrator",
    "WorldSettings",
    "build_bench_model",
    "instants_until",
    "require_long_enough",
    "run_session",
    "smooth_centrelines",
]
