"""Settings of a training run that all networks share."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Epochs = Annotated[int, Field(ge=1, le=1_000_000)]
Batch = Annotated[int, Field(ge=2, le=65_536)]
Rate = Annotated[float, Field(gt=0, le=1e3)]
WeightDecay = Annotated[float, Field(ge=0, le=1e3)]
WarmupEpochs = Annotated[float, Field(ge=0, le=1e6)]
ClipNorm = Annotated[float, Field(gt=0, le=1e9)]


class TrainConfig(BaseModel):
    """Budget, optimiser and device. The settings of each network derive from this, with defaults of their own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    epochs: Epochs = 100
    """Largest number of epochs."""
    patience: Epochs | None = 30
    """Early stopping: training ends after this number of epochs without a smaller validation error; None: none.
    The weights of the best epoch are kept in any case."""
    minutes: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Training ends with the epoch in which this time is up. All runs of a resumed training count together."""
    batch: Batch = 32
    """Batch size."""
    optimiser: Literal["sgd", "adamw"] = "sgd"
    """Stochastic gradient descent with ``momentum``, or AdamW with its usual constants."""
    rate: Rate = 0.01
    """Learning rate."""
    momentum: Annotated[float, Field(ge=0, lt=1)] = 0.9
    """Momentum of `sgd`."""
    weight_decay: WeightDecay = 0.0
    """Weight decay of the optimiser."""
    schedule: Literal["constant", "cosine", "plateau"] = "constant"
    """Learning-rate schedule: `cosine` falls to 0 at the end of ``epochs``; `plateau` halves the rate after
    ``plateau_epochs`` without a smaller validation error."""
    plateau_epochs: Epochs = 10
    """Patience of `plateau`."""
    warmup_epochs: WarmupEpochs = 0.0
    """The learning rate rises linearly over this number of epochs first."""
    clip_norm: ClipNorm | None = None
    """Largest norm of the gradient; longer gradients are scaled down."""
    average: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Decay of the exponential moving average of the weights (0.999, for example). Above 0 the averaged weights are
    validated and kept."""
    validation: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    """Share of the data in the validation split, which decides on early stopping and on the best epoch."""
    hold_out: Literal["auto", "session", "sample"] = "auto"
    """Content of the validation split: whole `session`s or single `sample`s, drawn at random. `auto`: sessions where
    the share is at least one session."""
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    """Arithmetic of training. `auto`: bf16 where the hardware supports it, else fp32. Validation is always in fp32."""
    workers: Annotated[int, Field(ge=1, le=1024)] | None = None
    """Threads that prepare batches; None: one on a CPU, up to eight with a GPU. The result does not depend on it."""
    seed: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    """Seed of the validation split, the initial weights, the order of the samples and the augmentation."""
