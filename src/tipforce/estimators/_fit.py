"""One training run: draw samples, hold some out, fit, measure."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..datasets import Dataset, random_split, random_subset
from ..errors import InputError
from ..types import FloatArray
from ._base import Estimator, FineTunable, Progress

E = TypeVar("E", bound=Estimator)


@dataclass(frozen=True, eq=False)
class Training:
    """Result of a training run.

    Attributes:
        estimator: the fitted method.
        dataset: the samples that it learnt from.
        metrics: its errors on the held-out samples; empty without any.
        calibration: the separate sessions of its intervals, if there were any.
    """

    estimator: Estimator
    dataset: Dataset
    metrics: dict[str, Any]
    calibration: Dataset | None = None


def train(
    method: Estimator,
    dataset: Dataset,
    *,
    samples: int | None = None,
    holdout: float = 0.0,
    seed: int = 0,
    start: FineTunable | None = None,
    folder: Path | None = None,
    resume: bool = False,
    calibrate: Dataset | None = None,
    progress: Progress | None = None,
) -> Training:
    """Fits a method and measures it on held-out samples.

    Args:
        method: the method and its settings.
        dataset: the data to train on.
        samples: number of samples to draw from ``dataset``; None: all.
        holdout: share of the samples that is held out at random, to measure on.
        seed: seed of drawing and holding out, and of the method where its settings do not state their own.
        start: initial model of a network, see `FineTunable.fine_tuned_from`.
        folder: run directory of a network, see `FineTunable.fit_resumable`.
        resume: continue from the checkpoint in ``folder``.
        calibrate: separate sessions on which the intervals are found.
        progress: called with the current work and its finished share.

    Returns:
        The fitted method, its samples, and its errors on the held-out samples.

    Raises:
        InputError: as `random_subset`, `random_split`, `Estimator.fit` and `Estimator.calibrate` raise it; ``start`` is
            of another method, or ``calibrate`` has sessions of ``dataset`` or other forces.
    """
    if start is not None and not isinstance(method, FineTunable):
        raise InputError(f"{method.name} is no network and always learns from nothing; leave out the initial model")
    method = for_dataset(method, dataset)
    if calibrate is not None:
        _check_calibration(dataset, calibrate)
        for_dataset(method, calibrate)
    settings = method.settings
    if "seed" in type(settings).model_fields and "seed" not in settings.model_fields_set:
        method = method.with_settings(settings.model_copy(update={"seed": seed}))

    def fit(part: Dataset) -> Estimator:
        """Fits a new copy of the method, from the initial model where there is one, and its intervals."""
        fresh = method.unfitted()
        if not isinstance(fresh, FineTunable):
            fitted = fresh.fit(part, progress)
        else:
            fresh = fresh if start is None else fresh.fine_tuned_from(start)
            fitted = fresh.fit_resumable(part, progress, folder=folder, resume=resume)
        return fitted if calibrate is None else fitted.calibrate(calibrate, progress)

    drawn = dataset if samples is None else random_subset(dataset, samples, seed)
    if not holdout:
        return Training(fit(drawn), drawn, {}, calibrate)
    split = random_split(drawn, holdout, seed)
    part = drawn.subset(split.train)
    fitted = fit(part)
    return Training(fitted, part, _measured(fitted, drawn.subset(split.test)), calibrate)


def for_dataset(method: E, dataset: Dataset) -> E:
    """Returns the method for the views of a dataset; see `Estimator.for_views`.

    Raises:
        InputError: the dataset lacks a view that the method reads.
    """
    try:
        return method.for_views(dataset.views)
    except InputError as error:
        advice = f": for example {method.view_setting}={dataset.views[0]}" if method.view_setting else ""
        raise InputError(f"{dataset.title}: {error}{advice}") from None


def _check_calibration(dataset: Dataset, calibrate: Dataset) -> None:
    """Checks the calibration sessions before a training of minutes: other sessions, with the same forces and frame.

    Raises:
        InputError: they do not fit the training data.
    """
    names = {fingerprint: name for name, fingerprint in dataset.session_fingerprints.items()}
    if shared := [names[mark] for mark in calibrate.session_fingerprints.values() if mark in names]:
        raise InputError(
            f"{calibrate.title}: {shared[0]} is in the training data, too, where errors are smaller than elsewhere; "
            f"leave it out there (without={shared[0]})"
        )
    if (dataset.known & ~calibrate.known).any():
        raise InputError(
            f"{calibrate.title}: lacks force components that {dataset.title} has; the intervals need all of them"
        )
    if other := calibrate.force_frames - dataset.force_frames:
        raise InputError(
            f"{calibrate.title}: its forces are in the frame {min(other)}, those of {dataset.title} in "
            f"{', '.join(sorted(dataset.force_frames))}; convert one of them"
        )


def _measured(fitted: Estimator, test: Dataset) -> dict[str, Any]:
    """Returns counts, and errors in newtons by component and magnitude, of those samples that have an estimate."""
    estimates = fitted.predict(test)
    valid = np.array([each.valid for each in estimates], np.bool_)
    metrics: dict[str, Any] = {"held_out_samples": len(test), "answered": int(valid.sum())}
    if not valid.any():
        return metrics
    force = np.array([each.force_n for each in estimates])[valid]
    size = np.array([each.magnitude_n for each in estimates])[valid]
    metrics |= _errors("magnitude", size - test.magnitude_n[valid])
    for axis, name in enumerate(("fx", "fy", "fz")):
        if test.known[axis] and np.isfinite(force[:, axis]).all():
            metrics |= _errors(name, force[:, axis] - test.force_n[valid, axis])
    return metrics


def _errors(name: str, error_n: FloatArray) -> dict[str, float]:
    return {
        f"{name}_mae_n": float(np.mean(np.abs(error_n))),
        f"{name}_rmse_n": float(np.sqrt(np.mean(error_n**2))),
        f"{name}_max_n": float(np.max(np.abs(error_n))),
    }
