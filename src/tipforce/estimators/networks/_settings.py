"""Settings of the methods that are networks."""

from typing import Annotated, Literal

from pydantic import Field

from ...learning import Recipe

__all__ = ["DcfeSettings"]


class DcfeSettings(Recipe):
    """ResNet-18 from the picture to Fx and Fy (thesis ch. 4).

    The thesis states stochastic gradient descent, eq. (19) and 10,000 epochs; what it leaves open is chosen here and
    may be set. ``patience`` ends training before its budget is used up.
    """

    view: str = "camera"
    """Which of an observation's views to look at."""
    components: Literal["xy", "all"] = "xy"
    """Components to learn: `xy` as in the thesis, or `all` that the training data know."""
    actuation: tuple[str, ...] | None = ()
    """Beyond the thesis: names of actuation values that join the picture's features; None: all that there are."""
    epochs: Annotated[int, Field(ge=1)] = 10_000
    """The thesis's budget: passes over the training part."""
    patience: Annotated[int, Field(ge=1)] | None = 60
    """Training ends after so many epochs without a smaller error on the validation part; None: all ``epochs``."""
    batch: Annotated[int, Field(ge=2)] = 16
    """Samples a step."""
    rate: Annotated[float, Field(gt=0)] = 0.002
    """The learning rate. The slope of eq. (19) is about 1 however small the error is, and the forces are not
    normalised, so larger rates leap over forces of 0.1 N and diverge."""
    schedule: Literal["constant", "cosine", "plateau"] = "plateau"
    """For the same reason a rate that never falls keeps the answers trembling."""
    plateau_epochs: Annotated[int, Field(ge=1)] = 15
    """Of `plateau`."""
