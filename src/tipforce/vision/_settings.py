"""Settings of the centreline detection; saved with every estimator, the same in training and live."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from ..errors import InputError
from ..types import DEFAULT_VIEW, Box, chosen_view

Polarity = Literal["auto", "dark", "light"]
BaseSide = Literal["auto", "left", "right", "top", "bottom"]
SIDES: tuple[Literal["left", "right", "top", "bottom"], ...] = ("left", "right", "top", "bottom")
_GreyLevel = Annotated[int, Field(ge=0, le=255)]
_PlacePx = Annotated[float, Field(ge=-1e9, le=1e9)]
_FoundPx = Annotated[float, Field(gt=0, le=1e9)]


MAX_TIP_STD_PX = 1e5
"""No limit of the tip's standard deviation."""
USUAL_TIP_STD_PX, USUAL_TIP_STD_DIAMETERS = 3.0, 0.2
"""The limit for methods that take the tip for seen: the larger of the two."""


class VisionSettings(BaseModel):
    """Settings of the user for detection. "auto" and None are resolved on images, by `auto_calibrate`.

    Boxes are (u0, v0, u1, v1) in pixels: left, top, right, bottom, the last two exclusive.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Literal["auto", "tracer", "classic"] = "auto"
    """`auto`: the locator, a trained network, finds the line; where the tracer finds the same one as exactly, it is
    asked first, because it is faster. `tracer`: ordered tracing with sub-pixel flanks alone; the locator only finds
    the values that the settings leave open. `classic`: thesis algorithm 1 to the letter, for a dark catheter on a light
    even ground with nothing else in view: it finds the shape in 165 of 165 frames of the simulated `thesis-2021-plain`
    and in 0 of 165 of `bench-2021`. On all other images method 1 uses `auto`."""
    view: str = DEFAULT_VIEW
    """The view of the data that is used; where this default is not among them and no other is stated, the first one."""
    polarity: Polarity = "auto"
    """Catheter darker or lighter than the ground."""
    base_side: BaseSide = "auto"
    """The border of the image (or of ``roi``) that the catheter enters from, or points away from."""
    base_region: Box | None = None
    """A marked box across the shaft at its base, for catheters that do not reach the border."""
    roi: Box | None = None
    """Only this part of the image is searched."""
    threshold: _GreyLevel | None = None
    """Grey level between catheter and ground: thesis algorithm 1, ``Thr = c``."""
    base_columns: Annotated[int, Field(ge=2, le=10_000)] = 20
    """Columns (rows for a base at the top or bottom) scanned for base points: thesis algorithm 1, ``BS = N``."""
    diameter_px: Annotated[float, Field(gt=1, le=10_000)] | None = None
    """Diameter of the shaft in the image, against which the detected one is checked."""
    length_px: Annotated[float, Field(gt=1, le=100_000)] | None = None
    """Length of the catheter from the base line to its tip in the image. None: unknown."""
    length_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.08
    """A stated ``length_px`` is right within this share of it."""
    max_gap_px: Annotated[float, Field(ge=0, le=10_000)] = 12.0
    """Longest stretch of shaft without visible flanks (rings, highlights, gaps) that is bridged."""
    points: Annotated[int, Field(ge=8, le=4096)] = 64
    """Points of the centreline."""
    max_tip_std_px: Annotated[float, Field(gt=0, le=MAX_TIP_STD_PX)] | None = None
    """A frame whose tip is known less exactly than this standard deviation is refused: its tip is hidden. None: 3 px,
    or 0.2 diameters where these are more, and no limit for the method `session`, which leaves hidden points out."""
    detector: str | None = None
    """Folder of a locator that `tipforce annotate` fine-tuned. None: the one of the session's view, else the one that
    comes with tipforce."""
    least_probability: Annotated[float, Field(ge=0, le=1)] = 0.8
    """A frame whose centreline is right with less probability is refused, where the length of the catheter was learnt
    in images of its session. 0: none is."""

    def for_views(self, there: Iterable[str], where: Path | str) -> "VisionSettings":
        """Returns the settings for data, with the view that the rule of `chosen_view` gives.

        Args:
            there: views of the data, the first one first; empty where they are not known.
            where: the data, for the message.

        Raises:
            InputError: the view was stated, and the data do not have it.
        """
        names = tuple(there)
        try:
            view = chosen_view(self.view, names, stated="view" in self.model_fields_set)
        except InputError as error:
            raise InputError(f"{where}: {error}: for example vision.view={names[0]}") from None
        return self.model_copy(update={"view": view})

    def with_hidden_tips(self) -> "VisionSettings":
        """Returns the settings for a method that leaves hidden points out; a limit that is stated stays."""
        return self.model_copy(update={"max_tip_std_px": self.max_tip_std_px or MAX_TIP_STD_PX})


def usual_tip_std_px(diameter_px: float) -> float:
    """Returns the limit of the tip's standard deviation where none is stated, for a shaft of ``diameter_px``.

    >>> usual_tip_std_px(25.0)
    5.0
    """
    return max(USUAL_TIP_STD_PX, USUAL_TIP_STD_DIAMETERS * diameter_px)


class LocatorPrior(BaseModel):
    """Constants of one session that the locator found in its images."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    session: str
    """Its name: in another session they do not hold."""
    base_px: tuple[_PlacePx, _PlacePx]
    """Position of the catheter's base, or where it enters the image: u, v."""
    base_in_view: bool
    """The base is inside the image."""
    length_px: _FoundPx
    """Length of the catheter in the image, from there to its tip."""
    length_std_px: _FoundPx
    """Standard error of the length."""
    diameter_px: _FoundPx
    log_odds: Annotated[float, Field(ge=-30, le=30)] = 0.0
    """Logit by which its lines are right more often than those of the shipped networks in camera images."""
    xray: bool = False
    """The images are X-ray images."""
    tracer: bool
    """The tracer finds the same line as exactly, and is asked first: it is faster."""


class ResolvedVision(BaseModel):
    """`VisionSettings` with the values that auto-calibration found; stated settings are kept.

    Lengths in px of the images of the auto-calibration; `for_session` scales them. Saved as JSON.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    settings: VisionSettings
    """The settings of the user."""
    polarity: Literal["dark", "light"]
    base_side: Literal["left", "right", "top", "bottom"]
    base_region: Box | None = None
    roi: Box | None = None
    threshold: _GreyLevel | None = None
    diameter_px: _FoundPx | None = None
    length_px: _FoundPx | None = None
    """Length of the catheter from the base line to its tip. None: unknown."""
    length_tolerance: Annotated[float, Field(ge=0, le=1)]
    """``length_px`` is right within this share of it."""
    nominal_px: tuple[_FoundPx, _FoundPx] | None = None
    """Nominal length and diameter of the catheter. In a session of another scale or catheter ``length_px`` and
    ``diameter_px`` change in proportion."""
    tip_template: Annotated[tuple[_GreyLevel, ...], Field(max_length=1000)] | None = None
    """Grey levels of the last stretch of the catheter in the session of the auto-calibration: by rows from the tip
    back, points across and channels. None: unknown."""
    least_probability: Annotated[float, Field(ge=0, le=1)] = 0.0
    """A centreline that is right with less probability is refused. 0 where the catheter's size is not stated: then the
    probability is a rough one."""
    locator: LocatorPrior | None = None
    """For the locator. None: its constants are not known, the tracer detects alone."""
    detector: str | None = None
    """Folder of a fine-tuned locator. None: the one that comes with tipforce."""
    refused: str = ""
    """Why nothing that is detected with these settings can be the catheter; "" where nothing says so."""

    @classmethod
    def stated(cls, settings: VisionSettings) -> "ResolvedVision":
        """Returns the values that ``settings`` state. Raises InputError where polarity or base side is "auto"."""
        if settings.polarity == "auto" or settings.base_side == "auto":
            raise InputError(
                f"the tracer needs a polarity and a base side, got {settings.polarity} and {settings.base_side}: "
                "state both, or find them with auto_calibrate"
            )
        return cls(
            settings=settings,
            polarity=settings.polarity,
            base_side=settings.base_side,
            base_region=settings.base_region,
            roi=settings.roi,
            threshold=settings.threshold,
            diameter_px=settings.diameter_px,
            length_px=settings.length_px,
            length_tolerance=settings.length_tolerance,
        )

    def reading(self, view: str) -> "ResolvedVision":
        """Returns the same values for another view."""
        return self.model_copy(update={"settings": self.settings.model_copy(update={"view": view})})

    @property
    def method(self) -> Literal["auto", "tracer", "classic"]:
        """Method of the settings."""
        return self.settings.method

    @property
    def view(self) -> str:
        """View of the settings."""
        return self.settings.view

    @property
    def base_columns(self) -> int:
        """Base columns of the settings."""
        return self.settings.base_columns

    @property
    def max_gap_px(self) -> float:
        """Longest gap of the settings."""
        return self.settings.max_gap_px

    @property
    def points(self) -> int:
        """Number of points of the settings."""
        return self.settings.points
