"""One face for both ways of seeing."""

from typing import Protocol

from ..errors import InputError
from ..types import Image, Status
from ._classic import ClassicChain
from ._fine import FineTracer
from ._settings import VisionSettings
from ._settle import is_settled, settle
from ._sighting import Sighting

__all__ = ["Vision"]


class _Seer(Protocol):
    def see(self, image: Image) -> Sighting: ...


def _seer(settings: VisionSettings) -> _Seer:
    return ClassicChain(settings) if settings.method == "classic" else FineTracer(settings)


class Vision:
    """Sees the catheter in one picture after another, by the method that ``settings`` names.

    The answer depends on the picture and the settings alone. Settings that leave something open are settled on each
    picture anew: settle them once with `settle` where there are many.
    """

    def __init__(self, settings: VisionSettings) -> None:
        self.settings = settings
        self._seer = _seer(settings) if settings.method == "classic" or is_settled(settings) else None

    def see(self, image: Image) -> Sighting:
        """The catheter's shape in ``image``, (h, w) grey or (h, w, 3) RGB, uint8; or why it was not found."""
        if self._seer is not None:
            return self._seer.see(image)
        try:
            settled = settle(self.settings, [image])
        except InputError as error:
            return Sighting(Status.NO_CATHETER, str(error))
        return _seer(settled).see(image)
