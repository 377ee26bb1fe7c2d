"""How a network's error fell while it was trained, from the log that it carries."""

import json
import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..errors import ModelError
from ..estimators import Estimator
from ._style import COLOURS, GREY, legend_above, make_figure

__all__ = ["LOG", "figure_training", "kept_epoch", "training_log"]

LOG = "training.jsonl"
"""The file of a fitted method that holds a JSON object an epoch."""

_NEEDED = ("epoch", "training_error_n", "validation_error_n")


def training_log(estimator: Estimator) -> list[dict[str, Any]]:
    """The epochs of a fitted method's training, in order; empty for one that keeps no log.

    Raises ModelError for a log that cannot be read.
    """
    lines = estimator.files().get(LOG, b"").decode("utf-8", errors="replace").splitlines()
    try:
        rows = [json.loads(line) for line in lines]
        for row in rows:  # null: an epoch whose network answered without bounds
            row |= {name: math.nan if row[name] is None else float(row[name]) for name in _NEEDED}
            row["epoch"] = int(row["epoch"])
    except (ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{estimator.name}: its {LOG} cannot be read ({error}); train the model again") from None
    return rows


def kept_epoch(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The row of the epoch with the smallest error on the validation part, the first of equals."""
    return min(
        rows, key=lambda row: row["validation_error_n"] if math.isfinite(row["validation_error_n"]) else math.inf
    )


def figure_training(rows: list[dict[str, Any]], label: str) -> Figure:
    """Errors of the training and the validation part over the epochs, with the epoch that was kept."""
    epoch = np.array([row["epoch"] for row in rows])
    best = kept_epoch(rows)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for key, name, colour, width in (
            ("training_error_n", "training part", GREY, 1.2),
            ("validation_error_n", "validation part", COLOURS["estimate"], 1.6),
        ):
            errors_mn = 1e3 * np.array([row[key] for row in rows], dtype=np.float64)
            axes.plot(epoch, errors_mn, ".-" if len(rows) < 40 else "-", color=colour, linewidth=width, label=name)
        told = f"kept: epoch {best['epoch']}, {1e3 * best['validation_error_n']:.3g} mN"
        axes.plot(best["epoch"], 1e3 * best["validation_error_n"], "D", color=COLOURS["line"], markersize=6, label=told)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if _first_digit(value) in "25" else "")
        if len(rows) > 300:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("epoch")
        axes.set_ylabel("error, mN (log scale)")
        legend_above(axes, 3)

    return make_figure(draw, f"{label}: error while it was trained")


def _first_digit(value: float) -> str:
    return f"{value:e}"[0]
