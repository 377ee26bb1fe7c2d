"""The force at each image's mid-exposure."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..io import RecordingReader
from ..plausibility import MAX_GAP_S
from ..types import BoolArray, FloatArray, IntArray, SensorInfo
from ._find import ForceCorrections, TareChoice, find_tare_and_inertia
from ._inertia import StageMotion


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """Forces of the tissue on the tip, base frame.

    Attributes:
        stamp_ns: (n,) stamps of the frames.
        force_n: (n, 3) forces in N; NaN where the force is not known.
        known: (3,) whether the sensor measures each component.
    """

    stamp_ns: IntArray
    force_n: FloatArray
    known: BoolArray


def labels(
    reader: RecordingReader,
    *,
    camera: str | None = None,
    force: str = "force",
    max_gap_s: float = MAX_GAP_S,
    later_s: float = 0.0,
) -> Labels:
    """Returns the force at every frame, linear in time, tare and inertia subtracted, in the base frame.

    The force series is read chunk by chunk.

    Args:
        reader: the recording, with its clock map.
        camera: view of the frames; None: the first.
        force: stream of the readings.
        max_gap_s: where the readings around a frame are farther apart, or on one side only, its force is NaN.
        later_s: delay of the force after each frame, to find its rate.

    Raises:
        InputError: readings are in the sensor's frame and its pose is not stated, or the clock map is unknown.
    """
    info = reader.info
    if info.clock_map.how == "refused":
        raise InputError(
            f"{reader.path}: no image has a label, for it is unknown how the camera's clock maps to the force log's: "
            f"{info.clock_map.detail}; state it in a copy of the recording, as the camera's clock minus the force's "
            f"(none: both share one clock): `tipforce import --offset-ms MS {reader.path} -o NEW.mcap`"
        )
    stage = StageMotion.of(reader.stage_readings() if info.inertia.axes else [])
    facts = ForceCorrections(info.sensor, info.tare, info.inertia, stage, info.plausibility)
    blocks = ((times, wrench[:, :3], frame) for times, wrench, frame in reader.wrench_blocks(force))
    frames = reader.stamps(camera or next(iter(reader.views), "camera"))
    when = info.clock_map.force_ns(frames + round(later_s * 1e9))
    return replace(_label(when, blocks, facts, max_gap_s, str(reader.path)), stamp_ns=frames)


def label_log(
    frame_ns: IntArray,
    readings: tuple[IntArray, FloatArray],
    stage: tuple[IntArray, Mapping[str, FloatArray]],
    *,
    sensor: SensorInfo,
    tare: TareChoice,
    offset_ms: float,
    max_gap_s: float = MAX_GAP_S,
) -> Labels:
    """Labels the frames of a run whose data are arrays: the labels that `record` and `labels` would give.

    Args:
        frame_ns: (n,) stamps of the frames.
        readings: stamps (m,) and forces (m, 3) in N, sensor's frame.
        stage: stamps (k,) and commanded positions (k,) by name, NAME_m or NAME_mm; may be empty.
        sensor: metadata of the sensor.
        tare: how the tare is found.
        offset_ms: the camera's clock minus the force's.
        max_gap_s: see `labels`.

    Raises:
        InputError: tare or inertia cannot be found, or the pose of the sensor is not stated.
    """
    stamps, force = readings
    motion = StageMotion(*stage)
    tare_and_inertia = find_tare_and_inertia(stamps, force, motion, tare, [], sensor.moving_mass_kg)
    facts = ForceCorrections(sensor, *tare_and_inertia, motion)
    when = frame_ns - round(offset_ms * 1e6)
    return replace(_label(when, [(stamps, force, "sensor")], facts, max_gap_s, "the readings"), stamp_ns=frame_ns)


def covered_frames(frame_ns: IntArray, force_ns: IntArray) -> BoolArray:
    """Returns whether a frame is on a reading or between two that are at most `MAX_GAP_S` apart.

    Args:
        frame_ns: (n,) stamps of the frames, sorted.
        force_ns: (m,) stamps of the readings on the same clock, sorted.

    Returns:
        (n,) whether the frame is covered.

    >>> covered_frames(np.array([0, 10, 2000]), np.array([5, 20])).tolist()
    [False, True, False]
    """
    index = np.searchsorted(force_ns, frame_ns, side="left")
    inside = (index > 0) & (index < len(force_ns))
    after = force_ns[np.minimum(index, len(force_ns) - 1)]
    gap = after - force_ns[np.maximum(index - 1, 0)]
    return (after == frame_ns) | (inside & (gap <= round(MAX_GAP_S * 1e9)))


def _label(
    frames: IntArray,
    blocks: Iterable[tuple[IntArray, FloatArray, str]],
    facts: ForceCorrections,
    max_gap_s: float,
    where: str,
) -> Labels:
    """Interpolates the labels at ``frames`` (n,), stamps on the force log's clock; see `labels`.

    ``blocks`` are stamps (m,), forces (m, 3) in N and frame of reference of successive readings. The last reading of a
    block is carried into the next.
    """
    values = np.full((len(frames), 3), math.nan)
    last_time, last_value = np.empty(0, np.int64), np.empty((0, 3))
    for times, force, frame in blocks:
        usable = facts.plausibility.usable(times)
        times, force = times[usable], facts.plausibility.corrected(times, force)[usable]
        readings = _in_base(force - facts.carried(times), frame, facts, where)
        times, readings = np.concatenate([last_time, times]), np.concatenate([last_value, readings])
        if not len(times):
            continue
        if np.any(np.diff(times) < 0):
            order = np.argsort(times, kind="stable")
            times, readings = times[order], readings[order]
        inside = np.flatnonzero((frames >= times[0]) & (frames <= times[-1]))
        if len(inside):
            values[inside] = _interpolate(frames[inside], times, readings, round(max_gap_s * 1e9))
        last_time, last_value = times[-1:], readings[-1:]
    measured = np.zeros(3, np.bool_)
    if len(last_value):
        measured = np.logical_not(np.isnan(last_value[0]))
    values[np.isnan(values[:, measured]).any(axis=1)] = math.nan
    return Labels(frames, values, measured)


def _in_base(force: FloatArray, frame: str, facts: ForceCorrections, where: str) -> FloatArray:
    """Returns forces (n, 3) less the tare, turned from their ``frame`` to the base frame. Raises InputError."""
    tared = force - facts.tare.force_n
    if frame == "base":
        return tared
    pose = facts.sensor
    if pose is None:
        raise InputError(
            f"{where}: forces are in the frame {frame!r}, whose pose the recording does not state; import it "
            "again with sensor.angle_deg and sensor.reads in bench.toml"
        )
    unknown = np.isnan(tared)
    # a planar sensor's unknown axis must not spoil the others: 0 * NaN is NaN
    rotated = np.where(unknown, 0.0, tared) @ pose.matrix.T
    needs_unknown = unknown @ (np.abs(pose.matrix.T) > 1e-12)
    rotated[needs_unknown.astype(np.bool_)] = math.nan
    return rotated


def _interpolate(at: IntArray, times: IntArray, values: FloatArray, max_gap_ns: int) -> FloatArray:
    """Returns ``values`` (m, 3) of ``times`` (m,), linear at ``at`` (n,): (n, 3), NaN in a gap of the times."""
    if len(times) == 1:
        return np.where((at == times[0])[:, None], values[0], math.nan)
    after = np.clip(np.searchsorted(times, at, side="left"), 1, len(times) - 1)
    before = after - 1
    gap = times[after] - times[before]
    share = ((at - times[before]) / np.maximum(gap, 1))[:, None]
    interpolated = values[before] + share * (values[after] - values[before])
    in_gap = (gap > max_gap_ns) & (at != times[after])
    return np.where(in_gap[:, None], math.nan, interpolated)
