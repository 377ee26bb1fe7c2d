"""Facts of a training that a model folder contains."""

from pydantic import BaseModel, ConfigDict


class TrainingFacts(BaseModel, frozen=True):
    """Facts of the training of a network.

    Attributes:
        network: the network in some words.
        parameters: number of its weights.
        training_samples: number of samples that trained it.
        validation_samples: number of samples that validated it.
        validation: choice of these samples.
        validation_error_n: smallest mean error on them, N; None without validation.
        max_epochs: largest number of epochs.
        epochs_run: number of epochs that were run.
        best_epoch: epoch whose weights were kept.
        stop_reason: the reason for the end of training.
        seconds: duration, s.
        device: processor or graphics card.
        precision: precision of the arithmetic.
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
