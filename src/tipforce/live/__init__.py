"""Live: a source pushes frames, an estimator answers, sinks get the answers, each at its own pace."""

from ._sinks import Sink
from ._update import CAMERA_STATES, CameraState, LiveHealth, LiveUpdate, SinkHealth, Zero

__all__ = ["CAMERA_STATES", "CameraState", "LiveHealth", "LiveUpdate", "Sink", "SinkHealth", "Zero"]
