"""Methods `rod` and `rod-track`: the force by the session model, from one frame or from all frames so far.

Unknown are the session's constants (rod, clamp, camera, knob), slow states, and the force of each frame. The force is
integrated along the direction that the shape shows least (`_walk`), not taken for a Gaussian there. `rod` starts each
frame from the priors; `rod-track` from the frames before (`_filter`). The one rule of abstention is the width of the
90 % interval, beside the check that a rod has this shape at all.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import ModelError
from ...mechanics.planar import FORCE, UNKNOWNS
from ...types import ForceEstimate, Image, Observation, SessionInfo
from ...vision.contact import ContactReader, ContactReading
from .._base import PlanarRodEstimator, Progress, Stream, no_progress
from .._builder import within_error
from .._session_metadata import UninformedStream
from .._values import StoredArrays, StoredFiles, StoredValues
from ._abstention import actuation_out_of_range, impossible, late_frame, too_noisy, unexplained
from ._calibration import Widths, calibrated_widths, without_widths
from ._detection import Detected, Detection
from ._facts import PriorFacts, RodFacts
from ._filter import SessionFilter
from ._knowledge import NEEDED, Knowledge, rod_model
from ._learning import learn
from ._posterior import LinePosterior, Posterior
from ._settings import RodSettings, RodTrackSettings


@dataclass(frozen=True, eq=False)
class _Fitted:
    knowledge: Knowledge
    widths: Widths


class RodEstimator(PlanarRodEstimator):
    """Base class of `rod` and `rod-track`; before `fit`, ``fitted_`` holds the settings' own."""

    settings: RodSettings
    needs_fit: ClassVar[bool] = False
    facts_type: ClassVar[type[RodFacts]] = RodFacts
    stream_type: ClassVar[Callable[..., Stream]]
    """Makes the stream from settings, knowledge, widths of the intervals, metadata and images."""

    def __init__(self, settings: RodSettings | None = None) -> None:
        super().__init__(settings)
        self.fitted_ = _Fitted(Knowledge.stated(self.settings), Widths())

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """The rod's length and stiffness, and the scale."""
        return (*NEEDED, f"views.{self.settings.vision.view}.metres_per_px")

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learns the priors of the rod's constants from sessions with forces; nothing where ``learn`` is off.

        Args:
            dataset: the sessions.
            progress: called with the current work and its finished share.

        Raises:
            InputError: the catheter is found in none of the images.
        """
        self.check_views(dataset)
        if self.settings.learn:
            knowledge = learn(self.settings, dataset, progress or no_progress)
            self.fitted_ = replace(self.fitted_, knowledge=knowledge)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Widens or narrows the intervals so that they hold on sessions apart; the forces stay as they are."""
        report = progress or no_progress
        found = without_widths(self, dataset, lambda share: report("calibrating", share))
        self.fitted_ = replace(self.fitted_, widths=calibrated_widths(found, dataset))
        return self

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """Returns a stream for one session; see `Estimator.start`."""
        if reason := self.obstacle(info):
            return UninformedStream(reason)
        return type(self).stream_type(self.settings, self.fitted_.knowledge, self.fitted_.widths, info, images)

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the factors of the intervals as JSON values, and the priors as arrays."""
        return {"unknowns": list(UNKNOWNS), "widths": self.fitted_.widths.values()}, self.fitted_.knowledge.arrays()

    @classmethod
    def from_state(
        cls, settings: StoredValues, values: StoredValues, arrays: StoredArrays, files: StoredFiles = None
    ) -> Self:
        """Makes the fitted method from its saved state; the inverse of `state`.

        Raises:
            ModelError: the model has other unknowns than this version of the program.
        """
        del files
        if values["unknowns"] != list(UNKNOWNS):
            raise ModelError(f"the model was made for the unknowns {values['unknowns']}; train it again")
        made = cls(cls.settings_type.model_validate(settings))  # type: ignore[arg-type]
        made.fitted_ = _Fitted(Knowledge.of(arrays), Widths.of(values["widths"]))
        return made

    def describe(self) -> RodFacts:
        """Returns the priors of the constants, and the basis of the intervals."""
        knowledge, widths = self.fitted_.knowledge, self.fitted_.widths
        std = np.sqrt(np.diag(knowledge.constants_covariance))
        names = UNKNOWNS[FORCE:]
        return self.facts_type(
            priors={
                name: PriorFacts(mean=mean, std=prior_std)
                for name, mean, prior_std in zip(names, knowledge.constants.tolist(), std.tolist(), strict=True)
            },
            contact_share=knowledge.contact_share,
            sessions=knowledge.sessions,
            interval_basis=widths.basis,
        )


class _LineStream:
    """Reads the line and the knob of each frame of a session."""

    def __init__(self, settings: RodSettings, widths: Widths, info: SessionInfo, images: Sequence[Image]) -> None:
        self._settings, self._widths, self._info = settings, widths, info
        self._detection = Detection(settings.vision, info, images, hidden_tips=True)
        read = settings.contact.read and info.view(settings.vision.view).modality != "xray"
        self._contact = ContactReader() if read else None

    def _read(self, observation: Observation) -> tuple[Detected, float] | ForceEstimate:
        """Returns the detected line and the knob's angle, degrees; NaN: not known. Or the estimate of an abstention."""
        found = self._detection.read(observation)
        knob_deg = observation.actuation.get("knob_deg", math.nan)
        if isinstance(found, Detected):
            out_of_range = actuation_out_of_range(self._settings, self._info, knob_deg)
            if out_of_range is None:
                return found, knob_deg
            found = out_of_range
        return ForceEstimate.invalid(observation.stamp_ns, found.status, found.detail, self._detection.shape)

    def _contact_reading(self, observation: Observation, detected: Detected) -> ContactReading | None:
        """Returns the geometry of the contact at the tip; None without a network, or where the tip is not known."""
        image = observation.views.get(self._settings.vision.view)
        if self._contact is None or not isinstance(image, np.ndarray):
            return None
        return self._contact.read(image, detected.shape, detected.frame.scale_m_per_px)

    def _estimate(self, stamp_ns: int, found: Posterior) -> ForceEstimate:
        """Returns the estimate of a frame; invalid where the noise, the rod's misfit or the interval is too large."""
        settings, shape = self._settings, self._detection.shape
        unfit = too_noisy(settings, found.level)
        if found.impossible:
            unfit = impossible(settings)
        elif not found.explained:
            unfit = unexplained(settings, found.misfit, found.off)
        if unfit:
            return ForceEstimate.invalid(stamp_ns, unfit.status, unfit.detail, shape)
        return within_error(self._widths.estimate(stamp_ns, found.force, shape), settings.max_error_n)


class RodStream(_LineStream):
    """Estimates the frames of one session, each by itself."""

    def __init__(
        self, settings: RodSettings, knowledge: Knowledge, widths: Widths, info: SessionInfo, images: Sequence[Image]
    ) -> None:
        super().__init__(settings, widths, info, images)
        self._model = LinePosterior(settings, knowledge, rod_model(info, settings.segments), info)

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        read = self._read(observation)
        if isinstance(read, ForceEstimate):
            return read
        detected, knob_deg = read
        reading = self._contact_reading(observation, detected)
        found = self._model.solve(detected.line(), detected.frame.scale_m_per_px, knob_deg, detected.errors(), reading)
        return self._estimate(observation.stamp_ns, found)


class RodTrackStream(_LineStream):
    """Estimates one session, frame after frame; a late frame is refused.

    Attributes:
        filter: the state of the session.
    """

    def __init__(
        self,
        settings: RodTrackSettings,
        knowledge: Knowledge,
        widths: Widths,
        info: SessionInfo,
        images: Sequence[Image],
    ) -> None:
        super().__init__(settings, widths, info, images)
        self.filter = SessionFilter(settings, knowledge, rod_model(info, settings.segments), info)
        self._stamp_ns: int | None = None

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        stamp = observation.stamp_ns
        if late := late_frame(stamp, self._stamp_ns):
            return late
        read = self._read(observation)
        if isinstance(read, ForceEstimate):
            return read
        detected, knob_deg = read
        elapsed_s = 0.0 if self._stamp_ns is None else (stamp - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp
        found = self.filter.step(
            detected.line(), detected.frame.scale_m_per_px, knob_deg, elapsed_s, detected.advance_m,
            detected.errors(), self._contact_reading(observation, detected),
        )  # fmt: skip
        return self._estimate(stamp, found)


class Rod(RodEstimator):
    """Each frame by itself; see the module."""

    name: ClassVar[str] = "rod"
    settings_type = RodSettings
    stream_type = RodStream


class RodTrack(RodEstimator):
    """All frames so far; see the module."""

    name: ClassVar[str] = "rod-track"
    settings_type = RodTrackSettings
    stream_type = RodTrackStream

    @property
    def uses_history(self) -> bool:
        """It remembers."""
        return True
