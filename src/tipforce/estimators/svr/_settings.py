"""Settings of method 1: those of the thesis except for detection and drives; options beyond the thesis are marked."""

from typing import Annotated, Literal

from pydantic import Field

from ..shape import ShapeRegressorSettings

Grid = Annotated[tuple[Annotated[float, Field(ge=1e-9, le=1e9)], ...], Field(min_length=1, max_length=100)]


class SvrSettings(ShapeRegressorSettings):
    """Support vector regression from the centreline's shape and the knob (thesis ch. 3).

    Beyond the thesis: the detection by the `tracer` (its own algorithm 1 is ``vision.method=classic``), ``angles``,
    ``window``, ``label_average_ms``, ``linear`` and ``training_samples``.
    """

    force: Literal["magnitude", "components"] = "magnitude"
    """One number as in the thesis, or one machine for each measured component."""
    scaling: Literal["max", "standard"] = "max"
    """`max`: divided by the largest absolute value (thesis). `standard`: mean removed, divided by the deviation."""
    linear: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Beyond the thesis: kernel = eq. (15) + ``linear`` times the mean product of the angle series and the actuation
    (of all features without ``angles``), so that the estimate continues in a straight line beyond the training
    range."""
    c: Grid = (1.0, 10.0, 100.0, 1000.0)
    """Values of C (thesis eq. 10) to choose from."""
    epsilon: Grid = (0.003, 0.01, 0.03)
    """Values of epsilon (eq. 8) to choose from, in shares of the largest force. An error below epsilon counts as zero:
    at 0.1 the estimate without contact may be a tenth of the largest force too high, and the squared error over the
    folds, by which epsilon is chosen, shows little of it (docs/results/force.md)."""
    sigma: Grid = (0.1, 0.3, 1.0, 3.0, 10.0)
    """Values of sigma (eq. 15) to choose from, in scaled features."""
    tuning_samples: Annotated[int, Field(ge=20, le=1_000_000)] = 1000
    """Largest number of samples, drawn with ``seed``, for choosing the constants and finding the interval. If training
    uses more, C becomes smaller in proportion, so that data and flatness keep the same relative weight."""
