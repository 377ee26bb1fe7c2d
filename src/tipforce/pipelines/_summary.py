"""A recording at a glance: its figures."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .._system.json_files import finite_values
from ..alignment import Labels, labels, nearest_frames
from ..errors import InputError
from ..io import SUBTRACTED_FORCE, ClockMap, Inertia, RecordingInfo, RecordingReader, Tare, check_image_target
from ..types import FloatArray, SessionInfo
from ..units import newtons_to_grams


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """Summary of a recording for a person.

    Attributes:
        path: the recording.
        info: its contents.
        session_info: metadata of the session.
        duration_s: time from the first to the last stamp of all streams.
        image_size: (width, height) of the first view in px; None without images.
        labelled: number of frames of all views that have a force.
        force_range_n: "fx", "fy", "fz", "magnitude" -> smallest and largest label.
        actuation_range: drive -> smallest and largest reading.
        unlabelled_because: why there is no label at all, or empty.
        paired: further view -> number of frames of the first view that have a partner in it.
    """

    path: Path
    info: RecordingInfo
    session_info: SessionInfo
    duration_s: float
    image_size: tuple[int, int] | None
    labelled: int
    force_range_n: Mapping[str, tuple[float, float]]
    actuation_range: Mapping[str, tuple[float, float]]
    unlabelled_because: str = ""
    paired: Mapping[str, int] = field(default_factory=dict[str, int])

    def figures(self) -> dict[str, Any]:
        """Returns all of it as JSON values; unknown numbers are None."""
        info = self.info
        return {
            "file": str(self.path),
            "session": self.session_info.name,
            "duration_s": self.duration_s,
            "image_size": self.image_size,
            "streams": {name: asdict(stream) for name, stream in info.streams.items()},
            "clock_map": finite_values(asdict(info.clock_map) | {"offset_ms": info.clock_map.offset_ms}),
            "tare": finite_values(
                {
                    "how": info.tare.how,
                    "force_n": info.tare.force_n.tolist(),
                    "stderr_n": info.tare.stderr_n.tolist(),
                    "stretches_s": info.tare.stretches_s,
                    "detail": info.tare.detail,
                }
            ),
            "inertia": asdict(info.inertia)
            | {"gain_kg": info.inertia.gain_kg.tolist(), "beat_n": info.inertia.beat_n.tolist()},
            "plausibility": {
                "findings": [finding.values() for finding in info.plausibility.findings],
                "bridged_gaps": info.plausibility.bridged,
                "longest_bridged_s": info.plausibility.longest_bridged_s,
            },
            "labelled_frames": self.labelled,
            **({"paired_frames": dict(self.paired)} if self.paired else {}),
            "unlabelled_because": self.unlabelled_because,
            "force_range_n": self.force_range_n,
            "actuation_range": self.actuation_range,
            "session_info": self.session_info.values(),
            "recovered": info.recovered,
            "zeros": _zeros(info),
        }


def summarise_recording(path: Path | str) -> RecordingSummary:
    """Summarises a recording: its streams, the size of its images, its labels, and the ranges of forces and drives.

    Raises:
        FileFormatError: it cannot be read.
    """
    with RecordingReader(path) as reader:
        info = reader.info
        streams = [stream for stream in info.streams.values() if stream.count]
        first_view = next(iter(reader.views), None)
        size, labelled, ranges, drives = None, 0, {}, {}
        if first_view is not None:
            image = reader.frame_at(0, first_view).image
            size = (image.shape[1], image.shape[0])
            drives = {
                name: (float(np.nanmin(values)), float(np.nanmax(values)))
                for name, values in reader.actuation_at(reader.stamps(first_view)).items()
                if not np.isnan(values).all()
            }
        first_labels, why = _labels(reader, first_view)
        if first_labels is not None:
            all_labels = [first_labels, *(labels(reader, camera=view) for view in reader.views[1:])]
            labelled = sum(int(np.sum(~np.isnan(of_view.force_n).all(axis=1))) for of_view in all_labels)
            ranges = _ranges(first_labels) if labelled else {}
        return RecordingSummary(
            path=reader.path,
            info=info,
            session_info=reader.session_info,
            duration_s=(max(s.last_ns for s in streams) - min(s.first_ns for s in streams)) * 1e-9 if streams else 0.0,
            image_size=size,
            labelled=labelled,
            force_range_n=ranges,
            actuation_range=drives,
            unlabelled_because=why,
            paired=_paired(reader),
        )


def _paired(reader: RecordingReader) -> dict[str, int]:
    first, *others = (reader.stamps(view) for view in reader.views) if reader.views else (np.empty(0, np.int64),)
    counts = (int((nearest_frames(first, stamps) >= 0).sum()) for stamps in others)
    return dict(zip(reader.views[1:], counts, strict=True))


def _labels(reader: RecordingReader, view: str | None) -> tuple[Labels | None, str]:
    """Returns the forces at the frames of a view, and ""; or None, and the reason why there are none."""
    force = next((stream.name for stream in reader.info.streams.values() if stream.kind == "wrench"), None)
    if view is None or force is None:
        return None, "the recording holds no frames" if view is None else "the recording holds no forces"
    try:
        return labels(reader, camera=view, force=force), ""
    except InputError as error:
        return None, str(error)


def _ranges(forces: Labels) -> dict[str, tuple[float, float]]:
    """Returns smallest and largest label in newtons of each known component ("fx") and of the "magnitude"."""

    def ends(values: FloatArray) -> tuple[float, float]:
        return float(np.nanmin(values)), float(np.nanmax(values))

    ranges = {f"f{'xyz'[axis]}": ends(forces.force_n[:, axis]) for axis in np.flatnonzero(forces.known).tolist()}
    ranges["magnitude"] = ends(np.sqrt(np.sum(forces.force_n[:, forces.known] ** 2, axis=1)))
    return ranges


def plot_summary(summary: RecordingSummary, path: Path | str) -> None:
    """Plots the force over time, an image and the frames' intervals.

    Args:
        summary: summary of the recording.
        path: the file, .png or .svg.

    Raises:
        FileFormatError: the name ends otherwise.
        OutputError: nothing can be written in the folder.
    """
    check_image_target(Path(path), plot=True)
    from ._plot import plot_run  # matplotlib takes a third of a second to load

    with RecordingReader(summary.path) as reader:
        forces, _ = _labels(reader, next(iter(reader.views), None))
        plot_run(reader, forces, Path(path))


def describe_recording(summary: RecordingSummary) -> list[str]:
    """Returns one line a fact, in this order: file, streams, drives, forces, catheter, views.

    "zero" is a force that the operator subtracted from the estimates of a live run; "tare" is the force that the sensor
    shows without contact. The inertia of a moving sensor is shown only where it was estimated or has a remark.
    """
    info, session = summary.info, summary.session_info
    size = f", {summary.image_size[0]}x{summary.image_size[1]} px" if summary.image_size else ""
    lines = [f"{summary.path}: session {session.name}, {summary.duration_s:.1f} s{size}"]
    if info.recovered:
        lines.append(f"recovered     {info.recovered}")
    for stream in info.streams.values():
        lost = f", {stream.dropped} dropped" if stream.dropped else ""
        rate = f" at {_rate(stream.rate_hz)} Hz" if stream.rate_hz else ""
        lines.append(f"{stream.name:<13} {stream.count} {_NOUNS.get(stream.kind, 'messages')}{rate}{lost}")
    lines += [f"zero          {_zero(zero)}" for zero in _zeros(info)]
    for view, count in summary.paired.items():
        lines.append(f"paired        {count} frames of the first view have one of {view} at the same instant")
    for name, (low, high) in summary.actuation_range.items():
        lines.append(f"{name:<13} {low:g}" if low == high else f"{name:<13} {low:g} to {high:g}")
    if any(stream.kind == "wrench" for stream in info.streams.values()):
        lines.append(f"clock map     {_clock(info.clock_map)}")
        lines += [f"implausible   {line}" for line in info.plausibility.lines()]
        lines.append(f"tare          {_tare(info.tare)}")
        if info.inertia.how == "estimated" or info.inertia.detail:
            lines.append(f"inertia       {_inertia(info.inertia)}")
        if info.sensor is not None:
            angle_deg, reads = info.sensor.angle_deg or 0.0, info.sensor.reads or "tip-on-tissue"
            lines.append(f"sensor        x axis {angle_deg:g} deg from the base x axis, reads {reads}")
        frames = sum(stream.count for stream in info.streams.values() if stream.kind == "frame")
        lines.append(f"labelled      {summary.labelled} of {frames} frames")
        if summary.unlabelled_because:
            lines.append(f"              {summary.unlabelled_because}")
        for name, (low, high) in summary.force_range_n.items():
            grams = f"{newtons_to_grams(low):.1f} to {newtons_to_grams(high):.1f} g"
            lines.append(f"{name:<13} {low:.3f} to {high:.3f} N ({grams})")
    if session.catheter.name != "unnamed":
        lines.append(f"catheter      {session.catheter.name}")
    for name, view in session.views.items():
        known = [f"{1e3 * view.metres_per_px:.4g} mm/px"] if view.metres_per_px else []
        known += [f"base at the {view.base_side}"] if view.base_side else []
        if known:
            lines.append(f"view {name:<8} {', '.join(known)}")
    return lines


_NOUNS = {"frame": "frames", "wrench": "readings", "actuation": "readings", "estimate": "estimates"}


def _zeros(info: RecordingInfo) -> list[dict[str, str]]:
    """Returns the operator's zeros of a live run, in the order in which they were set or undone."""
    records = [dict(record) for name, record in info.metadata.items() if name.startswith(f"{SUBTRACTED_FORCE}.")]
    return sorted(records, key=lambda record: int(record["stamp_ns"]))


def _zero(record: Mapping[str, str]) -> str:
    """Returns a sentence on a zero: the subtracted force, since when, and by whom."""
    since = f"from {int(record['stamp_ns']) * 1e-9:.3f} s on"
    magnitude_n = float(record["magnitude_n"])
    if magnitude_n == 0.0:
        return f"nothing is subtracted from the estimates {since}"
    contact = ", confirmed although the tip may have been in contact" if record.get("confirmed") == "yes" else ""
    return (
        f"{1e3 * magnitude_n:.1f} mN ({newtons_to_grams(magnitude_n):.1f} g) are subtracted from the estimates {since} "
        f"({record['by'] or 'not stated by whom'}{contact})"
    )


def _clock(clock: ClockMap) -> str:
    """Returns a clock map in words: offset, rate, their standard errors, and how they were found."""
    if clock.how == "refused":
        return f"unknown: {clock.detail}"
    if clock.how == "none":
        return "offset 0 ms (one clock)"
    at = f" at {clock.reference_ns * 1e-9:.1f} s of the force log" if clock.rate != 1.0 else ""
    offset = f"offset {clock.offset_ms:+.1f} ms"
    if clock.how == "stated":
        return f"{offset}{at}, rate {clock.rate:.6g} (stated; camera time = rate x force stamp + offset)"
    if clock.how == "stage":
        return f"{offset} +- {clock.stderr_ms:.1f} (from the stage's movement in the force; {clock.detail})"
    rate = f"rate {clock.rate:.7g} +- {clock.rate_stderr:.1g}"
    return (
        f"{offset} +- {clock.stderr_ms:.1f}{at}, {rate} (estimated; the force explains {100 * clock.explained:.1f} % "
        "of the deflection; camera time = rate x force stamp + offset)"
    )


def _inertia(inertia: Inertia) -> str:
    """Returns in words the parts of the inertia that were removed: by the stage's log, and by harmonics of the beat."""
    carried = ", ".join(
        f"{1e3 * float(np.linalg.norm(gain)):.1f} g by {axis}"
        for axis, gain in zip(inertia.axes, inertia.gain_kg, strict=True)
    )
    rate = "" if inertia.rate == 1.0 else f", rate {inertia.rate:.6g}"
    parts = [f"of the stage's movement taken out: {carried}; force stamp + {1e-6 * inertia.lag_ns:.1f} ms{rate}"]
    beat = f"{len(inertia.beat_n)} harmonics of {inertia.beat_hz:.4f} Hz taken out, as the contact-free stretch shows"
    return "; ".join(
        parts * bool(inertia.axes) + [beat] * (inertia.beat_hz > 0.0) + [inertia.detail] * bool(inertia.detail)
    )


def _tare(tare: Tare) -> str:
    """Returns a tare in words: force and standard error of each axis in mN, and the first stretches that it is from."""
    if tare.how == "none":
        return f"none ({tare.detail})" if tare.detail else "none"
    axes = [
        f"f{'xyz'[axis]} {1e3 * force:.1f} +- {1e3 * stderr:.1f}"
        for axis, (force, stderr) in enumerate(zip(tare.force_n.tolist(), tare.stderr_n.tolist(), strict=True))
        if not math.isnan(stderr)
    ]
    total = sum(end - start for start, end in tare.stretches_s)
    places = ", ".join(f"{start:.1f}-{end:.1f}" for start, end in tare.stretches_s[:4])
    more = f" and {len(tare.stretches_s) - 4} more" if len(tare.stretches_s) > 4 else ""
    note = f"; {tare.detail}" if tare.detail else ""
    return f"{', '.join(axes)} mN ({tare.how}: {total:.1f} s at {places}{more} s{note})"


def _rate(hertz: float) -> str:
    return f"{hertz:.0f}" if hertz >= 1000 else f"{hertz:.4g}"
