"""Fits of an evaluation on disk, so that one that was cut off need not train them again."""

import contextlib
import hashlib
import json
import shutil
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from .._system.executor import Executor
from .._system.locks import output_lock
from ..datasets import Dataset, Split
from ..errors import InputError
from ..estimators import (
    Estimator,
    FineTunable,
    Progress,
    load_model,
    no_progress,
    read_manifest,
    run_directory,
    save_model,
    training_started,
)
from ._methods import Method


class KeptFits:
    """Fits methods on splits; with a folder, each fit becomes a model in it, named by its training data and settings.

    Args:
        folder: Folder of the fits; None: none is kept.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder
        self.used: list[Path] = []

    def fit(self, method: Method, split: Split, dataset: Dataset, progress: Progress) -> tuple[Estimator, float]:
        """Fits ``method`` on the training part of ``split`` and calibrates it on its calibration part, if it has one.

        Args:
            method: The method; its ``estimator`` is copied.
            split: Indices into ``dataset``.
            dataset: The evaluated samples.
            progress: Called with the current step and the share that is done.

        Returns:
            The fitted method and the seconds that this took. A fit that an earlier run kept is loaded in its place.
        """
        training = dataset.subset(split.train)
        calibration = dataset.subset(split.calibrate) if len(split.calibrate) else None
        fresh, began = method.estimator.unfitted(), time.perf_counter()
        if self.folder is None:
            fitted = _calibrated(fresh.fit(training, progress), calibration, progress)
            return fitted, time.perf_counter() - began
        model = self.folder / _identity(method, training, calibration)
        self.used.append(model)
        if model.is_dir():
            return load_model(model), float(read_manifest(model)["metrics"]["seconds"])
        resume = training_started(model)  # a network that was cut off goes on at its last epoch
        with run_directory(fresh, model, resume=resume, advice="") as run:
            if isinstance(fresh, FineTunable):
                fitted = fresh.fit_resumable(training, progress, folder=run, resume=resume)
            else:
                fitted = fresh.fit(training, progress)
            fitted = _calibrated(fitted, calibration, progress)
            seconds = time.perf_counter() - began
            save_model(fitted, model, training, {"seconds": seconds}, calibration=calibration)
        return fitted, seconds

    def fit_elsewhere(
        self, jobs: Sequence[tuple[Method, Split]], dataset: Dataset, executor: Executor, progress: Progress
    ) -> None:
        """Fits the missing models, so that `fit` only has to load them; does nothing without a folder.

        A method that raises is left out: `fit` raises its error again.

        Args:
            jobs: Method and split of each fit.
            dataset: The samples that the splits index.
            executor: Runs the fits.
            progress: Called with the current work and its finished share.
        """
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        executor.run(
            partial(_fit_there, self.folder, dataset),
            [(replace(method, saved=None), split) for method, split in jobs],
            alone=any(isinstance(method.estimator, FineTunable) for method, _ in jobs),
            shared=self.folder,
            progress=partial(progress, f"{len(jobs)} fits"),
        )


def _fit_there(folder: Path, dataset: Dataset, job: tuple[Method, Split], step: Callable[[], None]) -> None:
    """Runs one fit, and keeps it in ``folder``."""
    with contextlib.suppress(InputError):
        KeptFits(folder).fit(*job, dataset, no_progress)
    step()


@contextmanager
def kept_fits(folder: Path) -> Generator[KeptFits]:
    """Keeps fits in ``folder`` until the block ends well, and says so where it does not.

    Fits that this run did not use, of another evaluation that was cut off at the same place, stay.
    """
    fits = KeptFits(folder)
    with output_lock(folder):
        try:
            yield fits
        except BaseException:
            if folder.is_dir() and any(folder.iterdir()):
                warnings.warn(f"{folder} keeps the trained models; the same command goes on with them", stacklevel=3)
            raise
        for model in fits.used:
            shutil.rmtree(model, ignore_errors=True)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _calibrated(fitted: Estimator, calibration: Dataset | None, progress: Progress) -> Estimator:
    return fitted if calibration is None else fitted.calibrate(calibration, progress)


def _identity(method: Method, training: Dataset, calibration: Dataset | None) -> str:
    """Returns 16 hexadecimal digits of everything in a fit: method, settings, first weights, samples, metadata."""
    digest = hashlib.sha256()
    for part in (
        method.estimator.name,
        method.estimator.settings.model_dump_json(),
        method.initial_sha256,
        *(text for data in (training, calibration) if data is not None for text in _content(data)),
    ):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:16]


def _content(dataset: Dataset) -> list[str]:
    metadata = {name: info.values() for name, info in dataset.session_info.items()}
    return [dataset.fingerprint(), json.dumps(metadata, sort_keys=True)]
