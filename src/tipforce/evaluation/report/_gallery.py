"""The held-out frames with the largest errors, each with the shape that the method detected in it."""

from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from ...datasets import Dataset
from ...estimators import Estimator
from ...types import FloatArray, Image, IntArray, Observation, ShapeFeatures
from ...units import newtons_to_grams
from ...vision import draw_shape
from .._evaluate import Evaluation
from .._predictions import Predictions
from ._style import COLOURS, GREY, jpeg_uri, make_figure, page_svg, to_svg

_WIDTH_PX = 560
_APART_NS = 1_000_000_000
"""Least distance in time of two frames of a session."""


@dataclass(frozen=True, slots=True)
class Card:
    """One frame of the gallery.

    Attributes:
        name: Name of the frame.
        session: Name of its session.
        text: Text beneath the image.
        svg: The image as SVG text, or empty.
        image_uri: The image as a data URI, or empty.
    """

    name: str
    session: str
    text: str
    svg: str = ""
    image_uri: str = ""


def worst_frames(evaluation: Evaluation, method: str, worst: int = 8, abstained: int = 4) -> list[Card]:
    """Finds the largest errors of a method under the strictest protocol, and some frames that it abstained from.

    Args:
        evaluation: The evaluation.
        method: Label of the method.
        worst: Largest number of errors, largest first, at least a second apart.
        abstained: Largest number of frames without an estimate that follow.

    Returns:
        A card for each frame, the errors before the abstentions.
    """
    result = evaluation.result(method, evaluation.strictest)
    assert result is not None
    predictions = result.predictions
    indices = _worst(predictions, worst)
    without = np.flatnonzero(~predictions.valid)
    if len(without):
        spread = np.unique(np.linspace(0, len(without) - 1, min(abstained, len(without))).round().astype(int))
        indices = np.concatenate([indices, without[spread]])
    if not len(indices):
        return []
    estimators = {fit.split.name: fit.estimator for fit in result.fits}
    chosen = predictions.where(indices)
    observations = evaluation.dataset.subset(chosen.index).observations()
    return [
        _card(chosen, index, observation, estimators[str(chosen.fold[index])], evaluation.dataset)
        for index, observation in enumerate(observations)
    ]


def _worst(predictions: Predictions, count: int) -> IntArray:
    """Returns indices of the largest errors, none within a second of a larger one: neighbours would show the same."""
    error = np.abs(predictions.magnitude_n - predictions.reference_magnitude_n)
    chosen: list[int] = []
    for index in np.argsort(-error, kind="stable")[: int(predictions.valid.sum())].tolist():
        same_session = [k for k in chosen if predictions.session[k] == predictions.session[index]]
        if all(abs(int(predictions.stamp_ns[k]) - int(predictions.stamp_ns[index])) > _APART_NS for k in same_session):
            chosen.append(index)
        if len(chosen) == count:
            break
    return np.array(chosen, dtype=np.int64)


def _card(
    predictions: Predictions, index: int, observation: Observation, estimator: Estimator, dataset: Dataset
) -> Card:
    """Returns the card of sample ``index`` of the predictions: its force, and its image with the detected shape.

    Of a dataset without images it has the curve of the shape coefficients, on those of the session.
    """
    true, estimate = float(predictions.reference_magnitude_n[index]), float(predictions.magnitude_n[index])
    if np.isfinite(estimate):
        answer_text = f"estimated {_both(estimate)}: {1e3 * (estimate - true):+.0f}\u00a0mN".replace(": -", ": \u2212")
    else:
        answer_text = f"abstained: {predictions.status[index].replace('_', ' ')}"
        answer_text += f", {predictions.detail[index]}" if predictions.detail[index] else ""
    text = f"measured {_both(true)}, {answer_text}"
    first_view = estimator.views[0]
    shown = first_view if first_view in observation.views else next(iter(observation.views), first_view)
    name = str(dataset.names_of(shown)[predictions.index[index]])
    view, session = observation.views.get(shown), str(predictions.session[index])
    svg = uri = ""
    if isinstance(view, ShapeFeatures):
        svg = _curve_svg(view, _session_curves(dataset.subset(np.flatnonzero(dataset.session == session))), name)
    elif view is not None:
        shape = predictions.shape[index]
        uri = _photo(view if shape is None else draw_shape(view, shape))
    return Card(name, session, text, svg, uri)


def _both(newtons: float) -> str:
    return f"{newtons_to_grams(newtons):.1f}\u00a0g ({1e3 * newtons:.0f}\u00a0mN)"


def _photo(image: Image) -> str:
    """Returns an RGB or grey image as a JPEG in a data URI, of limited width."""
    scale = min(1.0, _WIDTH_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    return jpeg_uri(small)  # type: ignore[arg-type]


def _session_curves(session: Dataset, most: int = 60) -> list[FloatArray]:
    """Returns the curves of up to ``most`` other samples of the session, for comparison."""
    rows = np.unique(np.linspace(0, len(session) - 1, min(most, len(session))).round().astype(int))
    curves: list[FloatArray] = []
    for observation in session.subset(rows).observations():
        for view in observation.views.values():
            curve = _curve_of_features(view) if isinstance(view, ShapeFeatures) else None
            if curve is not None:
                curves.append(curve)
    return curves


def _curve_svg(view: ShapeFeatures, others: list[FloatArray], name: str) -> str:
    """Draws the curve of the coefficients on the others of its session."""
    curve = _curve_of_features(view)
    if curve is None:
        return ""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for other in others:
            axes.plot(other[:, 0], other[:, 1], color=GREY, linewidth=0.7, alpha=0.3)
        axes.plot(curve[:, 0], curve[:, 1], color=COLOURS["estimate"], linewidth=2.2)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, units of the file")
        axes.set_ylabel("y")

    return page_svg(to_svg(make_figure(draw, "", 3.2, 2.5)), f"shape of {name}")


def _curve_of_features(view: ShapeFeatures, points: int = 48) -> FloatArray | None:
    """Returns (points, 2): y(x) for x in 0..1, in the file's own unit, for powers ``A1`` (highest) ... ``A5``.

    Coefficients without the constant A5 start at the base's origin. None for other features.
    """
    power = {"A1": 4, "A2": 3, "A3": 2, "A4": 1, "A5": 0}
    if tuple(view.names) not in (tuple(power), tuple(power)[:4]):
        return None
    x = np.linspace(0.0, 1.0, points)
    y = sum((float(value) * x ** power[name] for name, value in zip(view.names, view.values, strict=True)), 0.0 * x)
    return np.column_stack([x, y])
