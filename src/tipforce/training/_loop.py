"""The training loop of all networks. A training that was killed can be resumed and ends with the same weights.

All random numbers are keyed by seed and epoch, so a checkpoint holds no state of a random generator: an epoch is the
same whether those before it ran in this process or in another one.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ._checkpoint import TrainingLog, progress_text, read_checkpoint, run_identity, write_checkpoint
from ._config import TrainConfig
from ._data import TrainingSamples, TrainValSplit
from ._device import Device, choose_device, deterministic, require_torch
from ._facts import TrainingFacts
from ._task import Task, Weights
from ._trainer import BatchLoader, Trainer, batch_loader

Progress = Callable[[str, float], None]
"""Called with a description of the current work and its finished share (0..1)."""


@dataclass(frozen=True, eq=False)
class TrainResult:
    """A trained network.

    Attributes:
        weights: parameters and buffers of the epoch that was kept, by name.
        rows: the training log, one row an epoch.
        facts: facts of its training.
    """

    weights: dict[str, npt.NDArray[Any]]
    rows: list[dict[str, Any]]
    facts: TrainingFacts


@dataclass(slots=True)
class _State:
    """The state of the loop after ``epoch`` epochs."""

    epoch: int = 0
    best: dict[str, Any] | None = None
    best_epoch: int = 0
    best_error_n: float = float("inf")
    seconds: float = 0.0
    rate_scale: float = 1.0
    plateau: int = 0
    """Epochs since the learning rate was halved or the error was last smaller."""


def train_network(
    task: Task,
    samples: TrainingSamples,
    split: TrainValSplit,
    config: TrainConfig,
    *,
    init_from: Weights | None = None,
    folder: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> TrainResult:
    """Trains a network and keeps the epoch with the smallest validation error, or the last one without validation.

    Args:
        task: the network, its loss and its error.
        samples: all samples.
        split: indices of the samples for training and for validation.
        config: optimiser, schedule and budget.
        init_from: initial weights; None: random ones.
        folder: an existing folder for the log and a checkpoint after every epoch; None: nothing is written.
        resume: continue from the checkpoint in ``folder``, if there is one. The result is the same as without the
            interruption.
        progress: called during training.

    Returns:
        The weights of the kept epoch, the log and the facts of the training.

    Raises:
        InputError: the loss is not finite, or ``init_from`` or the checkpoint belongs to another network or training.
        MissingExtraError: torch is not installed.
    """
    require_torch()
    device = choose_device(config)
    identity = run_identity(task, samples, config, device.precision, init_from)
    saved = read_checkpoint(folder, identity) if folder is not None and resume else None
    with deterministic(device), batch_loader(task, samples, config.seed, device.workers) as loader:
        trainer = Trainer(task, config, device, init_from)
        state = _State()
        if saved is not None:
            trainer.load_state(saved["trainer"])
            state = _State(**saved["loop"])
        log = TrainingLog(folder, state.epoch)
        text = "training"
        while not (stop_reason := _stop_reason(state, config)):
            row = _run_epoch(trainer, loader, split, config, state, partial(progress or _no_progress, text))
            log.add(row)
            text = progress_text(row, config)
            if folder is not None:
                loop = {name: getattr(state, name) for name in _State.__slots__}
                write_checkpoint(folder, {"identity": identity, "trainer": trainer.state(), "loop": loop})
        if state.best is None:
            raise InputError(
                f"after {state.epoch} epochs the network's outputs are still not finite; train longer, or lower the "
                f"learning rate, for example rate={config.rate / 10:g}"
            )
        weights = {name: value.cpu().numpy().copy() for name, value in state.best.items()}
    return TrainResult(weights, log.rows, _facts(task, samples, split, config, device, trainer, state, stop_reason))


def _run_epoch(
    trainer: Trainer,
    loader: BatchLoader,
    split: TrainValSplit,
    config: TrainConfig,
    state: _State,
    report: Callable[[float], None],
) -> dict[str, Any]:
    """Trains and validates one epoch, keeps its weights if it is the best one, and returns its row of the log."""
    start, waited, share_before = time.perf_counter(), loader.waited_s, state.epoch / config.epochs
    rate_scale = state.rate_scale

    loss, training_error_n = trainer.train_epoch(
        loader, split.train, state.epoch, rate_scale, lambda share: report(share_before + share / config.epochs)
    )
    training_s = time.perf_counter() - start
    waited_s = loader.waited_s - waited
    if not np.isfinite(loss):
        raise InputError(
            f"training diverged in epoch {state.epoch + 1} (the loss is {loss:g}); lower the learning rate, for "
            f"example rate={config.rate / 10:g}"
        )
    # not finite where batch normalisation has seen too few batches: such an epoch is not the best
    error_n = trainer.validation_error_n(loader, split.val) if len(split.val) else float("nan")
    state.epoch += 1
    state.plateau += 1
    if not len(split.val):
        state.best, state.best_epoch = trainer.best_weights(), state.epoch
    elif error_n < state.best_error_n:
        state.best, state.best_epoch = trainer.best_weights(), state.epoch
        state.best_error_n, state.plateau = error_n, 0
    elif config.schedule == "plateau" and state.plateau >= config.plateau_epochs:
        state.rate_scale, state.plateau = state.rate_scale / 2, 0
    state.seconds += time.perf_counter() - start
    return {
        "epoch": state.epoch,
        "loss": loss,
        "training_error_n": training_error_n,
        "validation_error_n": error_n if np.isfinite(error_n) else None,
        "rate_scale": rate_scale,
        "images_per_s": len(split.train) / training_s,
        "waiting_share": waited_s / training_s,
        "seconds": state.seconds,
    }


def _stop_reason(state: _State, config: TrainConfig) -> str:
    """Returns the reason why training ends now; empty if it continues."""
    if state.epoch >= config.epochs:
        return "all epochs were run"
    if config.patience is not None and state.epoch - state.best_epoch >= config.patience:
        return f"{config.patience} epochs brought no smaller error"
    if config.minutes is not None and state.seconds >= 60 * config.minutes:
        return f"{config.minutes:g} minutes were up"
    return ""


def _facts(
    task: Task,
    samples: TrainingSamples,
    split: TrainValSplit,
    config: TrainConfig,
    device: Device,
    trainer: Trainer,
    state: _State,
    stop_reason: str,
) -> TrainingFacts:
    """Returns the facts of the training for its model folder."""
    return TrainingFacts(
        network=task.name,
        parameters=sum(value.numel() for value in trainer.network.parameters()),
        training_samples=len(split.train),
        validation_samples=len(split.val),
        validation=f"{len(set(samples.session[split.val].tolist()))} whole sessions"
        if split.by_session
        else "samples drawn at random",
        validation_error_n=state.best_error_n if len(split.val) else None,
        max_epochs=config.epochs,
        epochs_run=state.epoch,
        best_epoch=state.best_epoch,
        stop_reason=stop_reason,
        seconds=state.seconds,
        device=device.text,
        precision=device.precision,
        torch=version("torch"),
        reinitialised_weights=trainer.reinitialised,
    )


def _no_progress(text: str, share: float) -> None:
    del text, share
