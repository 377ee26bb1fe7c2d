"""What a method bears: its errors on test samples whose pictures were disturbed, beside those undisturbed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from ..datasets import PERTURBATIONS, Dataset, Perturbation, in_memory, perturbed
from ..errors import InputError
from ..estimators import Estimator, Progress
from ..types import ForceEstimate, IntArray
from ._constant import Constant
from ._evaluation import AS_SAVED, Candidate, Row
from ._metrics import error_figures, interval_figures
from ._outcome import CONTACT_N, Outcome, gather, join
from ._protocols import places_in

__all__ = ["bear", "require_pictures"]

_AT_ONCE = 50
"""So many pictures are in memory; a method that remembers sees so many in a row."""


@dataclass(frozen=True, eq=False)
class _Part:
    """Samples that one fitted method is asked: those at ``scored`` count, the others are what came before."""

    fold: str
    samples: Dataset
    scored: IntArray


def bear(
    candidate: Candidate,
    row: Row,
    constant: Row,
    dataset: Dataset,
    everything: Dataset,
    *,
    frames: int = 500,
    seed: int = 0,
    disturbances: Sequence[Perturbation] = PERTURBATIONS,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """The figures of ``row``'s fitted methods on up to ``frames`` of its test samples, undisturbed and then disturbed.

    A table's lines: disturbances that differ in their ways only are pooled, and told by themselves under ``ways``.
    ``constant``: the constant predictor's row, whose errors stand beside. A method that remembers is shown stretches
    of 50 frames in a row. Nothing tells a method of the disturbance: scale and base side are as they were noted.
    """
    methods, means = _fitted(candidate, row, constant, dataset)
    parts = list(_parts(row.outcome, dataset, everything, frames, methods))
    same = sorted(disturbances, key=lambda each: repr(each.picture))  # a picture is asked of once, whatever its labels
    pictures = [list(group) for _, group in groupby(same, key=lambda each: each.picture)]
    plain = Perturbation("undisturbed", "", _as_it_is)
    found: dict[tuple[str, str, str], tuple[list[Outcome], list[Outcome]]] = {
        (each.kind, each.size, each.way): ([], []) for each in (plain, *disturbances)
    }
    for number, part in enumerate(parts):
        kept = in_memory(part.samples)
        for group in ([plain], *pictures):
            estimates = methods[part.fold].predict(perturbed(kept, group[0], seed))
            for each in group:
                labelled = replace(kept, force_n=each.force(kept.force_n))
                own, others = found[each.kind, each.size, each.way]
                own.append(_outcome(row, part, labelled, estimates))
                others.append(_outcome(constant, part, labelled, means[part.fold].predict(labelled)))
        if progress is not None:
            progress(f"{candidate.label}, disturbed", (number + 1) / len(parts))
    lines: list[dict[str, Any]] = []
    for (kind, size), keys in groupby(found, key=lambda key: key[:2]):
        ways = {key[2]: tuple(map(join, found[key])) for key in keys}
        whole, mean = (join([pair[place] for pair in ways.values()]) for place in (0, 1))
        told = [{"way": way, **_figures(*pair)} for way, pair in ways.items() if way]
        lines.append({"kind": kind, "size": size, **_figures(whole, mean), "ways": told})
    return lines


def require_pictures(dataset: Dataset) -> None:
    """Raises InputError where the first sample shows no picture: ask before training for minutes."""
    first = next(dataset.subset(np.arange(1)).observations())
    if not any(isinstance(view, np.ndarray) for view in first.views.values()):
        raise InputError(
            f"there is no picture in the samples of {dataset.title}, and only pictures can be disturbed; leave "
            "perturb out"
        )


def _as_it_is(image: Any, seed: tuple[int, int]) -> Any:  # noqa: ARG001 - nothing is drawn
    return image


def _fitted(
    candidate: Candidate, row: Row, constant: Row, dataset: Dataset
) -> tuple[Mapping[str, Estimator], Mapping[str, Estimator]]:
    """By split: the fitted method, and the constant that was fitted on the same samples."""
    if row.fits:
        methods, means = ({fit.split.name: fit.estimator for fit in each.fits} for each in (row, constant))
        return methods, means
    assert candidate.saved is not None
    rest = np.setdiff1d(np.arange(len(dataset)), row.outcome.index)
    return {AS_SAVED: candidate.saved}, {AS_SAVED: Constant().fit(dataset.subset(rest) if len(rest) else dataset)}


def _parts(
    outcome: Outcome, dataset: Dataset, everything: Dataset, frames: int, methods: Mapping[str, Estimator]
) -> Iterator[_Part]:
    """Test samples spread over all of them; for a method that remembers, each ends a stretch of its session."""
    remembers = next(iter(methods.values())).uses_history
    count = max(1, frames // _AT_ONCE) if remembers else frames
    chosen = np.unique(np.linspace(0, len(outcome) - 1, min(count, len(outcome))).round().astype(np.int64))
    if not remembers:
        keys = list(zip(outcome.fold[chosen].tolist(), outcome.session[chosen].tolist(), strict=True))
        for key in dict.fromkeys(keys):
            own = chosen[[place for place, each in enumerate(keys) if each == key]]
            for some in np.array_split(own, -(-len(own) // _AT_ONCE)):
                yield _Part(key[0], dataset.subset(outcome.index[some]), np.arange(len(some)))
        return
    places = places_in(everything, dataset)[outcome.index]
    for place in chosen.tolist():
        session = np.flatnonzero(everything.session == outcome.session[place])
        end = int(np.searchsorted(session, places[place])) + 1
        stretch = session[max(0, end - _AT_ONCE) : end]
        own = places[outcome.fold == outcome.fold[place]]
        yield _Part(str(outcome.fold[place]), everything.subset(stretch), np.flatnonzero(np.isin(stretch, own)))


def _outcome(row: Row, part: _Part, samples: Dataset, estimates: Sequence[ForceEstimate]) -> Outcome:
    contact = samples.magnitude_n > CONTACT_N
    found = [estimates[place] for place in part.scored.tolist()]
    return gather(row.method, row.protocol, part.fold, samples, part.scored, found, contact)


def _figures(outcome: Outcome, constant: Outcome) -> dict[str, Any]:
    """Errors of the answers, coverage, and the share that has none; then the constant's errors."""
    mean = _errors(constant)
    own = _errors(outcome)
    coverage = interval_figures(outcome.reference_magnitude_n, outcome.magnitude_interval_n)["coverage"]
    return {
        "samples": len(outcome),
        **own,
        "mae_over_constant": own["mae_n"] / mean["mae_n"] if mean["mae_n"] > 0 else None,
        "coverage": coverage,
        "refused_share": float(np.mean(~outcome.answered)),
        "constant": mean,
    }


def _errors(outcome: Outcome) -> dict[str, Any]:
    magnitude = error_figures(outcome.reference_magnitude_n, outcome.magnitude_n)
    errors: dict[str, Any] = {name: magnitude[name] for name in ("mae_n", "mae_g", "rmse_n")}
    for axis, name in enumerate("xyz"):
        errors[f"rmse_{name}_n"] = error_figures(outcome.reference_n[:, axis], outcome.force_n[:, axis])["rmse_n"]
    return errors
