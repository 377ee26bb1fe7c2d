"""The thesis's figures of chapter 4 for the data at hand, of methods that answer components: 30, 31 and 32."""

from itertools import pairwise

import cv2
import numpy as np
from matplotlib.figure import Figure

from ..datasets import Dataset
from ..types import Image
from ._outcome import Outcome
from ._style import COLOURS, grams_axis, legend_above, make_figure

__all__ = ["figure_31", "figure_32", "sample_sheet"]

_LEGIBLE = 300
"""More samples than these cannot be told apart in a line over the sample number."""
_SAMPLES, _COLUMNS = 12, 4
_TILE_PX = 300


def figure_31(outcome: Outcome) -> Figure:
    """Distribution of measured and estimated force by direction (thesis fig. 31): rx, px; ry, py."""
    axes_of = _components(outcome)
    use = outcome.answered

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(axes_of), squeeze=False)[0]
        for axes, name in zip(panels, axes_of, strict=True):
            reference, estimate, _ = outcome.column(name)
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
                flier.set_rasterized(len(outcome) > 1500)
            axes.set_title(f"$F_{name}$")
            axes.tick_params(axis="x", length=0)
            axes.grid(visible=False, axis="x")
        panels[0].set_ylabel("force, N")
        grams_axis(panels[-1])

    title = f"{outcome.method}: distribution of the force (thesis fig. 31)"
    return make_figure(draw, title, 6.8, 4.1)


def figure_32(outcome: Outcome) -> Figure:
    """Measured and estimated force over the test samples, a panel for each direction (thesis fig. 32)."""
    part = outcome.where(np.arange(min(len(outcome), _LEGIBLE)))
    axes_of = _components(outcome)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(axes_of), 1, sharex=True, squeeze=False)[:, 0]
        number = np.arange(1, len(part) + 1)
        for axes, name in zip(panels, axes_of, strict=True):
            reference, estimate, _ = part.column(name)
            axes.plot(number, reference, color=COLOURS["reference"], linewidth=1.1, label="measured")
            axes.plot(number, estimate, color=COLOURS["line"], linewidth=1.1, alpha=0.9, label="estimated")
            axes.set_ylabel(f"$F_{name}$, N")
            grams_axis(axes)
        legend_above(panels[0])
        cut = f" (the first {len(part)} of {len(outcome)})" if len(part) < len(outcome) else ""
        panels[-1].set_xlabel(f"test sample{cut}")
        panels[-1].set_xlim(0, len(part) + 1)

    title = f"{outcome.method}: estimates of the test samples (thesis fig. 32)"
    return make_figure(draw, title, 6.8, 1.1 + 1.75 * len(axes_of))


def sample_sheet(dataset: Dataset, outcome: Outcome, view: str) -> Image | None:
    """Twelve pictures spread over the test samples (thesis fig. 30), as they come; None where ``view`` has none.

    A view of another name is taken where a sample has only that one.
    """
    chosen = outcome.index[np.unique(np.linspace(0, len(outcome) - 1, min(_SAMPLES, len(outcome))).round().astype(int))]
    tiles: list[Image] = []
    for observation in dataset.subset(chosen).observations():
        image = observation.views.get(view, next(iter(observation.views.values()), None))
        if isinstance(image, np.ndarray):
            tiles.append(_tile(image))
    if not tiles:
        return None
    height = max(tile.shape[0] for tile in tiles)
    rows = -(-len(tiles) // _COLUMNS)
    columns = min(_COLUMNS, len(tiles))
    edges = [place * (height + 4) for place in range(rows + 1)]
    sheet = np.full((edges[-1] - 4, columns * (_TILE_PX + 4) - 4, 3), 255, np.uint8)
    for row, (top, _) in enumerate(pairwise(edges)):
        for column, tile in enumerate(tiles[row * _COLUMNS : (row + 1) * _COLUMNS]):
            left = column * (_TILE_PX + 4)
            sheet[top : top + tile.shape[0], left : left + _TILE_PX] = tile
    return sheet


def _tile(image: Image) -> Image:
    """``image`` in colour and `_TILE_PX` wide."""
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image
    high = max(1, round(colour.shape[0] * _TILE_PX / colour.shape[1]))
    way = cv2.INTER_AREA if colour.shape[1] > _TILE_PX else cv2.INTER_NEAREST
    return cv2.resize(colour, (_TILE_PX, high), interpolation=way)  # type: ignore[return-value]


def _components(outcome: Outcome) -> tuple[str, ...]:
    return tuple(name for name in outcome.quantities if name != "magnitude")
