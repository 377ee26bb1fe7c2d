"""Settings of the methods that are networks."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from ...training import Augmentation, Batch, ClipNorm, Epochs, Rate, TrainConfig, WarmupEpochs, WeightDecay
from ...types import DEFAULT_VIEW
from ._image_input import WINDOW_LENGTHS


class NetworkSettings(TrainConfig):
    """Settings of all networks."""

    fine_tuning: ClassVar[Mapping[str, Any]] = {}
    """Defaults that differ where a model is fine-tuned."""

    def for_fine_tuning(self) -> Self:
        """Returns the settings for fine-tuning; values that were set explicitly stay.

        >>> CompactSettings(epochs=3).for_fine_tuning().epochs, CompactSettings().for_fine_tuning().rate
        (3, 0.0005)
        """
        return self.model_copy(
            update={name: value for name, value in self.fine_tuning.items() if name not in self.model_fields_set}
        )

    bits: Literal[32, 8] = 32
    """8: the graph is quantised to 8 bits, two to four times faster, if its validation error grows by less than 5 %;
    else the model runs in 32 bits, with a warning."""
    max_left_out: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Training stops where a larger share of the samples, or a whole session, cannot be learnt from; 1: never."""


class DcfeSettings(NetworkSettings):
    """ResNet-18 from the image to Fx and Fy (thesis ch. 4).

    The thesis states stochastic gradient descent, eq. (19) and 10,000 epochs on all training images; the values
    that it does not state are chosen here. By default a tenth of the images is held out and ends training early
    (``validation``, ``patience``); `Dcfe.thesis_settings` are exactly those of the thesis.
    """

    fine_tuning: ClassVar[Mapping[str, Any]] = {
        "epochs": 80,
        "patience": None,
        "optimiser": "adamw",
        "schedule": "cosine",
        "clip_norm": 1.0,
        "average": 0.99,
    }

    view: str = DEFAULT_VIEW
    """The view that is used; where this default is not in the data and no other is stated, the first one."""
    components: Literal["xy", "all"] = "xy"
    """Force components: `xy` as in the thesis, or `all` that the training data have."""
    actuation: tuple[str, ...] | None = ()
    """Beyond the thesis: names of actuation values that join the image's features; None: all of the dataset."""
    epochs: Epochs = 10_000
    """Largest number of epochs, as in the thesis."""
    patience: Epochs | None = 60
    """Number of epochs without a smaller validation error after which training stops; None: all ``epochs``."""
    validation: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    """See `TrainConfig`. 0, as in the thesis: all samples train, the last epoch is kept, and there are no intervals and
    no abstention, for nothing is left to measure them on."""
    batch: Batch = 16
    """Batch size."""
    rate: Rate = 0.0003
    """Learning rate. The gradient of eq. (19) is about 1 however small the error is, and the forces are not
    normalised, so larger rates overshoot forces of 0.1 N and diverge."""
    schedule: Literal["constant", "cosine", "plateau"] = "plateau"
    """Learning-rate schedule. For the same reason a constant rate does not converge."""
    plateau_epochs: Epochs = 15
    """Patience of `plateau`."""

    @model_validator(mode="after")
    def _held_out(self) -> Self:
        if self.validation == 0 and (self.patience is not None or self.schedule == "plateau" or self.bits == 8):
            raise ValueError(
                "validation=0 holds nothing out, so nothing can stop training, halve the rate or check 8 bits: state "
                "patience=null, schedule=cosine and bits=32 too"
            )
        return self


class CropSettings(NetworkSettings):
    """Settings of the networks for a window around the catheter."""

    fine_tuning: ClassVar[Mapping[str, Any]] = {"rate": 0.0005}

    components: Literal["xy", "all"] = "all"
    """Force components: those in the image plane, or all that the training data have."""
    actuation: tuple[str, ...] | None = ()
    """Names of actuation values that join the metadata as they are; None: all of the dataset. The knob needs no
    mention: where the metadata has its gain, the network is given the curvature that it sets anyway."""
    size: Annotated[int, Field(ge=64, le=4096, multiple_of=32)] = 160
    """Side of the network's image in pixels."""
    lengths: Annotated[float, Field(gt=1, le=1000)] = WINDOW_LENGTHS
    """Side of the window in nominal lengths of the catheter: it also shows the tissue at the tip."""
    base_side: Literal["auto", "left", "right", "top", "bottom", "none"] = "auto"
    """Border at which the base is. `auto`: from the metadata, else detected; `none`: the whole image is used."""
    across: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Position of the base along that border, as a share from its left or upper end."""
    abstained: Annotated[float, Field(ge=0, lt=1)] = 0.03
    """Share of in-distribution images without an estimate: those with the largest predicted uncertainty."""
    max_error_n: Annotated[float, Field(gt=0, le=100)] | None = None
    """No estimate, either, from the predicted uncertainty on up to which a twentieth of the images that were held out
    are wrong by more than this, in newtons; None: however wrong they may be."""
    augmentation: Augmentation = Augmentation()
    """Data augmentation."""
    epochs: Epochs = 30
    """Largest number of epochs."""
    patience: Epochs | None = None
    """Number of epochs without a smaller validation error after which training stops; None: never, because the learning
    rate falls with the number of epochs."""
    batch: Batch = 64
    """Batch size."""
    optimiser: Literal["sgd", "adamw"] = "adamw"
    """Stochastic gradient descent with ``momentum``, or AdamW with its usual constants."""
    rate: Rate = 0.002
    """Learning rate."""
    weight_decay: WeightDecay = 0.02
    """Weight decay of the optimiser."""
    schedule: Literal["constant", "cosine", "plateau"] = "cosine"
    """See `TrainConfig`."""
    warmup_epochs: WarmupEpochs = 0.5
    """Number of epochs at the start over which the learning rate rises linearly."""
    clip_norm: ClipNorm | None = 1.0
    """Largest norm of the gradient; longer gradients are scaled down."""
    average: Annotated[float, Field(ge=0, lt=1)] = 0.998
    """See `TrainConfig`."""


class CompactSettings(CropSettings):
    """Small network for a window around the catheter; see `Compact`."""

    view: str = DEFAULT_VIEW
    """The view that is used; where this default is not in the data and no other is stated, the first one."""


class StereoSettings(CropSettings):
    """Small network for the windows of two views; see `Stereo`."""

    views: tuple[str, str] = ("a", "b")
    """Names of both views; the first one sets the frame rate."""

    @field_validator("views")
    @classmethod
    def _two_views(cls, views: tuple[str, str]) -> tuple[str, str]:
        if views[0] == views[1]:
            raise ValueError(f"names the view {views[0]!r} twice, expected two different views")
        return views
