"""The worst held-out frames, with the curve that was fitted to each."""

from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from ..datasets import Dataset
from ..estimators import Estimator, view_of
from ..types import FloatArray, Image, IntArray, Observation, ShapeFeatures
from ..units import newtons_to_grams
from ._evaluation import Evaluation
from ._outcome import Outcome
from ._picture import jpeg_uri
from ._sketch import curve_of_features, picture_of
from ._style import COLOURS, GREY, make_figure, page_svg, to_svg

__all__ = ["Card", "worst_frames"]

_WIDTH_PX = 560
_APART_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Card:
    """One frame of the gallery: a picture (SVG text or a data URI) and what is said beneath it."""

    name: str
    session: str
    text: str
    svg: str = ""
    image_uri: str = ""


def worst_frames(evaluation: Evaluation, method: str, worst: int = 8, refused: int = 4) -> list[Card]:
    """The ``worst`` errors under the strictest protocol, largest first, then up to ``refused`` without an answer."""
    row = evaluation.row(method, evaluation.honest)
    assert row is not None
    outcome = row.outcome
    places = _worst(outcome, worst)
    without = np.flatnonzero(~outcome.answered)
    if len(without):
        spread = np.unique(np.linspace(0, len(without) - 1, min(refused, len(without))).round().astype(int))
        places = np.concatenate([places, without[spread]])
    if not len(places):
        return []
    estimators = {fit.split.name: fit.estimator for fit in row.fits}
    chosen = outcome.where(places)
    observations = evaluation.dataset.subset(chosen.index).observations()
    return [
        _card(chosen, place, observation, estimators[str(chosen.fold[place])], evaluation.dataset)
        for place, observation in enumerate(observations)
    ]


def _worst(outcome: Outcome, count: int) -> IntArray:
    """Places of the largest errors, none within a second of a larger one: neighbours would show the same."""
    error = np.abs(outcome.magnitude_n - outcome.reference_magnitude_n)
    chosen: list[int] = []
    for place in np.argsort(-error, kind="stable")[: int(outcome.answered.sum())].tolist():
        same = [k for k in chosen if outcome.session[k] == outcome.session[place]]
        if all(abs(int(outcome.stamp_ns[k]) - int(outcome.stamp_ns[place])) > _APART_NS for k in same):
            chosen.append(place)
        if len(chosen) == count:
            break
    return np.array(chosen, dtype=np.int64)


def _card(outcome: Outcome, place: int, observation: Observation, estimator: Estimator, dataset: Dataset) -> Card:
    true, found = float(outcome.reference_magnitude_n[place]), float(outcome.magnitude_n[place])
    if np.isfinite(found):
        said = f"estimated {_both(found)}: {1e3 * (found - true):+.0f}\u00a0mN".replace(": -", ": \u2212")
    else:
        said = f"refused: {outcome.status[place].replace('_', ' ')}"
        said += f", {outcome.detail[place]}" if outcome.detail[place] else ""
    text = f"measured {_both(true)}, {said}"
    wanted = view_of(estimator)
    shown = wanted if wanted in observation.views else next(iter(observation.views), wanted)
    name = str(dataset.names_of(shown)[outcome.index[place]])
    view, session = observation.views.get(shown), str(outcome.session[place])
    svg = uri = ""
    if isinstance(view, ShapeFeatures):
        svg = _curve_svg(view, _session_curves(dataset.subset(np.flatnonzero(dataset.session == session))), name)
    elif view is not None:
        uri = _photo(picture_of(estimator, observation, view, dataset.session_info[session]))
    return Card(name, session, text, svg, uri)


def _both(newtons: float) -> str:
    return f"{newtons_to_grams(newtons):.1f}\u00a0g ({1e3 * newtons:.0f}\u00a0mN)"


def _photo(picture: Image) -> str:
    """An RGB or grey picture as a JPEG in a data URI."""
    scale = min(1.0, _WIDTH_PX / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else picture
    return jpeg_uri(small)  # type: ignore[arg-type]


def _session_curves(session: Dataset, most: int = 60) -> list[FloatArray]:
    """Curves of up to ``most`` other samples of the session, to see this one against."""
    some = np.unique(np.linspace(0, len(session) - 1, min(most, len(session))).round().astype(int))
    curves: list[FloatArray] = []
    for observation in session.subset(some).observations():
        for view in observation.views.values():
            curve = curve_of_features(view) if isinstance(view, ShapeFeatures) else None
            if curve is not None:
                curves.append(curve)
    return curves


def _curve_svg(view: ShapeFeatures, others: list[FloatArray], name: str) -> str:
    """The curve that the coefficients stand for, on the others of its session."""
    curve = curve_of_features(view)
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
