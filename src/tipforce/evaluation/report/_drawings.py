"""All figures of a report, in the order of the page, each with a file name and a caption."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...clinical import CONTACT_N
from ...types import FloatArray
from .._comparison import SENSOR_SOURCE, comparison
from .._constant import Constant
from .._evaluate import Evaluation
from .._predictions import Predictions, collect
from .._protocols import BY_SESSION, PROTOCOL_WORDS, MethodResult, index_in
from ._figures_comparison import figure_comparison
from ._figures_extra import figure_bound, figure_perturbed, figure_training, training_log
from ._figures_results import (
    figure_bland_altman,
    figure_coverage,
    figure_residuals,
    figure_retention,
    figure_scatter,
    figure_sessions,
    figure_splits,
    figure_trace,
    typical_session,
)
from ._figures_thesis import figure_23a, figure_23b, figure_24, figure_31, figure_32, sample_sheet
from ._style import METHOD_COLOURS, WIDE_IN, WIDTH_IN, Drawing, drawing_of, image_drawing, window_words

HEAD = (
    "trace", "scatter", "agreement", "coverage_force", "coverage_angle", "retention", "splits", "comparison", "bound",
    "perturbed",
)  # fmt: skip
"""Names of the figures before the sections of the methods."""


def traces_of(evaluation: Evaluation) -> dict[str, Predictions]:
    """Predicts one whole session for each method that has valid predictions under the strictest protocol.

    It is the session with the median error, see `typical_session` and `whole_session`.
    """
    traces: dict[str, Predictions] = {}
    for method in evaluation.methods:
        result = evaluation.result(method.label, evaluation.strictest)
        if result is not None and result.predictions.valid.any():
            traces[method.label] = whole_session(evaluation, result, typical_session(result.predictions))
    return traces


def head_drawings(evaluation: Evaluation, best: str, traces: Mapping[str, Predictions]) -> dict[str, Drawing]:
    """Returns name of `HEAD` -> figure before the sections of the methods, for those that the data allow.

    Args:
        evaluation: The evaluation.
        best: Label of the method whose trace, scatter and agreement are shown.
        traces: Result of `traces_of`.
    """
    drawings: dict[str, Drawing] = {}
    strict = evaluation.result(best, evaluation.strictest)
    assert strict is not None
    samples_of = PROTOCOL_WORDS[evaluation.strictest].of
    if best in traces:
        trace = traces[best]
        session = str(trace.session[0])
        figure = figure_trace(
            trace, session, evaluation.truth_n, quantities=("magnitude",), width_in=8.4, height_in=5.3
        )
        caption = (
            f"Session {session}, the one with the median error: {PROTOCOL_WORDS[evaluation.strictest].held}. "
            f"{window_words()}."
        )
        drawings["trace"] = drawing_of("trace", caption, figure)
        caption = f"Each point is a sample of {samples_of}; on the line the estimate equals the force sensor."
        drawings["scatter"] = drawing_of("scatter", caption, figure_scatter(strict.predictions))
        drawings["agreement"] = _agreement(strict, "bland-altman")
    drawings |= _coverage(evaluation)
    if (retained := _retention(evaluation)) is not None:
        drawings["retention"] = retained
    drawings["splits"] = _splits(evaluation)
    if evaluation.settings.compare:
        caption = (
            f"{samples_of[0].upper()}{samples_of[1:]}. Bins with fewer than 10 samples are left out. Sensors in the "
            f"tip: {SENSOR_SOURCE}."
        )
        drawings["comparison"] = drawing_of("comparison", caption, figure_comparison(comparison(evaluation)))
    bound, perturbed = _bound(evaluation), _perturbed(evaluation)
    if bound is not None:
        drawings["bound"] = bound
    if perturbed is not None:
        drawings["perturbed"] = perturbed
    return drawings


def _agreement(result: MethodResult, slug: str) -> Drawing:
    agreement = result.metrics["quantities"]["magnitude"]["bland_altman"]
    caption = (
        f"Bland-Altman, {PROTOCOL_WORDS[result.protocol].of}: 95 % of the differences are expected between the dashed "
        "lines. Their variance is the sum of that within and that between sessions."
    )
    return drawing_of(slug, caption, figure_bland_altman(result.predictions, agreement))


def _coverage(evaluation: Evaluation) -> dict[str, Drawing]:
    """Draws coverage by force and, where the contact angle is known, by angle, under the strictest protocol."""
    results = {m.label: evaluation.result(m.label, evaluation.strictest) for m in evaluation.methods}
    strata_of: dict[str, dict[str, Any]] = {}
    for key in ("coverage_by_force", "coverage_by_contact_angle"):
        strata = {name: result.metrics.get(key, []) for name, result in results.items() if result is not None}
        strata = {name: parts for name, parts in strata.items() if any(np.isfinite(part["coverage"]) for part in parts)}
        if strata:
            strata_of[key] = strata
    caption = (
        "Bars through the points: 95 % confidence intervals from resampled sessions, where a stratum has enough "
        "sessions. Coverage of fewer than 10 samples is not drawn."
    )
    drawings: dict[str, Drawing] = {}
    for key, strata in strata_of.items():
        name, unit, axis_label, by = (
            ("coverage_force", "n", "measured force, N", "force")
            if key == "coverage_by_force"
            else ("coverage_angle", "deg", "contact angle, degrees", "contact angle")
        )
        title, width_in = f"Coverage of the 90 % intervals by {by}", WIDTH_IN if len(strata_of) > 1 else WIDE_IN
        figure = figure_coverage(strata, unit, axis_label, title, width_in=width_in)
        drawings[name] = drawing_of(name.replace("_", "-"), caption, figure)
    return drawings


def _retention(evaluation: Evaluation) -> Drawing | None:
    """Draws error over the share abstained under the strictest protocol; None where no method gave an estimate."""
    results = [each for each in evaluation.results if each.protocol == evaluation.strictest]
    curves = {each.method: (each.truth_metrics or each.metrics)["trust"]["retention"] for each in results}
    curves = {method: curve for method, curve in curves.items() if curve["mae_n"]}
    if not curves:
        return None
    against = "the truth" if any(each.truth_metrics for each in results) else "the force sensor"
    caption = (
        f"Errors of the magnitude against {against}. A line begins (dot) at the share that the method abstained from "
        "by itself and continues as if it had also left out the estimates with the widest intervals: a method that "
        "knows when it is wrong falls to the right. Area: mean of the line over the answers."
    )
    figure = figure_retention(curves, Constant.name, "Error over the share abstained")
    return drawing_of("retention", caption, figure)


def _splits(evaluation: Evaluation) -> Drawing:
    """Draws the protocols side by side, all methods and the constant predictor."""
    labels = [*(method.label for method in evaluation.methods), Constant.name]
    maes = {
        label: {each.protocol: _mae_and_sessions(each) for each in evaluation.results if each.method == label}
        for label in labels
    }
    caption = (
        "Bars: mean absolute error of the magnitude over all test samples. Dots: single sessions. Neighbouring frames "
        "of one recording leak into a random split; only sessions never seen show the error on a new recording."
    )
    return drawing_of("splits", caption, figure_splits(maes, evaluation.protocols))


def _bound(evaluation: Evaluation) -> Drawing | None:
    """Draws all methods' errors over their Cramer-Rao bounds under the strictest protocol; None without any bound."""
    results = [each for each in evaluation.results if each.protocol == evaluation.strictest and each.bound_ratios]
    ratios = {each.method: each.bound_ratios or {} for each in results}
    quantities = [
        name for name in ("magnitude", "x", "y") if any(each["one_frame"][name]["all"]["n"] for each in ratios.values())
    ]
    if not quantities:
        return None
    caption = (
        "Median of error over bound in each bin, divided by the 0.674 of a Gaussian; the prior is that of the preset's "
        "forces. One frame: for a method that looks at each image on its own. All frames until then: for one that "
        "remembers. Bins of fewer than 10 samples are left out."
    )
    return drawing_of("bound", caption, figure_bound(ratios, quantities))


def _perturbed(evaluation: Evaluation) -> Drawing | None:
    """Draws errors under perturbations, all methods; None where they were not requested."""
    if not evaluation.perturbed:
        return None
    caption = (
        "Above: mean absolute error of the samples with an estimate. Below: share of those without. Every panel begins "
        "with the same samples unperturbed; its directions (left, right, up, down) are taken together."
    )
    return drawing_of("perturbed", caption, figure_perturbed(evaluation.perturbed))


def method_drawings(evaluation: Evaluation, method: str, best: str, traces: Mapping[str, Predictions]) -> list[Drawing]:
    """Draws the figures of one method's section: the thesis's, then those beyond it.

    Args:
        evaluation: The evaluation.
        method: Label of the method.
        best: Label of the method whose agreement is at the head of the page.
        traces: Result of `traces_of`.
    """
    number = [each.label for each in evaluation.methods].index(method)
    colour = METHOD_COLOURS[number % len(METHOD_COLOURS)]
    results = {each.protocol: each for each in evaluation.results if each.method == method}
    first = results.get("random") or next(iter(results.values()))
    strict = results[evaluation.strictest]
    constant = evaluation.result(Constant.name, evaluation.strictest)
    assert constant is not None
    name = _file_name(method)
    panels = {PROTOCOL_WORDS[each.protocol].name: each.predictions for each in (first, strict)}
    drawings: list[Drawing] = []
    if method in traces:
        drawings += [
            drawing_of(
                f"{name}-residuals",
                "Error over force. The band is the median of the 90 % intervals; a median error that leaves zero is "
                "bias.",
                figure_residuals(strict.predictions),
            ),
            drawing_of(
                f"{name}-sessions",
                "Every session by itself, "
                + ("when it was held out" if evaluation.strictest in BY_SESSION else _protocol_name(strict))
                + ". Right: share of its forces inside the 90 % interval.",
                _sessions(strict, constant, colour),
            ),
        ]
        if method != best:
            drawings.append(_agreement(strict, f"{name}-bland-altman"))
    drawings += [
        drawing_of(
            f"{name}-fig23b",
            "Thesis fig. 23(b): on the line y = x the estimate equals the sensor's force.",
            figure_23b(panels),
        )
    ]
    if method in evaluation.fitted:
        fitted = evaluation.fitted[method]
        caption = (
            f"Thesis fig. 24: the model on the very samples it was trained on, split "
            f"“{PROTOCOL_WORDS[fitted.protocol].name}”. A good fit here says nothing of new data."
        )
        drawings.append(drawing_of(f"{name}-fig24", caption, figure_24(fitted)))
    if len(first.predictions.quantities) > 1:
        drawings += _of_components(evaluation, first, name)
    drawings += _of_training(evaluation, strict, name)
    odd = sum(not drawing.wide for drawing in drawings) % 2 == 0  # with fig. 23(a), which then goes across
    caption = (
        f"Thesis fig. 23(a): over-estimates are positive. Samples of the split “{_protocol_name(first)}”; forces below "
        "10 mN have no percentage."
    )
    figure = figure_23a(first.predictions, width_in=WIDE_IN if odd else WIDTH_IN)
    drawings.append(drawing_of(f"{name}-fig23a", caption, figure))
    if method not in traces:
        return drawings
    session = str(traces[method].session[0])
    caption = f"Session {session}, the one with the median error: {PROTOCOL_WORDS[evaluation.strictest].held}."
    height_in = 1.3 + 1.25 * len(traces[method].quantities)
    figure = figure_trace(traces[method], session, evaluation.truth_n, width_in=WIDE_IN, height_in=height_in)
    return [drawing_of(f"{name}-trace", caption, figure), *drawings]


def _of_training(evaluation: Evaluation, result: MethodResult, name: str) -> list[Drawing]:
    """Draws the learning curve of the saved model, or of the first fit, where the method keeps a log."""
    saved = next(each.saved for each in evaluation.methods if each.label == result.method)
    epochs = training_log(saved or result.fits[0].estimator)
    if not epochs:
        return []
    model = (
        "the saved model"
        if saved
        else f"the split “{PROTOCOL_WORDS[result.protocol].name}: {result.fits[0].split.name}”"
    )
    caption = (
        f"Learning curve of {model}: the epoch with the smallest error on the validation part was kept; {len(epochs)} "
        "epochs were run. The validation part chose it, so its error there flatters."
    )
    return [drawing_of(f"{name}-training", caption, figure_training(epochs, result.method))]


def _of_components(evaluation: Evaluation, result: MethodResult, name: str) -> list[Drawing]:
    """Draws the thesis's figures 30, 31 and 32."""
    split = f"Test samples of the split “{PROTOCOL_WORDS[result.protocol].name}”"
    sheet = sample_sheet(evaluation.dataset, result.predictions, result.fits[0].estimator.views[0])
    drawings = [
        drawing_of(
            f"{name}-fig31",
            f"Thesis fig. 31: box plots by direction, r measured and p estimated. {split}: median, quartiles, whiskers "
            "to 1.5 times their distance, outliers.",
            figure_31(result.predictions),
        ),
        drawing_of(
            f"{name}-fig32",
            f"Thesis fig. 32: measured and estimated force by direction. {split}, in their order; in a gap the method "
            "abstained.",
            figure_32(result.predictions),
        ),
    ]
    if sheet is None:
        return drawings
    caption = "Thesis fig. 30: images of the test part as they come, before the method's own resizing."
    return [image_drawing(f"{name}-fig30", caption, sheet), *drawings]


def whole_session(evaluation: Evaluation, result: MethodResult, session: str) -> Predictions:
    """Predicts all frames of a held-out session, also those that were not drawn.

    Args:
        evaluation: The evaluation.
        result: Result of one method; under protocols without held-out sessions its test samples are taken.
        session: Name of the session.

    Returns:
        Predictions whose ``index`` counts in ``evaluation.everything``.
    """
    tested = result.predictions.where(result.predictions.session == session)
    everything = evaluation.everything
    if result.protocol not in BY_SESSION:
        return replace(tested, index=index_in(everything, evaluation.dataset)[tested.index])
    fit = next(fit for fit in result.fits if fit.split.name == tested.fold[0])
    frames = np.flatnonzero(everything.session == session)
    estimates = fit.estimator.predict(everything.subset(frames))
    contact = everything.magnitude_n > CONTACT_N
    return collect(result.method, result.protocol, fit.split.name, everything, frames, estimates, contact)


def _sessions(result: MethodResult, constant: MethodResult, colour: str) -> Figure:
    """Plots error and coverage of a method by session, in its colour, beside the error of the constant predictor."""
    sessions = list(result.metrics["by_session"])

    def column(of: MethodResult, key: str) -> FloatArray:
        by_session = of.metrics["by_session"]
        return np.array([by_session[name]["quantities"]["magnitude"][key] for name in sessions], dtype=np.float64)

    mae_n, constant_n, coverage = column(result, "mae_n"), column(constant, "mae_n"), column(result, "coverage")
    return figure_sessions(f"{result.method}: session by session", sessions, mae_n, constant_n, coverage, colour)


def _mae_and_sessions(result: MethodResult) -> FloatArray:
    sessions = result.metrics["by_session"].values()
    return np.array([result.mae_n, *(part["quantities"]["magnitude"]["mae_n"] for part in sessions)], dtype=np.float64)


def _file_name(method: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in method)


def _protocol_name(result: MethodResult) -> str:
    return PROTOCOL_WORDS[result.protocol].name
