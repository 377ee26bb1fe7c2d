"""One training run: draw samples, hold some out, fit, measure."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..dataset import Dataset, draw, random_split
from ..errors import InputError
from ..types import FloatArray
from ._base import Estimator, Progress
from .networks import NetworkEstimator

__all__ = ["Training", "train"]


@dataclass(frozen=True, eq=False)
class Training:
    """A fitted ``estimator``, the samples it learnt from, and ``metrics`` on those held out (empty without any)."""

    estimator: Estimator
    dataset: Dataset
    metrics: dict[str, Any]


def train(
    recipe: Estimator,
    dataset: Dataset,
    *,
    samples: int | None = None,
    holdout: float = 0.0,
    seed: int = 0,
    start: NetworkEstimator | None = None,
    folder: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Training:
    """Fit ``recipe`` on ``dataset``, or on ``samples`` drawn from it, less a random share ``holdout`` to measure on.

    ``seed`` is that of drawing, holding out and, where its settings do not state their own, of the method. ``start``,
    ``folder`` and ``resume`` are for networks: see `NetworkEstimator.fit_from`. Raises InputError as `draw`,
    `random_split` and `Estimator.fit` do, and where ``start`` is another method's.
    """
    if start is not None and not isinstance(recipe, NetworkEstimator):
        raise InputError(f"{recipe.name} is no network and always learns from nothing; leave out what it starts from")
    settings = recipe.settings
    if "seed" in type(settings).model_fields and "seed" not in settings.model_fields_set:
        recipe = recipe.unfitted()
        recipe.settings = settings.model_copy(update={"seed": seed})

    def fit(part: Dataset) -> Estimator:
        fresh = recipe.unfitted()
        if not isinstance(fresh, NetworkEstimator):
            return fresh.fit(part, progress)
        if start is not None:
            fresh = fresh.beginning_with(start)
        return fresh.fit_from(part, progress, folder=folder, resume=resume)

    drawn = dataset if samples is None else draw(dataset, samples, seed)
    if not holdout:
        return Training(fit(drawn), drawn, {})
    split = random_split(drawn, holdout, seed)
    part = drawn.subset(split.train)
    fitted = fit(part)
    return Training(fitted, part, _measured(fitted, drawn.subset(split.test)))


def _measured(fitted: Estimator, test: Dataset) -> dict[str, Any]:
    """Errors in newtons over the answered samples of ``test``."""
    answers = fitted.answers(test)
    valid = np.array([answer.valid for answer in answers], np.bool_)
    metrics: dict[str, Any] = {"held_out_samples": len(test), "answered": int(valid.sum())}
    if not valid.any():
        return metrics
    force = np.array([answer.force_n for answer in answers])[valid]
    size = np.array([answer.magnitude_n for answer in answers])[valid]
    metrics |= _errors("magnitude", size - test.magnitude_n[valid])
    for axis, name in enumerate(("fx", "fy", "fz")):
        if test.known[axis] and np.isfinite(force[:, axis]).all():
            metrics |= _errors(name, force[:, axis] - test.force_n[valid, axis])
    return metrics


def _errors(name: str, wrong_n: FloatArray) -> dict[str, float]:
    return {
        f"{name}_mae_n": float(np.mean(np.abs(wrong_n))),
        f"{name}_rmse_n": float(np.sqrt(np.mean(wrong_n**2))),
        f"{name}_max_n": float(np.max(np.abs(wrong_n))),
    }
