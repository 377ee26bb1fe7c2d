"""How a network is trained: the settings that all tasks share."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["TrainConfig"]


class TrainConfig(BaseModel):
    """Budget, optimiser and machine. A method derives its settings from this, with defaults of its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    epochs: Annotated[int, Field(ge=1)] = 100
    """The budget: passes over the training part."""
    patience: Annotated[int, Field(ge=1)] | None = 30
    """Training ends after so many epochs without a smaller error on the validation part; None: never before its time.
    The weights of the best epoch are kept in any case."""
    minutes: Annotated[float, Field(gt=0)] | None = None
    """Training ends with the epoch in which so much time is up, all runs since its beginning counted together."""
    batch: Annotated[int, Field(ge=2)] = 32
    """Samples a step."""
    optimiser: Literal["sgd", "adamw"] = "sgd"
    """Stochastic gradient descent with ``momentum``, or AdamW with the usual constants."""
    rate: Annotated[float, Field(gt=0)] = 0.01
    """The learning rate."""
    momentum: Annotated[float, Field(ge=0, lt=1)] = 0.9
    """Of sgd."""
    weight_decay: Annotated[float, Field(ge=0)] = 0.0
    """Pull of the weights toward 0."""
    schedule: Literal["constant", "cosine", "plateau"] = "constant"
    """How the rate goes on: `cosine` to 0 at the end of the budget; `plateau` halves it after ``plateau_epochs``
    without a smaller error on the validation part."""
    plateau_epochs: Annotated[int, Field(ge=1)] = 10
    """Of `plateau`."""
    warmup_epochs: Annotated[float, Field(ge=0)] = 0.0
    """The rate rises in a straight line over so many epochs first."""
    clip_norm: Annotated[float, Field(gt=0)] | None = None
    """Longer gradients are shortened to this length."""
    average: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Above 0: the network that is measured and kept is the moving average of the trained one, with this share of the
    past a step (0.999, say)."""
    validation: Annotated[float, Field(gt=0, le=0.5)] = 0.1
    """Share of the data on which nothing is trained: it says when to stop and which epoch was best."""
    hold_out: Literal["auto", "session", "sample"] = "auto"
    """What that share is made of: whole `session`s drawn at random, or `sample`s. `auto`: sessions where the share
    comes to at least one."""
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    """`auto`: bf16 where the processor computes in it, else fp32. Measuring is always in fp32."""
    workers: Annotated[int, Field(ge=1)] | None = None
    """Threads that prepare batches; None: one on a CPU, up to eight beside a GPU. The result does not depend on it."""
    seed: int = 0
    """Of the validation part, the first weights, the order of the samples and all that is drawn in training."""
