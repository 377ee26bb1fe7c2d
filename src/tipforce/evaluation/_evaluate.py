"""Evaluation of methods on data: every protocol, every method, the constant predictor beside them."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, runtime_checkable
from typing import Protocol as Interface

import numpy as np

from .._system.executor import Executor
from ..datasets import Dataset, Protocol, Split, every_nth, random_subset, splits
from ..errors import InputError
from ..estimators import Estimator, Progress, no_progress
from ..types import FloatArray
from ._constant import Constant
from ._ground_truth import CramerRaoBounds
from ._kept_fits import KeptFits
from ._methods import Method, view_notes
from ._predictions import Predictions, collect, in_contact
from ._protocols import (
    AS_SAVED,
    PROTOCOLS,
    STRICTNESS,
    MethodResult,
    ScoredData,
    fine_tuning_notes,
    index_in,
    run_protocol,
    run_saved,
    run_saved_alone,
)
from ._robustness import perturbed_metrics, require_images


@dataclass(frozen=True)
class EvaluationSettings:
    """How methods are evaluated.

    Attributes:
        protocols: Names of the protocols; None: all of `PROTOCOLS` that the data allow.
        as_saved: Nothing is trained, only saved models are scored; ``protocols`` is then not used.
        samples: Number of drawn samples; None: all. Under the protocol "thesis" they are drawn from its sessions,
            and None means as many as the thesis has for the method (the most of any where there are several methods).
        folds: Number of folds of a cross-validation; None: the protocol's own.
        every: Every so many-th frame of each session is scored. Methods that remember still see those between.
        seed: Seed of the drawn samples, the splits and the bootstrap.
        perturbed_frames: Number of test samples on which each method is also scored with perturbed images; or None.
        compare: The report also shows the methods side by side over the load, see `comparison`.
    """

    protocols: Sequence[Protocol] | None = None
    as_saved: bool = False
    samples: int | None = None
    folds: int | None = None
    every: int = 1
    seed: int = 0
    perturbed_frames: int | None = None
    compare: bool = False


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything a report is made of.

    Attributes:
        dataset: The n samples that were scored, drawn from ``everything``.
        everything: The whole dataset.
        methods: The methods, in their order.
        results: Results by protocol, within it the methods in their order and the constant predictor last.
        fitted: Method -> its predictions on the part it was trained on (thesis fig. 24).
        timing: Method -> microseconds a frame, see `time_per_frame`.
        notes: Sentences on parts that could not be done, and why.
        settings: The requested settings.
        truth_n: (len(everything), 3) true force in newtons, or None.
        bounds: Bounds of the n samples, or None.
        perturbed: Method -> lines of a table (see `perturbed_metrics`); empty where it was not asked for.
    """

    dataset: Dataset
    everything: Dataset
    methods: tuple[Method, ...]
    results: tuple[MethodResult, ...]
    fitted: dict[str, Predictions]
    timing: dict[str, dict[str, Any]]
    notes: tuple[str, ...]
    settings: EvaluationSettings
    truth_n: FloatArray | None = field(default=None, repr=False)
    bounds: CramerRaoBounds | None = field(default=None, repr=False)
    perturbed: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict[str, Any], repr=False)

    def result(self, method: str, protocol: str) -> MethodResult | None:
        """Returns the result of one method under one protocol; None if it was not evaluated.

        Args:
            method: Label of the method.
            protocol: Name of the protocol.
        """
        return next((each for each in self.results if (each.method, each.protocol) == (method, protocol)), None)

    @property
    def protocols(self) -> tuple[str, ...]:
        """Those that were run, in order."""
        return tuple(dict.fromkeys(each.protocol for each in self.results))

    @property
    def strictest(self) -> str:
        """The strictest protocol that was run: whole sessions before blocks before random frames."""
        return max((p for p in self.protocols if p in STRICTNESS), key=STRICTNESS.index)


@runtime_checkable
class ShowsFeatures(Interface):
    """A fitted method that can show its inputs: an optional addition to the estimator's contract."""

    def normalised(self, dataset: Dataset) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...], FloatArray]:
        """Returns the scaled inputs and targets of the samples that have features (m <= len(dataset)).

        Returns:
            Names (k,) and values (m, k) of the features, then names (t,) and values (m, t) of the target forces.
        """
        ...


def evaluate(
    dataset: Dataset,
    methods: Sequence[Method],
    settings: EvaluationSettings | None = None,
    *,
    truth_n: FloatArray | None = None,
    bounds: CramerRaoBounds | None = None,
    progress: Progress | None = None,
    fits: KeptFits | None = None,
    executor: Executor | None = None,
) -> Evaluation:
    """Trains and scores every method under every protocol, the constant predictor beside them.

    Args:
        dataset: Labelled samples; the labels are the force sensor's.
        methods: The methods, with labels that differ; see `methods_from`.
        settings: Protocols, samples, seed, perturbations; None: the defaults.
        truth_n: (len(dataset), 3) true force of a simulation in newtons, base frame, NaN where not known (see
            `truth_at`). The same estimates are scored against it too.
        bounds: Cramer-Rao bounds of all samples of ``dataset``; errors against ``truth_n`` are compared with them.
        progress: Called with the current step and the share that is done.
        fits: Keeps the fits on disk until all are done, see `kept_fits`; None: nothing is kept.
        executor: Makes ``fits`` first, side by side; None: they are made here, one after the other.

    Returns:
        The predictions, their metrics and all that a report needs (see `write_report`).

    Raises:
        InputError: A protocol that was asked for cannot be run on these data, none can be, two methods have one label,
            or images are to be perturbed and there are none.
        ValueError: ``truth_n`` or ``bounds`` do not fit ``dataset``.
    """
    settings = settings or EvaluationSettings()
    _check_inputs(dataset, methods, settings, truth_n, bounds)
    methods = [method.for_dataset(dataset) for method in methods]
    everything, whole_truth_n = dataset, truth_n
    # under "thesis" the protocol itself draws the samples
    dataset = every_nth(everything, settings.every) if settings.every != 1 else everything
    if settings.samples is not None and "thesis" not in (settings.protocols or ()):
        dataset = random_subset(dataset, settings.samples, settings.seed)
    if truth_n is not None:
        rows = index_in(everything, dataset)
        truth_n, bounds = truth_n[rows], None if bounds is None else bounds.at(rows)
    data = ScoredData(dataset, everything, in_contact(dataset, truth_n), truth_n, bounds, settings.seed)
    notes = [*fine_tuning_notes(methods, dataset), *view_notes(methods, dataset)]
    if settings.as_saved:
        results = run_saved_alone(methods, data, notes)
    else:
        results = _run_protocols(methods, settings, data, notes, progress, fits, executor)
        results += filter(None, [run_saved(method, data, notes) for method in methods])
    fitted: dict[str, Predictions] = {}
    timing: dict[str, dict[str, Any]] = {}
    for method in methods:
        first_fit = next(each for each in results if each.method == method.label).fits[0]
        if len(rows := first_fit.split.train):  # none for a saved model
            fitted[method.label] = collect(
                method.label, first_fit.protocol, first_fit.split.name, dataset, rows,
                first_fit.estimator.predict(dataset.subset(rows)), data.contact,
            )  # fmt: skip
        timing[method.label] = time_per_frame(first_fit.estimator, everything)
    evaluation = Evaluation(
        dataset=dataset, everything=everything, methods=tuple(methods), results=tuple(results), fitted=fitted,
        timing=timing, notes=tuple(notes), settings=settings, truth_n=whole_truth_n, bounds=bounds,
    )  # fmt: skip
    if settings.perturbed_frames is None:
        return evaluation
    return replace(evaluation, perturbed=_perturbed(evaluation, data, settings.perturbed_frames, progress))


def _check_inputs(
    dataset: Dataset,
    methods: Sequence[Method],
    settings: EvaluationSettings,
    truth_n: FloatArray | None,
    bounds: CramerRaoBounds | None,
) -> None:
    """Checks methods, ground truth and bounds before anything is trained.

    Args:
        dataset: n samples.
        methods: methods to evaluate, with different names.
        settings: settings of the evaluation; ``perturbed_frames`` requires images in the dataset.
        truth_n: forces of the ground truth in newtons, in the shape of those of ``dataset``; None: it is not known.
        bounds: Cramer-Rao bounds of the n samples; they require ``truth_n``.

    Raises:
        InputError: methods are missing or two have the same name, or the dataset has no images.
        ValueError: ``truth_n`` or ``bounds`` do not fit the dataset.
    """
    if not methods:
        raise InputError("there is no method to evaluate; name one, for example svr")
    labels = [method.label for method in methods]
    if len(set(labels)) < len(labels) or Constant.name in labels:
        raise InputError(
            f"the methods' names must differ from each other and from {Constant.name!r}, got {', '.join(labels)}"
        )
    if truth_n is not None and truth_n.shape != dataset.force_n.shape:
        raise ValueError(f"truth_n: expected shape {dataset.force_n.shape}, got {truth_n.shape}")
    if bounds is not None and (truth_n is None or len(bounds.contact_angle_deg) != len(dataset)):
        raise ValueError(
            "bounds: expected those of all samples, beside truth_n: errors against the truth are compared with them"
        )
    if settings.perturbed_frames is not None:
        require_images(dataset)


def _run_protocols(
    methods: Sequence[Method],
    settings: EvaluationSettings,
    data: ScoredData,
    notes: list[str],
    progress: Progress | None,
    fits: KeptFits | None,
    executor: Executor | None,
) -> list[MethodResult]:
    """Runs all protocols that the data and methods allow; see `evaluate` for the arguments.

    Returns:
        By protocol the results of the methods in their order, then that of the constant predictor. ``notes`` gets a
        sentence for each protocol that was left out.
    """
    thesis_samples = settings.samples or max(method.estimator.thesis_samples for method in methods)
    plans: dict[Protocol, list[Split]] = {}
    reasons: dict[str, InputError] = {}

    def left_out(protocol: str, error: InputError) -> None:
        """Raises the error of a protocol that was requested by name; another one is left out with a note."""
        if settings.protocols is not None:
            raise error
        reasons[protocol] = error
        notes.append(f"Protocol {protocol} was left out: {error}.")

    for protocol in settings.protocols or PROTOCOLS:
        try:
            plans[protocol] = splits(
                protocol, data.dataset, folds=settings.folds, seed=settings.seed, thesis_samples=thesis_samples
            )
        except InputError as error:
            left_out(protocol, error)
            continue
        unused = len(data.dataset) - sum(len(split.train) + len(split.test) for split in plans[protocol])
        if protocol == "catheter" and unused:
            notes.append(f"Protocol catheter passes over {unused} samples of catheters with a single session.")
    if executor is not None and fits is not None:
        jobs = [(method, split) for plan in plans.values() for method in methods for split in plan]
        fits.fit_elsewhere(jobs, data.dataset, executor, progress or no_progress)
    total_fits = sum(len(plan) for plan in plans.values()) * len(methods)
    done_fits = 0
    results: list[MethodResult] = []
    for protocol, plan in plans.items():
        try:
            constant = run_protocol(Method(Constant.name, Constant()), protocol, plan, data)
            protocol_results: list[MethodResult] = []
            for method in methods:
                part_progress = _part_of(progress, done_fits / total_fits, len(plan) / total_fits)
                done_fits += len(plan)
                protocol_results.append(
                    run_protocol(method, protocol, plan, data, constant.predictions, part_progress, fits)
                )
        except InputError as error:
            left_out(protocol, error)
        else:
            results += [*protocol_results, constant]
    if not results:
        raise reasons[next(name for name in PROTOCOLS if name in reasons)]
    return results


def _part_of(progress: Progress | None, start: float, share: float) -> Progress | None:
    """Returns a progress that reports from ``start`` to ``start`` + ``share`` of ``progress``."""
    if progress is None:
        return None
    return lambda what, done: progress(what, start + done * share)


def _perturbed(
    evaluation: Evaluation, data: ScoredData, frames: int, progress: Progress | None
) -> dict[str, list[dict[str, Any]]]:
    """Returns method -> lines of the table of perturbations; a saved model is used as it is."""
    constant = evaluation.result(Constant.name, evaluation.strictest)
    assert constant is not None
    lines: dict[str, list[dict[str, Any]]] = {}
    for method in evaluation.methods:
        result = evaluation.result(method.label, AS_SAVED) or evaluation.result(method.label, evaluation.strictest)
        assert result is not None
        lines[method.label] = perturbed_metrics(method, result, constant, data, frames=frames, progress=progress)
    return lines


def time_per_frame(estimator: Estimator, dataset: Dataset, frames: int = 300) -> dict[str, Any]:
    """Times one update of a stream, with the image already in memory.

    Args:
        estimator: A fitted method.
        dataset: Its longest session is used.
        frames: Largest number of frames.

    Returns:
        ``frames``; ``p50_us``, ``p99_us`` and ``min_us`` in microseconds. The frames are passed twice; the first pass
        warms caches and compiled code and is not counted.
    """
    name = max(dataset.sessions, key=lambda session: int(np.sum(dataset.session == session)))
    session = dataset.subset(np.flatnonzero(dataset.session == name)[:frames])
    observations = list(islice(session.observations(), frames))
    taken_ns: list[int] = []
    for counted in (False, True):
        stream = estimator.start(dataset.session_info[name])
        for observation in observations:
            start = time.perf_counter_ns()
            stream.update(observation)
            if counted:
                taken_ns.append(time.perf_counter_ns() - start)
    taken_us = np.array(taken_ns) / 1e3
    return {
        "frames": len(observations),
        "p50_us": float(np.percentile(taken_us, 50)),
        "p99_us": float(np.percentile(taken_us, 99)),
        "min_us": float(taken_us.min()),
    }
