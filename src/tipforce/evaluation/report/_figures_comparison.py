"""Figure of the comparison of methods: error and bias over the load, beside sensors in the tip."""

from collections.abc import Mapping
from itertools import cycle
from typing import Any

from matplotlib.figure import Figure

from .._constant import Constant
from ._style import GREY, INK, METHOD_COLOURS, WIDE_IN, grams_axis, make_figure

_MARKERS = "os^DvPX*"


def figure_comparison(compared: Mapping[str, Any]) -> Figure:
    """Plots the result of `comparison` over the force: mean absolute error (left) and bias (right), a line a method."""

    def draw(figure: Figure) -> None:
        """Draws errors (left) and biases (right); a method beyond the sixth repeats a colour with another line."""
        left, right = figure.subplots(1, 2)
        styles = zip(cycle(METHOD_COLOURS), cycle(_MARKERS), strict=False)
        for number, (row, (colour, marker)) in enumerate(zip(compared["rows"], styles, strict=False)):
            constant, again = row["method"] == Constant.name, number >= len(METHOD_COLOURS)
            for axes, key in ((left, "mae_n"), (right, "bias_n")):
                axes.plot(
                    [part["mean_n"] for part in row["by_load"]], [part[key] for part in row["by_load"]], markersize=5,
                    color=GREY if constant else colour, linestyle="--" if constant else "-." if again else "-",
                    marker=None if constant else marker, label="constant predictor" if constant else row["method"],
                )  # fmt: skip
        sensors = sorted(compared["sensors"].items(), key=lambda pair: pair[1])
        for (name, error), dashes in zip(sensors, ((1, 2), (3, 2), (5, 2), (8, 2)), strict=False):
            left.axhline(error, color=INK, linewidth=1.0, linestyle=(0, dashes), label=f"{name}, sensor in the tip")
        right.axhline(0.0, color=INK, linewidth=0.8)
        for axes, text in ((left, "mean absolute error, N"), (right, "bias, N")):
            axes.set_xlabel("measured force, N")
            axes.set_ylabel(text)
            grams_axis(axes)
        left.set_ylim(bottom=0.0)
        figure.legend(*left.get_legend_handles_labels(), loc="outside right center")

    return make_figure(draw, "Error over the load", WIDE_IN, 5.0)
