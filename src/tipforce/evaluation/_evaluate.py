"""Judging methods on data: every protocol, every method, the constant predictor beside them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from ..datasets import Dataset, Protocol, Split, every_nth, random_subset, splits
from ..errors import InputError
from ..estimators import Progress
from ..types import BoolArray, FloatArray
from ._bounds import Bounds
from ._constant import Constant
from ._disturbed import bear, require_pictures
from ._evaluation import AS_SAVED, PROTOCOLS, Candidate, Evaluation, Row
from ._judging import in_contact, row_of
from ._outcome import Outcome, gather
from ._protocols import places_in, run_splits
from ._saved import begun_notes, saved_alone, saved_row
from ._timing import time_per_frame

__all__ = ["evaluate"]

CONSTANT = Constant.name


def evaluate(
    dataset: Dataset,
    candidates: Sequence[Candidate],
    *,
    protocols: Sequence[Protocol] | None = None,
    samples: int | None = None,
    folds: int | None = None,
    every: int = 1,
    seed: int = 0,
    truth_n: FloatArray | None = None,
    bounds: Bounds | None = None,
    as_saved: bool = False,
    disturbed_frames: int | None = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Train and score every candidate under every one of ``protocols`` (None: all that the data allow).

    ``every``: of each session every so many-th frame is taken; methods that remember still see those between.
    ``samples``: as many are then drawn with ``seed``; under the protocol "thesis" from its sessions, and unless
    stated as many as the thesis has for the method (the most of any where there are several: all get the same).
    ``truth_n`` (len(dataset), 3): the twin's truth in the base frame; scores against it stand beside those against the
    sensor; ``bounds``, of ``dataset`` too: how close each method's error against the truth comes to the smallest
    possible. ``as_saved``: nothing is trained, saved models alone are scored. ``disturbed_frames``: each method, as
    saved where it was, else as fitted under the strictest protocol, is also asked for so many test samples whose
    pictures were disturbed. Raises InputError where a protocol that was asked for cannot be run on these data, or none
    can be.
    """
    if not candidates:
        raise InputError("there is no method to evaluate; name one, for example svr")
    labels = [candidate.label for candidate in candidates]
    if len(set(labels)) < len(labels) or CONSTANT in labels:
        raise InputError(
            f"the methods' names must differ from each other and from {CONSTANT!r}, got {', '.join(labels)}"
        )
    if truth_n is not None and truth_n.shape != dataset.force_n.shape:
        raise ValueError(f"truth_n: expected shape {dataset.force_n.shape}, got {truth_n.shape}")
    if bounds is not None and (truth_n is None or len(bounds.contact_angle_deg) != len(dataset)):
        raise ValueError(
            "bounds: expected those of all samples, beside truth_n: errors against the truth are held to them"
        )
    if disturbed_frames is not None:
        require_pictures(dataset)
    everything = dataset
    whole_truth_n = truth_n
    dataset = every_nth(everything, every) if every != 1 else everything
    if samples is not None and "thesis" not in (protocols or ()):
        dataset = random_subset(dataset, samples, seed)
    if truth_n is not None:
        places = places_in(everything, dataset)
        truth_n, bounds = truth_n[places], None if bounds is None else bounds.at(places)
    contact = in_contact(dataset, truth_n)
    thesis_samples = samples or max(candidate.recipe.thesis_samples for candidate in candidates)
    notes = begun_notes(candidates, dataset)
    plans: dict[Protocol, list[Split]] = {}
    refusals: dict[str, InputError] = {}

    def left_out(protocol: str, error: InputError) -> None:
        """Without a wish for certain protocols, those that these data do not allow are named and passed over."""
        if protocols is not None:
            raise error
        refusals[protocol] = error
        notes.append(f"Protocol {protocol} was left out: {error}.")

    for protocol in () if as_saved else protocols or PROTOCOLS:
        try:
            plans[protocol] = splits(protocol, dataset, folds=folds, seed=seed, thesis_samples=thesis_samples)
        except InputError as error:
            left_out(protocol, error)
            continue
        alone = len(dataset) - sum(len(split.train) + len(split.test) for split in plans[protocol])
        if protocol == "catheter" and alone:
            notes.append(f"Protocol catheter passes over {alone} samples of catheters with a single session.")
    judge = partial(row_of, truth_n=truth_n, bounds=bounds)
    steps = _Steps(progress, sum(len(plan) for plan in plans.values()) * len(candidates))
    rows: list[Row] = []
    for protocol, plan in plans.items():
        try:
            rows += _under(protocol, plan, candidates, dataset, contact, judge, steps)
        except InputError as error:
            left_out(protocol, error)
    if as_saved:
        rows = saved_alone(candidates, dataset, everything, contact, judge, notes)
    elif not rows:
        raise refusals[next(name for name in PROTOCOLS if name in refusals)]
    else:
        found = [saved_row(candidate, dataset, everything, contact, judge, notes) for candidate in candidates]
        rows += filter(None, found)

    fitted: dict[str, Outcome] = {}
    timing: dict[str, dict[str, Any]] = {}
    for candidate in candidates:
        first = next(row for row in rows if row.method == candidate.label).fits[0]
        if len(index := first.split.train):
            fitted[candidate.label] = gather(
                candidate.label, first.protocol, first.split.name, dataset, index,
                first.estimator.answers(dataset.subset(index)), contact,
            )  # fmt: skip
        timing[candidate.label] = time_per_frame(first.estimator, everything)
    result = Evaluation(
        dataset=dataset,
        everything=everything,
        candidates=tuple(candidates),
        rows=tuple(rows),
        fitted=fitted,
        timing=timing,
        notes=tuple(notes),
        seed=seed,
        samples=samples,
        folds=folds,
        every=every,
        truth_n=whole_truth_n,
        bounds=bounds,
    )
    if disturbed_frames is None:
        return result
    return replace(result, disturbed=_disturbed(result, disturbed_frames, progress))


def _disturbed(result: Evaluation, frames: int, progress: Progress | None) -> dict[str, list[dict[str, Any]]]:
    """What each method bears."""
    constant = result.row(CONSTANT, result.honest)
    assert constant is not None
    found: dict[str, list[dict[str, Any]]] = {}
    for candidate in result.candidates:
        row = result.row(candidate.label, AS_SAVED) or result.row(candidate.label, result.honest)
        assert row is not None
        found[candidate.label] = bear(
            candidate, row, constant, result.dataset, result.everything,
            frames=frames, seed=result.seed, progress=progress,
        )  # fmt: skip
    return found


def _under(
    protocol: Protocol,
    plan: Sequence[Split],
    candidates: Sequence[Candidate],
    dataset: Dataset,
    contact: BoolArray,
    judge: Callable[..., Row],
    steps: "_Steps",
) -> list[Row]:
    """The rows of one protocol: the candidates in their order, then the constant predictor."""
    constant, fits = run_splits(Constant(), CONSTANT, protocol, plan, dataset, contact)
    rows: list[Row] = []
    for candidate in candidates:
        progress = steps.part(len(plan))
        outcome, trained = run_splits(candidate.recipe, candidate.label, protocol, plan, dataset, contact, progress)
        rows.append(judge(outcome, constant, trained))
    return [*rows, judge(constant, constant, fits)]


class _Steps:
    """One bar over all fits."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def part(self, splits: int) -> Progress:
        """The report of one method under one protocol, ``splits`` of the total."""
        before = self._done
        self._done += splits

        def report(what: str, share: float) -> None:
            if self._progress is not None:
                self._progress(what, (before + share * splits) / self._total)

        return report
