"""A recording in plain lines, for the terminal."""

import math

import numpy as np

from ..io import ClockOffset, Inertia, Tare
from ..units import newtons_to_grams
from ._summary import RecordingSummary

__all__ = ["describe_recording"]


def describe_recording(summary: RecordingSummary) -> list[str]:
    """One line a fact: file, streams, clock offset, tare, sensor, forces."""
    info, session = summary.info, summary.session_info
    size = f", {summary.image_size[0]}x{summary.image_size[1]} px" if summary.image_size else ""
    lines = [f"{summary.path}: session {session.name}, {summary.duration_s:.1f} s{size}"]
    if info.recovered:
        lines.append(f"recovered     {info.recovered}")
    for stream in info.streams.values():
        lost = f", {stream.dropped} dropped" if stream.dropped else ""
        rate = f" at {_rate(stream.rate_hz)} Hz" if stream.rate_hz else ""
        lines.append(f"{stream.name:<13} {stream.count} {_NOUNS.get(stream.kind, 'messages')}{rate}{lost}")
    for view, count in summary.paired.items():
        lines.append(f"paired        {count} frames of the first view have one of {view} at the same instant")
    for name, (low, high) in summary.actuation_range.items():
        lines.append(f"{name:<13} {low:g}" if low == high else f"{name:<13} {low:g} to {high:g}")
    if any(stream.kind == "wrench" for stream in info.streams.values()):
        lines.append(f"clock offset  {_offset(info.clock_offset)}")
        lines.append(f"tare          {_tare(info.tare)}")
        if info.inertia.axes:
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


_NOUNS = {"frame": "frames", "wrench": "readings", "actuation": "readings"}


def _offset(offset: ClockOffset) -> str:
    if offset.how == "estimated":
        return (
            f"{offset.offset_ms:+.1f} ms +- {offset.stderr_ms:.1f} (estimated; the force explains "
            f"{100 * offset.explained:.1f} % of the deflection; camera time = force stamp + offset)"
        )
    if offset.how == "stated":
        return f"{offset.offset_ms:+.1f} ms (stated; camera time = force stamp + offset)"
    if offset.how == "stage":
        return (
            f"{offset.offset_ms:+.1f} ms (from the stage's movement, good to some milliseconds; the pictures do not "
            f"tell: {offset.detail})"
        )
    return f"0 ms (could not be told: {offset.detail})" if offset.how == "refused" else "0 ms (one clock)"


def _inertia(inertia: Inertia) -> str:
    carried = ", ".join(
        f"{1e3 * float(np.linalg.norm(gain)):.1f} g by {axis}"
        for axis, gain in zip(inertia.axes, inertia.gain_kg, strict=True)
    )
    return f"of the stage's movement taken out: {carried}; force stamp + {1e-6 * inertia.lag_ns:.1f} ms"


def _tare(tare: Tare) -> str:
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
