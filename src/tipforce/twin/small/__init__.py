"""The small bench of the demo: sessions of a planar catheter on a beating wall, as events and as files."""

from ._bench import SmallBench
from ._files import VideoMaker, simulate, write_session
from ._sensor import SensorLog
from ._settings import SmallBenchSettings
from ._truth import Truth, read_truth

__all__ = [
    "SensorLog",
    "SmallBench",
    "SmallBenchSettings",
    "Truth",
    "VideoMaker",
    "read_truth",
    "simulate",
    "write_session",
]
