"""What the rod models read of a frame: stations of the centreline in metres, and the knob."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..types import DetectedShape, FloatArray, Image, Observation, SessionInfo, Status
from ..vision import (
    ResolvedVision,
    SessionCalibration,
    ShapeDetector,
    VisionSettings,
    for_session,
    session_vision,
)
from ._reading import Abstention, implausible_actuation, read_actuation, read_view
from ._rod_inverse import line_stations

__all__ = ["RodLine", "RodReader"]

_KNOB = "knob_deg"


@dataclass(frozen=True, slots=True, eq=False)
class RodLine:
    """What was read of a frame."""

    stations_m: FloatArray
    shape: DetectedShape
    knob_deg: float


class RodReader:
    """Reads stations of the centreline from observations of one session.

    ``shared``: the detection that is taken, scaled to this session, where none of its ``images`` shows a catheter.
    """

    def __init__(
        self, settings: VisionSettings, shared: ResolvedVision | None, info: SessionInfo, images: Sequence[Image] = ()
    ) -> None:
        self._settings, self._info = settings, info
        self._calibration: SessionCalibration | None = None
        self.vision: ResolvedVision | VisionSettings = settings if shared is None else for_session(shared, info)
        if settings.method == "tracer" and images:
            self.vision = session_vision(settings, images, info, shared)
        elif settings.method == "tracer":
            self._calibration = SessionCalibration(settings, info)
        self._detector = ShapeDetector(self.vision)
        self.shape: DetectedShape | None = None
        """Of the last image that was read."""

    def read(self, observation: Observation) -> RodLine | Abstention:
        """The stations in metres, or why there are none."""
        self.shape = None
        view = read_view(observation, self._settings.view, "vision.view")
        if isinstance(view, Abstention):
            return view
        scale = self._info.view(self._settings.view).metres_per_px
        if not isinstance(view, np.ndarray) or scale is None:
            return Abstention(Status.MISSING_INPUT, "a rod model needs an image and its scale, and there is none")
        knob = np.zeros(1)
        if self._info.actuation.knob_gain_per_m_deg:
            found = read_actuation(observation, (_KNOB,))
            if isinstance(found, Abstention):
                return replace(found, detail=f"{_KNOB} is absent, and the catheter is bent by it; state it")
            if (abstention := implausible_actuation({_KNOB: float(found[0])}, self._info)) is not None:
                return abstention
            knob = found
        self.shape = shape = self._detector.detect(view)
        if self._calibration is not None and (vision := self._calibration.add(view)) is not None:
            self._detector = ShapeDetector(vision)
        if shape.centreline is None or shape.base is None:
            return Abstention(shape.status, shape.detail)
        points_m = shape.base.to_base(shape.centreline.points) * scale
        return RodLine(line_stations(points_m), shape, float(knob[0]))
