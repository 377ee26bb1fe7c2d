"""All figures of a report, in the order of its pages, each with a file name and a caption."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from ..estimators import view_of
from ..types import FloatArray
from ._constant import Constant
from ._evaluation import BY_SESSION, Evaluation, Row
from ._figure_bound import figure_bound
from ._figure_disturbed import figure_disturbed
from ._figure_training import figure_training, training_log
from ._figures import figure_23a, figure_23b, figure_24
from ._figures_beyond import figure_residuals, figure_sessions, figure_splits, figure_trace, typical_session
from ._figures_components import figure_31, figure_32, sample_sheet
from ._outcome import CONTACT_N, Outcome, gather
from ._picture import Picture, of_figure, of_image
from ._protocols import places_in
from ._style import METHOD_COLOURS
from ._wording import WORDS

__all__ = ["bound_picture", "disturbed_picture", "method_pictures", "overview"]


def overview(evaluation: Evaluation) -> Picture:
    """The splits side by side, all methods and the constant predictor."""
    labels = [*(candidate.label for candidate in evaluation.candidates), Constant.name]
    maes = {
        label: {row.protocol: _mae_and_sessions(row) for row in evaluation.rows if row.method == label}
        for label in labels
    }
    caption = (
        "Bars: mean absolute error of the magnitude over all test samples. Dots: single sessions. Neighbouring frames "
        "of one recording leak into a random split; only the sessions never seen show what a new recording will get."
    )
    return of_figure("splits", caption, figure_splits(maes, evaluation.protocols))


def bound_picture(evaluation: Evaluation) -> Picture | None:
    """All methods' errors over their bounds under the strictest protocol; None where nothing has a bound."""
    rows = [row for row in evaluation.rows if row.protocol == evaluation.honest and row.bound_figures]
    held = {row.method: row.bound_figures or {} for row in rows}
    quantities = [
        name for name in ("magnitude", "x", "y") if any(f["one_frame"][name]["all"]["n"] for f in held.values())
    ]
    if not quantities:
        return None
    caption = (
        "Median of error over bound in each bin, divided by the 0.674 of a Gaussian; forces of the preset known "
        "beforehand. One frame: the measure of a method that sees each picture on its own. All frames until then: of "
        "one that remembers. Bins of fewer than 10 samples are left out."
    )
    return of_figure("bound", caption, figure_bound(held, quantities))


def disturbed_picture(evaluation: Evaluation) -> Picture | None:
    """What all methods bear; None where nobody asked."""
    if not evaluation.disturbed:
        return None
    caption = (
        "Above: mean absolute error of the samples that were answered. Below: share of those that were not. Every "
        "panel begins with the same samples undisturbed; its ways (left, right, up, down) are taken together."
    )
    return of_figure("disturbed", caption, figure_disturbed(evaluation.disturbed))


def method_pictures(evaluation: Evaluation, method: str) -> list[Picture]:
    """The thesis's figures 23(a), 23(b) and 24, then those beyond it, of one method."""
    place = [candidate.label for candidate in evaluation.candidates].index(method)
    colour = METHOD_COLOURS[place % len(METHOD_COLOURS)]
    rows = {row.protocol: row for row in evaluation.rows if row.method == method}
    first = rows.get("random") or next(iter(rows.values()))
    strict = rows[evaluation.honest]
    constant = evaluation.row(Constant.name, evaluation.honest)
    assert constant is not None
    name = _file_name(method)
    panels = {WORDS[row.protocol].name: row.outcome for row in (first, strict)}
    made = [
        of_figure(
            f"{name}-fig23a",
            f"Thesis fig. 23(a): over-estimates are positive. Samples of the split “{WORDS[first.protocol].name}”; "
            "forces below 10 mN have no percentage.",
            figure_23a(first.outcome),
        ),
        of_figure(
            f"{name}-fig23b",
            "Thesis fig. 23(b): on the line y = x the estimate equals the sensor's force.",
            figure_23b(panels),
        ),
    ]
    if method in evaluation.fitted:
        fitted = evaluation.fitted[method]
        caption = (
            f"Thesis fig. 24: the model on the very samples it was trained on, split “{WORDS[fitted.protocol].name}”. "
            "A good fit here says nothing of new data."
        )
        made.append(of_figure(f"{name}-fig24", caption, figure_24(fitted)))
    made += _of_training(evaluation, strict, name)
    if len(first.outcome.quantities) > 1:
        made += _of_components(evaluation, first, name)
    if not strict.outcome.answered.any():
        return made
    session = typical_session(strict.outcome)
    whole = whole_session(evaluation, strict, session)
    return [
        *made,
        of_figure(
            f"{name}-residuals",
            "Error over force. The band is the median of the 90 % intervals; a median error that leaves zero is bias.",
            figure_residuals(strict.outcome),
        ),
        of_figure(
            f"{name}-trace",
            f"Session {session}, the one with the median error of all sessions, {WORDS[evaluation.honest].held}.",
            figure_trace(whole, session, evaluation.truth_n),
        ),
        of_figure(
            f"{name}-sessions",
            "Every session by itself, "
            + ("when it was held out" if evaluation.honest in BY_SESSION else WORDS[evaluation.honest].name)
            + ". Right: share of its forces inside the 90 % interval.",
            _sessions(strict, constant, colour),
        ),
    ]


def _of_training(evaluation: Evaluation, row: Row, name: str) -> list[Picture]:
    """The learning curve of the saved model, or of the first fit, where it keeps a log."""
    saved = next(candidate.saved for candidate in evaluation.candidates if candidate.label == row.method)
    rows = training_log(saved or row.fits[0].estimator)
    if not rows:
        return []
    of = "the saved model" if saved else f"the split “{WORDS[row.protocol].name}: {row.fits[0].split.name}”"
    caption = (
        f"Learning curve of {of}: the epoch with the smallest error on the validation part was kept; {len(rows)} "
        "epochs were run. The validation part chose it, so its error there flatters."
    )
    return [of_figure(f"{name}-training", caption, figure_training(rows, row.method))]


def _of_components(evaluation: Evaluation, row: Row, name: str) -> list[Picture]:
    """The thesis's figures 30, 31 and 32."""
    split = f"Test samples of the split “{WORDS[row.protocol].name}”"
    sheet = sample_sheet(evaluation.dataset, row.outcome, view_of(row.fits[0].estimator))
    made = [
        of_figure(
            f"{name}-fig31",
            f"Thesis fig. 31: box plots by direction, r measured and p estimated. {split}: median, quartiles, whiskers "
            "to 1.5 times their distance, outliers.",
            figure_31(row.outcome),
        ),
        of_figure(
            f"{name}-fig32",
            f"Thesis fig. 32: measured and estimated force by direction. {split}, in their order; a gap was refused.",
            figure_32(row.outcome),
        ),
    ]
    if sheet is None:
        return made
    told = "Thesis fig. 30: pictures of the test part as they come, before the method's own resizing."
    return [of_image(f"{name}-fig30", told, sheet), *made]


def whole_session(evaluation: Evaluation, row: Row, session: str) -> Outcome:
    """All frames of a held-out session, also those that were not drawn; under other protocols its test samples.

    The outcome's ``index`` counts in ``evaluation.everything``.
    """
    part = row.outcome.where(row.outcome.session == session)
    everything = evaluation.everything
    if row.protocol not in BY_SESSION:
        return replace(part, index=places_in(everything, evaluation.dataset)[part.index])
    fit = next(fit for fit in row.fits if fit.split.name == part.fold[0])
    frames = np.flatnonzero(everything.session == session)
    found = fit.estimator.answers(everything.subset(frames))
    contact = everything.magnitude_n > CONTACT_N
    return gather(row.method, row.protocol, fit.split.name, everything, frames, found, contact)


def _sessions(row: Row, constant: Row, colour: str) -> Figure:
    own, other = row.figures["by_session"], constant.figures["by_session"]

    def column(groups: dict[str, dict[str, dict[str, dict[str, float]]]], key: str) -> FloatArray:
        return np.array([groups[name]["quantities"]["magnitude"][key] for name in own], dtype=np.float64)

    title = f"{row.method}: session by session"
    return figure_sessions(
        title, list(own), column(own, "mae_n"), column(other, "mae_n"), column(own, "coverage"), colour
    )


def _mae_and_sessions(row: Row) -> FloatArray:
    sessions = row.figures["by_session"].values()
    return np.array([row.mae_n, *(part["quantities"]["magnitude"]["mae_n"] for part in sessions)], dtype=np.float64)


def _file_name(method: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in method)
