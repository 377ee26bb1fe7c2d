"""Inputs of the rod models in a frame: stations of the centreline in metres, and the knob."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...types import DetectedShape, FloatArray, Image, Observation, SessionInfo
from ...vision import ResolvedVision, VisionSettings
from .._reading import Abstention, implausible_actuation, read_actuation
from .._session_detection import SessionDetection
from ._inverse import line_stations

_KNOB = "knob_deg"


@dataclass(frozen=True, slots=True, eq=False)
class RodLine:
    """Inputs of one frame.

    Attributes:
        stations_m: (2 k,) x and y of the stations in metres, base frame.
        shape: the detected shape.
        knob_deg: angle of the knob.
    """

    stations_m: FloatArray
    shape: DetectedShape
    knob_deg: float


class RodReader:
    """Reads stations of the centreline from observations of one session.

    Args:
        settings: settings of the detection.
        shared: see `SessionDetection`.
        info: metadata of the session.
        images: see `SessionDetection`.
    """

    def __init__(
        self, settings: VisionSettings, shared: ResolvedVision | None, info: SessionInfo, images: Sequence[Image] = ()
    ) -> None:
        self._info = info
        self._detection = SessionDetection(settings, info, images, shared)

    @property
    def shape(self) -> DetectedShape | None:
        """Shape in the last image that was read."""
        return self._detection.shape

    @property
    def key(self) -> str:
        """See `SessionDetector.key`."""
        return self._detection.key

    def read(self, observation: Observation) -> RodLine | Abstention:
        """Returns the stations in metres and the knob's angle, or the reason why there are none.

        The knob counts as 0 degrees where its gain is not stated: then it has no known effect on the shape.
        """
        line = self._detection.read(observation)
        knob_deg = 0.0
        if self._info.actuation.knob_gain_per_m_deg:
            values = read_actuation(observation, (_KNOB,))
            if isinstance(values, Abstention):
                return replace(values, detail=f"{_KNOB} is absent, and the catheter is bent by it; state it")
            knob_deg = float(values[0])
            if (abstention := implausible_actuation({_KNOB: knob_deg}, self._info)) is not None:
                return abstention
        if isinstance(line, Abstention):
            return line
        base = line.shape.base
        assert base is not None
        points_m = base.to_base(line.centreline.points) * line.scale_m_per_px
        return RodLine(line_stations(points_m), line.shape, knob_deg)
