"""Detects the shape of the catheter for page and recording if the method (a network) does not detect it."""

import math

import numpy as np

from ..types import DetectedShape, Image, SessionInfo
from ..vision import INWARD, SessionCalibration, ShapeDetector, VisionSettings, image_from_clamp


class ShapeFinder:
    """Detects the catheter in the images of one view, after the first images have resolved the settings.

    Detection takes a tenth of a millisecond; `SessionCalibration` resolves the settings.

    Args:
        view: name of the view.
        info: metadata of the session.
    """

    def __init__(self, view: str, info: SessionInfo) -> None:
        self._calibration = SessionCalibration(VisionSettings(view=view), info)
        view_info = info.view(view)
        self._side, self._scale = view_info.base_side or "left", view_info.metres_per_px
        self._detector: ShapeDetector | None = None

    def find(self, image: Image, advance_mm: float = 0.0) -> DetectedShape | None:
        """Returns the shape in ``image``, or the reason why none is detected; None before the settings are resolved.

        Args:
            image: the image (h, w) or (h, w, 3).
            advance_mm: advance of the clamp; the image is shifted by it if the scale is known.
        """
        if not math.isfinite(advance_mm):
            return None  # the position of the base is not known
        advance_px = 0 if self._scale is None else round(1e-3 * advance_mm / self._scale)
        from_clamp = image_from_clamp(image, self._side, advance_px)
        resolved = self._calibration.add(from_clamp)
        if resolved is not None and (vision := resolved.vision) is not None:
            self._detector, self._side = ShapeDetector(vision), vision.base_side
        if self._detector is None:
            return None
        return self._detector.detect(from_clamp).moved(advance_px * np.array(INWARD[self._side]))

    def close(self) -> None:
        """Ends the detector: no image comes any more."""
        self._calibration.close()
