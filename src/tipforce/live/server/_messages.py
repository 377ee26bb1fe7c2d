"""Messages on the socket of a page: one binary message per frame, and short JSON texts for all others.

A binary message is a header of 36 bytes, little endian, then JSON (UTF-8), then a JPEG image::

    offset  size  type    content
         0     4  bytes   "TIPF"
         4     2  uint16  version of this layout: 1
         6     2  uint16  bytes of this header: 36
         8     4  uint32  number of the update, to be acknowledged
        12     8  int64   captured: mid-exposure, ns on the engine's clock
        20     8  int64   published: when the estimate was ready, ns on the same clock
        28     4  uint32  bytes of the JSON
        32     4  uint32  bytes of the JPEG; 0: there is no image

A number that is not known is null in the JSON. Coordinates are in pixels of the image of a view, u right, v down, also
if the JPEG has another size: ``shape`` of the first view in ``read``, ``shapes_beside`` of each other one. Several
views are sent side by side, the first one at the left, unless the page chooses one; ``panels`` states the column at
which each begins, and the factor by which it is scaled to the height of the first.
"""

import json
import struct
import threading
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from ...types import DetectedShape, FloatArray, Image, ShapeBeside
from .._numbers import number
from .._update import LiveUpdate, Zero
from ._tip_force import tip_force

HEADER = struct.Struct("<4sHHIqqII")
MAGIC = b"TIPF"
VERSION = 1

WIDTHS = (320, 480, 640, 800, 960, 1280, 1920)
"""Images are scaled to one of these widths, so that pages of nearly the same size share one encoded image."""
CENTRELINE_POINTS = 64
"""Number of points of the centreline that are sent: more than a display can separate."""

Point = tuple[float, float | None, float | None, float | None]
"""Point of the trace: mid-exposure in ms on the engine's clock, force and its interval in N; None if not valid."""

ALL_VIEWS = ""
"""In place of the name of a view: all views side by side."""
GAP_PX = 8
"""Columns between two views."""

Wanted = tuple[str, int]
"""View or `ALL_VIEWS`, and width of the image in pixels."""


def display_width(pixels: int) -> int:
    """Returns the smallest of `WIDTHS` that is at least ``pixels``, or the largest one.

    >>> display_width(500), display_width(4000)
    (640, 1920)
    """
    return next((width for width in WIDTHS if width >= pixels), WIDTHS[-1])


class EncodedUpdate:
    """One update as messages: its numbers are encoded once, its image once for each requested size.

    May be used from several threads at the same time.

    Args:
        update: the update.
        quality: JPEG quality, 1 to 100.
        recent: points of the trace of the preceding updates, for pages that did not get those.
    """

    def __init__(self, update: LiveUpdate, quality: int, recent: Sequence[Point] = ()) -> None:
        self.update = update
        self._quality, self._recent = quality, recent
        self._lock = threading.Lock()
        self._numbers: bytes | None = None
        self._messages: dict[Wanted, bytes] = {}

    @property
    def number(self) -> int:
        """Number of the update."""
        return self.update.number

    def message(self, view: str, pixels: int) -> bytes:
        """Returns the binary message with the image of ``view``.

        Args:
            view: name of the view; if the update does not have it, all views are sent, side by side.
            pixels: requested width of the image; the image is never enlarged.
        """
        view, image, panels = self._view(view)
        wanted = (view, 0 if image is None else min(display_width(pixels), image.shape[1]))
        with self._lock:  # pages that want the same view and width share one message
            if wanted not in self._messages:
                self._messages[wanted] = self._encode(image, wanted, panels)
            return self._messages[wanted]

    def _view(self, name: str) -> tuple[str, Image | None, dict[str, Any]]:
        """Returns the name of the shown view or `ALL_VIEWS`, its image, and the JSON values on the views in it.

        Args:
            name: requested view; without an image of it all views are shown side by side, if there are several.
        """
        frames = self._frames
        if name in frames or len(frames) < 2:
            view = name if name in frames else next(iter(frames), "")
            return view, frames.get(view), {"views": list(frames), "panels": []}
        image, begins_px = self._side_by_side
        height = next(iter(frames.values())).shape[0]
        panels = [
            {"view": view, "begins_px": column, "scale": height / frame.shape[0]}
            for (view, frame), column in zip(frames.items(), begins_px, strict=True)
        ]
        return ALL_VIEWS, image, {"views": list(frames), "panels": panels}

    @cached_property
    def _side_by_side(self) -> tuple[Image, list[int]]:
        return side_by_side(list(self._frames.values()))

    @cached_property
    def _frames(self) -> dict[str, Image]:
        """The images by view: those that the method reads first, in its order; empty for a notice."""
        update = self.update
        there = {**update.frames, **update.beside} if update.frames else {}
        return {view: there[view] for view in dict.fromkeys([*update.reads, *there]) if view in there}

    def _encode(self, image: Image | None, wanted: Wanted, panels: dict[str, Any]) -> bytes:
        """Returns the binary message: header, JSON and JPEG; its layout is in the description of this module.

        Args:
            image: (h, w) or (h, w, 3) image; None for a notice of the watchdog.
            wanted: name of the view, and width of the JPEG in pixels.
            panels: JSON values on the views in the image.
        """
        jpeg = b"" if image is None else _jpeg(image, wanted[1], self._quality)
        if self._numbers is None:  # the same for all images of the update
            values = update_values(self.update) | {"recent": self._recent}
            self._numbers = json.dumps(values, separators=(",", ":"), allow_nan=False).encode()
        panels |= {"view": wanted[0], "size": None if image is None else [image.shape[1], image.shape[0]]}
        # joins both JSON objects into one, without encoding the numbers again
        numbers = self._numbers[:-1] + b"," + json.dumps(panels, separators=(",", ":")).encode()[1:]
        update = self.update
        header = HEADER.pack(
            MAGIC, VERSION, HEADER.size, update.number & 0xFFFFFFFF, update.captured_ns, update.published_ns,
            len(numbers), len(jpeg),
        )  # fmt: skip
        return header + numbers + jpeg


def side_by_side(images: Sequence[Image]) -> tuple[Image, list[int]]:
    """Puts images beside each other.

    Args:
        images: at least one, (h, w) grey or (h, w, 3) RGB; the others are scaled to the height of the first.

    Returns:
        One image, of colour if any is, and the column at which each begins. The first keeps its size.
    """
    height = images[0].shape[0]
    colour = any(image.ndim == 3 for image in images)
    parts: list[Image] = []
    begins_px: list[int] = []
    for image in images:
        width = max(1, round(image.shape[1] * height / image.shape[0]))
        part = image
        if image.shape[0] != height:
            part = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        if colour and part.ndim == 2:
            part = np.repeat(part[:, :, None], 3, axis=2)
        if parts:
            parts.append(np.zeros((height, GAP_PX, *part.shape[2:]), np.uint8))
        begins_px.append(sum(earlier.shape[1] for earlier in parts))
        parts.append(part)
    return np.concatenate(parts, axis=1), begins_px


def _jpeg(image: Image, width: int, quality: int) -> bytes:
    """Encodes ``image``, (h, w) grey or (h, w, 3) RGB, as JPEG that is ``width`` pixels wide."""
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) if width < image.shape[1] else image
    coloured = cv2.cvtColor(small, cv2.COLOR_RGB2BGR) if small.ndim == 3 else small
    done, data = cv2.imencode(".jpg", coloured, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise RuntimeError(f"an image of {image.shape} could not be written as JPEG")
    return data.tobytes()


def point_of(update: LiveUpdate) -> Point:
    """Returns the point of the trace for an update."""
    estimate = update.estimate
    low, high = estimate.magnitude_interval_n.tolist()
    force = number(estimate.magnitude_n) if estimate.valid else None
    return update.captured_ns / 1e6, force, number(low), number(high)


def update_values(update: LiveUpdate) -> dict[str, Any]:
    """Returns the numbers of an update as JSON values; keys end in the unit."""
    estimate, tip = update.estimate, tip_force(update.estimate)
    return {
        "status": estimate.status.value,
        "detail": estimate.detail,
        "magnitude_n": number(estimate.magnitude_n),
        "interval_n": _numbers(estimate.magnitude_interval_n),
        "force_n": _numbers(estimate.force_n),
        "component_intervals_n": [_numbers(ends) for ends in estimate.interval_n],
        "tip": None
        if tip is None
        else {
            "axial_n": number(tip.axial_n),
            "lateral_n": number(tip.lateral_n),
            "angle_deg": number(tip.angle_deg, 1),
            "angle_error_deg": number(tip.angle_error_deg, 1),
        },
        "clinical": _clinical(update),
        "integral_running": update.integral_running,
        "zero": None if update.zero is None else _zero(update.zero, update.published_ns),
        "shape": None if estimate.shape is None else _shape(estimate.shape),
        "shapes_beside": {each.view: _shape_beside(each) for each in estimate.shapes_beside},
        "read": list(update.reads or update.frames),
        "health": _health(update),
    }


def _clinical(update: LiveUpdate) -> dict[str, Any] | None:
    """Returns contact state, probabilities, times and force-time integral as JSON values; None if not known."""
    state = update.clinical
    if state is None:
        return None
    return {
        "contact": state.contact.value,
        "contact_class": state.contact_class.value,
        "in_contact": number(state.in_contact),
        "above_limit": number(state.above_limit),
        "elapsed_s": number(state.elapsed_s, 2),
        "unknown_s": number(state.unknown_s, 2),
        "window_share": number(state.window_share, 3),
        "integral_g_s": number(state.integral_g_s, 1),
        "integral_interval_g_s": [number(end, 1) for end in state.integral_interval_g_s],
    }


def _zero(zero: Zero, now_ns: int) -> dict[str, Any]:
    """Returns the zero of the force as the page receives it; ages are relative to ``now_ns`` on the engine's clock."""
    return {
        "magnitude_n": number(zero.magnitude_n),
        "offset_n": _numbers(zero.offset_n),
        "age_s": number((now_ns - zero.since_ns) * 1e-9, 1),
        "since_unix_s": number(zero.since_unix_s, 3),
        "by": zero.by,
        "confirmed": zero.confirmed,
        "contact": number(zero.contact, 2),
        "drift_n": number(zero.drift_n),
        "drift_age_s": None if zero.drift_ns is None else number((now_ns - zero.drift_ns) * 1e-9, 1),
    }


def _shape(shape: DetectedShape) -> dict[str, Any] | None:
    """Returns the detected catheter as JSON values in image pixels, with few points; None without a centreline."""
    if shape.centreline is None or shape.base is None:
        return None
    points = shape.centreline.points
    rows = np.unique(np.round(np.linspace(0, len(points) - 1, CENTRELINE_POINTS)).astype(int))
    return {
        "centreline_px": _pixels(points[rows]),
        "seen": None if shape.seen is None else shape.seen[rows].tolist(),
        "origin_px": _pixels(shape.base.origin_px),
        "axes_px": np.round(shape.base.axes_px, 4).tolist(),
        "diameter_px": number(shape.diameter_px, 1),
    }


def _shape_beside(beside: ShapeBeside) -> dict[str, Any] | None:
    found = _shape(beside.shape)
    if found is not None:  # in place of the axes of the image: x, y and z of the base frame
        found["axes_px"] = None if beside.axes_px is None else np.round(beside.axes_px, 4).tolist()
    return found


def _health(update: LiveUpdate) -> dict[str, Any]:
    """Returns the health of the run as JSON values, with the message of each sink that hangs or failed."""
    health = update.health
    failing: Mapping[str, str] = {
        name: "does not answer" if sink.hung else sink.message
        for name, sink in health.sinks.items()
        if sink.hung or sink.message
    }
    return {
        "frames_per_s": number(health.frames_per_s, 1),
        "dropped": health.dropped,
        "latency_p50_ms": number(1e3 * health.latency_p50_s, 1),
        "latency_p99_ms": number(1e3 * health.latency_p99_s, 1),
        "camera": health.camera,
        "reconnects": health.reconnects,
        "message": health.message,
        "starting": health.starting,
        "sinks": failing,
    }


def _numbers(values: FloatArray) -> list[float | None]:
    return [number(value) for value in values.tolist()]


def _pixels(points: FloatArray) -> list[Any]:
    return np.round(points, 1).tolist()
