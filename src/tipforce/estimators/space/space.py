"""Method `rod-3d`: the force in space from the centrelines of one view or two, by the mechanics of the rod in space.

One rod in space is fitted to the lines of all views together, in the pixels of each view: no curve in space is
triangulated before. The force is integrated along the direction that the lines show least, and constants of the session
are learnt over time (`_filter`). An instant with one view has an estimate, too, whose depth is known up to its mirror
image at best: its interval then contains both.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import InputError, ModelError
from ...types import (
    DetectedShape,
    FloatArray,
    ForceEstimate,
    Image,
    Observation,
    SessionInfo,
    ShapeBeside,
    Status,
    missing_views,
    views_text,
)
from ...vision import detector_kind
from .._base import Estimator, Progress, Stream, no_progress
from .._builder import within_error
from .._facts import ModelFacts, ModelSummary
from .._reading import Abstention
from .._session_detection import DetectedLine, SessionDetection
from .._session_metadata import UninformedStream
from .._values import StoredArrays, StoredFiles, StoredValues
from ..session import actuation_out_of_range, late_frame, too_noisy, unexplained, without_widths
from ._filter import SpaceFilter, SpaceResult, ViewShape
from ._motion import MAX_LINE_AGE_S
from ._settings import SpaceSettings
from ._widths import SpaceWidths, calibrated_widths

_NEEDED = ("catheter.flexible_length_m", "catheter.bending_stiffness_nm2")
_CONTACT_N = 0.01
"""Force from which a frame counts as in contact."""
_LEAST_CONTACT, _MOST_CONTACT = 0.02, 0.98
"""Limits of the share of contact that `fit` learns."""


@dataclass(frozen=True)
class _Fitted:
    contact_share: float
    widths: SpaceWidths = SpaceWidths()  # noqa: RUF009 (frozen)


class SpaceFacts(ModelFacts, frozen=True):
    """Facts of `rod-3d`.

    Attributes:
        contact_share: share of the frames in which the tip touches.
    """

    contact_share: float = 0.5

    def summary(self) -> ModelSummary:
        """Returns the facts in words."""
        line = f"90 % intervals rest on {self.interval_basis}"
        inputs = (
            "The detected centrelines of one view or two, the knob, and the catheter's stated stiffness and length."
        )
        return ModelSummary(inputs, "centrelines and knob", (f"{line}.",), (line,))


class SpaceStream:
    """Estimates one session, instant after instant; a late one is refused.

    Args:
        settings: settings of the method.
        fitted: its learnt state.
        info: the session metadata.
        images: images of the session by view, as far as they are available beforehand.
    """

    def __init__(
        self, settings: SpaceSettings, fitted: _Fitted, info: SessionInfo, images: Mapping[str, Sequence[Image]]
    ) -> None:
        self._settings, self._widths = settings, fitted.widths
        self._detections = {
            view: SessionDetection(settings.vision_of(view), info, images.get(view, ())) for view in settings.views
        }
        self._info = info
        self._pool = ThreadPoolExecutor(len(settings.views), thread_name_prefix="detection")
        self._filter = SpaceFilter(settings, fitted.contact_share, info)
        self._stamp_ns: int | None = None
        self._shapes: dict[str, tuple[int, DetectedShape]] = {}
        """Stamp and shape of the newest image of each view."""
        self._axes_px: Mapping[str, FloatArray] = {}

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        found = self._estimate(observation)
        beside = tuple(
            ShapeBeside(view, shape, self._axes_px.get(view))
            for view in self._settings.views[1:]
            if (shape := self._shape(view, observation.stamp_ns)) is not None
        )
        return replace(found, shapes_beside=beside)

    def _shape(self, view: str, stamp_ns: int) -> DetectedShape | None:
        """Returns the shape in the newest image of a view, if it is of about this time."""
        at_ns, shape = self._shapes.get(view, (0, None))
        return shape if stamp_ns - at_ns <= MAX_LINE_AGE_S * 1e9 else None

    def _detected(self, observation: Observation) -> dict[str, DetectedLine | Abstention]:
        """Detects the catheter in the images of an observation, in several at the same time."""
        there = [view for view in self._detections if view in observation.views]

        def read(view: str) -> DetectedLine | Abstention:
            return self._detections[view].read(observation)

        found = self._pool.map(read, there) if len(there) > 1 else map(read, there)
        return dict(zip(there, found, strict=True))

    def _read(self, observation: Observation) -> tuple[dict[str, ViewShape], dict[str, Abstention], float]:
        """Returns the shapes by view, the reasons of views without a shape, and the advance of the clamp in m."""
        shapes: dict[str, ViewShape] = {}
        reasons: dict[str, Abstention] = {}
        advance_m = 0.0
        detected = self._detected(observation)
        for view, detection in self._detections.items():
            if view not in detected:
                reasons[view] = Abstention(Status.MISSING_INPUT, "no image of this instant")
                continue
            found = detected[view]
            if detection.shape is not None:
                self._shapes[view] = observation.stamp_ns, detection.shape
            if isinstance(found, Abstention):
                reasons[view] = found
            else:
                shapes[view], advance_m = ViewShape(found.shape, found.size_px), found.advance_m
        return shapes, reasons, advance_m

    def _estimate(self, observation: Observation) -> ForceEstimate:
        """Returns the force at an observation, without the shapes of further views; or the reason of an abstention."""
        stamp, settings = observation.stamp_ns, self._settings
        if late := late_frame(stamp, self._stamp_ns):
            return late
        seen, reasons, advance_m = self._read(observation)
        first = self._shape(settings.views[0], stamp)
        begins = self._filter.constants is None
        # without any line, or at the start without one in the first view, there is nothing to fit
        if not seen or (begins and settings.views[0] in reasons):
            abstention = next(iter(reasons.values()))
            detail = _texts(reasons)
            if seen:
                detail += f" (a session begins with a line in {settings.views[0]}, where the knob bends the shaft)"
            return ForceEstimate.invalid(stamp, abstention.status, detail, first)
        knob_deg = observation.actuation.get("knob_deg", math.nan)
        if abstention := actuation_out_of_range(settings, self._info, knob_deg):
            return ForceEstimate.invalid(stamp, abstention.status, abstention.detail, first)
        elapsed_s = 0.0 if self._stamp_ns is None else (stamp - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp
        found = self._filter.step(seen, knob_deg, elapsed_s, advance_m)
        self._axes_px = found.axes_px
        unfit = too_noisy(settings, found.level) if found.explained else unexplained(settings, found.misfit)
        if unfit:
            detail = unfit.detail
            if len(seen) > 1 and found.excluded:
                detail += f" ({_conflict(found, settings.views)})"
            return ForceEstimate.invalid(stamp, unfit.status, detail, first)
        # a valid estimate states which line is late, or which view is absent
        detail = "; ".join(
            f"{view}: predicted, its last line is {1e3 * age_s:.0f} ms old" for view, age_s in found.late_s.items()
        )
        if len(found.views) == 1:
            detail = f"from {views_text(found.views)} alone: the depth is known up to its mirror image"
            if found.pose_is_wrong or len(seen) > 1:
                detail += f" ({_conflict(found, settings.views)})"
            elif reasons:
                detail += f" ({_texts(reasons)})"
        estimate = replace(self._widths.estimate(stamp, found.force, first, detail), tip_axis=found.tip_axis)
        return within_error(estimate, settings.max_error_n)


def _texts(reasons: Mapping[str, Abstention]) -> str:
    return "; ".join(f"{view}: {each.detail}" for view, each in reasons.items())


def _conflict(found: SpaceResult, views: tuple[str, ...]) -> str:
    """Returns why the lines of two views are not read together, and the command that helps."""
    first, second = views
    if found.pose_is_wrong:
        return (
            f"the lines of {first} and {second} do not fit the stated pose of {second}, by far more than "
            f"views.{second}.pose_uncertainty_deg and pose_uncertainty_m allow: find the pose with "
            "`tipforce calibrate RECORDING --views`"
        )
    if found.excluded:
        return (
            "no rod explains the lines of both views: one line is wrong, see `tipforce inspect`, or "
            f"views.{second}.projection is: find the pose with `tipforce calibrate RECORDING --views`"
        )
    return "no rod explains the lines of both views"


class Rod3d(Estimator):
    """See the module; before `fit`, ``fitted_`` holds the settings' own."""

    name: ClassVar[str] = "rod-3d"
    settings_type = SpaceSettings
    settings: SpaceSettings
    needs_fit: ClassVar[bool] = False
    view_setting: ClassVar[str] = "views"

    def __init__(self, settings: SpaceSettings | None = None) -> None:
        super().__init__(settings)
        self.fitted_ = _Fitted(self.settings.prior.contact_share)

    @property
    def views(self) -> tuple[str, ...]:
        """The views of the settings."""
        return self.settings.views

    @property
    def needs_all_views(self) -> bool:
        """The line of a view that shows no image is predicted, or left out."""
        return False

    @property
    def uses_history(self) -> bool:
        """It remembers."""
        return True

    @property
    def calibrates_on_images(self) -> bool:
        """Whether tip template, length and threshold are resolved for each session."""
        return detector_kind(self.settings.vision.method).by_session

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """The rod's length and stiffness, and the scale of each view; of two views also the projections."""
        keys = [f"views.{view}.metres_per_px" for view in self.views]
        if len(self.views) > 1:
            keys += [f"views.{view}.projection" for view in self.views]
        return (*_NEEDED, *keys)

    def obstacle(self, info: SessionInfo) -> str:
        """Returns why a session's metadata do not allow an estimate; empty where they do; see `Estimator.obstacle`.

        Two views also need projections in the same frame.
        """
        if lacking := super().obstacle(info):
            return lacking
        frames = {view: info.view(view).projection_frame for view in self.views}
        if len(self.views) == 2 and len(set(frames.values())) > 1:
            text = " and ".join(f"views.{view}.projection_frame is {frame}" for view, frame in frames.items())
            return f"{text}; both views need the same frame of their projections"
        return ""

    def reading(self, view: str) -> Self:
        """Returns this method for one other view."""
        return self._for((view,))

    def for_views(self, there: Iterable[str]) -> Self:
        """Returns this method for data with the views ``there``: where nobody chose views, it reads the first two.

        Raises:
            InputError: a chosen view is absent.
        """
        names = tuple(there)
        if not names:
            return self
        if not self.view_is_stated:
            return self if self.views == names[:2] else self._for(names[:2])
        lacking = [view for view in self.views if view not in names]
        if lacking:
            raise InputError(f"{missing_views(lacking, names)}, and {self.name} reads {views_text(self.views)}")
        return self

    def _for(self, views: tuple[str, ...]) -> Self:
        made = type(self)(self.settings.model_copy(update={"views": views}))
        made.fitted_ = self.fitted_
        return made

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """A stream for one session; see `Estimator.start`."""
        return self.start_on(info, {self.views[0]: images})

    def start_on(self, info: SessionInfo, images: Mapping[str, Sequence[Image]]) -> Stream:
        """A stream for one session, whose detection is resolved in each view; see `Estimator.start_on`."""
        if reason := self.obstacle(info):
            return UninformedStream(reason)
        return SpaceStream(self.settings, self.fitted_, info, images)

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learns the share of frames in contact from sessions with forces."""
        del progress
        touching = np.linalg.norm(np.where(dataset.known, dataset.force_n, 0.0), axis=1) > _CONTACT_N
        share = min(_MOST_CONTACT, max(_LEAST_CONTACT, float(touching.mean())))
        self.fitted_ = replace(self.fitted_, contact_share=share)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Widens or narrows the intervals so that they hold on sessions apart; the forces stay as they are."""
        report = progress or no_progress
        found = without_widths(self, dataset, lambda share: report("calibrating", share))
        self.fitted_ = replace(self.fitted_, widths=calibrated_widths(found, dataset))
        return self

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """See `Estimator.state`."""
        return {"contact_share": self.fitted_.contact_share, "widths": self.fitted_.widths.values()}, {}

    @classmethod
    def from_state(
        cls, settings: StoredValues, values: StoredValues, arrays: StoredArrays, files: StoredFiles = None
    ) -> Self:
        """Makes the fitted method from its saved state, the inverse of `state`.

        Raises:
            ModelError: the share of contact is not between 0 and 1.
        """
        del arrays, files
        share = float(values["contact_share"])
        if not 0.0 < share < 1.0:
            raise ModelError(f"the model states a share of contact of {share}; expected one between 0 and 1")
        made = cls(SpaceSettings.model_validate(settings))
        made.fitted_ = _Fitted(share, SpaceWidths.of(values["widths"]))
        return made

    def describe(self) -> SpaceFacts:
        """Returns the facts of the model."""
        return SpaceFacts(contact_share=self.fitted_.contact_share, interval_basis=self.fitted_.widths.basis)
