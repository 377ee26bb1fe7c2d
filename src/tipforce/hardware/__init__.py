"""Real benches: drivers of cameras, force sensors, stages and knobs, and a `Source` of all their events."""

from ._driver import ClockMap, ClockReport, DeclaredStream, DeviceConfig, Driver, EndOfStream, Setting
from ._net_ft import NetFt, NetFtConfig
from ._source import DeviceHealth, HardwareSource, StreamHealth, StreamMeter

__all__ = [
    "ClockMap",
    "ClockReport",
    "DeclaredStream",
    "DeviceConfig",
    "DeviceHealth",
    "Driver",
    "EndOfStream",
    "HardwareSource",
    "NetFt",
    "NetFtConfig",
    "Setting",
    "StreamHealth",
    "StreamMeter",
]
