"""The figure of a calibration: the knob's map, the forces, the tissue."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..calibration import Calibration, KnobFit, SessionResult
from ..io import atomic_path, check_image_target
from ._plot import COLOURS, GREY, INK, plain_axes


def draw_calibration(calibration: Calibration, path: Path) -> None:
    """Draws three panels of all sessions: knob, forces, tissue. An empty panel states why.

    Args:
        calibration: the fitted constants and the data of each session.
        path: the file, .png or .svg.
    """
    check_image_target(path, plot=True)
    figure = Figure(figsize=(12.0, 4.0), dpi=110, layout="constrained")
    for axes, draw in zip(figure.subplots(1, 3), (_knob, _forces, _tissue), strict=True):
        plain_axes(axes)
        draw(axes, calibration.sessions)
    with atomic_path(path) as part:
        figure.savefig(part, format=path.suffix.lstrip(".").lower())


def _nothing(axes: Axes, said: str) -> None:
    axes.text(0.5, 0.5, said, ha="center", va="center", color=GREY, transform=axes.transAxes, wrap=True, fontsize=9)


def _title(axes: Axes, text: str, x: str, y: str) -> None:
    axes.set_title(text, fontsize=10, color=INK, loc="left")
    axes.set_xlabel(x, color=INK)
    axes.set_ylabel(y, color=INK)


def _knob(axes: Axes, results: tuple[SessionResult, ...]) -> None:
    """Draws the curvature in 1/m over the angle of the knob in degrees of all sessions, or why there is no such fit."""
    _title(axes, "knob: curvature without load", "angle of the knob, deg", "curvature, 1/m")
    knobs = [each.knob for each in results if each.knob is not None]
    if not knobs:
        _nothing(axes, next((each.reasons.get("knob", "") for each in results), ""))
        return
    for number, knob in enumerate(knobs):
        _one_knob(axes, knob, first=number == 0)
    axes.legend(frameon=False, fontsize=8, loc="best")


def _one_knob(axes: Axes, knob: KnobFit, *, first: bool) -> None:
    """Draws the measured curvatures of one session by turning direction, and the two lines of the fitted play.

    Args:
        axes: the axes.
        knob: the fit of the session.
        first: whether it is the first session, whose points get the legend.
    """
    for direction, name, colour in (
        (1.0, "turned up", COLOURS[1]),
        (-1.0, "turned down", COLOURS[0]),
        (0.0, "at rest", GREY),
    ):
        rows = knob.turning == direction
        if rows.any():
            axes.plot(
                knob.knob_deg[rows], knob.measured_per_m[rows], ".", ms=4, alpha=0.6, color=colour,
                label=name if first else None,
            )  # fmt: skip
    if np.isfinite(knob.gain_per_m_deg):
        half_play = 0.5 * knob.play_deg if np.isfinite(knob.play_deg) else 0.0
        ends = np.array([knob.low_deg, knob.high_deg])
        for shift, colour in ((-half_play, COLOURS[1]), (half_play, COLOURS[0])):
            axes.plot(ends, knob.offset_per_m + knob.gain_per_m_deg * (ends + shift), color=colour, lw=1.2)


def _forces(axes: Axes, results: tuple[SessionResult, ...]) -> None:
    """Draws the force components in N of the rod model over those of the sensor, with the diagonal."""
    _title(axes, "force: sensor and calibrated rod", "sensor, N", "rod, from the line alone, N")
    with_force = [result.shown for result in results if len(result.shown[0])]
    if not with_force:
        _nothing(axes, "no forces")
        return
    sensor_n, rod_n = (np.concatenate([shown[k] for shown in with_force]) for k in (1, 2))
    for axis in (0, 1):
        axes.plot(sensor_n[:, axis], rod_n[:, axis], ".", ms=4, alpha=0.6, color=COLOURS[axis], label=f"f{'xy'[axis]}")
    ends = [float(np.nanmin([sensor_n, rod_n])), float(np.nanmax([sensor_n, rod_n]))]
    axes.plot(ends, ends, color=INK, lw=0.8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(frameon=False, fontsize=8, loc="upper left")


def _tissue(axes: Axes, results: tuple[SessionResult, ...]) -> None:
    """Draws force over depth with the fitted law of the tissue of each session, or writes why no law was fitted."""
    _title(axes, "tissue: force over depth", "depth of the tip, mm", "force across the surface, N")
    tissues = [result.tissue for result in results if result.tissue is not None]
    if not tissues:
        _nothing(axes, next((result.reasons.get("tissue", "") for result in results), "") or "no contact")
        return
    for number, tissue in enumerate(tissues):
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(1e3 * tissue.depth_at_m, tissue.force_n, ".", ms=2.5, alpha=0.35, color=colour, rasterized=True)
        axes.plot(1e3 * tissue.law_m, tissue.law_n, color=INK, lw=1.4)
