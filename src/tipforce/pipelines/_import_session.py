"""Video or images plus logs -> one recording; streams of different rate are merged in the order of their stamps."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..alignment import ClockChoice, OffsetChoice, TareChoice, stated_tare
from ..errors import FileFormatError, InputError, TimeError
from ..io import (
    Bag,
    ClockMap,
    DriveLog,
    FilesOfViews,
    FileSource,
    ForceLog,
    RecordingWriter,
    is_bag,
    logs_by_kind,
    open_bag,
    read_drive_log,
    read_force_log,
)
from ..types import JOINTS, STAGE, Actuation, ActuationInfo, Event, FloatArray, Frame, IntArray, SessionInfo, Wrench
from ..vision import VisionSettings
from ._estimate import session_info_from
from ._record import RecordingReport, refuse_target, write_run
from ._summary import summarise_recording

Logs = Path | str | Sequence[Path | str] | Mapping[str, Path | str] | None
"""A force log, several logs, or kind -> log."""

Readings = tuple[IntArray, dict[str, FloatArray]]
"""(n,) stamps, and (n,) values by name."""

_MAX_DRIVE_SHIFT_S = 0.1
"""A hand that turns the knob by 30 degrees a second turns it by 3 within this time."""
_KNOB_PERIOD_NS = 1e7
"""A knob moves by hand: one reading in 10 ms is plenty, and a thousand a second would double the file."""
_NO_TORQUE = np.full(3, np.nan)
_BLOCK = 1 << 14
"""Rows handed out at a time: a log may run for hours after the last frame."""


def merged(
    frames: Iterable[Event], force: tuple[IntArray, FloatArray] | None, drives: Mapping[str, Readings], shift_ns: int
) -> Iterator[Event]:
    """Merges images, forces and readings of drives in the order of their stamps.

    Args:
        frames: images, possibly with readings of drives, in order.
        force: stamps (n,) in ns and forces (n, 3) in N on the sensor's axes; None: no force.
        drives: stream -> stamps (m,) in ns and readings by name, (m,) each; NaN is left out.
        shift_ns: added to every stamp.

    Yields:
        The events with shifted stamps.
    """
    wrenches = _Feed(force[0] if force else None)
    feeds = [(stream, _Feed(stamps), values) for stream, (stamps, values) in drives.items()]

    def until(stamp_ns: int | None) -> Iterator[Event]:
        for stream, feed, values in feeds:
            for row, stamp in feed.take(stamp_ns):
                readings = {name: float(column[row]) for name, column in values.items() if not np.isnan(column[row])}
                if readings:
                    yield Actuation(stamp + shift_ns, readings, stream)
        for row, stamp in wrenches.take(stamp_ns):
            assert force is not None
            yield Wrench(stamp + shift_ns, force[1][row], _NO_TORQUE, "sensor")

    for event in frames:
        yield from until(event.stamp_ns)
        if shift_ns and isinstance(event, Frame):
            yield Frame(event.stamp_ns + shift_ns, event.image, event.view)
        elif shift_ns and isinstance(event, Actuation):
            yield Actuation(event.stamp_ns + shift_ns, event.values, event.stream)
        else:
            yield event
    yield from until(None)


class _Feed:
    """Hands out the rows of a stream up to a time."""

    def __init__(self, stamps_ns: IntArray | None) -> None:
        self._stamps = np.empty(0, np.int64) if stamps_ns is None else stamps_ns
        self._next = 0

    def take(self, stamp_ns: int | None) -> Iterator[tuple[int, int]]:
        """Yields (row, stamp) of the rows not yet taken, up to and with ``stamp_ns``; all of them for None."""
        end = len(self._stamps) if stamp_ns is None else int(np.searchsorted(self._stamps, stamp_ns, side="right"))
        while self._next < end:
            start = self._next
            self._next = min(end, start + _BLOCK)
            yield from enumerate(self._stamps[start : self._next].tolist(), start=start)


def import_session(
    frames: Path | str | Sequence[Path | str],
    logs: Logs,
    output: Path | str,
    *,
    bench: SessionInfo | Path | str | None = None,
    tare: TareChoice = "auto",
    offset_ms: OffsetChoice | Literal["start"] = "auto",
    rate: float | None = None,
    vision: VisionSettings | None = None,
    lossless: bool = False,
    jpeg_quality: int = 90,
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> RecordingReport:
    """Makes a recording of a video (or images) and its logs; it appears when it is whole.

    Readings are kept as the sensor gave them, on their own clock. Tare, the inertia of the mass that a moving sensor
    carries and the clock map (offset and rate) are found, stored beside them, and applied when labels are made. Where
    the map cannot be determined nothing is written.

    Args:
        frames: a video, DICOM file or folder of images; or several, one for each view, on one clock (see
            `io.FilesOfViews`); or a ROS bag (.bag, .db3, .mcap or a folder), whose topics ``bench`` names.
        logs: the force log; or several logs, of force, stage and knob, recognised by their columns (see
            `logs_by_kind`); or kind ("force", "stage", "knob") -> log. The stage's positions, NAME_m or NAME_mm,
            serve to take the sensor's inertia out.
        output: the recording (.mcap).
        bench: metadata of the session, or its ``bench.toml``: pose of the sensor, columns and units of its log,
            constant readings of drives.
        tare: "auto": as ``bench`` states, else found; "none"; or (start, end) in seconds of the force log.
        offset_ms: camera clock minus force clock; "auto": from the deflection; "none": one clock; "start": the first
            row of the force log belongs to the first frame.
        rate: true over stated frame rate; None: found with the offset, else 1.
        vision: how the catheter is detected for the clock map.
        lossless: keep images as PNG.
        jpeg_quality: quality of images that are kept as JPEG, 1 to 100.
        overwrite: replace an existing recording.
        progress: called with the current step and the share that is done.

    Returns:
        The recording's summary, and remarks that a person should read.

    Raises:
        FileFormatError, TableError: a file cannot be read; the message names file, line and column.
        TimeError: stamps are unsorted, the streams do not overlap, or their clock map cannot be determined.
        InputError: the rate is no positive number, the metadata are refused, or do not go together with the logs.
    """
    target, info = Path(output), session_info_from(bench)
    refuse_target(target, overwrite=overwrite, origin="import")
    clock = ClockChoice("none" if offset_ms == "start" else offset_ms, rate)
    views = [Path(frames)] if isinstance(frames, str | Path) else [Path(path) for path in frames]
    frames = views[0]
    # the logs, by kind
    bag, logs = _bag(frames, logs, info)
    by_kind = _by_kind(logs, info)
    force_log, knob_log, stage_log = (by_kind.get(kind) for kind in ("force", "knob", "stage"))
    knob_column = info.actuation.knob_column
    log = None if force_log is None else read_force_log(force_log, info.sensor.log, knob_column)
    info = info if info.name else replace(info, name=target.stem)
    remarks: list[str] = []
    if bag is not None:
        remarks += (f"{bag.path.name}: {remark}" for remark in bag.remarks)
        log = log or bag.force
    # the images
    if bag and bag.views:
        source = replace(bag, joints=None)
    else:
        source = FilesOfViews(views, info) if len(views) > 1 else FileSource(frames, {}, info)
        remarks += source.remarks
    if source.numbered and (log is not None or knob_log is not None or stage_log is not None):
        raise FileFormatError(
            f"{frames}: neither a table nor the names of the images say when they were taken, so a log cannot be "
            f"aligned with them; write {frames / 'stamps.csv'} with the columns file_name,stamp_ns"
        )
    first_ns = next(event.stamp_ns for event in source)
    if log is not None and offset_ms == "start":
        moved_ns = first_ns - int(log.stamp_ns[0])
        log = replace(log, stamp_ns=log.stamp_ns + moved_ns)
        remarks.append(f"the force log was moved by {moved_ns * 1e-9:.6f} s: its first row belongs to the first frame")
    drives = _drives(log, knob_column, knob_log, info.actuation, remarks, bag.joints if bag else None)
    stage = bag.stage if bag else None
    if stage_log is not None:
        stage = read_drive_log(stage_log, info.stage.log, "stage.log")
        remarks += (f"{stage_log.name}: {remark}" for remark in stage.remarks)
    if stage is not None:
        drives[STAGE] = stage.stamp_ns, stage.values
    starts = [first_ns, *(int(stamps[0]) for stamps, _ in drives.values())]
    starts += [] if log is None else [int(log.stamp_ns[0])]
    # the file's format has no time before zero; whole seconds keep the stamps readable
    shift_ns = max(0, -(min(starts) // 1_000_000_000)) * 1_000_000_000
    if shift_ns:
        remarks.append(f"all stamps were moved by {shift_ns // 1_000_000_000} s, so that none is before zero")
    if log is not None:
        name = force_log.name if force_log else bag.path.name if bag else ""
        remarks += (f"{name}: {said}" for said in (log.said, *log.remarks))
        if not isinstance(tare, str):
            stated_tare(log.stamp_ns, log.force_n, *tare)  # raises its error before a long video is read
    last_ns = first_ns

    def images() -> Iterator[Event]:
        """Yields the events of the source, and remembers the stamp of the last one."""
        nonlocal last_ns
        for event in source:
            last_ns = event.stamp_ns
            yield event

    # a knob in the force log has the clock of that log: it is written last, when the clock map is known
    knob_readings = drives.pop(JOINTS) if log is not None and log.knob is not None else None

    def knob(clock: ClockMap) -> Iterator[Event]:
        """Yields the readings of a knob in the force log, with stamps on the camera's clock."""
        if knob_readings is None:
            return
        stamps, values = knob_readings
        camera_ns = clock.camera_ns(stamps + shift_ns)
        usable = camera_ns >= 0
        readings = camera_ns[usable], {name: column[usable] for name, column in values.items()}
        yield from merged((), None, {JOINTS: readings}, 0)

    events = merged(images(), None if log is None else (log.stamp_ns, log.force_n), drives, shift_ns)
    writer = RecordingWriter(
        target, source.session_info, lossless=lossless, jpeg_quality=jpeg_quality, overwrite=overwrite, origin="import"
    )

    def report(count: int) -> None:
        if progress:
            progress("reading frames", min(count / max(source.frame_count, count), 1.0))

    try:
        names = (frames.name, str(force_log or (bag.path if bag else "")))
        run_remarks = write_run(
            writer,
            events,
            source.session_info,
            None,
            tare,
            clock,
            vision or VisionSettings(),
            report,
            names,
            None if log is None else log.status,
            knob,
        )
        origin = force_log or (bag.path if bag else frames)
        _check_drives(drives, (first_ns, last_ns), knob_log or origin, stage_log or origin)
        writer.note("tipforce.import", _origin(frames, force_log, knob_log, log, shift_ns))
        writer.close()
    except BaseException:
        writer.abandon()
        raise
    summary = summarise_recording(target)
    if log is not None and JOINTS in drives:
        stamps, values = drives[JOINTS]
        late = _late_drives(stamps + shift_ns, values, summary.info.clock_map, knob_log or origin, knob_log is None)
        run_remarks += [late] if late else []
    return RecordingReport(summary, (*remarks, *run_remarks))


def _bag(frames: Path, logs: Logs, info: SessionInfo) -> tuple[Bag | None, Logs]:
    """Returns the bag with the images, or the one among the logs, and the other logs; None without a bag.

    Raises:
        InputError: there is more than one bag.
    """
    paths = [] if logs is None or isinstance(logs, Mapping) else [logs] if isinstance(logs, str | Path) else list(logs)
    bags = [Path(path) for path in paths if is_bag(Path(path))]
    if is_bag(frames):
        bags.insert(0, frames)
    if len(bags) > 1:
        raise InputError(f"{bags[1]}: one bag is imported at a time, and {bags[0]} is one, too")
    if not bags:
        return None, logs
    images = bags[0] == frames
    return open_bag(bags[0], info, images=images), logs if images else [path for path in paths if Path(path) != bags[0]]


def _by_kind(logs: Logs, info: SessionInfo) -> dict[str, Path]:
    """Returns the logs by their kind, as they are stated or recognised by their columns."""
    if isinstance(logs, Mapping):
        return {kind: Path(path) for kind, path in logs.items()}
    paths = [] if logs is None else [logs] if isinstance(logs, str | Path) else list(logs)
    stated = {"force": info.sensor.log, "knob": info.actuation.log, "stage": info.stage.log}
    return logs_by_kind([Path(path) for path in paths], stated)


def _drives(
    log: ForceLog | None,
    column: str | None,
    knob_log: Path | None,
    actuation: ActuationInfo,
    remarks: list[str],
    joints: DriveLog | None,
) -> dict[str, Readings]:
    """Returns the readings of the catheter's drives as a stream; they come from one of three places, or from none.

    Args:
        log: the force log, which may have a column of the knob; None without one.
        column: name of that column in the metadata, or None.
        knob_log: a log of the knob alone, or None.
        actuation: metadata of the drives, with constant readings.
        remarks: gets the remarks on the knob's log.
        joints: readings of the drives in a ROS bag, or None.

    Returns:
        `JOINTS` -> stamps in ns and readings by name; empty where there are no readings.

    Raises:
        InputError: two places have the same drive.
    """
    if column and knob_log:
        raise InputError(
            "the knob's angle can come from actuation.knob_column or from a log of the knob, not from both"
        )
    readings: Readings | None = None
    if column and log is not None and log.knob is not None:
        name = column if column.rpartition("_")[0] else "knob_deg"  # a name that ends in its unit is kept
        period_ns = float(np.median(np.diff(log.stamp_ns))) if len(log.stamp_ns) > 1 else _KNOB_PERIOD_NS
        step = max(1, round(_KNOB_PERIOD_NS / max(period_ns, 1.0)))
        readings = log.stamp_ns[::step], {name: log.knob[::step]}
    elif knob_log:
        drive_log = read_drive_log(knob_log, actuation.log)
        readings = drive_log.stamp_ns, drive_log.values
        remarks += (f"{knob_log.name}: {remark}" for remark in drive_log.remarks)
    elif joints:
        readings = joints.stamp_ns, joints.values
    clash = set(readings[1] if readings else ()) & set(actuation.constant)
    if clash:
        raise InputError(f"{min(clash)} is stated as a constant and read from a log; state one of them")
    return {} if readings is None else {JOINTS: readings}


def _check_drives(drives: Mapping[str, Readings], frames: tuple[int, int], knob_log: Path, stage_log: Path) -> None:
    """Checks that each log of drives overlaps with the images: on another clock no reading would be used.

    Args:
        drives: stream -> stamps in ns and readings.
        frames: stamps of the first and the last image, ns.
        knob_log: file of the catheter's drives, for the message.
        stage_log: file of the stage, for the message.

    Raises:
        TimeError: a log does not overlap; one earlier reading is a constant, and is allowed.
    """
    for stream, (stamps, _) in drives.items():
        first, last = int(stamps[0]), int(stamps[-1])
        if first > frames[1] or (last < frames[0] and len(stamps) > 1):
            raise TimeError(
                f"{stage_log if stream == STAGE else knob_log}: its {first * 1e-9:.3f} to {last * 1e-9:.3f} s do not "
                f"overlap with the images, {frames[0] * 1e-9:.3f} to {frames[1] * 1e-9:.3f} s; bring its stamps to "
                "the camera's clock"
            )


def _late_drives(
    stamps: IntArray, values: Mapping[str, FloatArray], clock: ClockMap, log: Path, by_force_clock: bool
) -> str:
    """Returns a remark where the drives move and the clock map, which they do not use, would shift their readings.

    Args:
        stamps: (n,) stamps of the readings.
        values: name -> (n,) readings.
        clock: clock map between the force log and the camera.
        log: the file of the readings.
        by_force_clock: whether the stamps are those of the force.
    """
    moving = [name for name, readings in values.items() if np.nanmax(readings) > np.nanmin(readings)]
    shift_s = 1e-9 * float(np.abs(clock.camera_ns(stamps[[0, -1]]) - stamps[[0, -1]]).max())
    if not moving or shift_s < _MAX_DRIVE_SHIFT_S:
        return ""
    remedy = "bring its stamps to the camera's clock unless they are of that clock already"
    if by_force_clock:
        remedy = (
            "write it to a log of its own with stamps of the camera's clock, and import that beside it: "
            "`tipforce import VIDEO FORCE --knob FILE`"
        )
    return (
        f"{', '.join(moving)} of {log.name} is placed by the stamps as they are, but the force log's clock is up to "
        f"{shift_s:.2g} s from the camera's: {remedy}"
    )


def _origin(
    frames: Path, force_log: Path | None, knob_log: Path | None, log: ForceLog | None, shift_ns: int
) -> dict[str, str]:
    return {
        "frames": frames.name,
        "force_log": "" if force_log is None else force_log.name,
        "knob_log": "" if knob_log is None else knob_log.name,
        "columns": log.said if log else "",
        "stamps_moved_ns": json.dumps(shift_ns),
    }
