"""Figures beyond the thesis: the splits side by side, residuals, a held-out session in time, sessions one by one."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from ..types import BoolArray, FloatArray
from ._outcome import Outcome
from ._style import COLOURS, GREY, METHOD_COLOURS, grams_axis, legend_above, make_figure, mark_line
from ._wording import WORDS

__all__ = [
    "THESIS_MAE_N",
    "figure_residuals",
    "figure_sessions",
    "figure_splits",
    "figure_trace",
    "typical_session",
]

THESIS_MAE_N = 0.042
"""Table 4 of the thesis: mean absolute error of its own test samples, forces of 0.160-0.275 N."""

_MANY = 1500
_TRACE = 900
"""Samples of a session that a time trace shows."""


def figure_splits(maes: dict[str, dict[str, FloatArray]], protocols: Sequence[str]) -> Figure:
    """Bars of the MAE by protocol: ``maes`` method -> protocol -> (1 + sessions,): the whole, then session by session.

    The constant predictor (named ``constant``) is drawn in grey.
    """
    methods = list(maes)
    top = max(float(np.nanmax(values, initial=0.0)) for groups in maes.values() for values in groups.values())

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        width = 0.8 / len(methods)
        for place, method in enumerate(methods):
            colour = GREY if method == "constant" else METHOD_COLOURS[place % len(METHOD_COLOURS)]
            offset = (place - (len(methods) - 1) / 2) * width
            for group, protocol in enumerate(protocols):
                values = maes[method].get(protocol)
                if values is None or not math.isfinite(values[0]):
                    continue
                x = group + offset
                label = method if protocol == next(p for p in protocols if p in maes[method]) else None
                axes.bar(x, values[0], 0.92 * width, color=colour, label=label)
                sessions = values[1:][np.isfinite(values[1:])]
                spread = (
                    np.linspace(-0.28, 0.28, len(sessions)) * width if len(sessions) > 1 else np.zeros(len(sessions))
                )
                axes.plot(
                    x + spread, sessions, "o", color=COLOURS["reference"], markersize=2.6, alpha=0.55, mew=0,
                )  # fmt: skip
                tall = values[0] > 0.07 * top
                axes.annotate(
                    f"{values[0] * 1e3:.3g}", (x, 0 if tall else values[0]), xytext=(0, 4), textcoords="offset points",
                    ha="center", fontsize=9.5, fontweight="bold",
                    color=COLOURS["reference"] if not tall else "#000000" if colour in _LIGHT else "#ffffff",
                )  # fmt: skip
        mark_line(axes, THESIS_MAE_N, "the thesis's 42 mN, on 0.16-0.275 N")
        axes.set_xticks(range(len(protocols)), [WORDS[name].bar for name in protocols])
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
        axes.set_ylabel("MAE of the magnitude, N (in the bars: mN)")
        grams_axis(axes)
        legend_above(axes)

    split = f"the same methods, split {len(protocols)} ways" if len(protocols) > 1 else "bars over all, dots by session"
    return make_figure(draw, f"Mean absolute error: {split}", 6.6, 4.2)


_LIGHT = {"#e69f00", "#56b4e9", "#cc79a7"}
"""Bars that need dark numbers."""


def figure_residuals(outcome: Outcome) -> Figure:
    """Estimate minus reference over the reference, with the median 90 % interval as a band."""
    reference, estimate, interval = outcome.column("magnitude")
    use = outcome.answered
    reference, estimate, interval = reference[use], estimate[use], _bounded(interval[use])
    residual = estimate - reference

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0, color=COLOURS["reference"], linewidth=0.8)
        axes.plot(
            reference, residual, "o", color=COLOURS["estimate"], markersize=3, alpha=0.45, mew=0,
            rasterized=len(residual) > _MANY, label="held-out samples",
        )  # fmt: skip
        edges = (
            np.quantile(reference, np.linspace(0, 1, min(13, max(2, len(reference) // 15 + 1)))) if use.any() else []
        )
        edges = np.unique(edges)
        if len(edges) > 1:
            slot = np.clip(np.searchsorted(edges, reference, side="right") - 1, 0, len(edges) - 2)
            groups = [slot == number for number in range(len(edges) - 1)]
            groups = [group for group in groups if group.any()]
            middle = [float(np.median(reference[group])) for group in groups]
            # The reference lies inside its interval exactly where the residual lies in (estimate - interval).
            low = [float(np.median((estimate - interval[:, 1])[group])) for group in groups]
            high = [float(np.median((estimate - interval[:, 0])[group])) for group in groups]
            median = [float(np.median(residual[group])) for group in groups]
            axes.fill_between(middle, low, high, color=COLOURS["band"], alpha=0.28, linewidth=0, label="90 % interval")
            axes.plot(middle, median, color=COLOURS["line"], linewidth=1.5, label="median error")
        axes.set_xlabel("true force, N")
        axes.set_ylabel("estimate - true, N")
        grams_axis(axes)
        legend_above(axes)

    return make_figure(draw, f"{outcome.method}: error over force, samples of {WORDS[outcome.protocol].of}")


def typical_session(outcome: Outcome) -> str:
    """The session with the median error: neither the best nor the worst one."""
    names = list(dict.fromkeys(outcome.session.tolist()))
    size = np.abs(outcome.magnitude_n - outcome.reference_magnitude_n)
    errors = {
        name: float(np.nanmean(size[outcome.session == name]))
        for name in names
        if np.isfinite(size[outcome.session == name]).any()
    }
    ranked = sorted(errors, key=lambda name: errors[name])
    return ranked[len(ranked) // 2] if ranked else names[0]


def figure_trace(outcome: Outcome, session: str, truth_n: FloatArray | None = None) -> Figure:
    """One held-out session in time: reference, estimate, 90 % band, refused stretches; a panel for each quantity.

    ``truth_n`` (m, 3): at the outcome's ``index``, drawn beside the sensor where it is known.
    """
    part = outcome.where(np.flatnonzero(outcome.session == session))
    part = part.where(np.argsort(part.stamp_ns, kind="stable")[:_TRACE])
    seconds = (part.stamp_ns - part.stamp_ns[0]) * 1e-9
    quantities = part.quantities

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(quantities), 1, sharex=True, squeeze=False)[:, 0]
        gaps = _stretches(seconds, ~part.answered)
        for axes, name in zip(panels, quantities, strict=True):
            reference, estimate, interval = part.column(name)
            interval = _bounded(interval)
            axes.fill_between(
                seconds, interval[:, 0], interval[:, 1], color=COLOURS["band"], alpha=0.3, linewidth=0,
                label="90 % interval",
            )  # fmt: skip
            axes.plot(seconds, reference, color=COLOURS["reference"], linewidth=1.2, label="measured")
            if truth_n is not None:
                true = truth_n[part.index]
                axis = "xyz".find(name)
                known = np.isfinite(part.reference_n).any(axis=0)
                values = true[:, axis] if axis >= 0 else np.sqrt(np.sum(true[:, known] ** 2, axis=1))
                axes.plot(seconds, values, color=COLOURS["second"], linewidth=1.0, label="truth")
            axes.plot(seconds, estimate, color=COLOURS["estimate"], linewidth=1.3, label="estimated")
            for number, (start, end) in enumerate(gaps):
                label = "refused" if number == 0 else None
                axes.axvspan(start, end, color=COLOURS["refused"], alpha=0.35, linewidth=0, label=label)
            axes.set_ylabel("magnitude, N" if name == "magnitude" else f"$F_{name}$, N")
            grams_axis(axes)
        legend_above(panels[0], 5)
        panels[-1].set_xlabel("time, s")
        panels[-1].set_xlim(seconds[0], max(seconds[-1], 1e-3))

    title = f"{outcome.method}: {_short(session, 40)} in time, {WORDS[outcome.protocol].of}"
    return make_figure(draw, title, 6.8, 1.3 + 1.75 * len(quantities))


def figure_sessions(
    title: str, names: Sequence[str], mae_n: FloatArray, constant_n: FloatArray, coverage: FloatArray, colour: str
) -> Figure:
    """Error and coverage of every held-out session; ``mae_n``, ``constant_n``, ``coverage`` (sessions,)."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.6, 1))
        place = np.arange(len(names))
        left.barh(place - 0.19, mae_n, 0.38, color=colour, label="method")
        left.barh(place + 0.19, constant_n, 0.38, color=GREY, label="constant")
        left.set_yticks(place, [_short(name) for name in names])
        left.set_ylim(len(names) - 0.4, -0.6)
        left.grid(visible=False, axis="y")
        left.set_xlabel("MAE, N")
        legend_above(left, 2)
        right.hlines(place, np.minimum(coverage, 0.9), np.maximum(coverage, 0.9), color=colour, alpha=0.5)
        right.plot(coverage, place, "o", color=colour, markersize=5)
        mark_line(right, 0.9, "promised", vertical=True)
        right.set_xlim(min(0.5, float(np.nanmin(coverage, initial=0.9)) - 0.05), 1.02)
        right.xaxis.set_major_formatter(PercentFormatter(1.0, 0, " %"))
        right.set_xlabel("inside the 90 % interval")
        right.tick_params(axis="y", length=0)
        right.grid(visible=False, axis="y")
        legend_above(right, 1)

    return make_figure(draw, title, 6.8, 1.6 + 0.34 * len(names))


def _stretches(seconds: FloatArray, chosen: BoolArray) -> list[tuple[float, float]]:
    """Start and end of every run of True; a single sample still has a visible width."""
    step = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0
    edges = np.diff(np.concatenate([[0], chosen.astype(np.int64), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(float(seconds[a]) - step / 2, float(seconds[b]) + step / 2) for a, b in zip(starts, ends, strict=True)]


def _bounded(interval: FloatArray) -> FloatArray:
    """An unbounded interval is not drawn."""
    return np.where(np.isfinite(interval).all(axis=1, keepdims=True), interval, np.nan)


def _short(name: str, length: int = 22) -> str:
    return name if len(name) <= length else "…" + name[-length + 1 :]
