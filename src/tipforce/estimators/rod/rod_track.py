"""Method `rod-track`: `rod` over time, causal. See `_filter` for how the frames are joined.

The state: the force and its rate, the curvature with the play of the knob, a slow walk of the clamp, and the session's
constants (stiffness, length, scale, camera, the error of the line that stays). Where nothing but a rod without force
explains the shape the constants are learnt and the force is zeroed; nobody has to say when.
"""

import math
from collections.abc import Sequence
from typing import ClassVar

from ...types import ForceEstimate, Image, Observation, SessionInfo, Status
from .._reading import Abstention
from .._recent_share import RecentShare
from ._calibration import Widths
from ._detection import Detection
from ._filter import ContactFilter
from ._knowledge import Knowledge, rod_model
from ._outcome import estimate_of, unfit
from ._settings import RodTrackSettings
from .rod import HistoryRodEstimator, actuation_out_of_range, late_frame


class RodTrackStream:
    """Estimates one session, frame after frame: a late frame is refused, a gap increases the uncertainty."""

    def __init__(
        self,
        settings: RodTrackSettings,
        knowledge: Knowledge,
        widths: Widths,
        info: SessionInfo,
        images: Sequence[Image],
    ) -> None:
        self._settings, self._widths, self._info = settings, widths, info
        self._detection = Detection(settings.vision, info, images)
        self._filter = ContactFilter(settings, knowledge, rod_model(info, settings.segments), info)
        self._explained = RecentShare(settings.explained_s)
        self._stamp_ns: int | None = None

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        stamp = observation.stamp_ns
        if late := late_frame(stamp, self._stamp_ns):
            return late
        detected = self._detection.read(observation)
        shape = self._detection.shape
        found = detected if isinstance(detected, Abstention) else None
        knob = observation.actuation.get("knob_deg", math.nan)
        found = found or actuation_out_of_range(self._settings, self._info, knob)
        elapsed_s = 0.0 if self._stamp_ns is None else (stamp - self._stamp_ns) * 1e-9
        if found is not None or isinstance(detected, Abstention) or detected.shape.centreline is None:
            assert found is not None
            return ForceEstimate.invalid(stamp, found.status, found.detail, shape)
        outcome = self._filter.step(
            detected.line(), detected.frame.scale_m_per_px, knob, elapsed_s, detected.advance_m, detected.errors()
        )
        self._stamp_ns = stamp
        self._explained.add(unfit(self._settings, outcome) is None, elapsed_s)
        estimate = estimate_of(self._settings, self._widths, stamp, outcome, shape)
        if estimate.valid and self._explained.value < self._settings.min_explained:
            return ForceEstimate.invalid(
                stamp,
                Status.OUT_OF_DISTRIBUTION,
                f"the rod explains {self._explained.value:.0%} of the recent frames, fewer than min_explained = "
                f"{self._settings.min_explained:.0%}: look at the detected object with `tipforce inspect`",
                shape,
            )
        return estimate


class RodTrack(HistoryRodEstimator):
    """All frames so far; see the module."""

    name: ClassVar[str] = "rod-track"
    settings_type = RodTrackSettings
    stream_type = RodTrackStream
