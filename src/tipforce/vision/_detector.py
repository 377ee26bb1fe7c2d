"""Centreline detection, by the locator and the tracer, or by thesis algorithm 1."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from ..errors import InputError
from ..types import BoolArray, DetectedShape, Image, SessionInfo, Status
from ._auto_calibrate import auto_calibrate, is_resolved
from ._by_locator import LocatorDetector
from ._classic import ClassicDetector
from ._settings import BaseSide, ResolvedVision, VisionSettings
from .tracer import Tracer


class Detector(Protocol):
    """Detects the catheter in one image after another."""

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter's shape in ``image``, or why it was not found."""
        ...


@dataclass(frozen=True, slots=True)
class DetectorKind:
    """A method of detection: its detector, and the abilities of the detector.

    Attributes:
        make: makes the detector from settings.
        by_session: True where open settings are resolved session by session, on images of the session.
        mask: returns the mask (h, w) of the catheter on which the detection rests; None for a detector without one.
        thesis: True for the thesis's own algorithm.
    """

    make: Callable[[ResolvedVision | VisionSettings], Detector]
    by_session: bool = True
    mask: Callable[[ResolvedVision | VisionSettings, Image], BoolArray] | None = None
    thesis: bool = False


def _with_locator(vision: ResolvedVision | VisionSettings) -> Detector:
    if isinstance(vision, ResolvedVision) and vision.locator is not None:
        return LocatorDetector(vision)
    return Tracer(vision)


_KINDS: dict[str, DetectorKind] = {
    "tracer": DetectorKind(_with_locator),
    "auto": DetectorKind(_with_locator),
    "classic": DetectorKind(
        ClassicDetector,
        by_session=False,
        mask=lambda vision, image: ClassicDetector(vision).steps(image).binary,
        thesis=True,
    ),
}


def detector_kind(method: str) -> DetectorKind:
    """Returns the detector of a method and its abilities; ``method``: see `VisionSettings.method`.

    >>> detector_kind("classic").by_session, detector_kind("tracer").by_session
    (False, True)
    """
    return _KINDS[method]


class ShapeDetector:
    """Detects the catheter in one image after another, by the method that the settings name.

    The result depends on the image, the settings and the metadata ``info`` alone. Settings that leave something open
    are resolved on each image anew: where there are many, resolve them once with `SessionDetector`.
    """

    def __init__(self, vision: ResolvedVision | VisionSettings, info: SessionInfo | None = None) -> None:
        self.settings, self._info = vision, info
        self.resolved = vision if isinstance(vision, ResolvedVision) else None
        """Settings that the last image was read with; None before open settings were resolved on one."""
        self._open: VisionSettings | None = None
        self._detector: Detector | None = None
        kind = detector_kind(vision.method)
        if isinstance(vision, ResolvedVision) or not kind.by_session or (info is None and is_resolved(vision)):
            self._detector = kind.make(vision)
        else:
            self._open = vision

    @property
    def base_side(self) -> BaseSide:
        """The border that the shaft came from in the last image; "auto" where nothing states or found it."""
        return (self.resolved or self.settings).base_side

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter's shape in ``image``, (h, w) grey or (h, w, 3) RGB, uint8; or why it was not found."""
        detector = self._detector
        if detector is None:
            assert self._open is not None
            try:
                self.resolved = auto_calibrate(self._open, [image], self._info)
            except InputError as error:
                return DetectedShape(Status.NO_CATHETER, str(error))
            detector = _with_locator(self.resolved)
        return detector.detect(image)
