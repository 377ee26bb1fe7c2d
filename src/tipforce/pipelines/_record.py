"""Events -> one recording: everything is kept as it came; offset, tare and inertia are found and stored beside it."""

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from ..alignment import (
    MAX_GAP_S,
    ForceCorrections,
    OffsetChoice,
    StageMotion,
    TareChoice,
    covered_frames,
    find_offset,
    find_tare_and_inertia,
)
from ..errors import InputError, TimeError
from ..io import RecordingWriter, check_target
from ..types import STAGE, Clock, Event, FloatArray, Frame, Image, IntArray, SensorInfo, SessionInfo, Source, Wrench
from ..vision import DetectedShape, ShapeDetector, VisionSettings, auto_calibrate
from ._summary import RecordingSummary, summarise_recording

__all__ = ["RecordingReport", "record", "refuse_target", "write_run"]

_COVERED = 0.9
"""Share of the images that usually have a force; with less a person is told."""
_FEWEST = 5
"""Images with a force, without which an import is a mistake."""
_LARGE_N = 10.0
"""A catheter buckles long before; what is more is another unit or a slip of the pen."""
_FIRST, _EVERY = 50, 5
"""Frames on which vision is calibrated first, every fifth of them."""
_KEPT = 16
"""Images from all over the run so far on which it is calibrated again, whenever the run has doubled."""


@dataclass(frozen=True, slots=True)
class RecordingReport:
    """What was written, and in ``remarks`` what a person should know of it."""

    summary: RecordingSummary
    remarks: tuple[str, ...]


def refuse_target(target: Path, *, overwrite: bool, origin: str) -> None:
    """Raises InputError where ``target`` is no recording's name, FileFormatError where it stands already."""
    if target.suffix != ".mcap":
        raise InputError(f"{target}: a recording ends in .mcap; name it {target.with_suffix('.mcap').name}")
    check_target(target, overwrite=overwrite, origin=origin)


def record(
    source: Source,
    target: Path | str,
    *,
    sensor: SensorInfo | None = None,
    tare: TareChoice = "auto",
    offset_ms: OffsetChoice = "auto",
    vision: VisionSettings | None = None,
    lossless: bool = False,
    jpeg_quality: int = 90,
    overwrite: bool = False,
    clock: Clock | None = None,
    progress: Callable[[int], None] | None = None,
) -> RecordingReport:
    """Write all events of ``source`` to ``target`` (.mcap), then what is found of offset, tare and inertia.

    ``progress`` gets the number of frames so far; ``clock`` is `RecordingWriter`'s. What was recorded before a kill is
    kept in ``target``'s ``.part``. Raises InputError, FileFormatError, TimeError.
    """
    target = Path(target)
    refuse_target(target, overwrite=overwrite, origin="record")
    with source as events:
        writer = RecordingWriter(
            target,
            source.session_info,
            lossless=lossless,
            jpeg_quality=jpeg_quality,
            clock=clock,
            overwrite=overwrite,
            origin="record",
        )
        with writer:
            remarks = write_run(
                writer, events, source.session_info, sensor, tare, offset_ms, vision or VisionSettings(), progress
            )
    return RecordingReport(summarise_recording(target), tuple(remarks))


def write_run(
    writer: RecordingWriter,
    events: Iterable[Event],
    info: SessionInfo,
    sensor: SensorInfo | None,
    tare: TareChoice,
    offset_ms: OffsetChoice,
    vision: VisionSettings,
    progress: Callable[[int], None] | None,
    names: tuple[str, str] = ("the images", "the force"),
) -> list[str]:
    """Write ``events`` and the facts found; returns remarks. ``names`` of images and force log, for TimeError."""
    remarks: list[str] = []
    run = _Run(events, info, vision, look=offset_ms == "auto", progress=progress)
    for event in run:
        writer.write(event)
    stamps, force = run.force
    if not len(stamps):
        return remarks
    _check_overlap(names, run.stamp_ns, stamps)
    pose = sensor or info.sensor
    if pose.angle_deg is None or pose.reads is None:
        remarks.append(
            "the pose of the force sensor is not stated: its x axis is taken to lie along the catheter's base, its "
            "readings as tip-on-tissue; see sensor.angle_deg and sensor.reads in bench.toml"
        )
        pose = replace(pose, angle_deg=pose.angle_deg or 0.0, reads=pose.reads or "tip-on-tissue")
    if tare == "auto" and pose.no_contact_s is not None:
        tare = pose.no_contact_s
    writer.state(pose)
    stage = run.stage
    level, inertia = find_tare_and_inertia(stamps, force, stage, tare, remarks)
    writer.state(level)
    writer.state(inertia)
    most_n = float(np.nanmax(np.abs(force - level.force_n)))
    if most_n > _LARGE_N:
        remarks.append(f"the force log holds up to {most_n:.3g} N: check sensor.log.force_unit and its rows")
    found = ForceCorrections(pose, level, inertia, stage)
    offset = find_offset(run.stamp_ns, run.shapes, info, run.view, stamps, force, found, offset_ms, remarks, run.blind)
    writer.state(offset)
    return [*remarks, *_check_cover(names, run.stamp_ns, stamps, offset.offset_ns)]


class _Run:
    """Passes events on; remembers the frames' stamps, readings, the stage, and, where asked, the catheter's shape."""

    def __init__(
        self,
        events: Iterable[Event],
        info: SessionInfo,
        settings: VisionSettings,
        *,
        look: bool,
        progress: Callable[[int], None] | None,
    ) -> None:
        self._events, self._context, self._settings, self._look, self._progress = (
            events, info, settings, look, progress,
        )  # fmt: skip
        self.blind = ""
        """Why no catheter is detected at all, or empty."""
        self.shapes: list[DetectedShape] = []
        self.view = settings.view
        self._kept: list[Image] = []
        self._every = _EVERY
        self._frames: list[int] = []
        self._count = 0
        self._force_ns, self._force_n = array("q"), array("d")  # an hour at 1 kHz takes 115 MB
        self._stage: list[tuple[int, Mapping[str, float]]] = []

    def __iter__(self) -> Iterator[Event]:
        events, detect = iter(self._events), None
        if self._look:
            head = _head(events)
            try:
                self.view = _view_among(head, self._settings.view)
                images = [event.image for event in head if isinstance(event, Frame) and event.view == self.view]
                detect = ShapeDetector(
                    auto_calibrate(self._settings, images[::_EVERY], self._context, whole=False)
                ).detect
            except InputError as error:  # the recording is worth having without its clock offset
                self.blind = str(error)
            events = chain(head, events)
        for event in events:
            yield event
            if isinstance(event, Frame):
                self._add_frame(event, detect)
                if detect is not None and event.view == self.view:
                    detect = self._calibrated_again(event.image) or detect
            elif isinstance(event, Wrench):
                self._force_ns.append(event.stamp_ns)
                self._force_n.extend(event.force_n)
            elif event.stream == STAGE:
                self._stage.append((event.stamp_ns, event.values))

    def _add_frame(self, frame: Frame, detect: Callable[[Image], DetectedShape] | None) -> None:
        self._count += 1
        if detect is None or frame.view == self.view:
            self._frames.append(frame.stamp_ns)
        if detect is not None and frame.view == self.view:
            self.shapes.append(detect(frame.image))
        if self._progress:
            self._progress(self._count)

    def _calibrated_again(self, image: Image) -> Callable[[Image], DetectedShape] | None:
        """A way of looking that knows more of the run: while the catheter stands still, what lies beneath it does."""
        if (len(self.shapes) - 1) % self._every == 0:
            self._kept.append(image)
        if len(self._kept) < 2 * _KEPT:
            return None
        self._kept, self._every = self._kept[::2], 2 * self._every
        try:
            return ShapeDetector(auto_calibrate(self._settings, self._kept, self._context, whole=False)).detect
        except InputError:
            return None

    @property
    def stamp_ns(self) -> IntArray:
        """(n,) stamps of the frames so far: of those that were looked at, or of all."""
        return np.array(self._frames, dtype=np.int64)

    @property
    def force(self) -> tuple[IntArray, FloatArray]:
        """(n,) stamps and (n, 3) readings so far."""
        return np.frombuffer(self._force_ns, np.int64), np.frombuffer(self._force_n).reshape(-1, 3)

    @property
    def stage(self) -> StageMotion:
        """How the stage moved, as far as it said so."""
        return StageMotion.of(self._stage)


def _head(events: Iterator[Event]) -> list[Event]:
    """Events up to the frame that completes those on which vision is calibrated, of whatever view."""
    head: list[Event] = []
    counts: Counter[str] = Counter()
    for event in events:
        head.append(event)
        if isinstance(event, Frame):
            counts[event.view] += 1
            if counts[event.view] == _FIRST:
                break
    return head


def _view_among(head: Iterable[Event], wanted: str) -> str:
    """The view that is looked at: ``wanted``, or where no image is of it the one that came first."""
    views = dict.fromkeys(event.view for event in head if isinstance(event, Frame))
    return wanted if wanted in views else next(iter(views), wanted)


def _check_overlap(names: tuple[str, str], frames: IntArray, force: IntArray) -> None:
    if len(frames) and min(frames[-1], force[-1]) <= max(frames[0], force[0]):
        raise TimeError(
            f"{names[1]}: its {force[0] * 1e-9:.3f} to {force[-1] * 1e-9:.3f} s do not overlap with {names[0]}, "
            f"{frames[0] * 1e-9:.3f} to {frames[-1] * 1e-9:.3f} s; check sensor.log.time_unit, or state "
            'offset_ms="start" where both began together'
        )


def _check_cover(names: tuple[str, str], frames: IntArray, force: IntArray, offset_ns: int) -> list[str]:
    """A remark where many images get no force. Raises TimeError where almost none gets one."""
    count = int(covered_frames(frames, force + offset_ns).sum())
    if count >= _COVERED * len(frames):
        return []
    moved = f", moved by the clock offset of {offset_ns * 1e-6:+.1f} ms," if offset_ns else ""
    spans = (
        f"{force[0] * 1e-9:.3f} to {force[-1] * 1e-9:.3f} s of the force{moved} against {frames[0] * 1e-9:.3f} to "
        f"{frames[-1] * 1e-9:.3f} s of the images"
    )
    step_s = float(np.median(np.diff(force))) * 1e-9 if len(force) > 1 else 0.0
    rare = f"; its readings lie {step_s:.3g} s apart, at most {MAX_GAP_S:g} s are allowed" if step_s > MAX_GAP_S else ""
    if count < min(_FEWEST, len(frames)):
        raise TimeError(
            f"{names[1]}: gives a force to {count} of the {len(frames)} images of {names[0]}: {spans}{rare}; check "
            'sensor.log.time_unit and offset_ms, or state offset_ms="start" where both began together'
        )
    return [f"only {count} of {len(frames)} images have a force: {spans}{rare}; the others are no samples"]
