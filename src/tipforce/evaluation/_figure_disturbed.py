"""What the methods bear: error and refusals over the size of each disturbance."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from ._style import GREY, METHOD_COLOURS, grams_axis, make_figure

__all__ = ["figure_disturbed"]

_TOP = 2.5
"""Errors above so many times the constant's are told as numbers: how wrong such a method is matters no more."""

_Lines = Sequence[Mapping[str, Any]]


def figure_disturbed(lines: Mapping[str, _Lines]) -> Figure:
    """``lines``: method -> a table's lines, the first of them undisturbed (see `bear`); a column for each kind.

    Kinds that differ in the force alone, whose magnitude is the same, are shown once.
    """
    some = next(iter(lines.values()))
    kinds = [kind for kind in dict.fromkeys(line["kind"] for line in some[1:]) if "," not in kind]
    sizes = {kind: [line["size"] for line in some if line["kind"] == kind] for kind in kinds}
    errors = [float(line["mae_n"]) for each in lines.values() for line in each]
    mean = float(some[0]["constant"]["mae_n"])
    top = 1.08 * min(max([mean, *filter(np.isfinite, errors)]), _TOP * mean)

    def draw(figure: Figure) -> None:
        widths = [len(sizes[kind]) + 1 for kind in kinds]
        panels = figure.subplots(2, len(kinds), sharey="row", sharex="col", width_ratios=widths, height_ratios=(2.2, 1))
        for column, kind in enumerate(kinds):
            above, below = panels[:, column]
            above.axhline(mean, color=GREY, linestyle=(0, (4, 3)), linewidth=1.4, label="constant predictor")
            for place, (method, each) in enumerate(lines.items()):
                shown = [each[0], *(line for line in each if line["kind"] == kind)]
                colour = METHOD_COLOURS[place % len(METHOD_COLOURS)]
                style = "o" if "×" in shown[-1]["size"] else "o-"  # factors lead away from 1 to both sides
                for axes, key in ((above, "mae_n"), (below, "refused_share")):
                    values = [line[key] for line in shown]
                    axes.plot(values, style, color=colour, markersize=4.5, linewidth=1.5, label=method)
                edge = (0.96 - 0.08 * place) * top
                for size, error in enumerate(line["mae_n"] for line in shown):
                    if error > top:
                        above.plot(size, edge, "^", color=colour, markersize=7)
                        above.annotate(
                            f"{1e3 * error:.0f} mN", (size, edge), xytext=(-6, 0), textcoords="offset points",
                            ha="right", va="center", fontsize=9, color=colour,
                        )  # fmt: skip
            below.set_xticks(range(len(sizes[kind]) + 1), ["none", *map(_short, sizes[kind])], rotation=60, ha="right")
            below.set_xlim(-0.4, len(sizes[kind]) + 0.4)
            below.tick_params(axis="x", length=0, labelsize=9)
            above.tick_params(axis="x", length=0)
            above.set_title(kind)
            for axes in (above, below):
                axes.grid(visible=False, axis="x")
        panels[0, 0].set_ylim(0, top)
        panels[0, 0].set_ylabel("MAE of the magnitude, N")
        panels[1, 0].set_ylim(-0.04, 1.04)
        panels[1, 0].yaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
        panels[1, 0].set_ylabel("refused")
        grams_axis(panels[0, -1])
        handles, names = panels[0, 0].get_legend_handles_labels()
        figure.legend([*handles[1:], handles[0]], [*names[1:], names[0]], loc="outside lower left", ncols=4)

    return make_figure(draw, "Error and refusals under disturbances", 9.2, 5.2)


def _short(size: str) -> str:
    return "slope" if " to " in size else size.replace(" levels", "")
