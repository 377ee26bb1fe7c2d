"""The thesis's figures for the data at hand: 23(a), 23(b) and 24 of any method, 30 to 32 of those with components."""

from collections.abc import Mapping

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...datasets import Dataset
from ...types import FloatArray, Image
from .._metrics import percent_of_true
from .._predictions import Predictions
from ._style import COLOURS, MANY_POINTS, WIDTH_IN, grams_axis, legend_above, make_figure

MAX_LEGIBLE_SAMPLES = 300
"""With more samples the points of a line over the sample number overlap."""
_SAMPLES, _COLUMNS = 12, 4
_TILE_PX, _GAP_PX = 300, 4
"""Width of an image on the sheet, and the white between two of them."""


def figure_23a(predictions: Predictions, *, width_in: float = WIDTH_IN) -> Figure:
    """Plots the error in percent of the true value over the test samples (thesis fig. 23a).

    Args:
        predictions: Predictions of one method.
        width_in: Width in inches.
    """
    percent = percent_of_true(predictions.reference_magnitude_n, predictions.magnitude_n)

    def draw(figure: Figure) -> None:
        """Draws a point for each sample; those beyond the scale are diamonds at its edge."""
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
            rasterized=len(percent) > MANY_POINTS,
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

    return make_figure(draw, f"{predictions.method}: error of each test sample (thesis fig. 23a)", width_in)


def figure_23b(panels_of: Mapping[str, Predictions]) -> Figure:
    """Plots estimated over true magnitude with the line y = x (thesis fig. 23b), a panel for each of ``panels_of``."""
    method = next(iter(panels_of.values())).method
    shown = [predictions for predictions in panels_of.values() if predictions.valid.any()]
    top = max((_top(predictions) for predictions in shown), default=1.0)

    def draw(figure: Figure) -> None:
        """Draws the panels side by side, with the scale in grams at the last one."""
        panels = figure.subplots(1, len(panels_of), squeeze=False)[0]
        for number, (axes, (title, predictions)) in enumerate(zip(panels, panels_of.items(), strict=True)):
            _true_against_estimated(axes, predictions, top)
            axes.set_title(title)
            if number == 0:
                axes.set_ylabel("estimated force, N")
            if number == len(panels_of) - 1:
                grams_axis(axes)

    return make_figure(draw, f"{method}: estimated and true force (thesis fig. 23b)", 3.4 * max(2, len(panels_of)))


def figure_24(predictions: Predictions) -> Figure:
    """Plots observed and fitted force over the training samples (thesis fig. 24)."""
    part = predictions.where(np.arange(min(len(predictions), MAX_LEGIBLE_SAMPLES)))

    def draw(figure: Figure) -> None:
        """Draws the observed forces as points and the fitted ones as a line."""
        axes = figure.subplots()
        number = np.arange(1, len(part) + 1)
        axes.plot(
            number, part.reference_magnitude_n, "o", color=COLOURS["reference"], markersize=2.8, alpha=0.75, mew=0,
            label="observed",
        )  # fmt: skip
        axes.plot(number, part.magnitude_n, color=COLOURS["estimate"], linewidth=1.2, label="fitted model")
        axes.set_xlim(0, len(part) + 1)
        axes.set_ylim(bottom=0)
        cut = f" (the first {len(part)} of {len(predictions)})" if len(part) < len(predictions) else ""
        axes.set_xlabel(f"training sample{cut}")
        axes.set_ylabel("force, N")
        grams_axis(axes)
        legend_above(axes)

    return make_figure(draw, f"{predictions.method}: model fitted to its training data (thesis fig. 24)")


def _true_against_estimated(axes: Axes, predictions: Predictions, top: float) -> None:
    """Plots estimated over true magnitude in N with the line y = x; both axes end at ``top``."""
    axes.plot(
        predictions.reference_magnitude_n, predictions.magnitude_n, "o", color=COLOURS["estimate"], markersize=3,
        alpha=0.5, mew=0, rasterized=len(predictions) > MANY_POINTS, label="test samples",
    )  # fmt: skip
    axes.plot([0, top], [0, top], "--", color=COLOURS["line"], linewidth=1.3, label="y = x")
    axes.set_xlim(0, top)
    axes.set_ylim(0, top)
    axes.set_aspect("equal")
    axes.set_xlabel("true force, N")
    axes.legend(loc="upper left", handletextpad=0.4)


def _top(predictions: Predictions) -> float:
    largest = max(float(np.nanmax(predictions.magnitude_n)), float(predictions.reference_magnitude_n.max()))
    return 1.05 * largest if largest > 0 else 1.0


def _limit(percent: FloatArray) -> float:
    """Returns half the height of the scale: all points where that is legible, else 98 % of them."""
    if not len(percent):
        return 10.0
    size = np.abs(percent)
    quantile_98, largest = float(np.quantile(size, 0.98)), float(size.max())
    return max(largest if largest <= 2.5 * quantile_98 else 1.2 * quantile_98, 1e-6)


def figure_31(predictions: Predictions) -> Figure:
    """Plots the distribution of measured and estimated force by direction (thesis fig. 31): rx, px; ry, py."""
    axes_of = _components(predictions)
    use = predictions.valid

    def draw(figure: Figure) -> None:
        """Draws two boxes for each direction, r measured and p estimated, of the samples with an estimate."""
        panels = figure.subplots(1, len(axes_of), squeeze=False)[0]
        for axes, name in zip(panels, axes_of, strict=True):
            reference, estimate, _ = predictions.column(name)
            boxes = axes.boxplot(
                [reference[use], estimate[use]],
                tick_labels=[f"r{name}", f"p{name}"],
                widths=0.5,
                patch_artist=True,
                flierprops={"marker": "o", "markersize": 3, "alpha": 0.4, "mew": 0, "mfc": COLOURS["reference"]},
                medianprops={"color": COLOURS["line"], "linewidth": 1.8},
            )
            for box, colour in zip(boxes["boxes"], (COLOURS["reference"], COLOURS["estimate"]), strict=True):
                box.set(facecolor=colour, alpha=0.35)
            for flier in boxes["fliers"]:
                flier.set_rasterized(len(predictions) > MANY_POINTS)
            axes.set_title(f"F{name}")
            axes.tick_params(axis="x", length=0)
            axes.grid(visible=False, axis="x")
        panels[0].set_ylabel("force, N")
        grams_axis(panels[-1])

    title = f"{predictions.method}: distribution of the force (thesis fig. 31)"
    return make_figure(draw, title)


def figure_32(predictions: Predictions) -> Figure:
    """Plots measured and estimated force over the test samples, a panel for each direction (thesis fig. 32)."""
    part = predictions.where(np.arange(min(len(predictions), MAX_LEGIBLE_SAMPLES)))
    axes_of = _components(predictions)

    def draw(figure: Figure) -> None:
        """Draws a panel for each direction, with a line each for the measured and the estimated force."""
        panels = figure.subplots(len(axes_of), 1, sharex=True, squeeze=False)[:, 0]
        number = np.arange(1, len(part) + 1)
        for axes, name in zip(panels, axes_of, strict=True):
            reference, estimate, _ = part.column(name)
            axes.plot(number, reference, color=COLOURS["reference"], linewidth=1.1, label="measured")
            axes.plot(number, estimate, color=COLOURS["line"], linewidth=1.1, alpha=0.9, label="estimated")
            axes.set_ylabel(f"F{name}, N")
            grams_axis(axes)
        legend_above(panels[0])
        cut = f" (the first {len(part)} of {len(predictions)})" if len(part) < len(predictions) else ""
        panels[-1].set_xlabel(f"test sample{cut}")
        panels[-1].set_xlim(0, len(part) + 1)

    title = f"{predictions.method}: estimates of the test samples (thesis fig. 32)"
    return make_figure(draw, title)


def sample_sheet(dataset: Dataset, predictions: Predictions, view: str) -> Image | None:
    """Shows twelve unchanged images, spread over the test samples (thesis fig. 30).

    Args:
        dataset: The evaluated data.
        predictions: Predictions of one method; its test samples are shown.
        view: Name of the view; the only view of a sample replaces it where it has another name.

    Returns:
        The sheet (h, w, 3); None where there is no image.
    """
    spread = np.linspace(0, len(predictions) - 1, min(_SAMPLES, len(predictions)))
    chosen = predictions.index[np.unique(spread.round().astype(int))]
    tiles: list[Image] = []
    for observation in dataset.subset(chosen).observations():
        image = observation.views.get(view, next(iter(observation.views.values()), None))
        if isinstance(image, np.ndarray):
            tiles.append(_tile(image))
    if not tiles:
        return None
    tiles = tiles[: len(tiles) // _COLUMNS * _COLUMNS] or tiles  # whole rows, without a gap at the end
    height = max(tile.shape[0] for tile in tiles)
    rows = -(-len(tiles) // _COLUMNS)
    columns = min(_COLUMNS, len(tiles))
    row_pitch, column_pitch = height + _GAP_PX, _TILE_PX + _GAP_PX
    sheet = np.full((rows * row_pitch - _GAP_PX, columns * column_pitch - _GAP_PX, 3), 255, np.uint8)
    for number, tile in enumerate(tiles):
        top, left = number // _COLUMNS * row_pitch, number % _COLUMNS * column_pitch
        sheet[top : top + tile.shape[0], left : left + _TILE_PX] = tile
    return sheet


def _tile(image: Image) -> Image:
    """Returns ``image`` in colour and `_TILE_PX` wide."""
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image
    height = max(1, round(colour.shape[0] * _TILE_PX / colour.shape[1]))
    interpolation = cv2.INTER_AREA if colour.shape[1] > _TILE_PX else cv2.INTER_NEAREST
    return cv2.resize(colour, (_TILE_PX, height), interpolation=interpolation)  # type: ignore[return-value]


def _components(predictions: Predictions) -> tuple[str, ...]:
    return tuple(name for name in predictions.quantities if name != "magnitude")
