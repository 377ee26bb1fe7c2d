"""From labelled samples to a model folder."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from .._system.executor import Executor, ExecutorName, LocalExecutor, executor_of
from ..datasets import Dataset, join, open_dataset, without_sessions
from ..estimators import (
    Estimator,
    Progress,
    check_target,
    create,
    load_initial_model,
    load_model,
    read_manifest,
    run_directory,
    save_model,
    training_lines,
    training_started,
)
from ..estimators import train as fit
from ..types import SessionInfo
from ._estimate import session_info_from

Data = str | Path | Dataset | Sequence[str | Path | Dataset]
"""Labelled samples: a dataset, or recordings, a dataset folder, Parquet shards or a published layout; or several."""
PROGRESS_STEPS = 1000
"""Steps in which a training on a cluster reports its progress."""


@dataclass(frozen=True, eq=False)
class TrainReport:
    """Result of a training.

    Attributes:
        model: the model folder.
        estimator: the fitted method.
        manifest: content of its model.json.
        metrics: errors in newtons on the samples held out, empty without any.
        lines: the same for people.
    """

    model: Path
    estimator: Estimator
    manifest: Mapping[str, Any]
    metrics: Mapping[str, Any]
    lines: tuple[str, ...]


def train(
    data: Data,
    output: str | Path,
    *,
    estimator: str = "svr",
    settings: BaseModel | Mapping[str, Any] | None = None,
    bench: SessionInfo | str | Path | None = None,
    init_from: str | Path | None = None,
    without: Sequence[str] = (),
    calibrate: Data | None = None,
    samples: int | None = None,
    holdout: float = 0.0,
    seed: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    executor: Executor | ExecutorName = "local",
    progress: Progress | None = None,
) -> TrainReport:
    """Trains a method on labelled samples and saves it as a model folder.

    Args:
        data: labelled samples; several datasets are joined.
        output: the model folder to write.
        estimator: name of the method: svr, dcfe, compact, stereo, rod or rod-track.
        settings: the method's settings, or some of their values.
        bench: metadata in place of those in the data.
        init_from: networks only: a model to be fine-tuned, or "pretrained" for the shipped one of this method.
        without: names of sessions that are left out.
        calibrate: other sessions, on which the intervals are fitted.
        samples: number of samples to draw; all by default.
        holdout: share of the samples, 0..1, held out at random to measure errors on.
        seed: seed of drawing, holding out, cross-validation and training; by default that of the settings.
        resume: networks only: go on with a training that was cut off.
        overwrite: replace a model that is there already.
        executor: "local": here; "ray": in one piece on the largest node of the cluster at RAY_ADDRESS. A network whose
            node is lost goes on from its last checkpoint on another.
        progress: called with the current step and the share that is done.

    Returns:
        The fitted method, its manifest, the measured errors and remarks.

    Raises:
        InputError: the data or settings cannot be used, or ``output`` is there already.
        MissingExtraError: a network without torch, the cluster without Ray.
        ModelError: the exported model answers otherwise than the trained one.
    """
    output = Path(output)
    asked = _Asked(
        data, output, estimator, settings, session_info_from(bench), init_from, tuple(without), calibrate, samples,
        holdout, seed, resume, overwrite, begun=training_started(output),
    )  # fmt: skip
    chosen = executor_of(executor)
    if isinstance(chosen, LocalExecutor):
        fitted, metrics, remarks = _train_here(asked, progress)
    else:
        tell = None if progress is None else partial(progress, "training on the cluster")
        task = partial(_train_there, asked)
        ((metrics, remarks),) = chosen.run(
            task, [0], steps=PROGRESS_STEPS, alone=True, shared=output.absolute().parent, progress=tell
        )
        fitted = load_model(output)
    manifest = read_manifest(output)
    return TrainReport(output, fitted, manifest, metrics, (*remarks, *training_lines(fitted, manifest)))


@dataclass(frozen=True, eq=False)
class _Asked:
    """Arguments of `train`. ``begun``: whether a training of ``output`` was cut off before."""

    data: Data
    output: Path
    estimator: str
    settings: BaseModel | Mapping[str, Any] | None
    stated: SessionInfo
    init_from: str | Path | None
    without: tuple[str, ...]
    calibrate: Data | None
    samples: int | None
    holdout: float
    seed: int | None
    resume: bool
    overwrite: bool
    begun: bool


def _train_here(asked: _Asked, progress: Progress | None) -> tuple[Estimator, Mapping[str, Any], tuple[str, ...]]:
    """Returns the fitted method, its metrics, and remarks on the data."""
    output, resume = asked.output, asked.resume
    method = create(asked.estimator, asked.settings)
    check_target(output, overwrite=asked.overwrite)
    start = load_initial_model(method, None if asked.init_from is None else str(asked.init_from), resume=resume)
    dataset = without_sessions(data_of(asked.data, asked.stated, [method]), asked.without)
    apart = None if asked.calibrate is None else data_of(asked.calibrate, asked.stated, [method])
    with run_directory(method, output, resume=resume) as folder:
        done = fit(
            method, dataset, samples=asked.samples, holdout=asked.holdout,
            seed=getattr(method.settings, "seed", 0) if asked.seed is None else asked.seed,
            start=start, folder=folder, resume=resume, calibrate=apart, progress=progress,
        )  # fmt: skip
        save_model(
            done.estimator, output, done.dataset, done.metrics, calibration=done.calibration, overwrite=asked.overwrite
        )
    return done.estimator, done.metrics, dataset.remarks


def _train_there(asked: _Asked, item: int, step: Callable[[], None]) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """Trains on a node of the cluster; it continues from the checkpoint of a node that was lost.

    Args:
        asked: the arguments of `train`.
        item: number of the task; there is one task only.
        step: called for each of the `PROGRESS_STEPS` steps of the progress.

    Returns:
        Metrics and remarks: the model itself is in the folder.
    """
    del item
    steps_taken = 0

    def progress(text: str, share: float) -> None:
        nonlocal steps_taken
        del text
        while steps_taken < round(share * PROGRESS_STEPS):
            steps_taken += 1
            step()

    # the folder was empty when `train` began: a node that was lost since then has written or even finished the model
    node_lost = not asked.begun and training_started(asked.output)
    asked = replace(asked, resume=asked.resume or node_lost, overwrite=asked.overwrite or node_lost)
    _, metrics, remarks = _train_here(asked, progress)
    return metrics, remarks


def data_of(data: Data, stated: SessionInfo | None = None, methods: Sequence[Estimator] = ()) -> Dataset:
    """Joins data to one dataset.

    Args:
        data: one or several datasets, or their paths.
        stated: metadata that replace those of the data.
        methods: the methods that use the data; where all state the same first view, its frames are the samples of a
            recording: the views may be exposed at different times.

    Returns:
        The samples with their metadata.
    """
    parts = [data] if isinstance(data, str | Path | Dataset) else list(data)
    first = {method.views[0] if method.view_is_stated else None for method in methods}
    view = first.pop() if len(first) == 1 else None
    dataset = join([part if isinstance(part, Dataset) else open_dataset(part, view) for part in parts])
    if stated is None or stated == SessionInfo():
        return dataset
    shared = replace(stated, name="")
    return replace(dataset, session_info={name: info.updated(shared) for name, info in dataset.session_info.items()})
