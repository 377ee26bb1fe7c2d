"""The thesis's figures for the data at hand: 23(a), 23(b) and 24."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..types import FloatArray
from ._metrics import percent_of_true
from ._outcome import Outcome
from ._style import COLOURS, grams_axis, legend_above, make_figure

__all__ = ["figure_23a", "figure_23b", "figure_24"]

_MANY = 1500
"""Above so many points a scatter is stored as pixels."""
_LEGIBLE = 300
"""More samples than these cannot be told apart in a line over the sample number."""


def figure_23a(outcome: Outcome) -> Figure:
    """Error in percent of the true value over the test samples (thesis fig. 23a)."""
    percent = percent_of_true(outcome.reference_magnitude_n, outcome.magnitude_n)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        shown = np.isfinite(percent)
        number = np.arange(1, len(percent) + 1)
        limit = _limit(percent[shown])
        inside = shown & (np.abs(percent) <= limit)
        axes.axhline(0, color=COLOURS["reference"], linewidth=0.8)
        if len(percent) <= 120:
            axes.vlines(number[inside], 0, percent[inside], color=COLOURS["estimate"], linewidth=1.2, alpha=0.6)
        axes.plot(
            number[inside], percent[inside], "o", color=COLOURS["estimate"], markersize=3.2, alpha=0.8, mew=0,
            rasterized=len(percent) > _MANY,
        )  # fmt: skip
        beyond = shown & ~inside
        if beyond.any():
            edge = np.clip(percent[beyond], -limit, limit)
            text = f"{int(beyond.sum())} beyond the scale"
            axes.plot(number[beyond], edge, "D", color=COLOURS["line"], markersize=4, mew=0, label=text)
            legend_above(axes)
        axes.set_ylim(-1.08 * limit, 1.08 * limit)
        axes.set_xlabel("test sample")
        axes.set_ylabel("error, % of the true force")

    return make_figure(draw, f"{outcome.method}: error of each test sample (thesis fig. 23a)")


def figure_23b(outcomes: dict[str, Outcome]) -> Figure:
    """Estimated over true magnitude with the line y = x (thesis fig. 23b), one panel for each of ``outcomes``."""
    method = next(iter(outcomes.values())).method
    shown = [outcome for outcome in outcomes.values() if outcome.answered.any()]
    top = max((_top(outcome) for outcome in shown), default=1.0)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(outcomes), squeeze=False)[0]
        for place, (axes, (title, outcome)) in enumerate(zip(panels, outcomes.items(), strict=True)):
            _true_against_estimated(axes, outcome, top)
            axes.set_title(title)
            if place == 0:
                axes.set_ylabel("estimated force, N")
            if place == len(outcomes) - 1:
                grams_axis(axes)

    return make_figure(
        draw, f"{method}: estimated and true force (thesis fig. 23b)", 3.4 * max(2, len(outcomes)) + 0.2, 3.9
    )


def figure_24(outcome: Outcome) -> Figure:
    """Observed and fitted force over the training samples (thesis fig. 24)."""
    part = outcome.where(np.arange(min(len(outcome), _LEGIBLE)))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        number = np.arange(1, len(part) + 1)
        axes.plot(
            number, part.reference_magnitude_n, "o", color=COLOURS["reference"], markersize=2.8, alpha=0.75, mew=0,
            label="observed",
        )  # fmt: skip
        axes.plot(number, part.magnitude_n, color=COLOURS["estimate"], linewidth=1.2, label="fitted model")
        axes.set_xlim(0, len(part) + 1)
        axes.set_ylim(bottom=0)
        cut = f" (the first {len(part)} of {len(outcome)})" if len(part) < len(outcome) else ""
        axes.set_xlabel(f"training sample{cut}")
        axes.set_ylabel("force, N")
        grams_axis(axes)
        legend_above(axes)

    return make_figure(draw, f"{outcome.method}: model fitted to its training data (thesis fig. 24)")


def _true_against_estimated(axes: Axes, outcome: Outcome, top: float) -> None:
    axes.plot(
        outcome.reference_magnitude_n, outcome.magnitude_n, "o", color=COLOURS["estimate"], markersize=3, alpha=0.5,
        mew=0, rasterized=len(outcome) > _MANY, label="test samples",
    )  # fmt: skip
    axes.plot([0, top], [0, top], "--", color=COLOURS["line"], linewidth=1.3, label="y = x")
    axes.set_xlim(0, top)
    axes.set_ylim(0, top)
    axes.set_aspect("equal")
    axes.set_xlabel("true force, N")
    axes.legend(loc="upper left", handletextpad=0.4)


def _top(outcome: Outcome) -> float:
    largest = max(float(np.nanmax(outcome.magnitude_n)), float(outcome.reference_magnitude_n.max()))
    return 1.05 * largest if largest > 0 else 1.0


def _limit(percent: FloatArray) -> float:
    """Half height of the scale: all points where that is legible, else 98 % of them."""
    if not len(percent):
        return 10.0
    size = np.abs(percent)
    most = float(np.quantile(size, 0.98))
    whole = float(size.max())
    return max(whole if whole <= 2.5 * most else 1.2 * most, 1e-6)
