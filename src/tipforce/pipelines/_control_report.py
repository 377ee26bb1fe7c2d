"""The files of a control run: recording, table, figures as JSON, a plot as in the thesis's figure 33, a page."""

import csv
import io
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import matplotlib as mpl
import numpy as np
from markupsafe import escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..alignment import ClockChoice
from ..clinical import WINDOW_N
from ..control import LIFTED_LIMIT_N, ControlState, SafetyAction
from ..errors import InputError
from ..io import RecordingWriter, atomic_text, write_atomic
from ..types import BoolArray, Event, FloatArray, Frame
from ..units import newtons_to_grams
from ..vision import VisionSettings
from ._control import ControlRun, ControlSession
from ._plot import COLOURS, GREY, INK, plain_axes
from ._record import write_run

_COLUMNS = (
    "time_s", "state", "target_n", "force_n", "low_n", "high_n", "valid", "true_n", "position_mm", "sent_mm",
    "upper_n", "safety", "reason", "gain_n_per_mm", "heart_hz",
)  # fmt: skip
_BANDS = {
    ControlState.APPROACH: "#e8eef3",
    ControlState.CONTACT: "#fbeecb",
    ControlState.HOLD: "#dff0e4",
    ControlState.RETRACT: "#f6dcd2",
}
"""Colours that differ in lightness too; the words are above them."""


def control(
    session: ControlSession,
    folder: Path,
    seconds: float,
    *,
    title: str,
    command: str = "",
    progress: Callable[[str, float], None] | None = None,
) -> dict[str, Any]:
    """Runs ``session`` and writes ``recording.mcap``, ``control.csv``, ``.json``, ``.svg`` and ``report.html``.

    Args:
        session: not yet entered.
        folder: folder of the files; it may not hold an earlier run.
        seconds: time from the first hold that is judged.
        title: description of the run in one line.
        command: the command that was typed, for the page.
        progress: called with the current step and the share that is done.

    Returns:
        The content of ``control.json``.

    Raises:
        InputError: ``folder`` holds a run already, or the session cannot be had.
    """
    target = folder / "recording.mcap"
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty; choose another folder with -o")
    folder.mkdir(parents=True, exist_ok=True)
    with session:
        total_ns = session.simulation.source.settings.world.seconds * 1e9
        info = session.simulation.source.session_info

        complete = False

        def watched() -> Iterator[Event]:
            """Yields the events of the session, reports the progress, and notes whether all have been passed on."""
            nonlocal complete
            for event in session.events():
                if progress is not None and isinstance(event, Frame):
                    progress("control", min(1.0, event.stamp_ns / total_ns))
                yield event
            complete = True

        remark = ""
        with RecordingWriter(target, info, clock=session.simulation.clock, origin="control") as writer:
            try:
                write_run(writer, watched(), info, None, "auto", ClockChoice("none"), VisionSettings(), None)
            except InputError as error:
                if not complete:  # the error is of the session, not of the labels
                    raise
                remark = f"The recording has no labels: {error}."  # the run has its figures all the same
        run = session.finish()
    figures = {"title": title, "settings": run.settings.model_dump(mode="json"), **run.figures(seconds)}
    if remark:
        figures["remark"] = remark
    write_atomic(folder / "control.json", _json(figures))
    with atomic_text(folder / "control.csv") as table:
        _write_table(run, table)
    svg = plot_control(run, title)
    write_atomic(folder / "control.svg", svg)
    write_atomic(folder / "report.html", _page(run, figures, svg, command))
    return figures


def _json(figures: dict[str, Any]) -> str:
    return json.dumps(figures, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _write_table(run: ControlRun, table: TextIO) -> None:
    """Writes a row of `_COLUMNS` for each tick as CSV; forces that are not known are empty."""
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(_COLUMNS)
    for tick, true in zip(run.ticks, run.true_n.tolist(), strict=True):
        forces = (_cell(value) for value in (tick.force_n, tick.low_n, tick.high_n))
        upper = _cell(tick.upper_n)
        rows.writerow(
            [
                f"{tick.time_s:.4f}", tick.state.value, f"{tick.target_n:.4f}", *forces, int(tick.valid), _cell(true),
                f"{tick.position_mm:.4f}", f"{tick.applied.position_mm:.4f}", upper, tick.applied.action.value,
                tick.applied.reason, f"{tick.gain_n_per_mm:.5f}", f"{tick.heart_hz:.4f}",
            ]
        )  # fmt: skip


def _cell(newtons: float) -> str:
    return f"{newtons:.5f}" if math.isfinite(newtons) else ""


_POINTS = 3000
"""Number of ticks that are plotted, at most about twice: every n-th one."""


def plot_control(run: ControlRun, title: str) -> str:
    """Plots the force above the position on the path, over the states of the run.

    Args:
        run: the run.
        title: title of the figure.

    Returns:
        The SVG document.
    """
    every = max(1, len(run.ticks) // _POINTS)
    run = replace(run, ticks=run.ticks[::every], true_n=run.true_n[::every])
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "tipforce", "font.family": "sans-serif"}):
        figure = Figure(figsize=(11.0, 6.2), layout="constrained")
        force, path = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
        for axes in (force, path):
            plain_axes(axes)
            _bands(axes, run, named=axes is force)
        time = run.time_s
        _forces(force, run, time)
        path.plot(time, [tick.position_mm for tick in run.ticks], color=INK, lw=1.0)
        path.set_ylabel("way from the\nmarked start, mm", color=INK)
        path.set_xlabel("time, s", color=INK)
        path.set_xlim(time[0], time[-1])
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, color=INK)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def _forces(axes: Axes, run: ControlRun, time: FloatArray) -> None:
    """Plots estimate, interval, true force, target and limit over ``time`` (s); marks ticks without a valid estimate.

    The first second is not marked: no estimate can have come yet.
    """
    force, low, high = (
        np.array([getattr(tick, name) for tick in run.ticks]) for name in ("force_n", "low_n", "high_n")
    )
    valid = np.array([tick.valid for tick in run.ticks])
    target = np.array([tick.target_n for tick in run.ticks])
    limit = run.judged_limit_n
    axes.fill_between(time, low, high, where=valid.tolist(), color=COLOURS[0], alpha=0.22, lw=0, label="90 % interval")
    axes.plot(time, np.where(valid, force, np.nan), color=COLOURS[0], lw=0.9, label="estimate")
    axes.plot(time, run.true_n, color=INK, lw=1.1, label="true force")
    axes.plot(time, np.where(target > 0.0, target, np.nan), color=COLOURS[1], lw=1.6, ls="--", label="target")
    axes.axhline(limit, color=COLOURS[1], lw=1.0, label=f"limit {limit:g} N")
    top = 1.12 * max(limit if limit < 1.0 else 0.0, float(run.true_n.max()), run.settings.target_n)
    for number, (first, end) in enumerate(_stretches(~valid & (time > time[0] + 1.0))):
        label = "" if number else "no valid estimate"
        axes.axvspan(time[first], time[end], 0.0, 0.035, color=COLOURS[1], lw=0, label=label)
    axes.set_ylim(0.0, top)
    axes.set_ylabel("force, N", color=INK)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 1.13), ncols=6, frameon=False, fontsize=9)


def _bands(axes: Axes, run: ControlRun, *, named: bool) -> None:
    """Colours the background by the state of the run, and red where the catheter is drawn back above the limit.

    Args:
        axes: the axes.
        run: the run.
        named: whether the states' names are written above bands that are wide enough for them.
    """
    states = np.array([tick.state.value for tick in run.ticks])
    time = run.time_s
    for state, colour in _BANDS.items():
        for first, end in _stretches(states == state.value):
            axes.axvspan(time[first], time[end], color=colour, lw=0, zorder=0)
            if named and time[end] - time[first] > 0.05 * (time[-1] - time[0]):
                axes.text(
                    time[first], 0.985, f" {state.value}", va="top", fontsize=8, color=GREY,
                    transform=axes.get_xaxis_transform(),
                )  # fmt: skip
    over = np.array([tick.applied.action is SafetyAction.OVER_LIMIT for tick in run.ticks])
    for first, end in _stretches(over):
        axes.axvspan(time[first], time[end], color=COLOURS[1], alpha=0.35, lw=0, zorder=0)


def _stretches(chosen: BoolArray) -> list[tuple[int, int]]:
    """Returns first and last row of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(first), min(int(end), len(chosen) - 1)) for first, end in edges.reshape(-1, 2)]


def _page(run: ControlRun, figures: dict[str, Any], svg: str, command: str) -> str:
    """Returns the page of the run (HTML): verdict, command, plot, table of figures, and the changes of state."""
    drawing = svg[svg.index("<svg") :]
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in _facts(figures))
    typed = f"<p class='quiet'><code>{escape(command)}</code></p>" if command else ""
    changes = "".join(f"<li>{time_s:.2f} s: {escape(text)}</li>" for time_s, text in _changes(run))
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'><link rel='icon' href='data:,'>"
        f"<title>tipforce control: {escape(figures['title'])}</title><style>{_STYLE}</style></head><body><main>"
        f"<p class='quiet'>{escape(figures['title'])}. Research use only.</p><h1>{escape(verdict(figures))}</h1>"
        f"{typed}<figure>{drawing}<figcaption>Above the force: target, true force, estimate with its 90 % interval; "
        "red at the foot: no valid estimate; red bands: drawn back above the limit. Below: place on the path. Bands: "
        f"the states of the run.</figcaption></figure><table>{rows}</table><h2>Events</h2><ol>{changes}</ol>"
        "</main></body></html>\n"
    )


_STYLE = (
    "body{margin:0;font:16px/1.5 system-ui,sans-serif;color:#15202b;background:#f7f8f8}"
    "main{max-width:1080px;margin:0 auto;padding:16px 20px}h1{font-size:24px;line-height:1.3}"
    "figure{margin:0}svg{width:100%;height:auto;background:#fff}.quiet,figcaption{color:#4d5964;font-size:14px}"
    "th{text-align:left;font-weight:400;padding-right:2em}td{text-align:right}code{overflow-wrap:anywhere}"
)


def verdict(figures: dict[str, Any]) -> str:
    """Returns the result in three sentences: the hold, the peak, and the time above the limits; then a remark."""
    target = figures["settings"]["target_n"]
    if "rms_n" in figures:
        held = (
            f"{target:g} N was held to {1e3 * figures['rms_n']:.0f} mN RMS of the true force "
            f"({newtons_to_grams(figures['rms_n']):.1f} g); {figures['within_20_mn']:.0%} of the time within 20 mN; "
            f"{figures['not_valid_share']:.1%} of the time without a valid estimate."
        )
    else:
        held = f"{target:g} N was never held."
    peak_n = figures["peak_whole_run_n"]
    passes, unforeseen = round(figures["passes"]), round(figures["unforeseen"])
    begun = "" if not passes else f", passed {passes} times, {unforeseen} of them before the retraction had begun"
    return (
        f"{held} Peak of the true force: {peak_n:.2f} N ({newtons_to_grams(peak_n):.0f} g). "
        f"{figures['above_limit_s']:.2f} s above {_limit(figures)}{begun}; "
        f"{figures['above_thesis_limit_s']:.2f} s above the thesis's safe limit, {WINDOW_N[1]:g} N."
        + (f" {figures['remark']}" if "remark" in figures else "")
    )


def _limit(figures: dict[str, Any]) -> str:
    lifted = figures["settings"]["safety"]["limit_n"] >= LIFTED_LIMIT_N
    return f"the loop's limit, {figures['judged_limit_n']:g} N" + ", which was lifted in this run" * lifted


def _facts(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Returns the rows of the page's table, as label and value; without a hold only those of the whole run."""
    whole = [
        ("peak of the whole run, true force", f"{figures['peak_whole_run_n']:.3f} N at {figures['peak_at_s']:.1f} s"),
        ("largest upper end of the estimates", f"{figures['peak_upper_n']:.3f} N"),
        (f"time above {_limit(figures)}", f"{figures['above_limit_s']:.2f} s"),
        (f"time above the thesis's safe limit, {WINDOW_N[1]:g} N", f"{figures['above_thesis_limit_s']:.2f} s"),
        ("limit passed; before the retraction had begun",
         f"{figures['passes']:.0f} times; {figures['unforeseen']:.0f}"),
        ("begun again by itself", f"{figures['restarts']:.0f} times"),
    ]  # fmt: skip
    if "rms_n" not in figures:
        return whole
    return [
        ("RMS error of the true force", f"{1e3 * figures['rms_n']:.1f} mN"),
        ("mean error", f"{1e3 * figures['bias_n']:+.1f} mN"),
        ("share of time within 20 mN", f"{figures['within_20_mn']:.1%}"),
        ("peak while it was held", f"{figures['peak_n']:.3f} N"),
        *whole,
        ("held", f"{figures['held_s']:.1f} s"),
        ("time without a valid estimate", f"{figures['not_valid_share']:.1%}"),
        ("time drawn back above the limit", f"{figures['over_limit_share']:.1%}"),
    ]


def _changes(run: ControlRun, most: int = 40) -> list[tuple[float, str]]:
    """Returns time and text of each change of the run's state or of the safety layer's action; ``most`` of them."""
    changes: list[tuple[float, str]] = []
    before = None
    for tick in run.ticks:
        now = (tick.state, tick.applied.action)
        if now != before:
            reason = f" ({tick.applied.reason})" if tick.applied.reason else ""
            changes.append((tick.time_s, f"{tick.state.value}, safety: {tick.applied.action.value}{reason}"))
        before = now
    if len(changes) <= most:
        return changes
    return [*changes[:most], (run.ticks[-1].time_s, f"and {len(changes) - most} more")]
