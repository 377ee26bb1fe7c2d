"""Method `session`: the force from all centrelines so far, by a model of the whole session.

Unknown are the session's constants (rod, clamp, camera, knob), slow states, and the force of each frame. The force is
integrated along the direction that the shape shows least (`_walk`), not taken for a Gaussian there. The one rule of
abstention is the width of the 90 % interval, beside the check that a rod has this shape at all.
"""

import math
from collections.abc import Sequence
from typing import ClassVar

from ...types import ForceEstimate, Image, Observation, SessionInfo
from .._builder import within_error
from .._reading import Abstention
from ..rod import (
    Detection,
    HistoryRodEstimator,
    Knowledge,
    Widths,
    actuation_out_of_range,
    late_frame,
    rod_model,
    too_noisy,
    unexplained,
)
from ._filter import SessionFilter
from ._settings import SessionSettings


class SessionStream:
    """Estimates one session, frame after frame; a late frame is refused.

    Attributes:
        filter: the state of the session.
    """

    def __init__(
        self,
        settings: SessionSettings,
        knowledge: Knowledge,
        widths: Widths,
        info: SessionInfo,
        images: Sequence[Image],
    ) -> None:
        self._settings, self._widths, self._info = settings, widths, info
        self._detection = Detection(settings.vision, info, images, hidden_tips=True)
        self.filter = SessionFilter(settings, knowledge, rod_model(info, settings.segments), info)
        self._stamp_ns: int | None = None

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        stamp, settings = observation.stamp_ns, self._settings
        if late := late_frame(stamp, self._stamp_ns):
            return late
        detected = self._detection.read(observation)
        shape = self._detection.shape
        if isinstance(detected, Abstention):
            return ForceEstimate.invalid(stamp, detected.status, detected.detail, shape)
        knob = observation.actuation.get("knob_deg", math.nan)
        if abstention := actuation_out_of_range(settings, self._info, knob):
            return ForceEstimate.invalid(stamp, abstention.status, abstention.detail, shape)
        elapsed_s = 0.0 if self._stamp_ns is None else (stamp - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp
        found = self.filter.step(
            detected.line(), detected.frame.scale_m_per_px, knob, elapsed_s, detected.advance_m, detected.errors()
        )
        unfit = too_noisy(settings, found.level) if found.explained else unexplained(settings, found.misfit)
        if unfit:
            return ForceEstimate.invalid(stamp, unfit.status, unfit.detail, shape)
        return within_error(self._widths.estimate(stamp, found.force, shape), settings.max_error_n)


class SessionModel(HistoryRodEstimator):
    """All frames so far; see the module."""

    name: ClassVar[str] = "session"
    settings_type = SessionSettings
    stream_type = SessionStream
