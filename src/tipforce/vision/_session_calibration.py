"""Detection that is resolved session by session, on the session's own images."""

from collections.abc import Sequence
from typing import overload

from ..errors import InputError
from ..types import Image, SessionInfo
from ._auto_calibrate import auto_calibrate
from ._doubt import doubt, doubting, enough_images
from ._session_size import for_session, nominal_px
from ._settings import ResolvedVision, VisionSettings

__all__ = ["SessionCalibration", "session_vision"]

_FIRST, _EVERY = 50, 5
"""The detection is resolved on the first 50 images, every fifth of them."""
_KEPT = 16
"""And again, whenever the session has doubled, on so many images from all over it."""


@overload
def session_vision(
    settings: VisionSettings, images: Sequence[Image], info: SessionInfo, otherwise: ResolvedVision
) -> ResolvedVision: ...
@overload
def session_vision(
    settings: VisionSettings, images: Sequence[Image], info: SessionInfo, otherwise: ResolvedVision | None = None
) -> ResolvedVision | VisionSettings: ...
def session_vision(
    settings: VisionSettings, images: Sequence[Image], info: SessionInfo, otherwise: ResolvedVision | None = None
) -> ResolvedVision | VisionSettings:
    """Auto-calibrates the detection on ``images`` of one session.

    Where that fails, what else could be detected is doubted likewise: where it cannot be the catheter, the settings
    returned refuse every image and say why. What was refused in all images together would else be found in one.

    Args:
        settings: what the user says.
        images: of the session; from all over it, since the ground beneath the tip must change.
        info: its metadata.
        otherwise: what is taken, scaled to this session, where the auto-calibration fails. None: ``settings``, each
            image by itself, where the session's images are too few, or its metadata too little, to refuse it.
    """
    try:
        return auto_calibrate(settings, images, info)
    except InputError as error:
        if otherwise is None:
            told = enough_images(images) and nominal_px(info, settings.view) is not None
            return _refusing(_any_way(settings), str(error)) if told else settings
    shared = for_session(otherwise, info)
    if not enough_images(images):
        return shared
    doubts = doubt(shared, images[:_KEPT], info)[0]
    return _refusing(shared, f"what is found cannot be the catheter: {doubts}") if doubts else doubting(shared)


def _refusing(vision: ResolvedVision, why: str) -> ResolvedVision:
    return vision.model_copy(update={"refused": why})


def _any_way(settings: VisionSettings) -> ResolvedVision:
    """Returns ``settings`` with any side and polarity where these are open."""
    polarity = "dark" if settings.polarity == "auto" else settings.polarity
    side = "left" if settings.base_side == "auto" else settings.base_side
    stated = ResolvedVision.stated(settings.model_copy(update={"polarity": polarity, "base_side": side}))
    return stated.model_copy(update={"settings": settings})


class SessionCalibration:
    """Resolves the detection on the images of one session as these come.

    While the catheter stands still, so does what lies beneath it: therefore it is resolved again as the session goes
    on, whenever it has doubled.
    """

    def __init__(self, settings: VisionSettings, info: SessionInfo) -> None:
        self._settings, self._info = settings, info
        self._kept: list[Image] = []
        self._count, self._every, self._next = 0, _EVERY, _FIRST

    def add(self, image: Image) -> ResolvedVision | None:
        """Takes the next image; returns the detection when it was resolved anew."""
        if self._count % self._every == 0:
            self._kept.append(image)
        self._count += 1
        if self._count < self._next:
            return None
        self._next = 2 * self._count
        while len(self._kept) > _KEPT:
            self._kept, self._every = self._kept[::2], 2 * self._every
        try:
            return auto_calibrate(self._settings, self._kept, self._info, whole=False)
        except InputError:
            return None  # no catheter in these images: the detection stays as it was
