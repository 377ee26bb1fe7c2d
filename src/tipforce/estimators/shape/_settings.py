"""Settings that all shape regressors share: detection, features, windows, and the folds of the cross-validation."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from ...vision import ShapeFeatureSettings, VisionSettings

_Milliseconds = Annotated[float, Field(ge=0, le=3_600_000)]
"""At most an hour."""


class AngleSettings(BaseModel):
    """A series of the tangent angle over the arc length, besides the polynomial; moments change it in proportion."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    degree: Annotated[int, Field(ge=0, le=8)] = 3
    """Degree of the Legendre series."""
    length: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """Arc length of the curve in the unit of ready-made polynomials; not needed where there are images."""


class WindowSettings(BaseModel):
    """Earlier frames of the session that are used too, by their age in time: a lost frame shifts none of them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    lags_ms: Annotated[tuple[_Milliseconds, ...], Field(min_length=1, max_length=100)] = (0.0,)
    """For each lag, the newest frame that is at least this old is used; without one, the oldest since the start or a
    gap."""
    average_ms: _Milliseconds = 0.0
    """Each is the mean over the frames of this time before it: it reduces the noise and adds a delay."""
    gap_ms: Annotated[float, Field(gt=0, le=3_600_000)] = 500.0
    """After this time without a frame the history is cleared."""

    @property
    def reach_ns(self) -> int:
        """Age of the oldest frame that is used."""
        return round((max(self.lags_ms) + self.average_ms) * 1e6)

    @property
    def used(self) -> bool:
        """False where only the current frame is used."""
        return self.reach_ns > 0 or len(self.lags_ms) > 1


class ShapeRegressorSettings(BaseModel):
    """Settings of a regression from the centreline's shape and the drives to the force."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vision: VisionSettings = VisionSettings()
    """Settings of the centreline detection."""
    max_left_out: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Training stops where a larger share of the samples, or a whole session, cannot be learnt from; 1: never."""
    features: ShapeFeatureSettings = ShapeFeatureSettings()
    """The shape's numbers: five coefficients of a polynomial of degree 4 (thesis eq. 2)."""
    actuation: tuple[str, ...] | None = None
    """Names of the actuation values used; None: all of the training data. The thesis has the knob alone; a drive
    that is left out may move without effect on the estimate."""
    force: Literal["magnitude", "components"] = "components"
    """One number, or one for each measured component."""
    angles: AngleSettings | None = None
    """A series of the tangent angle as further features."""
    window: WindowSettings = WindowSettings()
    """Earlier frames as further features."""
    label_average_ms: _Milliseconds = 0.0
    """Labels to learn from are means over this time around each sample, to reduce the noise of the sensor. Errors are
    always measured on the original labels."""
    folds: Annotated[int, Field(ge=2, le=1000)] = 5
    """Folds of the cross-validation, where samples are shuffled."""
    hold_out: Literal["auto", "session", "sample"] = "auto"
    """Each fold holds out whole `session`s (each alone up to ten, else in ten groups), for a model that is used on new
    sessions; or shuffled `sample`s for one that is used within its training sessions. `auto`: sessions from three
    on."""
    training_samples: Annotated[int, Field(ge=20, le=1_000_000)] | None = None
    """Largest number of samples to learn from, drawn with ``seed``; neighbouring frames are nearly the same."""
    seed: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    """Seed of the drawn samples and the shuffled folds."""
