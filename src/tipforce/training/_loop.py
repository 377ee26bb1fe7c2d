"""The training loop: one for all networks, that can be killed and goes on to the same result, bit for bit.

All that is drawn is keyed by seed and epoch, so a checkpoint holds no state of a random generator: an epoch draws the
same whether the ones before it ran in this process or in another.
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
from ._batches import Batches, feeding
from ._checkpoint import identity_of, read_checkpoint, write_checkpoint
from ._epoch import Trainer
from ._log import Log, progress_line
from ._machine import Machine, machine_for, reproducible, require_torch
from ._parts import Part
from ._recipe import TrainConfig
from ._samples import Samples
from ._task import Task
from ._weights import Weights

__all__ = ["Progress", "TrainResult", "train_network"]

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done (0..1)."""


@dataclass(frozen=True, eq=False)
class TrainResult:
    """What training left: ``weights`` of the best epoch by name, the log's ``rows``, and ``facts`` as JSON values."""

    weights: dict[str, npt.NDArray[Any]]
    rows: list[dict[str, Any]]
    facts: dict[str, Any]


@dataclass(slots=True)
class _Standing:
    """Where a training stands after ``epoch`` epochs."""

    epoch: int = 0
    best: dict[str, Any] | None = None
    best_epoch: int = 0
    best_error_n: float = float("inf")
    seconds: float = 0.0
    scale: float = 1.0
    since: int = 0
    """Epochs since the rate was last halved or the error was last smaller."""


def train_network(
    task: Task,
    samples: Samples,
    part: Part,
    recipe: TrainConfig,
    *,
    start: Weights | None = None,
    folder: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> TrainResult:
    """Train the network of ``task`` on ``part.train`` of ``samples`` and keep the epoch that is best on the rest.

    ``start``: weights to begin with instead of drawn ones. ``folder``, which exists: takes a checkpoint after every
    epoch and the log; with ``resume`` training goes on from the checkpoint there, if there is one, and ends as it would
    have without the break. Raises InputError where the loss leaves the finite numbers, where ``start`` belongs to
    another network, or the checkpoint to another training; MissingExtraError without torch.
    """
    require_torch()
    machine = machine_for(recipe)
    identity = identity_of(task, samples, recipe, machine.precision, start)
    saved = read_checkpoint(folder, identity) if folder is not None and resume else None
    with reproducible(machine), feeding(task, samples, recipe.seed, machine.workers) as batches:
        trainer = Trainer(task, recipe, machine, start)
        now = _Standing()
        if saved is not None:
            trainer.load(saved["trainer"])
            now = _Standing(**saved["standing"])
        log = Log(folder, now.epoch)
        said = "training"
        while not (why := _ended(now, recipe)):
            row = _epoch(trainer, batches, part, recipe, now, partial(progress or _silent, said))
            log.add(row)
            said = progress_line(row, recipe)
            if folder is not None:
                standing = {name: getattr(now, name) for name in _Standing.__slots__}
                write_checkpoint(folder, {"identity": identity, "trainer": trainer.state(), "standing": standing})
        if now.best is None:
            raise InputError(
                f"after {now.epoch} epochs the network still answers without bounds; train longer, or lower the "
                f"learning rate, for example --set rate={recipe.rate / 10:g}"
            )
        weights = {name: value.cpu().numpy().copy() for name, value in now.best.items()}
    return TrainResult(weights, log.rows, _facts(task, samples, part, recipe, machine, trainer, now, why))


def _epoch(
    trainer: Trainer, batches: Batches, part: Part, recipe: TrainConfig, now: _Standing, report: Callable[[float], None]
) -> dict[str, Any]:
    """Train one epoch, measure it, and keep it where it is the best; returns its row of the log."""
    begun, waited, told = time.perf_counter(), batches.waited_s, now.epoch / recipe.epochs
    scale = now.scale

    loss, training_error_n = trainer.train(
        batches, part.train, now.epoch, scale, lambda share: report(told + share / recipe.epochs)
    )
    trained_s = time.perf_counter() - begun
    waited_s = batches.waited_s - waited
    if not np.isfinite(loss):
        raise InputError(
            f"training left the finite numbers in epoch {now.epoch + 1} (the loss is {loss:g}); lower the learning "
            f"rate, for example --set rate={recipe.rate / 10:g}"
        )
    # a network whose batch normalisation has seen little yet may answer without bounds: such an epoch is not the best
    error_n = trainer.error_n(batches, part.validate)
    now.epoch += 1
    now.since += 1
    if error_n < now.best_error_n:
        now.best, now.best_epoch, now.best_error_n, now.since = trainer.kept(), now.epoch, error_n, 0
    elif recipe.schedule == "plateau" and now.since >= recipe.plateau_epochs:
        now.scale, now.since = now.scale / 2, 0
    now.seconds += time.perf_counter() - begun
    return {
        "epoch": now.epoch,
        "loss": loss,
        "training_error_n": training_error_n,
        "validation_error_n": error_n if np.isfinite(error_n) else None,
        "rate_scale": scale,
        "pictures_per_s": len(part.train) / trained_s,
        "waiting_share": waited_s / trained_s,
        "seconds": now.seconds,
    }


def _ended(now: _Standing, recipe: TrainConfig) -> str:
    """Why training is over; nothing while it is not."""
    if now.epoch >= recipe.epochs:
        return "all epochs were run"
    if recipe.patience is not None and now.epoch - now.best_epoch >= recipe.patience:
        return f"{recipe.patience} epochs brought no smaller error"
    if recipe.minutes is not None and now.seconds >= 60 * recipe.minutes:
        return f"{recipe.minutes:g} minutes were up"
    return ""


def _facts(
    task: Task, samples: Samples, part: Part, recipe: TrainConfig, machine: Machine, trainer: Trainer, now: _Standing,
    why: str,
) -> dict[str, Any]:  # fmt: skip
    """The budget that was used and what came of it."""
    return {
        "network": task.name,
        "parameters": sum(value.numel() for value in trainer.network.parameters()),
        "training_samples": len(part.train),
        "validation_samples": len(part.validate),
        "validation": f"{len(set(samples.session[part.validate].tolist()))} whole sessions"
        if part.sessions
        else "samples drawn at random",
        "validation_error_n": now.best_error_n,
        "epochs_wanted": recipe.epochs,
        "epochs_run": now.epoch,
        "best_epoch": now.best_epoch,
        "ended": why,
        "seconds": now.seconds,
        "machine": machine.text,
        "precision": machine.precision,
        "torch": version("torch"),
        "new_weights": trainer.fresh,
    }


def _silent(what: str, share: float) -> None:
    del what, share
