"""Centreline detection, by the tracer, the trained networks, or thesis algorithm 1."""

from typing import Protocol

from ..errors import InputError
from ..types import DetectedShape, Image, SessionInfo, Status
from ._auto_calibrate import auto_calibrate, is_resolved
from ._by_keypoints import KeypointDetector
from ._classic import ClassicDetector
from ._settings import BaseSide, ResolvedVision, VisionSettings
from .tracer import Tracer


class _Detector(Protocol):
    def detect(self, image: Image) -> DetectedShape: ...


def _detector(vision: ResolvedVision | VisionSettings) -> _Detector:
    if vision.method == "classic":
        return ClassicDetector(vision)
    if isinstance(vision, ResolvedVision) and vision.keypoints is not None:
        return KeypointDetector(vision)
    return Tracer(vision)


class ShapeDetector:
    """Detects the catheter in one image after another, by the method that the settings name.

    The result depends on the image, the settings and the metadata ``info`` alone. Settings that leave something open
    are resolved on each image anew: where there are many, resolve them once with `SessionDetector`.
    """

    def __init__(self, vision: ResolvedVision | VisionSettings, info: SessionInfo | None = None) -> None:
        self.settings, self._info = vision, info
        self._base_side: BaseSide = vision.base_side
        self._open: VisionSettings | None = None
        self._detector: _Detector | None = None
        if isinstance(vision, ResolvedVision) or vision.method == "classic" or (info is None and is_resolved(vision)):
            self._detector = _detector(vision)
        else:
            self._open = vision

    @property
    def base_side(self) -> BaseSide:
        """The border that the shaft came from in the last image; "auto" where nothing states or found it."""
        return self._base_side

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter's shape in ``image``, (h, w) grey or (h, w, 3) RGB, uint8; or why it was not found."""
        detector = self._detector
        if detector is None:
            assert self._open is not None
            try:
                found = auto_calibrate(self._open, [image], self._info)
            except InputError as error:
                return DetectedShape(Status.NO_CATHETER, str(error))
            detector, self._base_side = Tracer(found), found.base_side
        return detector.detect(image)
