"""Detection of the catheter in one session for methods that use its centreline: resolved before it or as it comes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..types import CentrelinePx, DetectedShape, Image, Observation, SessionInfo, Status
from ..vision import (
    INWARD,
    ResolvedVision,
    SessionCalibration,
    ShapeDetector,
    VisionSettings,
    auto_calibrate,
    for_session,
    image_from_clamp,
    session_vision,
)
from ._reading import Abstention, read_advance_m, read_view

__all__ = ["DetectedLine", "SessionDetection"]

_NOMINAL_SIDE = "left"


@dataclass(frozen=True, slots=True, eq=False)
class DetectedLine:
    """A found ``shape`` and its ``centreline``; ``size_px``: width and height of the image.

    ``base_side``: the border that the shaft comes from. ``advance_m``: of the clamp, see `read_advance_m`.
    """

    shape: DetectedShape
    centreline: CentrelinePx
    size_px: tuple[int, int]
    base_side: str
    scale_m_per_px: float
    advance_m: float


class SessionDetection:
    """Detects the catheter in the frames of one session.

    ``images`` of the session resolve the detection beforehand. Without them, or where none of them shows a catheter,
    ``shared`` is taken, scaled to this session; without that, what the settings leave open is found in each image,
    until the session's first images have resolved it.
    """

    def __init__(
        self,
        settings: VisionSettings,
        info: SessionInfo,
        images: Sequence[Image] = (),
        shared: ResolvedVision | None = None,
    ) -> None:
        self._settings, self._info = settings, info
        self._calibration: SessionCalibration | None = None
        self.vision: ResolvedVision | VisionSettings = settings if shared is None else for_session(shared, info)
        if settings.method != "classic":
            if images:
                self.vision = session_vision(settings, images, info, shared)
            if not images or not isinstance(self.vision, ResolvedVision):
                self._calibration = SessionCalibration(settings, info)
        self._detector = ShapeDetector(self.vision)
        self.shape: DetectedShape | None = None
        """Of the last image that was read."""

    def read(self, observation: Observation) -> DetectedLine | Abstention:
        """The catheter in the image of ``observation``, or why there is none."""
        self.shape = None
        name = self._settings.view
        view = read_view(observation, name, "vision.view")
        if isinstance(view, Abstention):
            return view
        if not isinstance(view, np.ndarray):
            return Abstention(Status.MISSING_INPUT, "the rod is fitted to an image's centreline; there is no image")
        scale = self._info.view(name).metres_per_px
        if scale is None:
            return Abstention(Status.MISSING_INPUT, f"views.{name}.metres_per_px is not stated; add it to bench.toml")
        advance_m = read_advance_m(observation)
        if isinstance(advance_m, Abstention):
            return advance_m
        side, advance_px = self._side(self._detector), round(advance_m / scale)
        view = image_from_clamp(view, side, advance_px)
        detector = self._detector
        if self._settings.method != "classic" and not isinstance(self.vision, ResolvedVision):
            try:
                detector = ShapeDetector(auto_calibrate(self._settings, [view], self._info))
            except InputError as error:
                self.shape = DetectedShape(Status.NO_CATHETER, str(error))
        shape = self.shape or detector.detect(view)
        shape = self.shape = shape.moved(advance_px * np.array(INWARD[side]))
        if self._calibration is not None and (found := self._calibration.add(view)) is not None:
            self.vision, self._detector = found, ShapeDetector(found)
        if shape.centreline is None:
            return Abstention(shape.status, shape.detail)
        size_px = view.shape[1], view.shape[0]
        return DetectedLine(shape, shape.centreline, size_px, self._side(detector), scale, advance_m)

    def _side(self, detector: ShapeDetector) -> str:
        side = detector.settings.base_side
        if side == "auto":
            side = self._info.view(self._settings.view).base_side or _NOMINAL_SIDE
        return side
