"""Real benches: drivers of cameras, force sensors, stages and knobs, and a `Source` of all their events.

Each driver has a typed config, a table of ``bench.toml``. It reads the requested settings back, is connected again
where it is lost, and has an emulator in `tipforce.hardware.emulators`, or a substitute in the tests.
"""

from .._system.arrival_clock import ArrivalClock, ClockReport
from ._bench import DRIVERS, BenchDevices, open_bench, read_devices
from ._daq import DaqCalibration, DaqForce, DaqForceConfig, read_calibration
from ._driver import DeclaredStream, DeviceConfig, DeviceTable, Driver, EndOfStream, Setting
from ._genicam import GenICamCamera, GenICamCameraConfig
from ._grbl import AxisConfig, GrblActuators, GrblConfig, GrblStage, MotionConfig
from ._knob import ConstantKnob, ConstantKnobConfig, LogKnob, LogKnobConfig, SerialKnob, SerialKnobConfig
from ._net_ft import NetFt, NetFtConfig
from ._opencv import OpenCvCamera, OpenCvCameraConfig
from ._source import DeviceHealth, HardwareSource, StreamHealth, StreamMeter
from ._video import Video, VideoConfig

__all__ = [
    "DRIVERS",
    "ArrivalClock",
    "AxisConfig",
    "BenchDevices",
    "ClockReport",
    "ConstantKnob",
    "ConstantKnobConfig",
    "DaqCalibration",
    "DaqForce",
    "DaqForceConfig",
    "DeclaredStream",
    "DeviceConfig",
    "DeviceHealth",
    "DeviceTable",
    "Driver",
    "EndOfStream",
    "GenICamCamera",
    "GenICamCameraConfig",
    "GrblActuators",
    "GrblConfig",
    "GrblStage",
    "HardwareSource",
    "LogKnob",
    "LogKnobConfig",
    "MotionConfig",
    "NetFt",
    "NetFtConfig",
    "OpenCvCamera",
    "OpenCvCameraConfig",
    "SerialKnob",
    "SerialKnobConfig",
    "Setting",
    "StreamHealth",
    "StreamMeter",
    "Video",
    "VideoConfig",
    "open_bench",
    "read_calibration",
    "read_devices",
]
