"""Detection for the rod estimators: the centreline, in the frame in which the rod is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...mechanics.planar import Line
from ...types import DetectedShape, Image, Observation, SessionInfo
from ...vision import INWARD, VisionSettings
from .._reading import Abstention
from .._session_detection import SessionDetection
from ._lines import LineFrame, StatedErrors


@dataclass(frozen=True, slots=True, eq=False)
class Detected:
    """A found ``shape``, the ``frame`` of its line, and the advance of the clamp."""

    shape: DetectedShape
    frame: LineFrame
    advance_m: float = 0.0

    def line(self) -> Line:
        """The line that the rod is fitted to."""
        assert self.shape.centreline is not None
        return self.frame.line(self.shape.centreline, self.advance_m, from_clamp=not self.shape.tip_seen)

    def errors(self) -> StatedErrors | None:
        """Vision's statements about it."""
        return StatedErrors.of(self.shape)


class Detection:
    """Detects the catheter in the frames of one session.

    Args:
        settings: settings of the detection.
        info: the session metadata.
        images: see `SessionDetection`.
        hidden_tips: the method weighs each point by its covariance: it also reads lines whose tip is hidden.
    """

    def __init__(
        self, settings: VisionSettings, info: SessionInfo, images: Sequence[Image], *, hidden_tips: bool = False
    ) -> None:
        self._detection = SessionDetection(settings.with_hidden_tips() if hidden_tips else settings, info, images)
        self._frame: LineFrame | None = None

    @property
    def shape(self) -> DetectedShape | None:
        """Shape in the last image that was read."""
        return self._detection.shape

    def read(self, observation: Observation) -> Detected | Abstention:
        """Returns the catheter in the image of ``observation``, or the reason why it was not found."""
        found = self._detection.read(observation)
        if isinstance(found, Abstention):
            return found
        key = (found.size_px, found.base_side, found.scale_m_per_px)
        if self._frame is None or self._frame.key != key:
            # the first line sets the origin for the session: its base, where the clamp was before it advanced
            inward_px = found.advance_m / found.scale_m_per_px * np.array(INWARD[found.base_side])
            self._frame = LineFrame(*key, origin_px=found.centreline.points[0] - inward_px)
        return Detected(found.shape, self._frame, found.advance_m)
