"""Methods judged on held-out data, and the report on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from .._system.executor import Executor, ExecutorName, LocalExecutor, executor_of
from ..errors import InputError
from ..estimators import ESTIMATORS, Progress, no_progress
from ..estimators.session import RodTrack
from ..evaluation import (
    Evaluation,
    EvaluationSettings,
    check_report_folder,
    kept_fits,
    methods_from,
    report_lines,
    truth_at,
    write_report,
)
from ..evaluation import evaluate as evaluate_methods
from ..simulation import read_truth
from ..types import FloatArray, IntArray, SessionInfo, merged_values
from ._bounds import bounds_from
from ._estimate import session_info_from
from ._limits import limits_in_dataset
from ._train import Data, data_of

Protocol = Literal["all", "random", "blocked", "session", "thesis", "standard", "catheter", "saved"]


@dataclass(frozen=True, eq=False)
class EvaluateReport:
    """Result of an evaluation.

    Attributes:
        evaluation: predictions and scores.
        metrics: content of metrics.json.
        lines: the same for people.
        report: the page that was written.
    """

    evaluation: Evaluation
    metrics: Mapping[str, Any]
    lines: tuple[str, ...]
    report: Path


def evaluate(
    models: str | Path | Sequence[str | Path],
    data: Data,
    output: str | Path,
    *,
    protocol: Protocol = "all",
    settings: BaseModel | Mapping[str, Any] | None = None,
    to_the_letter: bool = False,
    bench: SessionInfo | str | Path | None = None,
    init_from: str | Path | None = None,
    truth: str | Path | None = None,
    bound: bool | None = None,
    samples: int | None = None,
    every: int = 1,
    folds: int | None = None,
    perturb: int = 0,
    compare: bool = False,
    seed: int = 0,
    command: str = "",
    executor: Executor | ExecutorName = "local",
    progress: Progress | None = None,
) -> EvaluateReport:
    """Evaluates methods on held-out data and writes a report.

    A method is trained anew for every split; a saved model is also scored as it is, on sessions that it never saw.
    Trained models are kept in OUTPUT.evaluating until the report is written: an interrupted evaluation continues from
    there when it is run again in the same way.

    Args:
        models: folders of saved models, ``pretrained/NAME``, or names of methods.
        data: labelled samples; see `open_dataset`.
        output: folder for report.html, metrics.json and figures.
        protocol: the held-out samples. "all": random, blocked and session side by side; "saved": nothing is trained.
        settings: settings of the methods that are named; saved models have their own.
        to_the_letter: the methods that are named, ``svr`` and ``dcfe``, begin with the thesis's own settings, over
            which ``settings`` are laid.
        bench: metadata in place of those in the data.
        init_from: networks that are named: each split fine-tunes this model, or "pretrained".
        truth: folder with the truth of simulated sessions: score against it, too.
        bound: with ``truth``: also compute the posterior Cramer-Rao bound; default: yes.
        samples: number of samples to draw first; all by default.
        every: use every n-th frame of each session.
        folds: number of folds of cross-validation.
        perturb: number of samples that are also estimated with perturbed images, spread over all.
        compare: the report also holds the methods side by side over the load, beside sensors in the tip.
        seed: seed of drawn samples and splits.
        command: the command that was typed, for the report.
        executor: "local": one fit after the other, here; "ray": side by side on the cluster at RAY_ADDRESS.
        progress: called with the current step and the share that is done.

    Returns:
        Predictions and scores of each method under each protocol, and the page.

    Raises:
        InputError: no method, data or truth that can be used, or options that do not go together.
    """
    output, truth = Path(output), None if truth is None else Path(truth)
    names = [str(model) for model in ([models] if isinstance(models, str | Path) else models)]
    check_report_folder(output)
    named = [name for name in names if name in ESTIMATORS and not Path(name).is_dir()]
    if settings and not named:
        raise InputError("settings are for a method that is named, such as svr; a saved model has its own")
    if bound is not None and truth is None:
        raise InputError("the bound needs the truth: state the folder that `tipforce simulate` wrote as truth")
    if init_from is not None and not named:
        raise InputError("init_from is for a method that is named, such as compact; a saved model has its own weights")
    stated = settings.model_dump(exclude_unset=True) if isinstance(settings, BaseModel) else settings or {}
    settings_by_name = {
        name: ESTIMATORS[name].settings_type.model_validate(
            merged_values(thesis_settings(name), stated) if to_the_letter else stated
        )
        for name in named
    }
    if to_the_letter and (len(named) < len(names) or init_from is not None):
        raise InputError(
            "to_the_letter trains the thesis's own methods from nothing: name svr or dcfe, no saved model, and leave "
            "init_from out"
        )
    methods = methods_from(names, settings_by_name, None if init_from is None else str(init_from))
    dataset = data_of(data, session_info_from(bench), [method.as_it_comes or method.estimator for method in methods])
    report = progress or no_progress
    chosen_executor = executor_of(executor)
    true_n = None if truth is None else truth_at(dataset, _truths(truth))
    with kept_fits(output.with_name(f"{output.name}.evaluating")) as fits:
        result = evaluate_methods(
            dataset,
            methods,
            EvaluationSettings(
                protocols=None if protocol in ("all", "saved") else [protocol],
                as_saved=protocol == "saved",
                samples=samples,
                folds=folds,
                every=every,
                seed=seed,
                perturbed_frames=perturb or None,
                compare=compare,
            ),
            truth_n=true_n,
            bounds=bounds_from(dataset, truth, report) if truth is not None and bound is not False else None,
            progress=report,
            fits=fits,
            executor=None if isinstance(chosen_executor, LocalExecutor) else chosen_executor,
        )
        result = replace(result, notes=(*result.notes, *_limit_notes(result, report)))
        report("report", 1.0)
        metrics = write_report(result, output, command)
    return EvaluateReport(result, metrics, tuple(report_lines(metrics)), output / "report.html")


def _limit_notes(result: Evaluation, report: Progress) -> list[str]:
    """Returns a sentence on the unknown that limits the force, if the session model is one of the methods."""
    notes: list[str] = []
    for method in result.methods:
        model = method.saved or method.estimator
        if isinstance(model, RodTrack):
            report(f"{method.label}: limits of the force", 1.0)
            session_limits = limits_in_dataset(model, result.everything)
            if session_limits is not None and session_limits[1].measurable:
                notes.append(f"{method.label} is limited in {session_limits[0]} by {session_limits[1].text()}.")
    return notes


def thesis_settings(name: str) -> Mapping[str, Any]:
    """Returns the settings with which a method is the thesis's to the letter.

    Raises:
        InputError: the thesis has no such method.
    """
    settings = ESTIMATORS[name].thesis_settings
    if settings is None:
        known = " and ".join(each for each in ESTIMATORS if ESTIMATORS[each].thesis_settings is not None)
        raise InputError(f"{name}: the thesis has no such method; to_the_letter goes with {known}")
    return settings


def _truths(folder: Path) -> dict[str, tuple[IntArray, FloatArray]]:
    """Returns stamps (n,) and true forces (n, 3) by session, of all simulated sessions under ``folder``."""
    truths: dict[str, tuple[IntArray, FloatArray]] = {}
    for path in sorted(folder.rglob("*.truth.npz")):
        truth = read_truth(path)  # little of it is kept: a large set has thousands of sessions
        truths[truth.session] = truth.stamp_ns, truth.force_n
    if not truths:
        raise InputError(f"{folder}: it contains no truth; only `tipforce simulate` writes one")
    return truths
