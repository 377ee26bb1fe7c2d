"""Errors over the smallest possible ones, by contact angle and by force."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from ._bounds import WAYS
from ._constant import Constant
from ._style import COLOURS, GREY, METHOD_COLOURS, make_figure

__all__ = ["figure_bound"]

_SHOWN = {"one_frame": ("o", "-"), "all_frames": ("s", (0, (4, 2)))}
_BINS = {
    "by_contact_angle": ("deg", 1.0, "angle between tip and wall's normal, deg"),
    "by_force": ("n", 1e3, "true force, mN"),
}
_FEWEST = 10
"""Samples in a bin without which its ratio is not drawn."""


def figure_bound(figures: Mapping[str, Mapping[str, Any]], quantities: Sequence[str]) -> Figure:
    """``figures``: method -> way -> `bound_figures`; a row of panels for each of ``quantities``."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(quantities), len(_BINS), sharey="row", sharex="col", squeeze=False)
        for row, quantity in enumerate(quantities):
            for column, (key, (unit, factor, what)) in enumerate(_BINS.items()):
                axes = panels[row, column]
                for place, (method, ways) in enumerate(figures.items()):
                    colour = GREY if method == Constant.name else METHOD_COLOURS[place % len(METHOD_COLOURS)]
                    for way, (marker, dashes) in _SHOWN.items():
                        label = f"{method}, {WAYS[way]}" if row == column == 0 else None
                        _line(axes, ways[way][quantity][key], unit, factor, colour, marker, dashes, label)
                axes.axhline(1.0, color=COLOURS["line"], linewidth=1.1)
                axes.set_yscale("log")
                axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
                axes.minorticks_off()
                axes.set_yticks([t for t in _TICKS if axes.get_ylim()[0] <= t <= axes.get_ylim()[1]])
                if row == len(quantities) - 1:
                    axes.set_xlabel(what)
            name = "magnitude" if quantity == "magnitude" else f"$F_{quantity}$"
            panels[row, 0].set_ylabel(f"error / bound, {name}")
        figure.legend(loc="outside lower left", ncols=2, fontsize=9)

    return make_figure(
        draw, "Error over the smallest possible one (1: an efficient estimator)", 6.8, 1.9 + 2.2 * len(quantities)
    )


_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200)


def _line(
    axes: Axes,
    bins: Sequence[Mapping[str, float]],
    unit: str,
    factor: float,
    colour: str,
    marker: str,
    dashes: Any,
    label: str | None,
) -> None:
    use = [each for each in bins if each["n"] >= _FEWEST and math.isfinite(each["ratio"])]
    middle = [factor * 0.5 * (each[f"from_{unit}"] + each[f"below_{unit}"]) for each in use]
    ratios = [each["ratio"] for each in use]
    axes.plot(middle, ratios, marker=marker, linestyle=dashes, color=colour, markersize=4, linewidth=1.3, label=label)
