"""Centreline detection, by the tracer or by thesis algorithm 1."""

from typing import Protocol

from ..errors import InputError
from ..types import Image, Status
from ._auto_calibrate import auto_calibrate, is_resolved
from ._classic import ClassicDetector
from ._detected_shape import DetectedShape
from ._settings import VisionSettings
from .tracer import Tracer

__all__ = ["ShapeDetector"]


class _Detector(Protocol):
    def detect(self, image: Image) -> DetectedShape: ...


def _detector(settings: VisionSettings) -> _Detector:
    return ClassicDetector(settings) if settings.method == "classic" else Tracer(settings)


class ShapeDetector:
    """Detects the catheter in one image after another, by the method that ``settings`` names.

    The result depends on the image and the settings alone. Settings that leave something open are resolved on each
    image anew: where there are many, resolve them once with `auto_calibrate`.
    """

    def __init__(self, settings: VisionSettings) -> None:
        self.settings = settings
        self._detector = _detector(settings) if settings.method == "classic" or is_resolved(settings) else None

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter's shape in ``image``, (h, w) grey or (h, w, 3) RGB, uint8; or why it was not found."""
        if self._detector is not None:
            return self._detector.detect(image)
        try:
            resolved = auto_calibrate(self.settings, [image])
        except InputError as error:
            return DetectedShape(Status.NO_CATHETER, str(error))
        return _detector(resolved).detect(image)
