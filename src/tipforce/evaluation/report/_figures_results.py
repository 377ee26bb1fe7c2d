"""Figures of the results: force trace, scatter, agreement, coverage, protocols side by side, errors and sessions."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator, PercentFormatter

from ...clinical import LIMIT_N
from ...types import BoolArray, FloatArray
from .._predictions import Predictions
from .._protocols import PROTOCOL_WORDS
from .._thesis import THESIS_MAE_N
from ._style import (
    COLOURS,
    GREY,
    HEIGHT_IN,
    MANY_POINTS,
    METHOD_COLOURS,
    WIDE_IN,
    WIDTH_IN,
    draw_window,
    grams_axis,
    legend_above,
    make_figure,
    mark_line,
)

_TRACE_SAMPLES = 900
"""Samples of a session that a time trace shows."""
SCATTER_IN, SCATTER_HEIGHT_IN = 5.6, 5.3
"""Width and height of the scatter plot."""


def figure_trace(
    predictions: Predictions,
    session: str,
    truth_n: FloatArray | None = None,
    *,
    quantities: Sequence[str] | None = None,
    width_in: float = WIDTH_IN,
    height_in: float = HEIGHT_IN,
) -> Figure:
    """Plots one session in time: reference, estimate, 90 % interval and where the method abstained; a panel a quantity.

    The force window is marked in the panel of the magnitude.

    Args:
        predictions: Predictions of one method for m samples.
        session: Name of the session.
        truth_n: (m, 3) true force at ``predictions.index`` in newtons, drawn beside the sensor's.
        quantities: Panels; None: all that the predictions have.
        width_in: Width in inches.
        height_in: Height in inches.
    """
    part = predictions.where(np.flatnonzero(predictions.session == session))
    part = part.where(np.argsort(part.stamp_ns, kind="stable")[:_TRACE_SAMPLES])
    seconds = (part.stamp_ns - part.stamp_ns[0]) * 1e-9
    shown = part.quantities if quantities is None else tuple(quantities)

    def draw(figure: Figure) -> None:
        """Draws a panel for each quantity; grey stretches are those in which the method abstained."""
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        gaps = _stretches(seconds, ~part.valid)
        for axes, name in zip(panels, shown, strict=True):
            reference, estimate, interval = part.column(name)
            interval = _bounded(interval)
            axes.plot(seconds, reference, color=COLOURS["reference"], linewidth=1.3, label="measured")
            if truth_n is not None:
                axes.plot(seconds, _truth_of(part, truth_n, name), color=COLOURS["second"], linewidth=1.0, label="true")
            axes.plot(seconds, estimate, color=COLOURS["estimate"], linewidth=1.4, label="estimated")
            axes.fill_between(
                seconds, interval[:, 0], interval[:, 1], color=COLOURS["band"], alpha=0.35, linewidth=0,
                label="90 % interval",
            )  # fmt: skip
            for number, (start, end) in enumerate(gaps):
                label = "abstained" if number == 0 else None
                axes.axvspan(start, end, color=GREY, alpha=0.35, linewidth=0, label=label)
            if name == "magnitude":
                low, high = axes.get_ylim()
                axes.set_ylim(min(0.0, low), max(high, 1.1 * LIMIT_N))
                draw_window(axes)
            axes.set_ylabel("force, N" if name == "magnitude" else f"F{name}, N")
            grams_axis(axes)
        legend_above(panels[0], 4 if width_in < 8 else 7)
        panels[-1].set_xlabel("time, s")
        panels[-1].set_xlim(seconds[0], max(seconds[-1], 1e-3))

    title = f"{predictions.method}: {_short(session, 40)} in time, {PROTOCOL_WORDS[predictions.protocol].of}"
    return make_figure(draw, title, width_in, height_in)


def _truth_of(part: Predictions, truth_n: FloatArray, quantity: str) -> FloatArray:
    """Returns the (n,) true component or magnitude; the magnitude is over the axes that the sensor measures."""
    true = truth_n[part.index]
    if quantity != "magnitude":
        return true[:, "xyz".index(quantity)]
    known = np.isfinite(part.reference_n).any(axis=0)
    return np.sqrt(np.sum(true[:, known] ** 2, axis=1))


def figure_scatter(predictions: Predictions) -> Figure:
    """Plots estimated over measured magnitude of all test samples, with the identity line and the force window."""
    reference, estimate, _ = predictions.column("magnitude")
    largest = max(float(np.nanmax(estimate, initial=0.0)), float(np.max(reference, initial=0.0)))
    top = max(1.04 * largest, 1.1 * LIMIT_N)

    def draw(figure: Figure) -> None:
        """Draws the points on equal axes from 0 to ``top`` newtons."""
        axes = figure.subplots()
        _plot_points(axes, reference, estimate)
        axes.plot([0, top], [0, top], color=COLOURS["reference"], linewidth=1.2, label="estimated = measured")
        axes.set_xlim(0, top)
        axes.set_ylim(0, top)
        draw_window(axes, label=False)
        draw_window(axes, vertical=True, label=False)
        axes.set_aspect("equal")
        axes.xaxis.set_major_locator(MultipleLocator(_step(top)))
        axes.yaxis.set_major_locator(MultipleLocator(_step(top)))
        axes.set_xlabel("measured force, N")
        axes.set_ylabel("estimated force, N")
        grams_axis(axes)
        legend_above(axes)

    return make_figure(draw, f"{predictions.method}: all {len(predictions)} samples", SCATTER_IN, SCATTER_HEIGHT_IN)


def _plot_points(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    """Plots points that are the fainter the more there are, so that dense regions stay visible."""
    axes.plot(
        x, y, "o", color=COLOURS["estimate"], markersize=3, mew=0,
        alpha=float(np.clip(300 / max(len(x), 1), 0.12, 0.6)), rasterized=len(x) > MANY_POINTS,
    )  # fmt: skip


def _step(top: float) -> float:
    """Returns a distance of ticks that shows both limits of the force window where the forces are small."""
    return next((step for step in (0.1, 0.2, 0.5, 1.0, 2.0) if top / step <= 8), 5.0)


def figure_bland_altman(predictions: Predictions, agreement: Mapping[str, Any]) -> Figure:
    """Plots the difference (estimated - measured) over the mean of both, with bias and 95 % limits of agreement.

    Args:
        predictions: Predictions of one method.
        agreement: Result of `bland_altman` for their magnitude.
    """
    reference, estimate, _ = predictions.column("magnitude")
    use = predictions.valid
    mean, difference = 0.5 * (reference + estimate)[use], (estimate - reference)[use]

    def draw(figure: Figure) -> None:
        """Draws the points, the bias and the limits of agreement, in N; the legend states them in mN."""
        axes = figure.subplots()
        axes.axhline(0, color=COLOURS["reference"], linewidth=0.8)
        _plot_points(axes, mean, difference)
        bias, low, high = (float(agreement[name]) for name in ("bias_n", "lower_n", "upper_n"))
        axes.axhline(bias, color=COLOURS["line"], linewidth=1.6, label=f"bias {_signed(bias)} mN")
        limits = f"95 % limits of agreement {_signed(low)} to {_signed(high)} mN"
        for value, label in ((low, limits), (high, None)):
            if math.isfinite(value):
                axes.axhline(value, color=COLOURS["line"], linestyle=(0, (4, 3)), linewidth=1.3, label=label)
        axes.set_xlabel("mean of estimated and measured force, N")
        axes.set_ylabel("estimated - measured, N")
        grams_axis(axes)
        legend_above(axes, 2)

    return make_figure(draw, f"{predictions.method}: Bland-Altman")


_MIN_INTERVALS = 10
"""Coverage of fewer samples is not drawn."""


def figure_coverage(
    strata: Mapping[str, Sequence[Mapping[str, Any]]],
    unit: str,
    axis_label: str,
    title: str,
    *,
    width_in: float = WIDTH_IN,
) -> Figure:
    """Plots the coverage of the 90 % intervals by stratum, with 95 % confidence intervals; below, the samples of each.

    Args:
        strata: Method -> result of `coverage_by_stratum`.
        unit: Unit of the strata, ``n`` or ``deg``.
        axis_label: Label of the axis of the strata.
        title: Title of the figure.
        width_in: Width in inches.
    """
    # limits of all strata, a position on the horizontal axis each
    names = sorted({(each[f"from_{unit}"], each[f"below_{unit}"]) for parts in strata.values() for each in parts})

    def draw(figure: Figure) -> None:
        """Draws the coverage above, a colour for each method, and the number of samples of each stratum below."""
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
        lowest = 0.8
        for number, (method, parts) in enumerate(strata.items()):
            colour = METHOD_COLOURS[number % len(METHOD_COLOURS)]
            x = np.array([names.index((each[f"from_{unit}"], each[f"below_{unit}"])) for each in parts], np.float64)
            x += (number - (len(strata) - 1) / 2) * 0.18  # the methods side by side
            enough = np.array([each["intervals"] >= _MIN_INTERVALS for each in parts])
            coverage = np.where(enough, [each["coverage"] for each in parts], np.nan)
            ends = np.array([each["coverage_ci95"] for each in parts], np.float64).reshape(-1, 2)
            above.vlines(x, ends[:, 0], ends[:, 1], color=colour, linewidth=2, alpha=0.5)
            above.plot(x, coverage, "o", color=colour, markersize=6, label=method)
            shown = np.array([*coverage, *ends[:, 0]])
            lowest = min([lowest, *shown[np.isfinite(shown)].tolist()])
        for position, each in enumerate(names):
            first = next(iter(strata.values()))
            count = next((s["samples"] for s in first if (s[f"from_{unit}"], s[f"below_{unit}"]) == each), 0)
            below.bar(position, count, 0.6, color=GREY, alpha=0.8)
            below.annotate(str(count), (position, count), xytext=(0, 2), textcoords="offset points", ha="center")
        mark_line(above, 0.9, "nominal 90 %")
        above.set_ylim(max(0.0, lowest - 0.06), 1.02)
        above.yaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
        above.set_ylabel("inside the interval")
        below.set_ylabel("samples")
        below.margins(y=0.25)
        below.set_xticks(range(len(names)), [_stratum(*each) for each in names])
        below.set_xlabel(axis_label)
        for axes in (above, below):
            axes.grid(visible=False, axis="x")
            axes.tick_params(axis="x", length=0)
        legend_above(above)

    return make_figure(draw, title, width_in)


def figure_retention(curves: Mapping[str, Mapping[str, Any]], constant: str, title: str) -> Figure:
    """Plots the mean error of the kept estimates over the share of the samples left out, the least certain ones first.

    Args:
        curves: Method -> result of `retention`.
        constant: Name among them of the constant predictor, which is drawn in grey.
        title: Title of the figure.
    """

    def draw(figure: Figure) -> None:
        """Draws a line for each method; a dot marks the share that it abstained from by itself."""
        axes = figure.subplots()
        for number, (method, curve) in enumerate(curves.items()):
            is_constant = method == constant
            colour = GREY if is_constant else METHOD_COLOURS[number % len(METHOD_COLOURS)]
            name = "constant predictor" if is_constant else method
            axes.plot(
                curve["abstained_share"], curve["mae_n"], color=colour,
                linestyle=(0, (4, 3)) if is_constant else "-" if number < len(METHOD_COLOURS) else "-.",
                label=f"{name}: area {1e3 * curve['area_n']:.0f} mN",
            )  # fmt: skip
            if curve["mae_n"]:
                axes.plot(curve["abstained_share"][0], curve["mae_n"][0], "o", color=colour, markersize=6)
        axes.set_xlim(-0.01, 1.0)
        axes.set_ylim(bottom=0.0)
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
        axes.set_xlabel("share of the samples abstained from, the least certain first")
        axes.set_ylabel("mean error of the rest, N")
        grams_axis(axes)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper")

    return make_figure(draw, title, WIDE_IN)


def _stratum(low: float, high: float) -> str:
    return f"{low:g}-{high:g}" if math.isfinite(high) else f"> {low:g}"


def _signed(newtons: float) -> str:
    text = f"{1e3 * newtons:+.{0 if abs(newtons) >= 0.01 else 1}f}"
    return text.replace("-", "\u2212")


def figure_splits(maes: dict[str, dict[str, FloatArray]], protocols: Sequence[str]) -> Figure:
    """Plots bars of the MAE by protocol, with a dot for each session.

    Args:
        maes: Method -> protocol -> (1 + sessions,) in newtons: over all samples, then session by session. The constant
            predictor (named ``constant``) is drawn in grey.
        protocols: Names of the protocols in the order of the bars.
    """
    methods = list(maes)
    top = max(float(np.nanmax(values, initial=0.0)) for groups in maes.values() for values in groups.values())

    def draw(figure: Figure) -> None:
        """Draws the bars of a protocol side by side; the bars of one protocol are 0.8 wide together."""
        axes = figure.subplots()
        width = 0.8 / len(methods)
        numbered = len(methods) * len(protocols) <= _NUMBERED
        for number, method in enumerate(methods):
            colour = GREY if method == "constant" else METHOD_COLOURS[number % len(METHOD_COLOURS)]
            offset = (number - (len(methods) - 1) / 2) * width
            for group, protocol in enumerate(protocols):
                values = maes[method].get(protocol)
                if values is None or not math.isfinite(values[0]):
                    continue
                x = group + offset
                label = method if protocol == next(p for p in protocols if p in maes[method]) else None
                axes.bar(x, values[0], 0.92 * width, color=colour, label=label)
                sessions = values[1:][np.isfinite(values[1:])]
                edge = 0.28 * width if len(sessions) > 1 else 0.0
                dots_x = x + np.linspace(-edge, edge, len(sessions))
                axes.plot(dots_x, sessions, "o", color=COLOURS["reference"], markersize=2.6, alpha=0.55, mew=0)
                tall = values[0] > 0.07 * top
                if not numbered:
                    continue
                text = f"{values[0] * 1e3:.{0 if values[0] >= 0.01 else 1}f}"
                axes.annotate(
                    text, (x, 0 if tall else values[0]), xytext=(0, 4), textcoords="offset points",
                    ha="center", fontweight="bold",
                    color=COLOURS["reference"] if not tall else "#000000" if colour in _LIGHT else "#ffffff",
                )  # fmt: skip
        mark_line(axes, THESIS_MAE_N, "the thesis, its own bench: 42 mN")
        axes.set_xticks(range(len(protocols)), [PROTOCOL_WORDS[name].bar for name in protocols])
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
        axes.set_ylabel("MAE, N (in the bars: mN)")
        grams_axis(axes)
        legend_above(axes)

    split = f"the same methods, split {len(protocols)} ways" if len(protocols) > 1 else "bars over all, dots by session"
    return make_figure(draw, f"Mean absolute error: {split}")


_NUMBERED = 9
"""More bars than these leave no room for numbers of a legible size."""
_LIGHT = {"#e69f00", "#56b4e9", "#cc79a7"}
"""Bars that need dark numbers."""


def figure_residuals(predictions: Predictions) -> Figure:
    """Plots the error over the measured magnitude, with the median error and the median 90 % interval as a band."""
    reference, estimate, interval = predictions.column("magnitude")
    use = predictions.valid
    reference, estimate, interval = reference[use], estimate[use], _bounded(interval[use])
    residual = estimate - reference

    def draw(figure: Figure) -> None:
        """Draws the errors, and over bins of the force the median error and the median interval."""
        axes = figure.subplots()
        axes.axhline(0, color=COLOURS["reference"], linewidth=0.8)
        axes.plot(
            reference, residual, "o", color=COLOURS["estimate"], markersize=3, alpha=0.45, mew=0,
            rasterized=len(residual) > MANY_POINTS, label="held-out samples",
        )  # fmt: skip
        # bins of equal count: at most 12, of 15 samples or more
        edge_count = min(13, max(2, len(reference) // 15 + 1))
        edges = np.unique(np.quantile(reference, np.linspace(0, 1, edge_count)) if use.any() else [])
        if len(edges) > 1:
            bin_of = np.clip(np.searchsorted(edges, reference, side="right") - 1, 0, len(edges) - 2)
            groups = [bin_of == number for number in range(len(edges) - 1)]
            groups = [group for group in groups if group.any()]
            middle = [float(np.median(reference[group])) for group in groups]
            # The reference is inside its interval exactly where the residual is in (estimate - interval).
            low = [float(np.median((estimate - interval[:, 1])[group])) for group in groups]
            high = [float(np.median((estimate - interval[:, 0])[group])) for group in groups]
            median = [float(np.median(residual[group])) for group in groups]
            axes.fill_between(middle, low, high, color=COLOURS["band"], alpha=0.28, linewidth=0, label="90 % interval")
            axes.plot(middle, median, color=COLOURS["line"], linewidth=1.5, label="median error")
        axes.set_xlabel("measured force, N")
        axes.set_ylabel("estimated - measured, N")
        grams_axis(axes)
        legend_above(axes)

    return make_figure(
        draw, f"{predictions.method}: error over force, samples of {PROTOCOL_WORDS[predictions.protocol].of}"
    )


def typical_session(predictions: Predictions) -> str:
    """Returns the session with the median error: neither the best nor the worst one."""
    names = list(dict.fromkeys(predictions.session.tolist()))
    error = np.abs(predictions.magnitude_n - predictions.reference_magnitude_n)
    error_of = {name: error[predictions.session == name] for name in names}
    errors = {name: float(np.nanmean(values)) for name, values in error_of.items() if np.isfinite(values).any()}
    ranked = sorted(errors, key=lambda name: errors[name])
    return ranked[len(ranked) // 2] if ranked else names[0]


_SESSIONS_NARROW = 9
"""More sessions than these go across the page."""


def figure_sessions(
    title: str, names: Sequence[str], mae_n: FloatArray, constant_n: FloatArray, coverage: FloatArray, colour: str
) -> Figure:
    """Plots error and coverage session by session.

    Args:
        title: Title of the figure.
        names: Names of the sessions.
        mae_n: (sessions,) MAE of the method in newtons.
        constant_n: (sessions,) MAE of the constant predictor in newtons.
        coverage: (sessions,) share of the forces inside the 90 % interval.
        colour: Colour of the method, "#rrggbb".
    """

    def draw(figure: Figure) -> None:
        """Draws a row for each session: errors of method and constant predictor (left), coverage (right)."""
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.6, 1))
        rows = np.arange(len(names))
        left.barh(rows - 0.19, mae_n, 0.38, color=colour, label="method")
        left.barh(rows + 0.19, constant_n, 0.38, color=GREY, label="constant")
        left.set_yticks(rows, [_short(name) for name in names])
        left.set_ylim(len(names) - 0.4, -0.6)
        left.grid(visible=False, axis="y")
        left.set_xlabel("MAE, N")
        legend_above(left, 2)
        right.hlines(rows, np.minimum(coverage, 0.9), np.maximum(coverage, 0.9), color=colour, alpha=0.5)
        right.plot(coverage, rows, "o", color=colour, markersize=5)
        mark_line(right, 0.9, "nominal", vertical=True)
        right.set_xlim(min(0.5, float(np.nanmin(coverage, initial=0.9)) - 0.05), 1.02)
        right.xaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
        right.set_xlabel("inside the 90 % interval")
        right.tick_params(axis="y", length=0)
        right.grid(visible=False, axis="y")
        legend_above(right, 1)

    if len(names) <= _SESSIONS_NARROW:
        return make_figure(draw, title)
    return make_figure(draw, title, WIDE_IN, 1.8 + 0.3 * len(names))


def _stretches(seconds: FloatArray, chosen: BoolArray) -> list[tuple[float, float]]:
    """Returns start and end of every run of True; a single sample still has a visible width."""
    step = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0
    edges = np.diff(np.concatenate([[0], chosen.astype(np.int64), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    runs = zip(seconds[starts].tolist(), seconds[ends].tolist(), strict=True)
    return [(start - step / 2, end + step / 2) for start, end in runs]


def _bounded(interval: FloatArray) -> FloatArray:
    """Replaces unbounded intervals by NaN, so that they are not drawn."""
    return np.where(np.isfinite(interval).all(axis=1, keepdims=True), interval, np.nan)


def _short(name: str, length: int = 22) -> str:
    return name if len(name) <= length else "…" + name[-length + 1 :]
