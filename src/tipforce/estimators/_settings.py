"""Settings of method 1: the thesis's but for detection and drives; what else goes beyond the thesis says so."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from ..vision import ShapeFeatureSettings, VisionSettings

Grid = Annotated[tuple[Annotated[float, Field(ge=1e-9, le=1e9)], ...], Field(min_length=1, max_length=100)]
_Milliseconds = Annotated[float, Field(ge=0, le=3_600_000)]
"""At most an hour."""


class AngleSettings(BaseModel):
    """A series of the tangent angle over arc length beside the polynomial; moments change it in proportion."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    degree: Annotated[int, Field(ge=0, le=8)] = 3
    """Degree of the Legendre series."""
    length: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """Arc length of the curve in the unit of ready-made polynomials; not needed where there are images."""


class WindowSettings(BaseModel):
    """Which earlier frames of the same session are looked at too. Times, so that a lost frame shifts nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    lags_ms: Annotated[tuple[_Milliseconds, ...], Field(min_length=1, max_length=100)] = (0.0,)
    """The newest frame at least so old, for each; the oldest one since the start or a gap where there is none."""
    average_ms: _Milliseconds = 0.0
    """Each is the mean over the frames of so long before it: against the curve's noise, at the price of a delay."""
    gap_ms: Annotated[float, Field(gt=0, le=3_600_000)] = 500.0
    """After so long without a frame the past is forgotten."""

    @property
    def reach_ns(self) -> int:
        """How far back a frame may matter."""
        return round((max(self.lags_ms) + self.average_ms) * 1e6)

    @property
    def used(self) -> bool:
        """False where only the frame itself counts."""
        return self.reach_ns > 0 or len(self.lags_ms) > 1


class SvrSettings(BaseModel):
    """Support vector regression from the centreline's shape and the knob (thesis ch. 3)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vision: VisionSettings = VisionSettings()
    """How the catheter is looked for. Beyond the thesis: `tracer`; its own algorithm 1 is ``vision.method=classic``."""
    max_left_out: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Training stops where a larger share of the samples, or a whole session, cannot be learnt from; 1: never."""
    features: ShapeFeatureSettings = ShapeFeatureSettings()
    """The shape's numbers: five coefficients of a polynomial of degree 4 (thesis eq. 2)."""
    actuation: tuple[str, ...] | None = None
    """Names of the actuation values used; None: all that the training data have. The thesis has the knob alone; a drive
    that is left out may move without notice."""
    force: Literal["magnitude", "components"] = "magnitude"
    """One number as in the thesis, or one machine for each measured component."""
    scaling: Literal["max", "standard"] = "max"
    """`max`: divided by the largest absolute value (thesis). `standard`: mean removed, divided by the deviation."""
    angles: AngleSettings | None = None
    """Beyond the thesis: a series of the tangent angle as further features."""
    linear: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Beyond the thesis: kernel = eq. (15) + ``linear`` times the mean product of the angle series and the actuation
    (of all features without ``angles``), so that the answer goes on in a straight line beyond what was trained."""
    window: WindowSettings = WindowSettings()
    """Beyond the thesis: earlier frames."""
    label_average_ms: _Milliseconds = 0.0
    """Beyond the thesis: labels to learn from are means over so long around each sample, against the sensor's noise.
    Never those that errors are measured on."""
    c: Grid = (1.0, 10.0, 100.0, 1000.0)
    """Values of C (thesis eq. 10) to choose from."""
    epsilon: Grid = (0.003, 0.01, 0.03)
    """Values of epsilon (eq. 8) to choose from, in shares of the largest force. An error below epsilon counts as none:
    at 0.1 the estimate without contact may lie a tenth of the largest force too high, and the squared error over the
    folds, which chooses, hardly tells (docs/results/force.md)."""
    sigma: Grid = (0.1, 0.3, 1.0, 3.0, 10.0)
    """Values of sigma (eq. 15) to choose from, in scaled features."""
    folds: Annotated[int, Field(ge=2, le=1000)] = 5
    """Folds of the cross-validation that chooses, where samples are shuffled."""
    hold_out: Literal["auto", "session", "sample"] = "auto"
    """What it holds out: whole `session`s (each alone up to ten, else in ten groups) for a model that is to work on new
    ones; shuffled `sample`s for one that is to work within those it has seen. `auto`: sessions from three on."""
    training_samples: Annotated[int, Field(ge=20, le=1_000_000)] | None = None
    """Beyond the thesis: learn from at most so many samples, drawn with ``seed``; neighbouring frames say the same."""
    tuning_samples: Annotated[int, Field(ge=20, le=1_000_000)] = 1000
    """At most so many samples, drawn with ``seed``, serve to choose and to find the interval. Where more serve to
    train, C becomes smaller in proportion, so that the data weigh as much against flatness as they did when chosen."""
    seed: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
