"""The one model of settings for seeing the catheter; saved with every estimator, the same in training and live."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["BaseSide", "Polarity", "VisionSettings"]

Polarity = Literal["auto", "dark", "light"]
BaseSide = Literal["auto", "left", "right", "top", "bottom"]
Box = tuple[int, int, int, int]


class VisionSettings(BaseModel):
    """How the catheter is looked for. "auto" and None are settled once, on the first frames, by `settle`.

    Boxes are (u0, v0, u1, v1) in pixels: left, top, right, bottom, the last two exclusive.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Literal["fine", "classic"] = "fine"
    """`fine`: ordered tracing with sub-pixel flanks. `classic`: thesis algorithm 1 to the letter."""
    view: str = "camera"
    """Which of an observation's views to look at."""
    polarity: Polarity = "auto"
    """Catheter darker or lighter than the ground."""
    base_side: BaseSide = "auto"
    """The border of the picture (or of ``roi``) that the catheter enters from, or points away from."""
    base_region: Box | None = None
    """A marked box across the shaft where the base lies, for catheters that do not reach the border."""
    roi: Box | None = None
    """Only this part of the picture is looked at."""
    threshold: Annotated[int, Field(ge=0, le=255)] | None = None
    """Grey level between catheter and ground: thesis algorithm 1, ``Thr = c``."""
    base_columns: Annotated[int, Field(ge=2)] = 20
    """Columns (rows for a base at the top or bottom) scanned for base points: thesis algorithm 1, ``BS = N``."""
    diameter_px: Annotated[float, Field(gt=1)] | None = None
    """The shaft's diameter in the picture: a check on what is found."""
    length_px: Annotated[float, Field(gt=1)] | None = None
    """The catheter's length from the base line to its tip in the picture. None: nobody knows."""
    length_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.08
    """``length_px`` is right within this share of it."""
    nominal_px: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] | None = None
    """Length and diameter that the catheter should have in the pictures these settings were settled on, by its nominal
    size and their scale. In a session of another scale or catheter ``length_px`` and ``diameter_px`` follow in
    proportion; see `in_session`."""
    end_look: tuple[int, ...] | None = None
    """How the last stretch of the catheter looks in the session these settings were settled on: grey levels by rows
    from the tip back, places across and channels. None: nobody knows."""
    max_gap_px: Annotated[float, Field(ge=0)] = 12.0
    """Longest stretch of shaft without visible flanks (rings, highlights, gaps) that is bridged."""
    points: Annotated[int, Field(ge=8)] = 64
    """Points of the centreline."""
