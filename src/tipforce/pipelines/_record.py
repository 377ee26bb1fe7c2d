"""Events -> one recording: everything is kept as it came; clock map, tare and inertia are found and stored."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from ..alignment import (
    MAX_GAP_S,
    MAX_INERTIA_N,
    ClockChoice,
    DetectedShapes,
    ForceCorrections,
    OffsetChoice,
    TareChoice,
    changing_tare,
    contact_free_stretch,
    covered_frames,
    find_clock,
    find_plausible_force,
    inertia_left,
    pulling_force,
    tip_acceleration,
)
from ..errors import InputError, TimeError, TipforceError
from ..io import ClockMap, Fact, RecordingWriter, check_target
from ..types import Clock, Event, FloatArray, Frame, IntArray, SensorInfo, SessionInfo, Source
from ..vision import DetectedShape, VisionSettings
from ._run import Run, RunDetector
from ._summary import RecordingSummary, summarise_recording

Analysis = Literal["afterwards", "along"]

MIN_COVERED_SHARE = 0.9
"""Share of the images that usually have a force; with less a remark is given."""
_FEWEST = 5
"""Images with a force, without which an import is a mistake."""
_LARGE_N = 10.0
"""A catheter buckles long before; a larger force is in another unit or a typing error."""


@dataclass(frozen=True, slots=True)
class RecordingReport:
    """Result of a recording.

    Attributes:
        summary: summary of the file.
        remarks: sentences that a person should read.
    """

    summary: RecordingSummary
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Ended:
    """Facts that are known when a source has ended.

    Attributes:
        notes: metadata records by name.
        tare: start and end of a stretch without contact in s, or None.
    """

    notes: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    tare: tuple[float, float] | None = None


def refuse_target(target: Path, *, overwrite: bool, origin: str) -> None:
    """Checks, before the work, that a recording can be written.

    Args:
        target: its file.
        overwrite: whether a recording that exists may be replaced.
        origin: command that writes it, "record" for example.

    Raises:
        InputError: the name does not end in .mcap.
        FileFormatError: the file exists and may not be replaced.
        OutputError: nothing can be written there.
    """
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
    """Writes all events of a source to a recording as they come; then finds clock map, tare and inertia.

    Args:
        source: the source to record; it is entered here.
        target: the recording (.mcap).
        sensor: pose of the force sensor, in place of that of the source's metadata.
        tare: see `import_session`.
        offset_ms: see `import_session`. Where the clock map cannot be determined the recording is kept, and has no
            labels until it is stated.
        vision: how the catheter is detected for the clock map.
        lossless: keep images as PNG.
        jpeg_quality: quality of images that are kept as JPEG, 1 to 100.
        overwrite: replace a recording that is there already.
        clock: `RecordingWriter`'s.
        progress: gets the number of frames so far.
        analysis: "afterwards": the catheter is detected in the images as they are kept, once the source has ended, so
            that nothing keeps the writing waiting; "along": in the images as they came, for a source that waits.
        ended: called when the source has ended.

    Returns:
        Summary of the recording, and remarks on clock map, tare and inertia.

    Raises:
        InputError: ``target`` is no name for a recording, or ``tare`` does not fit the force; the events are
            kept in ``target``, without tare and clock map.
        FileFormatError: ``target`` exists.
        TimeError: force and images do not overlap; kept likewise.
        OutputError: the disk is full; the part written until then is kept in ``target``'s ``.part``, as after a kill.
    """
    target = Path(target)
    refuse_target(target, overwrite=overwrite, origin="record")
    info, settings = source.session_info, vision or VisionSettings()
    writer = RecordingWriter(
        target, info, lossless=lossless, jpeg_quality=jpeg_quality, clock=clock, overwrite=overwrite, origin="record"
    )
    with writer, source as events:
        if analysis == "along":
            remarks = write_run(writer, events, info, sensor, tare, ClockChoice(offset_ms), settings, progress)
        else:
            run = Run(progress)
            for event in events:
                writer.write(event)
                run.add(event)
            end = ended() if ended else Ended()
            for name, values in end.notes.items():
                writer.note(name, dict(values))
            try:
                # the clock map needs the catheter's shape in the images, and a force
                detector = RunDetector(info, settings) if offset_ms == "auto" and len(run.force[0]) else None
                if detector:
                    for frame in writer.written_frames():
                        detector.take(frame)
                clock_choice = ClockChoice(offset_ms)
                remarks, _ = _state_facts(writer, run, detector, info, sensor, end.tare or tare, clock_choice)
            except BaseException as error:  # the file is the only copy of the run; facts can be found again
                writer.close()
                if isinstance(error, TipforceError):
                    kept = f"{target} is kept, without tare and clock map"
                    if isinstance(error, InputError):
                        kept += f"; to make a copy with another tare: tipforce import {target} -o NEW.mcap --tare 0:5"
                    raise type(error)(f"{error}; {kept}") from None
                raise
    return RecordingReport(summarise_recording(target), tuple(remarks))


class RunWriter(Protocol):
    """Takes the events and the findings of a run, as `RecordingWriter` does."""

    def write(self, event: Event) -> object:
        """Takes the next event."""
        ...

    def state(self, fact: Fact | SensorInfo) -> None:
        """Takes a fact; the last one of its kind holds."""


def write_run(
    writer: RunWriter,
    events: Iterable[Event],
    info: SessionInfo,
    sensor: SensorInfo | None,
    tare: TareChoice,
    clock: ClockChoice,
    vision: VisionSettings,
    progress: Callable[[int], None] | None,
    names: tuple[str, str] | None = None,
    status: IntArray | None = None,
    knob: Callable[[ClockMap], Iterable[Event]] | None = None,
) -> list[str]:
    """Writes the events of a run and the facts found in them.

    The catheter is detected in the images as they come: for sources that wait, such as files.

    Args:
        writer: takes events and facts.
        events: all events, in order.
        info: metadata of the session.
        sensor: pose of the force sensor, in place of that in ``info``.
        tare: see `import_session`.
        clock: the stated offset of the clocks, or "auto".
        vision: how the catheter is detected for the clock map.
        progress: gets the number of frames so far.
        names: names of images and force log, where they come from files.
        status: (n,) status words of the force readings, 0 without an error.
        knob: gives the knob's readings that the force log's clock stamped, once its map is known.

    Returns:
        Remarks on clock map, tare and inertia.

    Raises:
        TimeError: images and force of files do not overlap, or their clock map cannot be determined. Of another source
            the recorded events are kept, without a map.
    """
    run, detector = Run(progress), RunDetector(info, vision) if clock.offset_ms == "auto" or names else None
    for event in events:
        writer.write(event)
        if detector and isinstance(event, Frame):
            detector.take(event)
        run.add(event)
    remarks, clocks = _state_facts(writer, run, detector, info, sensor, tare, clock, names, status)
    for event in knob(clocks) if knob else ():
        writer.write(event)
    return remarks


def _state_facts(
    writer: RunWriter,
    run: Run,
    detector: RunDetector | None,
    info: SessionInfo,
    sensor: SensorInfo | None,
    tare: TareChoice,
    clock: ClockChoice,
    files: tuple[str, str] | None = None,
    status: IntArray | None = None,
) -> tuple[list[str], ClockMap]:
    """Finds pose, plausible readings, tare, inertia and clock map of a run, in this order, and stores each.

    Args:
        writer: takes the facts.
        run: stamps and readings of the events that were written.
        detector: the shapes in the images; None where the clock map does not need them.
        info: metadata of the session.
        sensor: pose of the force sensor, in place of that in ``info``.
        tare: see `import_session`.
        clock: the stated offset of the clocks, or "auto".
        files: names of images and force log, where they come from files.
        status: (n,) status words of the force readings, 0 without an error.

    Returns:
        Remarks for people, and the clock map; that of one clock without force readings.

    Raises:
        InputError, TimeError: see `write_run` and `record`.
    """
    names = files or ("the images", "the force")
    remarks: list[str] = []
    stamps, force = run.force
    if not len(stamps):
        return remarks, ClockMap()
    shapes = DetectedShapes(run.stamps(None)) if detector is None else detector.of_run(run)
    frames = shapes.frame_ns
    _check_overlap(names, frames, stamps)
    pose = sensor or info.sensor
    if pose.angle_deg is None or pose.reads is None:
        remarks.append(
            "the pose of the force sensor is not stated: its x axis is taken along the catheter's base, its "
            "readings as tip-on-tissue; see sensor.angle_deg and sensor.reads in bench.toml"
        )
        pose = replace(pose, angle_deg=pose.angle_deg or 0.0, reads=pose.reads or "tip-on-tissue")
    if tare == "auto" and pose.no_contact_s is not None:
        tare = pose.no_contact_s
    writer.state(pose)
    stage = run.stage
    try:
        plausible, level, inertia = find_plausible_force(
            stamps, force, stage, tare, remarks, status=status, moving_mass_kg=pose.moving_mass_kg, range_n=pose.range_n
        )
    except InputError as error:
        raise InputError(f"{files[1]}: {error}" if files else str(error)) from None
    force = plausible.corrected(stamps, force)
    writer.state(plausible)
    writer.state(level)
    most_n = float(np.nanmax(np.abs(force - level.force_n)))
    if most_n > _LARGE_N:
        remarks.append(f"the force log holds up to {most_n:.3g} N: check sensor.log.force_unit and its rows")
    corrections = ForceCorrections(pose, level, inertia, stage, plausible)
    # events of one program run on one clock; files may come from several
    shares = files is None or info.stage.clock == "camera"
    clocks, inertia = find_clock(
        shapes, info, stamps, force, corrections, clock, remarks, stage_shares=shares, nominal_rate=files is not None
    )
    writer.state(clocks)
    corrections = replace(corrections, inertia=inertia)
    writer.state(inertia)
    _check_tare(writer, clocks.force_ns(frames), shapes.shapes, stamps, force, corrections)
    metres_per_px = info.view(shapes.view).metres_per_px or 0.0
    remaining_n, source = _remaining_inertia(shapes, stamps, force, corrections, clocks, metres_per_px)
    try:
        inertia_remarks = _check_inertia(corrections, remaining_n, source, names[1])
    except InputError:  # the file is kept, but no reading may become a label
        writer.state(plausible.without(stamps, np.ones(len(stamps), np.bool_)))
        raise
    if inertia_remarks:
        remarks += inertia_remarks
        writer.state(replace(inertia, detail=inertia_remarks[0]))
    if clocks.how == "refused":
        why = f"how the camera's clock maps to that of {names[1]} cannot be determined: {clocks.detail}"
        if files:
            raise TimeError(f"{names[0]}: {why}. {_STATE_IT}; nothing was written")
        return [*remarks, f"{why}; the recording has no labels until it is stated"], clocks
    return [*remarks, *_check_cover(names, frames, stamps[plausible.usable(stamps)], clocks)], clocks


_STATE_IT = (
    'State offset_ms="none" if both share one clock, offset_ms="start" if both began together, or offset_ms=MS (camera '
    "minus force clock at the log's first row), and rate=RATE where the frame rate of the file is not the true one "
    "(true over stated: 0.8 if 24 images a second were taken and the file says 30)"
)
_MIN_INERTIA_N = 3e-3
"""Inertia of which less remains is not worth a remark: the noise of a good sensor."""


def _remaining_inertia(
    shapes: DetectedShapes,
    stamps: IntArray,
    force: FloatArray,
    corrections: ForceCorrections,
    clocks: ClockMap,
    metres_per_px: float,
) -> tuple[float, str]:
    """Estimates the inertia of the moving sensor that is still in the labels.

    It comes from the readings of the contact-free stretch; where nothing was removed, from the tip's acceleration in
    the images, too: the stage may have been at rest in that stretch.

    Args:
        shapes: detected shapes of the catheter.
        stamps: (n,) stamps of the force readings, ns.
        force: (n, 3) readings of the force, N.
        corrections: tare, inertia and motion of the stage.
        clocks: map between the clocks of camera and force.
        metres_per_px: scale of the images; 0 where it is not known.

    Returns:
        Inertia in the labels, root mean square in N, and the source of that figure; 0 and "" if it is unknown.
    """
    remaining_n = inertia_left(stamps, force, corrections.stage, corrections.tare, corrections.inertia)
    mass_kg = corrections.sensor.moving_mass_kg if corrections.sensor else None
    by_readings = "as the readings in the contact-free stretch show"
    if not mass_kg or corrections.inertia.how == "estimated" or remaining_n > MAX_INERTIA_N:
        return remaining_n, by_readings
    if metres_per_px and clocks.how != "refused":
        acceleration_m_per_s2 = tip_acceleration(clocks.force_ns(shapes.frame_ns), shapes.shapes, metres_per_px)
        if (by_images_n := mass_kg * acceleration_m_per_s2) > 0.0:
            return max(remaining_n, by_images_n), "as the tip's acceleration in the images shows"
    return (remaining_n, by_readings) if remaining_n > _MIN_INERTIA_N else (0.0, "")


def _check_inertia(found: ForceCorrections, left_n: float, source: str, name: str) -> list[str]:
    """Returns remarks on the inertia that was removed without the stage's log, and on its rest in the labels.

    Args:
        found: corrections of the force log.
        left_n: inertia in the labels, N.
        source: origin of that figure.
        name: name of the force log.

    Raises:
        InputError: the labels would hold more than `MAX_INERTIA_N` of a mass that moves with the sensor.
    """
    mass_kg, stage = found.sensor.moving_mass_kg if found.sensor else None, found.stage.names
    mass = f"the {1e3 * mass_kg:.0f} g that move with the sensor" if mass_kg else "the mass that moves with the sensor"
    why = f" ({found.inertia.detail})" if found.inertia.detail else ""
    remedy = "check that the stage's log belongs to this run" if stage else "add the stage's log as a further file"
    size = f"{1e3 * left_n:.0f} mN (root mean square) of the inertia of {mass}"
    if left_n > MAX_INERTIA_N and (mass_kg or (mass_kg is None and stage)):
        raise InputError(
            f"{name}: the labels would hold {size}, {source}; at most {1e3 * MAX_INERTIA_N:.0f} mN are "
            f"allowed, and it cannot be removed{why}. {remedy[0].upper()}{remedy[1:]}, or state a contact-free stretch "
            "in which the stage beats as later on, tare=(START, END), or sensor.moving_mass_kg = 0 in bench.toml where "
            "nothing moves with the sensor or such labels are good enough"
        )
    remarks: list[str] = []
    if found.inertia.beat_hz:
        part = "the rest of the inertia after the stage's log" if found.inertia.axes else "the inertia"
        size_n = math.sqrt(0.5 * float(np.sum(found.inertia.beat_n**2, axis=(0, 1)).max()))
        remarks.append(
            f"{part} of {mass}, {1e3 * size_n:.0f} mN (root mean square), is removed as the contact-free stretch shows "
            f"it, at {60.0 * found.inertia.beat_hz:.1f} beats a minute; {1e3 * left_n:.1f} mN remain there"
        )
    elif left_n > (_MIN_INERTIA_N if mass_kg or stage else MAX_INERTIA_N):
        remarks.append(f"the labels hold {size}, {source}{why}; to remove it, {remedy}")
    elif mass_kg and not source:
        remarks.append(
            f"the inertia of {mass} is not removed{why}, and how much of it the labels hold is not known: {remedy}, or "
            "state views.NAME.metres_per_px in bench.toml to see how much it may be"
        )
    return remarks


def _check_tare(
    writer: RunWriter,
    frame_ns: IntArray,
    shapes: Sequence[DetectedShape],
    reading_ns: IntArray,
    force_n: FloatArray,
    found: ForceCorrections,
) -> None:
    """Checks that the tip was free during the tare: by the force log alone, then by the shapes in the images.

    Where it was in contact all labels would be wrong by the force of that contact. Therefore, before the error is
    raised, the finding is stored, and with it that no reading is used for labels.

    Args:
        writer: takes the finding.
        frame_ns: (n,) stamps of the images in ns, on the clock of the force log.
        shapes: (n) shapes in the images.
        reading_ns: (m,) stamps of the force readings in ns.
        force_n: (m, 3) force readings in N, before the tare is subtracted; NaN where they are not used.
        found: corrections of the force log: tare, inertia, pose of the sensor, movement of the stage.

    Raises:
        InputError: the tip was in contact during the tare.
    """
    if not found.tare.stretches_s or found.sensor is None:
        return
    mass_kg = found.sensor.moving_mass_kg
    shown_by_log = changing_tare(reading_ns, force_n, found.stage, found.tare, found.inertia, mass_kg)
    contact = shown_by_log or pulling_force(frame_ns, shapes, reading_ns, force_n, found)
    if contact is None:
        return
    every_reading = np.ones(len(reading_ns), np.bool_)
    plausible = found.plausibility.without(reading_ns, every_reading)
    writer.state(replace(plausible, findings=(*plausible.findings, contact)))
    free_s = contact_free_stretch(reading_ns, force_n, found.stage, mass_kg) if shown_by_log else None
    example = f", for example tare=({free_s[0]:g}, {free_s[1]:g})" if free_s else ""
    raise InputError(
        f"tare: the tip seems to be in contact at {contact.start_s:g} to {contact.end_s:g} s of the force log: "
        f"{contact.detail}; state a stretch without contact, tare=(START, END){example}, "
        """or tare="none" if the sensor's zero needs no correction"""
    )


def _check_overlap(names: tuple[str, str], frames: IntArray, force: IntArray) -> None:
    """Checks that images and force were recorded at the same time, before the clock map is searched.

    Args:
        names: names of images and force log, for the message.
        frames: (n,) sorted stamps of the images, ns.
        force: (m,) sorted stamps of the force readings, ns.

    Raises:
        TimeError: they do not overlap.
    """
    if len(frames) and min(frames[-1], force[-1]) <= max(frames[0], force[0]):
        raise TimeError(
            f"{names[1]}: its {force[0] * 1e-9:.3f} to {force[-1] * 1e-9:.3f} s do not overlap with {names[0]}, "
            f"{frames[0] * 1e-9:.3f} to {frames[-1] * 1e-9:.3f} s; check sensor.log.time_unit, or state "
            'offset_ms="start" where both began together'
        )


def _check_cover(names: tuple[str, str], frames: IntArray, force: IntArray, clock: ClockMap) -> list[str]:
    """Counts the images that get a force, and returns a remark where many get none.

    Args:
        names: names of images and force log.
        frames: (n,) stamps of the images in ns, on the camera's clock.
        force: (m,) stamps of the usable force readings in ns, on their own clock.
        clock: map between both clocks.

    Raises:
        TimeError: almost no image gets a force: the clocks or the files do not go together.
    """
    count = int(covered_frames(clock.force_ns(frames), force).sum())
    if count >= MIN_COVERED_SHARE * len(frames):
        return []
    moved = f", moved by the clock offset of {clock.offset_ms:+.1f} ms," if clock.offset_ns else ""
    spans = (
        f"{force[0] * 1e-9:.3f} to {force[-1] * 1e-9:.3f} s of the force{moved} against {frames[0] * 1e-9:.3f} to "
        f"{frames[-1] * 1e-9:.3f} s of the images"
    )
    step_s = float(np.median(np.diff(force))) * 1e-9 if len(force) > 1 else 0.0
    rare = f"; its readings are {step_s:.3g} s apart, at most {MAX_GAP_S:g} s are allowed" if step_s > MAX_GAP_S else ""
    if count < min(_FEWEST, len(frames)):
        raise TimeError(
            f"{names[1]}: gives a force to {count} of the {len(frames)} images of {names[0]}: {spans}{rare}; check "
            'sensor.log.time_unit and offset_ms, or state offset_ms="start" where both began together'
        )
    return [f"only {count} of {len(frames)} images have a force: {spans}{rare}; the others are no samples"]
