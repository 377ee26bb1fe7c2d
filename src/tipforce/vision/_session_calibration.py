"""Detection of the catheter in one session, resolved on its own images: the same for every verb and method."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from ..errors import InputError, NoCatheterError
from ..types import DetectedShape, Image, SessionInfo, Status
from ._advice import Advice, advise
from ._auto_calibrate import auto_calibrate, enough_images
from ._detector import ShapeDetector, detector_kind
from ._session_size import for_session, nominal_px, with_view
from ._settings import BaseSide, ResolvedVision, VisionSettings

_FIRST, _EVERY = 50, 5
"""The detection is resolved on the first 50 images, every fifth of them."""
RESOLVED_AFTER_IMAGES = 30
"""The result holds this number of images later, in every run alike: a thread needs 0.4 to 4 s for it meanwhile."""
KEPT_IMAGES = 16
"""Images from all over the session on which it is resolved again, whenever the session has doubled."""


def _without_catheter(
    settings: VisionSettings, images: Sequence[Image], info: SessionInfo, why: str
) -> ResolvedVision | VisionSettings:
    """Returns the settings of a session in whose ``images`` no catheter is found, for the reason ``why``.

    They refuse every image and say why: an object that was refused in all images together would else be found in one.
    Where the images are too few, or the metadata too little, to refuse it, each image is read by itself, with the
    session metadata of the view.
    """
    if enough_images(images) and nominal_px(info, settings.view) is not None:
        return _any_way(settings).model_copy(update={"refused": why})
    return with_view(settings, info)


def _any_way(settings: VisionSettings) -> ResolvedVision:
    """Returns ``settings`` with any side and polarity where these are open."""
    polarity = "dark" if settings.polarity == "auto" else settings.polarity
    side = "left" if settings.base_side == "auto" else settings.base_side
    stated = ResolvedVision.stated(settings.model_copy(update={"polarity": polarity, "base_side": side}))
    return stated.model_copy(update={"settings": settings})


class SessionDetector:
    """Detects the catheter in the images of one session.

    Images that are at hand beforehand resolve the open settings, once: every verb that is given the same
    images then detects the same shapes in them. Without such images detection begins with ``shared``, else with the
    first image by itself, and is resolved on the session's own images as these come.

    Args:
        settings: the settings of the user.
        info: the session's metadata; its facts hold in each of these ways.
        images: of the session, from all over it; see `calibration_rows`.
        shared: resolved in another session. It is scaled to this one.
    """

    def __init__(
        self,
        settings: VisionSettings,
        info: SessionInfo,
        images: Sequence[Image] = (),
        shared: ResolvedVision | None = None,
    ) -> None:
        self._settings, self._info = settings, info
        self._calibration: SessionCalibration | None = None
        self._refusal: NoCatheterError | None = None
        self._refused_images: Sequence[Image] = ()
        self._advice: Advice | None = None
        if images:
            try:
                vision = auto_calibrate(settings, images, info)
            except InputError as error:
                vision = _without_catheter(settings, images, info, str(error))
                if isinstance(error, NoCatheterError):
                    self._refusal, self._refused_images = error, images
        else:
            vision = with_view(settings, info) if shared is None else for_session(shared, info)
            if detector_kind(settings.method).by_session:
                self._calibration = SessionCalibration(settings, info)
        self._detector = ShapeDetector(vision, info)
        self._begun: ShapeDetector | None = None
        """Resolved on one image of the session, until there are enough: to resolve each anew takes 65 to 380 ms."""

    @property
    def advice(self) -> Advice | None:
        """The fact that would help most, found once; None where the session's images show the catheter."""
        if self._advice is None and self._refusal is not None:
            self._advice = advise(self._settings, self._refused_images, self._info)
        return self._advice

    @property
    def vision(self) -> ResolvedVision | VisionSettings:
        """The settings that the next image is looked at with."""
        return self._detector.settings

    @property
    def key(self) -> str:
        """The settings, and the metadata where these are open, as text: a shape depends on them and the image alone."""
        stated = "" if isinstance(self.vision, ResolvedVision) else repr((self._info.catheter, self._info.views))
        return self.vision.model_dump_json() + stated

    @property
    def base_side(self) -> BaseSide:
        """The border that the shaft came from in the last image; "auto" where nothing states or found it."""
        return (self._begun or self._detector).base_side

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter's shape in ``image``, (h, w) grey or (h, w, 3) RGB, uint8; or why it was not found."""
        shape = self._begun.detect(image) if self._begun else None
        if shape is None or not shape.found:
            shape = self._detector.detect(image)
            resolved = self._detector.resolved
            if self._calibration is not None and shape.found and resolved is not None and resolved is not self.vision:
                self._begun = ShapeDetector(resolved, self._info)
        if self._calibration is not None and (resolved := self._calibration.add(image)) is not None:
            if resolved.vision is not None:
                self._detector, self._begun, self._refusal = ShapeDetector(resolved.vision, self._info), None, None
            elif self._refusal is None and resolved.refusal is not None:
                self._refusal, self._advice = resolved.refusal, resolved.advice or self._advice
        if self._refusal is None:
            return shape
        unclear = self._refusal.several and not isinstance(self.vision, ResolvedVision)
        if (unclear or shape.status is Status.NO_CATHETER) and self.advice is not None:
            return DetectedShape(Status.NO_CATHETER, f"{self._refusal.reason}: {self.advice.text()}")
        return shape


@dataclass(frozen=True, slots=True, eq=False)
class Resolved:
    """Result of `SessionCalibration`.

    Attributes:
        vision: the resolved detection; None where the images show no catheter.
        refusal: the reason why they show none, where there is a sure one.
        advice: the fact that would help most; the first time that there is a reason.
    """

    vision: ResolvedVision | None
    refusal: NoCatheterError | None = None
    advice: Advice | None = None


class SessionCalibration:
    """Resolves the detection on the images of one session as these come, on a thread of its own.

    While the catheter does not move, the ground beneath it does not change: therefore it is resolved again as the
    session goes on, whenever it has doubled. A result holds `RESOLVED_AFTER_IMAGES` later, so that the estimates of a
    run do not depend on the speed of the computer; only where the thread is not ready by then the image waits for it.
    """

    def __init__(self, settings: VisionSettings, info: SessionInfo) -> None:
        self._settings, self._info = settings, info
        self._kept: list[Image] = []
        self._count, self._every, self._next = 0, _EVERY, _FIRST
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="session-detection")
        self._task: Future[Resolved] | None = None
        self._advised = False

    def add(self, image: Image) -> Resolved | None:
        """Takes the next image; returns the result at the image from which on it holds, None at the others."""
        if self._count % self._every == 0:
            self._kept.append(image)
        self._count += 1
        if self._task is not None and self._count == self._next // 2 + RESOLVED_AFTER_IMAGES:
            resolved = self._task.result()
            self._task, self._advised = None, self._advised or resolved.advice is not None
            return resolved
        if self._count == self._next:
            self._next = 2 * self._count
            while len(self._kept) > KEPT_IMAGES:
                self._kept, self._every = self._kept[::2], 2 * self._every
            self._task = self._pool.submit(self._resolve, tuple(self._kept), advised=self._advised)
        return None

    def _resolve(self, images: Sequence[Image], *, advised: bool) -> Resolved:
        try:
            return Resolved(auto_calibrate(self._settings, images, self._info, whole=False))
        except NoCatheterError as error:
            return Resolved(None, error, None if advised else advise(self._settings, images, self._info))
        except InputError:  # nothing sure: the detection stays as it was
            return Resolved(None)

    def close(self) -> None:
        """Ends it: no image comes any more."""
        self._pool.shutdown(wait=False, cancel_futures=True)
