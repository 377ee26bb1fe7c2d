"""Events -> one recording: everything is kept as it came; offset, tare and inertia are found and stored beside it."""

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..alignment import (
    MAX_GAP_S,
    ForceCorrections,
    OffsetChoice,
    StageMotion,
    TareChoice,
    changing_tare,
    contact_free_stretch,
    covered_frames,
    find_offset,
    find_plausible_force,
    pulling_force,
)
from ..errors import InputError, TimeError, TipforceError
from ..io import RecordingWriter, check_target
from ..types import STAGE, Clock, Event, FloatArray, Frame, Image, IntArray, SensorInfo, SessionInfo, Source, Wrench
from ..vision import DetectedShape, ShapeDetector, VisionSettings, auto_calibrate
from ._summary import RecordingSummary, summarise_recording

__all__ = ["Analysis", "Ended", "RecordingReport", "record", "refuse_target", "write_run"]

Analysis = Literal["afterwards", "along"]

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


@dataclass(frozen=True, slots=True)
class Ended:
    """What is known once a source has ended: metadata records by name, and a stretch without contact, or None."""

    notes: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    tare: tuple[float, float] | None = None


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
    analysis: Analysis = "afterwards",
    ended: Callable[[], Ended] | None = None,
) -> RecordingReport:
    """Write all events of ``source`` to ``target`` (.mcap) as they come; then find offset, tare and inertia.

    Args:
        source: what is recorded; it is entered here.
        target: the recording (.mcap).
        sensor: pose of the force sensor, in place of that of the source's metadata.
        tare: see `import_session`.
        offset_ms: see `import_session`.
        vision: how the catheter is detected for the clock offset.
        lossless: keep images as PNG.
        jpeg_quality: of images that are kept as JPEG.
        overwrite: replace a recording that is there already.
        clock: `RecordingWriter`'s.
        progress: gets the number of frames so far.
        analysis: "afterwards": the catheter is detected in the images as they are kept, once the source has ended, so
            that nothing keeps the writing waiting; "along": in the images as they came, for a source that waits.
        ended: called when the source has ended.

    Raises:
        InputError: ``target`` is no name for a recording, or ``tare`` does not fit the force; what the source gave is
            kept in ``target``, without tare and clock offset.
        FileFormatError: ``target`` stands already.
        TimeError: force and images do not overlap; kept likewise.
        OutputError: the disk is full; what was written until then is kept in ``target``'s ``.part``, as after a kill.
    """
    target = Path(target)
    refuse_target(target, overwrite=overwrite, origin="record")
    info, settings = source.session_info, vision or VisionSettings()
    writer = RecordingWriter(
        target,
        info,
        lossless=lossless,
        jpeg_quality=jpeg_quality,
        clock=clock,
        overwrite=overwrite,
        origin="record",
    )
    with writer, source as events:
        if analysis == "along":
            remarks = write_run(writer, events, info, sensor, tare, offset_ms, settings, progress)
        else:
            run = _Run(progress)
            for event in events:
                writer.write(event)
                run.add(event)
            end = ended() if ended else Ended()
            for name, values in end.notes.items():
                writer.note(name, dict(values))
            try:
                sight = _Sight(info, settings) if offset_ms == "auto" and len(run.force[0]) else None
                if sight:
                    for frame in writer.written_frames():
                        sight.take(frame)
                remarks = _state_facts(writer, run, sight, info, sensor, end.tare or tare, offset_ms)
            except BaseException as error:  # what was written is the only copy of the run; facts can be found again
                writer.close()
                if isinstance(error, TipforceError):
                    raise type(error)(f"{error}; {target} is kept, without tare and clock offset") from None
                raise
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
    status: IntArray | None = None,
) -> list[str]:
    """Write ``events`` and the facts found; returns remarks. ``names`` of images and force log, for TimeError.

    ``status`` (n,): status words of the readings, 0 without an error.
    The catheter is detected in the images as they come: for sources that wait, such as files.
    """
    run, sight = _Run(progress), _Sight(info, vision) if offset_ms == "auto" else None
    for event in events:
        writer.write(event)
        if sight and isinstance(event, Frame):
            sight.take(event)
        run.add(event)
    return _state_facts(writer, run, sight, info, sensor, tare, offset_ms, names, status)


def _state_facts(
    writer: RecordingWriter,
    run: "_Run",
    sight: "_Sight | None",
    info: SessionInfo,
    sensor: SensorInfo | None,
    tare: TareChoice,
    offset_ms: OffsetChoice,
    names: tuple[str, str] = ("the images", "the force"),
    status: IntArray | None = None,
) -> list[str]:
    """Find pose, plausible readings, tare, inertia and clock offset, and store them; returns remarks."""
    remarks: list[str] = []
    stamps, force = run.force
    if not len(stamps):
        return remarks
    if sight:
        sight.finish()
    view, shapes, blind = (sight.view, sight.shapes, sight.blind) if sight else ("camera", [], "")
    frames = run.stamps(view if sight and not blind else None)
    _check_overlap(names, frames, stamps)
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
    plausible, level, inertia = find_plausible_force(stamps, force, stage, tare, remarks, status=status)
    force = plausible.corrected(stamps, force)
    writer.state(plausible)
    writer.state(level)
    writer.state(inertia)
    most_n = float(np.nanmax(np.abs(force - level.force_n)))
    if most_n > _LARGE_N:
        remarks.append(f"the force log holds up to {most_n:.3g} N: check sensor.log.force_unit and its rows")
    found = ForceCorrections(pose, level, inertia, stage, plausible)
    _check_tare(writer, frames, shapes, stamps, force, found)
    offset = find_offset(frames, shapes, info, view, stamps, force, found, offset_ms, remarks, blind)
    writer.state(offset)
    return [*remarks, *_check_cover(names, frames, stamps[plausible.usable(stamps)], offset.offset_ns)]


def _check_tare(
    writer: RecordingWriter,
    frames: IntArray,
    shapes: Sequence[DetectedShape],
    stamps: IntArray,
    force: FloatArray,
    facts: ForceCorrections,
) -> None:
    """Raises InputError where the tip was in contact during the tare; no reading is then used for labels."""
    if not facts.tare.stretches_s or facts.sensor is None:
        return
    mass = facts.sensor.moving_mass_kg
    changing = changing_tare(stamps, force, facts.stage, facts.tare, facts.inertia, mass)
    contact = changing or pulling_force(frames, shapes, stamps, force, facts)
    if contact is None:
        return
    plausible = facts.plausibility.without(stamps, np.ones(len(stamps), np.bool_))
    writer.state(replace(plausible, findings=(*plausible.findings, contact)))
    other = contact_free_stretch(stamps, force, facts.stage, mass) if changing else None
    example = f", for example {other[0]:g}:{other[1]:g}" if other else ""
    raise InputError(
        f"tare: the tip seems to be in contact at {contact.start_s:g} to {contact.end_s:g} s of the force log: "
        f"{contact.detail}; state a stretch without contact, --tare START:END{example}, or --tare none if the sensor's "
        "zero needs no correction"
    )


class _Run:
    """What is remembered of the events that were written: stamps of the frames, readings of the force, the stage."""

    def __init__(self, progress: Callable[[int], None] | None) -> None:
        self._progress, self._count = progress, 0
        self._frames: list[tuple[int, str]] = []
        self._force_ns, self._force_n = array("q"), array("d")  # an hour at 1 kHz takes 115 MB
        self._stage: list[tuple[int, Mapping[str, float]]] = []

    def add(self, event: Event) -> None:
        """Remember ``event``."""
        if isinstance(event, Frame):
            self._frames.append((event.stamp_ns, event.view))
            self._count += 1
            if self._progress:
                self._progress(self._count)
        elif isinstance(event, Wrench):
            self._force_ns.append(event.stamp_ns)
            self._force_n.extend(event.force_n)
        elif event.stream == STAGE:
            self._stage.append((event.stamp_ns, event.values))

    def stamps(self, view: str | None) -> IntArray:
        """(n,) stamps of the frames of ``view``, or of all."""
        return np.array([stamp for stamp, name in self._frames if view in (None, name)], dtype=np.int64)

    @property
    def force(self) -> tuple[IntArray, FloatArray]:
        """(n,) stamps and (n, 3) readings."""
        return np.frombuffer(self._force_ns, np.int64), np.frombuffer(self._force_n).reshape(-1, 3)

    @property
    def stage(self) -> StageMotion:
        """How the stage moved, as far as it said so."""
        return StageMotion.of(self._stage)


class _Sight:
    """The catheter's shape in each frame of one view: the view that is asked for, or else that which comes first."""

    def __init__(self, info: SessionInfo, settings: VisionSettings) -> None:
        self._context, self._settings = info, settings
        self.blind = ""
        """Why no catheter is detected at all, or empty."""
        self.view = settings.view
        self.shapes: list[DetectedShape] = []
        self._detect: Callable[[Image], DetectedShape] | None = None
        self._head: list[Frame] | None = []
        self._counts: Counter[str] = Counter()
        self._kept: list[Image] = []
        self._every = _EVERY

    def take(self, frame: Frame) -> None:
        """The next frame; the first ones wait until there are enough to calibrate vision on."""
        if self._head is None:
            self._look(frame)
            return
        self._head.append(frame)
        self._counts[frame.view] += 1
        if self._counts[frame.view] == _FIRST:
            self.finish()

    def finish(self) -> None:
        """Look at the first frames, however few there are."""
        head, self._head = self._head, None
        if head is None:
            return
        if self.view not in self._counts:
            self.view = next((frame.view for frame in head), self.view)
        try:
            images = [frame.image for frame in head if frame.view == self.view]
            self._detect = self._calibrated(images[::_EVERY])
        except InputError as error:  # the recording is worth having without its clock offset
            self.blind = str(error)
        for frame in head:
            self._look(frame)

    def _calibrated(self, images: list[Image]) -> Callable[[Image], DetectedShape]:
        return ShapeDetector(auto_calibrate(self._settings, images, self._context, whole=False)).detect

    def _look(self, frame: Frame) -> None:
        if self._detect is None or frame.view != self.view:
            return
        self.shapes.append(self._detect(frame.image))
        self._detect = self._calibrated_again(frame.image) or self._detect

    def _calibrated_again(self, image: Image) -> Callable[[Image], DetectedShape] | None:
        """A way of looking that knows more of the run: while the catheter stands still, what lies beneath it does."""
        if (len(self.shapes) - 1) % self._every == 0:
            self._kept.append(image)
        if len(self._kept) < 2 * _KEPT:
            return None
        self._kept, self._every = self._kept[::2], 2 * self._every
        try:
            return self._calibrated(self._kept)
        except InputError:
            return None


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
