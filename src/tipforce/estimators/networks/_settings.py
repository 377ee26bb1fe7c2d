"""Settings of the methods that are networks."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field

from ...training import Augmentation, TrainConfig
from ._window import LENGTHS

__all__ = ["CompactSettings", "DcfeSettings"]


class NetworkSettings(TrainConfig):
    """What all networks have."""

    fine_tuning: ClassVar[Mapping[str, Any]] = {}
    """What is otherwise where training begins with a model's weights, as long as nothing else is stated."""

    def for_fine_tuning(self) -> Self:
        """The settings for a training that begins with a model's weights.

        >>> CompactSettings(epochs=3).for_fine_tuning().epochs, CompactSettings().for_fine_tuning().rate
        (3, 0.0005)
        """
        return self.model_copy(
            update={name: value for name, value in self.fine_tuning.items() if name not in self.model_fields_set}
        )

    view: str = "camera"
    """Which of an observation's views to look at."""
    bits: Literal[32, 8] = 32
    """8: the model answers by a graph in 8 bits, two to four times faster, if its error on what was kept from training
    is less than 5 % larger; else by the one in 32 bits, and says so."""


class DcfeSettings(NetworkSettings):
    """ResNet-18 from the picture to Fx and Fy (thesis ch. 4).

    The thesis states stochastic gradient descent, eq. (19) and 10,000 epochs; what it leaves open is chosen here and
    may be set. ``patience`` ends training before its budget is used up.
    """

    fine_tuning: ClassVar[Mapping[str, Any]] = {
        "epochs": 80,
        "patience": None,
        "optimiser": "adamw",
        "schedule": "cosine",
        "clip_norm": 1.0,
        "average": 0.99,
    }

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
    rate: Annotated[float, Field(gt=0)] = 0.0003
    """The learning rate. The slope of eq. (19) is about 1 however small the error is, and the forces are not
    normalised, so larger rates leap over forces of 0.1 N and diverge."""
    schedule: Literal["constant", "cosine", "plateau"] = "plateau"
    """For the same reason a rate that never falls keeps the answers trembling."""
    plateau_epochs: Annotated[int, Field(ge=1)] = 15
    """Of `plateau`."""


class CompactSettings(NetworkSettings):
    """A small network on the window around the catheter; see `Compact`."""

    fine_tuning: ClassVar[Mapping[str, Any]] = {"rate": 0.0005}

    components: Literal["xy", "all"] = "all"
    """Components to learn: those in the picture's plane, or all that the training data know."""
    actuation: tuple[str, ...] | None = ()
    """Names of actuation values that join the sheet as they are; None: all that there are. The knob needs no mention:
    where the sheet says what it does, the curvature that it asks for is given to the network anyway."""
    size: Annotated[int, Field(ge=64, multiple_of=32)] = 160
    """Side of the network's picture in pixels."""
    lengths: Annotated[float, Field(gt=1)] = LENGTHS
    """Side of the window in nominal lengths of the catheter: it is to show what the tip touches, too."""
    base_side: Literal["auto", "left", "right", "top", "bottom", "none"] = "auto"
    """The border that the base lies at; `auto`: as the sheet says, else as seen; `none`: the whole picture is shown."""
    across: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Where along that border, as a share from its left or upper end."""
    refused: Annotated[float, Field(ge=0, lt=1)] = 0.03
    """Share of usual pictures that are refused since they tell the force worst."""
    augmentation: Augmentation = Augmentation()
    """What is altered at random in training."""
    epochs: Annotated[int, Field(ge=1)] = 30
    """The budget: passes over the training part."""
    patience: Annotated[int, Field(ge=1)] | None = None
    """Training ends after so many epochs without a smaller error on the validation part; None: never before its time,
    for the rate falls with the budget."""
    batch: Annotated[int, Field(ge=2)] = 64
    """Samples a step."""
    optimiser: Literal["sgd", "adamw"] = "adamw"
    """Stochastic gradient descent with ``momentum``, or AdamW with the usual constants."""
    rate: Annotated[float, Field(gt=0)] = 0.002
    """The learning rate."""
    weight_decay: Annotated[float, Field(ge=0)] = 0.02
    """Pull of the weights toward 0."""
    schedule: Literal["constant", "cosine", "plateau"] = "cosine"
    """See `TrainConfig`."""
    warmup_epochs: Annotated[float, Field(ge=0)] = 0.5
    """The rate rises in a straight line over so many epochs first."""
    clip_norm: Annotated[float, Field(gt=0)] | None = 1.0
    """Longer gradients are shortened to this length."""
    average: Annotated[float, Field(ge=0, lt=1)] = 0.998
    """See `TrainConfig`."""
