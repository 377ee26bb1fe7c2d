"""Facts of a training, which a model folder keeps."""

from pydantic import BaseModel, ConfigDict


class TrainingFacts(BaseModel, frozen=True):
    """How a network was trained.

    Attributes:
        network: the network in a few words.
        parameters: number of its weights.
        training_samples: number of samples that trained it.
        validation_samples: number of samples that validated it.
        validation: how these were chosen.
        validation_error_n: smallest mean error on them, in newtons; None without any.
        max_epochs: largest number of epochs.
        epochs_run: number of epochs that were run.
        best_epoch: the epoch whose weights were kept.
        stop_reason: why training ended.
        seconds: time that it took.
        device: processor or graphics card.
        precision: of the arithmetic.
        torch: version of torch.
        reinitialised_weights: weights that the initial model did not have.
    """

    model_config = ConfigDict(extra="ignore")

    network: str = ""
    parameters: int = 0
    training_samples: int = 0
    validation_samples: int = 0
    validation: str = ""
    validation_error_n: float | None = None
    max_epochs: int = 0
    epochs_run: int = 0
    best_epoch: int = 0
    stop_reason: str = ""
    seconds: float = 0.0
    device: str = ""
    precision: str = ""
    torch: str = ""
    reinitialised_weights: list[str] = []
