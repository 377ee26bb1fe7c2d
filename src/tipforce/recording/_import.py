"""Video or images plus force log -> one recording."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InputError, TimeError
from ..types import Context, Event, FloatArray, Frame, Image, IntArray
from ..vision import Sighting, Vision, VisionSettings, settle
from ._facts import ClockOffset, SensorPose, Tare
from ._files import refuse_existing
from ._forcelog import ForceColumns, ForceLog, read_force_log, read_knob_log
from ._merge import merged, overlap_ns
from ._sources import FileSource
from ._summary import RecordingSummary, summarise
from ._tare import find_tare, stated_tare
from ._timing import estimate_offset, shape_coordinates
from ._writer import RecordingWriter

__all__ = ["ForceColumns", "ImportReport", "import_run"]

Progress = Callable[[str, float], None]
_LOOK_S = 0.3
"""Largest clock offset that is looked for."""


@dataclass(frozen=True, slots=True)
class ImportReport:
    """What was written, and in ``remarks`` what a person should know of it."""

    summary: RecordingSummary
    remarks: tuple[str, ...]


def import_run(
    frames: Path | str,
    force_log: Path | str | None,
    target: Path | str,
    *,
    columns: ForceColumns | None = None,
    sensor: SensorPose | None = None,
    actuation: Mapping[str, float] | None = None,
    knob_column: str | None = None,
    knob_log: Path | str | None = None,
    tare: Literal["auto", "none"] | tuple[float, float] = "auto",
    offset_ms: Literal["auto", "none"] | float = "auto",
    align_start: bool = False,
    context: Context | None = None,
    vision: VisionSettings | None = None,
    lossless: bool = False,
    jpeg_quality: int = 90,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> ImportReport:
    """Write ``target`` (.mcap) from a video or a folder of images and a force log.

    Readings are kept as the sensor gave them, on their own clock; ``sensor`` (default: x along the base, reading
    tip-on-tissue), ``tare`` ("auto": found, or start and end in seconds of the force log) and clock offset (positive:
    the camera's clock is ahead; "auto": estimated from the deflection) are stored beside them and applied when labels
    are made. ``align_start``: the log's first row belongs to the first frame, for logs that count from another zero.
    ``knob_column``: of the force log, NAME_UNIT or else taken as degrees. ``target`` appears when it is whole.
    Raises FileFormatError, TableError, TimeError, InputError.
    """
    target = Path(target)
    if target.suffix != ".mcap":
        raise InputError(f"{target}: a recording ends in .mcap; name it {target.with_suffix('.mcap').name}")
    refuse_existing(target, overwrite=overwrite, origin="import")
    log = None if force_log is None else read_force_log(Path(force_log), columns, knob_column)
    source = FileSource(Path(frames), dict(actuation or {}), context or Context(target.stem))
    remarks: list[str] = []
    first_ns = next(event.stamp_ns for event in source)
    if log is not None and align_start:
        moved = first_ns - int(log.stamp_ns[0])
        log = ForceLog(log.stamp_ns + moved, log.force_n, log.knob, log.said)
        remarks.append(f"the force log was moved by {moved * 1e-9:.6f} s: its first row belongs to the first frame")
    drives = _drives(log, knob_column, knob_log, actuation)
    starts = [first_ns, *(int(stamps[0]) for stamps in _stamps(log, drives))]
    # the file's format has no time before zero; whole seconds keep the stamps readable
    shift_ns = max(0, -(min(starts) // 1_000_000_000)) * 1_000_000_000
    if shift_ns:
        remarks.append(f"all stamps were moved by {shift_ns // 1_000_000_000} s, so that none lies before zero")
    if log is not None:
        remarks.append(f"{Path(force_log or '').name}: {log.said}")
    seen = _Seen(source, vision or VisionSettings(), look=log is not None and offset_ms == "auto", progress=progress)
    writer = RecordingWriter(
        target, source.context, lossless=lossless, jpeg_quality=jpeg_quality, overwrite=overwrite, origin="import"
    )
    try:
        force = None if log is None else (log.stamp_ns, log.force_n)
        pose, level = sensor or SensorPose(), Tare()
        if log is not None:
            level = _tare(log, tare, remarks)
            writer.state(pose)
            writer.state(level)
        for event in merged(seen, force, drives, shift_ns):
            writer.write(event)
        if log is not None:
            _check_overlap(Path(frames), Path(force_log or ""), seen, log)
            writer.state(_offset(seen, log, offset_ms, pose, level, remarks))
        writer.note("tipforce.import", _origin(Path(frames), force_log, knob_log, log, shift_ns))
        writer.close()
    except BaseException:
        writer.abandon()
        raise
    return ImportReport(summarise(target), tuple(remarks))


class _Seen:
    """The events of a source; remembers the frames' stamps and, where asked, the catheter's shape in them."""

    def __init__(self, source: FileSource, settings: VisionSettings, *, look: bool, progress: Progress | None) -> None:
        self._source, self._settings, self._look, self._progress = source, settings, look, progress
        self.blind = ""
        """Why no catheter is seen at all, or empty."""
        self._stamps: list[int] = []
        self._sightings: list[Sighting] = []

    def __iter__(self) -> Iterator[Event]:
        see = None
        if self._look:
            try:
                see = _eye(self._settings, self._source)
            except InputError as error:  # the recording is worth having without its clock offset
                self.blind = str(error)
        for event in self._source:
            yield event
            if isinstance(event, Frame):
                self._stamps.append(event.stamp_ns)
                if see is not None:
                    self._sightings.append(see(event.image))
                if self._progress:
                    share = len(self._stamps) / max(self._source.frame_count, len(self._stamps))
                    self._progress("reading frames", min(share, 1.0))

    @property
    def stamp_ns(self) -> IntArray:
        """(n,) stamps of the frames so far."""
        return np.array(self._stamps, dtype=np.int64)

    @property
    def coordinates(self) -> FloatArray:
        """(n, 4) shape coordinates of the frames so far."""
        catheter, share = self._source.context.catheter, 1.0
        if catheter.flexible_length_m and catheter.rigid_length_m:
            share = catheter.flexible_length_m / (catheter.flexible_length_m + catheter.rigid_length_m)
        return shape_coordinates(self._sightings, flexible_share=share)


def _eye(settings: VisionSettings, source: FileSource) -> Callable[[Image], Sighting]:
    """What sees the catheter, settled on pictures of the first seconds."""
    first = [event.image for event in islice(source, 50) if isinstance(event, Frame)]
    return Vision(settle(settings, first[::5])).see


def _stamps(log: ForceLog | None, drives: tuple[IntArray, dict[str, FloatArray]] | None) -> list[IntArray]:
    return [stamps for stamps in (log.stamp_ns if log else None, drives[0] if drives else None) if stamps is not None]


def _drives(
    log: ForceLog | None, column: str | None, knob_log: Path | str | None, actuation: Mapping[str, float] | None
) -> tuple[IntArray, dict[str, FloatArray]] | None:
    if column and knob_log:
        raise InputError("--knob-column and --knob-log: the knob's angle can come from one of them only")
    found = None
    if column and log is not None and log.knob is not None:
        name = column if column.rpartition("_")[0] else "knob_deg"
        # a knob moves by hand: one reading in 10 ms is plenty, and a thousand a second would double the file
        step = max(1, round(1e7 / max(float(np.median(np.diff(log.stamp_ns))), 1.0))) if len(log.stamp_ns) > 1 else 1
        found = log.stamp_ns[::step], {name: log.knob[::step]}
    elif knob_log:
        found = read_knob_log(Path(knob_log))
    clash = set(found[1] if found else ()) & set(actuation or ())
    if clash:
        raise InputError(f"{min(clash)} is stated as a constant and read from a log; state one of them")
    return found


def _check_overlap(frames: Path, force: Path, seen: _Seen, log: ForceLog) -> None:
    stamps = seen.stamp_ns
    overlap = overlap_ns((int(stamps[0]), int(stamps[-1])), log.stamp_ns)
    if overlap <= 0:
        raise TimeError(
            f"{force}: its {log.stamp_ns[0] * 1e-9:.3f} to {log.stamp_ns[-1] * 1e-9:.3f} s do not overlap with "
            f"{frames.name}, {stamps[0] * 1e-9:.3f} to {stamps[-1] * 1e-9:.3f} s; check --time-unit, or state "
            "--align-start where both began together"
        )


def _tare(log: ForceLog, choice: Literal["auto", "none"] | tuple[float, float], remarks: list[str]) -> Tare:
    if choice == "none":
        return Tare()
    tare = find_tare(log.stamp_ns, log.force_n) if choice == "auto" else stated_tare(log.stamp_ns, log.force_n, *choice)
    if tare.how == "none":
        remarks.append(f"the force is not tared: {tare.detail}")
    return tare


def _offset(
    seen: _Seen,
    log: ForceLog,
    choice: Literal["auto", "none"] | float,
    pose: SensorPose,
    tare: Tare,
    remarks: list[str],
) -> ClockOffset:
    if choice == "none":
        return ClockOffset()
    if not isinstance(choice, str):
        return ClockOffset(round(choice * 1e6), "stated")
    if seen.blind:
        remarks.append(f"the clock offset is taken as 0, for it could not be told: {seen.blind}; see --offset-ms")
        return ClockOffset(how="refused", detail=seen.blind)
    force = np.nan_to_num(log.force_n - tare.force_n) @ pose.matrix.T
    offset = estimate_offset(seen.stamp_ns, seen.coordinates, log.stamp_ns, force, window_s=_LOOK_S)
    if offset.how == "refused":
        remarks.append(f"the clock offset is taken as 0, for it could not be told: {offset.detail}; see --offset-ms")
    elif offset.detail:
        remarks.append(offset.detail)
    return offset


def _origin(
    frames: Path, force_log: Path | str | None, knob_log: Path | str | None, log: ForceLog | None, shift_ns: int
) -> dict[str, str]:
    return {
        "frames": frames.name,
        "force_log": "" if force_log is None else Path(force_log).name,
        "knob_log": "" if knob_log is None else Path(knob_log).name,
        "columns": log.said if log else "",
        "stamps_moved_ns": json.dumps(shift_ns),
    }
