"""Detection for the rod estimators: resolved on a session's images, before it or as they come."""

from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...types import DetectedShape, Image, Observation, SessionInfo, Status
from ...vision import (
    ResolvedVision,
    SessionCalibration,
    ShapeDetector,
    VisionSettings,
    auto_calibrate,
    session_vision,
)
from .._reading import Abstention, read_view
from ._lines import LineFrame

__all__ = ["Detected", "Detection"]

_NOMINAL_SIDE = "left"


class Detected:
    """``shape`` and the ``frame`` in which its line lies."""

    __slots__ = ("frame", "shape")

    def __init__(self, shape: DetectedShape, frame: LineFrame) -> None:
        self.shape, self.frame = shape, frame


class Detection:
    """Detects the catheter in the frames of one session.

    ``images`` of the session resolve the detection beforehand. Without them what the settings leave open is found in
    each image, until the session's first images have resolved it.
    """

    def __init__(self, settings: VisionSettings, info: SessionInfo, images: Sequence[Image]) -> None:
        self._settings, self._info = settings, info
        self._resolved: ResolvedVision | None = None
        self._calibration: SessionCalibration | None = None
        self._detector: ShapeDetector | None = None
        self._frame: LineFrame | None = None
        if settings.method == "tracer":
            if images:
                found = session_vision(settings, images, info)
                self._resolved = found if isinstance(found, ResolvedVision) else None
            if self._resolved is None:
                self._calibration = SessionCalibration(settings, info)
        self.shape: DetectedShape | None = None
        """Of the last image that was read."""

    def read(self, observation: Observation) -> Detected | Abstention:
        """The catheter in the image of ``observation``, or why there is none."""
        self.shape = None
        view = read_view(observation, self._settings.view, "vision.view")
        if isinstance(view, Abstention):
            return view
        if not isinstance(view, np.ndarray):
            return Abstention(Status.MISSING_INPUT, "the rod is fitted to an image's centreline; there is no image")
        if self._resolved is None and self._settings.method == "tracer":
            try:
                resolved = auto_calibrate(self._settings, [view], self._info)
            except InputError as error:
                return Abstention(Status.NO_CATHETER, str(error))
            detector, side = ShapeDetector(resolved), resolved.base_side
        else:
            detector = self._detector = self._detector or ShapeDetector(self._resolved or self._settings)
            side = self._resolved.base_side if self._resolved else self._stated_side()
        self.shape = detector.detect(view)
        if self._calibration is not None and (found := self._calibration.add(view)) is not None:
            self._resolved, self._detector = found, None
        if not self.shape.found:
            return Abstention(self.shape.status, self.shape.detail)
        scale = self._info.view(self._settings.view).metres_per_px
        if scale is None:
            name = self._settings.view
            return Abstention(Status.MISSING_INPUT, f"views.{name}.metres_per_px is not stated; add it to bench.toml")
        key = ((view.shape[1], view.shape[0]), side, scale)
        if self._frame is None or self._frame.key != key:
            self._frame = LineFrame(*key)
        return Detected(self.shape, self._frame)

    def _stated_side(self) -> str:
        side = self._settings.base_side
        if side == "auto":
            side = self._info.view(self._settings.view).base_side or _NOMINAL_SIDE
        return side
