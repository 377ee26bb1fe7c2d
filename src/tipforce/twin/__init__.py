"""The simulated bench: sessions of a catheter on a beating wall, as a source of events and as files."""

from ._bench import SmallBench
from ._files import PRESETS, VideoMaker, simulate, write_session
from ._sensor import SensorLog
from ._settings import SmallBenchSettings
from ._truth import Truth, read_truth

__all__ = [
    "PRESETS",
    "SensorLog",
    "SmallBench",
    "SmallBenchSettings",
    "Truth",
    "VideoMaker",
    "read_truth",
    "simulate",
    "write_session",
]
