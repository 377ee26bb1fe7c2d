"""Further figures: errors over their Cramer-Rao bound, errors under perturbations, the training of a network."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter, StrMethodFormatter

from ..._system.json_files import parse_json_lines
from ...errors import FileFormatError, ModelError
from ...estimators import Estimator
from .._constant import Constant
from .._ground_truth import BOUND_KINDS
from ._style import COLOURS, GREY, METHOD_COLOURS, grams_axis, legend_above, make_figure

_TRAINING_LOG = "training.jsonl"
"""The file of a fitted method that holds a JSON object an epoch."""
_LOG_FIELDS = ("epoch", "training_error_n", "validation_error_n")
_SHOWN = {"one_frame": ("o", "-"), "all_frames": ("s", (0, (4, 2)))}
_BINS = {
    "by_contact_angle": ("deg", 1.0, "angle between tip and wall's normal, deg"),
    "by_force": ("n", 1e3, "true force, mN"),
}
_MIN_SAMPLES = 10
"""Samples in a bin without which its ratio is not drawn."""


def figure_bound(ratios: Mapping[str, Mapping[str, Any]], quantities: Sequence[str]) -> Figure:
    """Plots errors over their Cramer-Rao bound, by contact angle and by force.

    Args:
        ratios: Method -> kind of bound -> `bound_ratios`.
        quantities: Magnitude and components; each has a row of panels.
    """

    def draw(figure: Figure) -> None:
        """Draws a row of panels for each quantity, with a line for each method and kind of bound."""
        panels = figure.subplots(len(quantities), len(_BINS), sharey="row", sharex="col", squeeze=False)
        for row, quantity in enumerate(quantities):
            for column, (key, (unit, factor, what)) in enumerate(_BINS.items()):
                axes = panels[row, column]
                for number, (method, kinds) in enumerate(ratios.items()):
                    colour = GREY if method == Constant.name else METHOD_COLOURS[number % len(METHOD_COLOURS)]
                    for kind, (marker, dashes) in _SHOWN.items():
                        label = f"{method}, {BOUND_KINDS[kind]}" if row == column == 0 else None
                        _plot_ratios(axes, kinds[kind][quantity][key], unit, factor, colour, marker, dashes, label)
                axes.axhline(1.0, color=COLOURS["line"], linewidth=1.1)
                axes.set_yscale("log")
                axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
                axes.minorticks_off()
                axes.set_yticks([t for t in _TICKS if axes.get_ylim()[0] <= t <= axes.get_ylim()[1]])
                if row == len(quantities) - 1:
                    axes.set_xlabel(what)
            name = "magnitude" if quantity == "magnitude" else f"F{quantity}"
            panels[row, 0].set_ylabel(f"error / bound, {name}")
        figure.legend(loc="outside lower left", ncols=2)

    return make_figure(
        draw, "Error over the Cramer-Rao bound (1: an efficient estimator)", 6.8, 2.1 + 2.2 * len(quantities)
    )


_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200)


def _plot_ratios(
    axes: Axes,
    bins: Sequence[Mapping[str, float]],
    unit: str,
    factor: float,
    colour: str,
    marker: str,
    dashes: Any,
    label: str | None,
) -> None:
    """Plots the ratio of each bin with enough samples at the bin's middle, which is ``factor`` times its ``unit``."""
    use = [each for each in bins if each["n"] >= _MIN_SAMPLES and math.isfinite(each["ratio"])]
    middle = [factor * 0.5 * (each[f"from_{unit}"] + each[f"below_{unit}"]) for each in use]
    ratios = [each["ratio"] for each in use]
    axes.plot(middle, ratios, marker=marker, linestyle=dashes, color=colour, markersize=4, linewidth=1.3, label=label)


MAX_SHOWN_RATIO = 2.5
"""Errors above this multiple of the constant's are written as numbers at the edge of the scale."""

_Lines = Sequence[Mapping[str, Any]]


def figure_perturbed(lines: Mapping[str, _Lines]) -> Figure:
    """Plots error and share abstained over the size of each perturbation; a column for each kind.

    Kinds that differ in the force alone, whose magnitude is the same, are shown once. ``lines``: method -> lines of a
    table, the first of them unperturbed (see `perturbed_metrics`).
    """
    first_lines = next(iter(lines.values()))
    kinds = [kind for kind in dict.fromkeys(line["kind"] for line in first_lines[1:]) if "," not in kind]
    sizes = {kind: [line["size"] for line in first_lines if line["kind"] == kind] for kind in kinds}
    errors = [float(line["mae_n"]) for each in lines.values() for line in each]
    constant_mae = float(first_lines[0]["constant"]["mae_n"])
    top = 1.08 * min(max([constant_mae, *filter(np.isfinite, errors)]), MAX_SHOWN_RATIO * constant_mae)

    def draw(figure: Figure) -> None:
        """Draws errors above and shares abstained below; the first point of each panel is the unperturbed case."""
        widths = [len(sizes[kind]) + 1 for kind in kinds]
        panels = figure.subplots(2, len(kinds), sharey="row", sharex="col", width_ratios=widths, height_ratios=(2.2, 1))
        for column, kind in enumerate(kinds):
            above, below = panels[:, column]
            above.axhline(constant_mae, color=GREY, linestyle=(0, (4, 3)), linewidth=1.4, label="constant predictor")
            for number, (method, each) in enumerate(lines.items()):
                shown = [each[0], *(line for line in each if line["kind"] == kind)]
                colour = METHOD_COLOURS[number % len(METHOD_COLOURS)]
                style = "o" if "×" in shown[-1]["size"] else "o-"  # factors lead away from 1 to both sides
                for axes, key in ((above, "mae_n"), (below, "abstained_share")):
                    values = [line[key] for line in shown]
                    axes.plot(values, style, color=colour, markersize=4.5, linewidth=1.5, label=method)
                edge = (0.96 - 0.08 * number) * top  # the methods' triangles below one another
                for size, error in enumerate(line["mae_n"] for line in shown):
                    if error > top:
                        above.plot(size, edge, "^", color=colour, markersize=7)
                        above.annotate(
                            f"{1e3 * error:.0f} mN", (size, edge), xytext=(-6, 0), textcoords="offset points",
                            ha="right", va="center", color=colour,
                        )  # fmt: skip
            below.set_xticks(range(len(sizes[kind]) + 1), ["none", *map(_short, sizes[kind])], rotation=60, ha="right")
            below.set_xlim(-0.4, len(sizes[kind]) + 0.4)
            below.tick_params(axis="x", length=0)
            above.tick_params(axis="x", length=0)
            above.set_title(kind)
            for axes in (above, below):
                axes.grid(visible=False, axis="x")
        panels[0, 0].set_ylim(0, top)
        panels[0, 0].set_ylabel("MAE of the magnitude, N")
        panels[1, 0].set_ylim(-0.04, 1.04)
        panels[1, 0].yaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
        panels[1, 0].set_ylabel("abstained")
        grams_axis(panels[0, -1])
        handles, names = panels[0, 0].get_legend_handles_labels()
        figure.legend([*handles[1:], handles[0]], [*names[1:], names[0]], loc="outside lower left", ncols=4)

    return make_figure(draw, "Error and share abstained under perturbations", 14.2, 6.2)


def _short(size: str) -> str:
    return "slope" if " to " in size else size.replace(" levels", "")


def training_log(estimator: Estimator) -> list[dict[str, Any]]:
    """Returns the epochs of a fitted method's training; empty if it keeps no log. Raises ModelError for a bad log."""
    text = estimator.files().get(_TRAINING_LOG, b"").decode("utf-8", errors="replace")
    try:
        rows = parse_json_lines(text, _TRAINING_LOG)
        for row in rows:  # null: an epoch whose network answered without bounds
            row |= {name: math.nan if row[name] is None else float(row[name]) for name in _LOG_FIELDS}
            row["epoch"] = int(row["epoch"])
    except (FileFormatError, ValueError, KeyError, TypeError) as error:
        raise ModelError(
            f"{estimator.name}: its {_TRAINING_LOG} cannot be read ({error}); train the model again"
        ) from None
    return rows


def kept_epoch(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Returns the epoch with the smallest error on the validation part, the first of equals."""
    return min(
        rows, key=lambda row: row["validation_error_n"] if math.isfinite(row["validation_error_n"]) else math.inf
    )


def figure_training(rows: list[dict[str, Any]], label: str) -> Figure:
    """Plots the errors of the training and the validation part over the epochs, and marks the epoch that was kept.

    Args:
        rows: Rows of the training log, errors in newtons.
        label: Label of the method, for the title.
    """
    epoch = np.array([row["epoch"] for row in rows])
    best = kept_epoch(rows)

    def draw(figure: Figure) -> None:
        """Draws both errors in mN over the epochs, on scales that suit 10 and 1000 epochs."""
        axes = figure.subplots()
        for key, name, colour, width in (
            ("training_error_n", "training part", GREY, 1.2),
            ("validation_error_n", "validation part", COLOURS["estimate"], 1.6),
        ):
            errors_mn = 1e3 * np.array([row[key] for row in rows], dtype=np.float64)
            axes.plot(epoch, errors_mn, ".-" if len(rows) < 40 else "-", color=colour, linewidth=width, label=name)
        kept = f"kept: epoch {best['epoch']}, {1e3 * best['validation_error_n']:.3g} mN"
        axes.plot(best["epoch"], 1e3 * best["validation_error_n"], "D", color=COLOURS["line"], markersize=6, label=kept)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        # of the minor ticks only 2 and 5 have labels
        axes.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
        if len(rows) > 300:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("epoch")
        axes.set_ylabel("error, mN (log scale)")
        legend_above(axes, 3)

    return make_figure(draw, f"{label}: error during training")
