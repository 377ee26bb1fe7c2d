"""Robustness: metrics on test samples with perturbed images, beside those on the same samples as they are."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from ..clinical import CONTACT_N
from ..datasets import PERTURBATIONS, Dataset, Perturbation, in_memory, perturbed
from ..errors import InputError
from ..estimators import Estimator, Progress
from ..types import ForceEstimate, IntArray
from ._constant import Constant
from ._methods import Method
from ._metrics import error_metrics, interval_metrics
from ._predictions import Predictions, collect, concatenate
from ._protocols import AS_SAVED, MethodResult, ScoredData, index_in

UNPERTURBED = "unperturbed"
"""Kind of the first line of a table: the same samples with their images as they are."""

CHUNK_FRAMES = 50
"""Number of images in memory at the same time, and in a row for a method with a memory."""
MIN_STRETCHES = 10
"""Least number of stretches for a method that remembers."""


@dataclass(frozen=True, eq=False)
class _Part:
    """Samples for the method fitted on the split ``fold``: those at ``scored`` count, the others come before them."""

    fold: str
    samples: Dataset
    scored: IntArray


def perturbed_metrics(
    method: Method,
    result: MethodResult,
    constant: MethodResult,
    data: ScoredData,
    *,
    frames: int = 500,
    perturbations: Sequence[Perturbation] = PERTURBATIONS,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Scores the fitted methods of a result on some of its test samples, as they are and then perturbed.

    A method that remembers is shown stretches of 50 frames in a row, ten or more; those that the result has count. The
    method does not know of the perturbation: scale and base side stay as they were noted.

    Args:
        method: The method.
        result: Its result, whose fitted methods are used.
        constant: The constant predictor's result under the same splits; its errors are shown as well.
        data: The samples; its seed is that of noise and of the position of an object.
        frames: Number of test samples, spread over all; of a method that remembers with those that came before.
        perturbations: Kinds and sizes; those that differ in their direction only are pooled in one line.
        progress: Called with the current step and the share that is done.

    Returns:
        Lines of a table, the first of kind `UNPERTURBED`: ``kind``, ``size``, ``samples``, errors, ``coverage``,
        ``abstained_share``, the errors of the ``constant``, and ``ways``: the same for each direction.
    """
    estimators, means = _fitted(method, result, constant, data.dataset)
    parts = list(_parts(result.predictions, data, frames, estimators))
    # perturbations with one image operation, which differ in the force label, share the predictions
    ordered = sorted(perturbations, key=lambda each: repr(each.operation))
    same_images = [list(group) for _, group in groupby(ordered, key=lambda each: each.operation)]
    plain = Perturbation(UNPERTURBED, "", _unchanged)
    # (kind, size, direction) -> predictions of the method and of the constant predictor, one for each part
    pairs: dict[tuple[str, str, str], tuple[list[Predictions], list[Predictions]]] = {
        (each.kind, each.size, each.way): ([], []) for each in (plain, *perturbations)
    }
    for number, part in enumerate(parts):
        samples = in_memory(part.samples)
        for group in ([plain], *same_images):
            estimates = estimators[part.fold].predict(perturbed(samples, group[0], data.seed))
            for each in group:
                labelled = replace(samples, force_n=each.force(samples.force_n))
                method_parts, constant_parts = pairs[each.kind, each.size, each.way]
                method_parts.append(_predictions(result, part, labelled, estimates))
                constant_parts.append(_predictions(constant, part, labelled, means[part.fold].predict(labelled)))
        if progress is not None:
            progress(f"{method.label}, perturbed", (number + 1) / len(parts))
    lines: list[dict[str, Any]] = []
    for (kind, size), keys in groupby(pairs, key=lambda key: key[:2]):
        ways = {key[2]: tuple(map(concatenate, pairs[key])) for key in keys}
        all_ways, constant_all = (concatenate([pair[side] for pair in ways.values()]) for side in (0, 1))
        by_way = [{"way": way, **_metrics(*pair)} for way, pair in ways.items() if way]
        lines.append({"kind": kind, "size": size, **_metrics(all_ways, constant_all), "ways": by_way})
    return lines


def require_images(dataset: Dataset) -> None:
    """Checks before minutes of training that the samples have images; raises InputError if the first one has none."""
    first = next(dataset.subset(np.arange(1)).observations())
    if not any(isinstance(view, np.ndarray) for view in first.views.values()):
        raise InputError(
            f"there is no image in the samples of {dataset.title}, and only images can be perturbed; evaluate "
            "without perturbations"
        )


def _unchanged(image: Any, seed: tuple[int, int]) -> Any:  # noqa: ARG001 - nothing is drawn
    return image


def _fitted(
    method: Method, result: MethodResult, constant: MethodResult, dataset: Dataset
) -> tuple[Mapping[str, Estimator], Mapping[str, Estimator]]:
    """Returns by split the fitted method, and the constant predictor that was fitted on the same samples."""
    if result.fits:
        estimators, means = ({fit.split.name: fit.estimator for fit in each.fits} for each in (result, constant))
        return estimators, means
    assert method.saved is not None
    others = np.setdiff1d(np.arange(len(dataset)), result.predictions.index)
    return {AS_SAVED: method.saved}, {AS_SAVED: Constant().fit(dataset.subset(others) if len(others) else dataset)}


def _parts(
    predictions: Predictions, data: ScoredData, frames: int, estimators: Mapping[str, Estimator]
) -> Iterator[_Part]:
    """Yields test samples spread over all of them, in parts of at most `CHUNK_FRAMES` frames of one split and session.

    A method that remembers needs the preceding frames: each of its parts is a stretch of frames in a row. In it the
    test samples of the split count, each at most once.

    Args:
        predictions: n predictions of the test samples.
        data: the samples, and all frames from which they were drawn.
        frames: number of test samples, or for a method that remembers about that of all frames.
        estimators: split -> fitted method.
    """
    remembers = next(iter(estimators.values())).uses_history
    last_position = len(predictions) - 1
    count = min(max(MIN_STRETCHES, frames // CHUNK_FRAMES) if remembers else frames, len(predictions))
    # a stretch that ended with the first sample would be that sample alone
    positions = np.linspace(0, last_position, count + 1)[1:] if remembers else np.linspace(0, last_position, count)
    chosen = np.unique(positions.round().astype(np.int64))
    if not remembers:
        keys = list(zip(predictions.fold[chosen].tolist(), predictions.session[chosen].tolist(), strict=True))
        for key in dict.fromkeys(keys):
            of_key = chosen[[index for index, each in enumerate(keys) if each == key]]
            for chunk in np.array_split(of_key, -(-len(of_key) // CHUNK_FRAMES)):
                yield _Part(key[0], data.dataset.subset(predictions.index[chunk]), np.arange(len(chunk)))
        return
    everything = data.everything
    frame_of_sample = index_in(everything, data.dataset)[predictions.index]
    counted = np.empty(0, np.int64)
    for index in chosen.tolist():
        session = np.flatnonzero(everything.session == predictions.session[index])
        end = int(np.searchsorted(session, frame_of_sample[index])) + 1
        stretch = session[max(0, end - CHUNK_FRAMES) : end]
        fold_frames = frame_of_sample[predictions.fold == predictions.fold[index]]
        scored = np.flatnonzero(np.isin(stretch, np.setdiff1d(fold_frames, counted)))
        counted = np.union1d(counted, stretch[scored])
        if len(scored):
            yield _Part(str(predictions.fold[index]), everything.subset(stretch), scored)


def _predictions(
    result: MethodResult, part: _Part, samples: Dataset, estimates: Sequence[ForceEstimate]
) -> Predictions:
    contact = samples.magnitude_n > CONTACT_N
    scored = [estimates[index] for index in part.scored.tolist()]
    return collect(result.method, result.protocol, part.fold, samples, part.scored, scored, contact)


def _metrics(predictions: Predictions, constant: Predictions) -> dict[str, Any]:
    """Returns errors of the valid samples, coverage, the share abstained, and the errors of the constant predictor."""
    constant_errors = _errors(constant)
    errors = _errors(predictions)
    coverage = interval_metrics(predictions.reference_magnitude_n, predictions.magnitude_interval_n)["coverage"]
    return {
        "samples": len(predictions),
        **errors,
        "mae_over_constant": errors["mae_n"] / constant_errors["mae_n"] if constant_errors["mae_n"] > 0 else None,
        "coverage": coverage,
        "abstained_share": float(np.mean(~predictions.valid)),
        "constant": constant_errors,
    }


def _errors(predictions: Predictions) -> dict[str, Any]:
    """Returns the errors of the magnitude and the RMS error of each component."""
    magnitude = error_metrics(predictions.reference_magnitude_n, predictions.magnitude_n)
    errors: dict[str, Any] = {name: magnitude[name] for name in ("mae_n", "mae_g", "rmse_n")}
    for axis, name in enumerate("xyz"):
        component = error_metrics(predictions.reference_n[:, axis], predictions.force_n[:, axis])
        errors[f"rmse_{name}_n"] = component["rmse_n"]
    return errors
