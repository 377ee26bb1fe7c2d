"""The small plot of a recording."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..alignment import Labels
from ..io import ClockMap, RecordingReader, atomic_path
from ..types import FloatArray, Image
from ..units import newtons_to_grams

INK, GREY = "#15202b", "#8a939c"
COLOURS = ("#0072b2", "#d55e00", "#009e73")
FINDING_COLOURS: dict[str, str] = {
    "error status": "#cc3311",
    "clipped": "#ee7733",
    "spike": "#aa3377",
    "dead axis": "#882255",
    "gap": "#bbbbbb",
    "step of the zero": "#117733",
    "drift": "#44aa99",
    "contact during tare": "#cc3311",
}
_POINTS = 4000


def plot_run(reader: RecordingReader, forces: Labels | None, path: Path) -> None:
    """Plots the force at the frames, the middle frame of each view, and the intervals between the first view's frames.

    Args:
        reader: the open recording.
        forces: forces at the frames; None: there are none.
        path: the file, .png or .svg.
    """
    figure = Figure(figsize=(10.5, 3.6), dpi=120, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(2.6, 1.0), height_ratios=(2.2, 1.0))
    force, image_axes, steps = (figure.add_subplot(grid[place]) for place in ((slice(None), 0), (0, 1), (1, 1)))
    _force(force, reader, forces)
    if not reader.views:
        image_axes.axis("off")
        steps.axis("off")
    else:
        stamps = reader.stamps(reader.views[0])
        middle = len(stamps) // 2
        image_axes.imshow(_together(reader, int(stamps[middle])), cmap="gray", vmin=0, vmax=255)
        image_axes.set_title(f"frame {middle} of {len(stamps)}", fontsize=9, color=INK, loc="left")
        image_axes.axis("off")
        _intervals(steps, (stamps - stamps[0]) * 1e-9)
    with atomic_path(path) as part:
        figure.savefig(part, format=path.suffix.lstrip(".").lower())


def _together(reader: RecordingReader, stamp_ns: int) -> Image:
    """Returns the image of each view that is nearest to ``stamp_ns``, side by side."""
    nearest = (int(np.argmin(np.abs(reader.stamps(view) - stamp_ns))) for view in reader.views)
    images = [reader.frame_at(index, view).image for index, view in zip(nearest, reader.views, strict=True)]
    if len(images) == 1:
        return images[0]
    height = max(image.shape[0] for image in images)
    grey = [image if image.ndim == 2 else image.mean(axis=2).astype(np.uint8) for image in images]
    # white below smaller images, and 4 px of it between two
    return np.hstack([np.pad(image, ((0, height - image.shape[0]), (0, 4)), constant_values=255) for image in grey])


def _force(axes: Axes, reader: RecordingReader, forces: Labels | None) -> None:
    """Plots the known components of the force in N over the time since the first frame, with tare and findings.

    Args:
        axes: the axes.
        reader: the open recording: clock map, tare and implausible stretches are in the title and the background.
        forces: forces at the frames; None: there are none.
    """
    plain_axes(axes)
    axes.set_xlabel("time, s", color=INK)
    if forces is None or np.isnan(forces.force_n).all():
        axes.text(0.5, 0.5, "no force at the frames", ha="center", va="center", color=GREY, transform=axes.transAxes)
        return
    origin = int(forces.stamp_ns[0])
    thin = slice(None, None, max(1, len(forces.stamp_ns) // _POINTS))
    seconds = (forces.stamp_ns[thin] - origin) * 1e-9
    for axis in np.flatnonzero(forces.known).tolist():
        axes.plot(seconds, forces.force_n[thin, axis], color=COLOURS[axis], lw=1.0, label=f"f{'xyz'[axis]}")
    info = reader.info
    for number, (start, end) in enumerate(info.tare.stretches_s):
        wrench = next(stream for stream in info.streams.values() if stream.kind == "wrench")
        first, last = _camera_s(info.clock_map, wrench.first_ns, (start, end), origin)
        axes.axvspan(first, last, color=GREY, alpha=0.18, lw=0, label="tare" if number == 0 else None)
    _findings(axes, reader, origin)
    axes.axhline(0, color=INK, lw=0.6)
    axes.set_xlim(seconds[0], seconds[-1])
    axes.set_ylabel("force of the tissue on the tip, N", color=INK)
    grams = axes.secondary_yaxis("right", functions=(_grams, _newtons))
    grams.set_ylabel("g", color=INK)
    grams.tick_params(colors=INK, labelsize=9)
    clock = info.clock_map
    known = clock.how in ("estimated", "stated", "stage")
    text = f"clock offset {clock.offset_ms:+.1f} ms" if known else f"clock map {clock.how}"
    if clock.how == "estimated":
        text += f" ± {clock.stderr_ms:.1f}"
    if clock.rate != 1.0:
        text += f", rate {clock.rate:.5g}"
    axes.set_title(f"{reader.path.name}   {text}", fontsize=10, color=INK, loc="left", pad=22)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, fontsize=9, borderaxespad=0.1)


def _findings(axes: Axes, reader: RecordingReader, origin_ns: int) -> None:
    """Marks the implausible stretches of the force, each kind in its colour; single instants are lines."""
    info = reader.info
    first_ns = next((stream.first_ns for stream in info.streams.values() if stream.kind == "wrench"), 0)
    named: set[str] = set()
    for finding in info.plausibility.findings:
        label = None if finding.kind in named else finding.kind
        named.add(finding.kind)
        colour = FINDING_COLOURS[finding.kind]
        start, end = _camera_s(info.clock_map, first_ns, (finding.start_s, finding.end_s), origin_ns)
        axes.axvspan(start, end, color=colour, alpha=0.25, lw=0.8, zorder=0, label=label)


def _camera_s(clock: ClockMap, first_ns: int, stretch_s: tuple[float, float], origin_ns: int) -> tuple[float, float]:
    """Returns a stretch of the force log, in seconds since its first row, on the camera's clock since ``origin_ns``."""
    force_ns = first_ns + np.rint(1e9 * np.array(stretch_s)).astype(np.int64)
    start, end = (clock.camera_ns(force_ns) - origin_ns) * 1e-9
    return float(start), float(end)


def _grams(newtons: ArrayLike) -> FloatArray:
    return np.asarray(newtons, dtype=np.float64) * newtons_to_grams(1.0)


def _newtons(grams: ArrayLike) -> FloatArray:
    return np.asarray(grams, dtype=np.float64) / newtons_to_grams(1.0)


def _intervals(axes: Axes, seconds: FloatArray) -> None:
    plain_axes(axes)
    if len(seconds) > 1:
        axes.plot(seconds[1:], 1e3 * np.diff(seconds), color=COLOURS[0], lw=0, marker=".", ms=2, rasterized=True)
        axes.set_ylim(0, 1.25 * 1e3 * float(np.max(np.diff(seconds))))
    axes.set_title("ms between frames", fontsize=9, color=INK, loc="left")
    axes.set_xlabel("time, s", color=INK, fontsize=9)


def plain_axes(axes: Axes) -> None:
    """Leaves two spines and a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, color=INK, alpha=0.1, lw=0.6)
    axes.tick_params(colors=INK, labelsize=9)
