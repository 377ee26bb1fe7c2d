"""Detection of the catheter in one session, for methods that use its centreline."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import CentrelinePx, DetectedShape, Image, Observation, SessionInfo, Status
from ..vision import INWARD, ResolvedVision, SessionDetector, VisionSettings, image_from_clamp
from ._reading import Abstention, read_advance_m, read_view

_NOMINAL_SIDE = "left"


@dataclass(frozen=True, slots=True, eq=False)
class DetectedLine:
    """A detected centreline.

    Attributes:
        shape: the detected shape.
        centreline: its centreline in px.
        size_px: width and height of the image.
        base_side: border that the shaft comes from.
        scale_m_per_px: scale of the image.
        advance_m: advance of the clamp, see `read_advance_m`.
    """

    shape: DetectedShape
    centreline: CentrelinePx
    size_px: tuple[int, int]
    base_side: str
    scale_m_per_px: float
    advance_m: float


class SessionDetection:
    """Detects the catheter in the frames of one session, shifted as if the camera moved with the clamp.

    Args:
        settings: settings of the detection.
        info: the session metadata.
        images: see `SessionDetector`.
        shared: see `SessionDetector`.
    """

    def __init__(
        self,
        settings: VisionSettings,
        info: SessionInfo,
        images: Sequence[Image] = (),
        shared: ResolvedVision | None = None,
    ) -> None:
        self._settings, self._info = settings, info
        self._detector = SessionDetector(settings, info, images, shared)
        self.shape: DetectedShape | None = None
        """Shape in the last image that was read."""

    @property
    def key(self) -> str:
        """See `SessionDetector.key`."""
        return self._detector.key

    def read(self, observation: Observation) -> DetectedLine | Abstention:
        """Returns the catheter in the image of ``observation``, or the reason why it was not found."""
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
        side, advance_px = self._side(), round(advance_m / scale)
        view = image_from_clamp(view, side, advance_px)
        shape = self.shape = self._detector.detect(view).moved(advance_px * np.array(INWARD[side]))
        if shape.centreline is None:
            return Abstention(shape.status, shape.detail)
        size_px = view.shape[1], view.shape[0]
        return DetectedLine(shape, shape.centreline, size_px, self._side(), scale, advance_m)

    def _side(self) -> str:
        side = self._detector.base_side
        return _NOMINAL_SIDE if side == "auto" else side
