"""Reads a recording: streams, single frames and whole force series, without holding the file in memory."""

import struct
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from .._system.contexts import ClosedAtExit
from ..errors import FileFormatError, InputError
from ..plausibility import ForcePlausibility
from ..types import (
    FORCE_RANGE,
    STAGE,
    Actuation,
    Event,
    FloatArray,
    ForceEstimate,
    Frame,
    IntArray,
    Range,
    SensorInfo,
    SessionInfo,
    Wrench,
    actuation_range,
    ordered_views,
)
from ._actuation import WAIT_S, ActuationSeries
from ._cdr import (
    COMPRESSED_IMAGE,
    ESTIMATE,
    FORCE_ESTIMATE,
    JOINT_STATE,
    WRENCH_BYTES,
    WRENCH_STAMPED,
    unpack_estimate,
    unpack_image,
    unpack_joints,
    unpack_wrench,
    wrench_layout,
)
from ._container import MESSAGE_HEAD, Container, Entries, is_foreign_metadata
from ._facts import ClockMap, Inertia, Tare, fact_from, session_from
from ._images import StreamDepth, decode_image
from ._recover import resolve

_T = TypeVar("_T")
_KINDS = {COMPRESSED_IMAGE: "frame", WRENCH_STAMPED: "wrench", JOINT_STATE: "actuation", FORCE_ESTIMATE: "estimate"}
_EVENTS = ("frame", "wrench", "actuation")


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """One stream of a recording.

    Attributes:
        name: name of the stream.
        topic: its ROS topic.
        kind: "frame", "wrench", "actuation", "estimate", or "other" (in the file, but not read by this program).
        count: number of messages.
        rate_hz: rate, with the dropped readings, Hz.
        first_ns: stamp of the first message.
        last_ns: stamp of the last message.
        dropped: number of readings that are missing in a regular stream.
    """

    name: str
    topic: str
    kind: str
    count: int
    rate_hz: float
    first_ns: int
    last_ns: int
    dropped: int


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """Contents of a recording.

    Attributes:
        streams: its streams by name.
        clock_map: clock map of force sensor and camera.
        tare: force without contact.
        inertia: load of the force sensor.
        sensor: pose of the force sensor; None: not stated.
        plausibility: findings of the force log.
        metadata: all metadata records by name.
        recovered: empty, or one line on the losses of a file that was cut off.
    """

    streams: Mapping[str, StreamInfo]
    clock_map: ClockMap
    tare: Tare
    inertia: Inertia
    sensor: SensorInfo | None
    plausibility: ForcePlausibility
    metadata: Mapping[str, Mapping[str, str]]
    recovered: str = ""


def stream_info(name: str, topic: str, kind: str, times_ns: IntArray) -> StreamInfo:
    """Determines rate and drops of a stream.

    Args:
        name: name of the stream.
        topic: its ROS topic.
        kind: see `StreamInfo`.
        times_ns: (n,) sorted stamps.

    Returns:
        The stream with its mean rate in Hz; ``dropped`` counts the messages that are missing between regular ones.
    """
    if len(times_ns) < 2:
        first = int(times_ns[0]) if len(times_ns) else 0
        return StreamInfo(name, topic, kind, len(times_ns), 0.0, first, first, 0)
    steps = np.diff(times_ns)
    usual_step = float(np.median(steps))
    # knob readings come when the knob moves: only a regular stream can have lost some
    regular = kind in ("frame", "wrench") and usual_step > 0
    dropped = int(np.sum(np.maximum(np.rint(steps / usual_step) - 1, 0))) if regular else 0
    span = int(times_ns[-1] - times_ns[0])
    rate = 1e9 * (len(times_ns) - 1 + dropped) / span if span else 0.0
    return StreamInfo(name, topic, kind, len(times_ns), rate, int(times_ns[0]), int(times_ns[-1]), dropped)


class RecordingReader(ClosedAtExit):
    """A `Source` that reads one ``.mcap`` of ours; a context manager.

    Streams are named by their topics: ``/camera/compressed`` is "camera", ``/force`` "force", ``/joints`` "joints".
    Where only the ``.part`` of ``path`` is there, or ``path`` is one, its undamaged part is recovered first, with a
    warning; ``recovered`` then states the losses. Raises FileFormatError.
    """

    def __init__(self, path: Path | str) -> None:
        """Opens the file, recovers it first if it was cut off, and reads its channels and session metadata."""
        self.path, self.recovered = resolve(Path(path))
        if self.recovered:
            warnings.warn(self.recovered, stacklevel=2)
        if not self.path.exists():
            raise FileFormatError(f"{self.path}: there is no such file")
        self._file = Container(self.path)
        if is_foreign_metadata(self._file.metadata):
            self._file.close()
            raise FileFormatError(
                f"{self.path}: was written by another program; make a recording of it, whose images and forces have "
                f"the stamps of their headers: tipforce import {self.path} --bench bench.toml -o NEW.mcap"
            )
        self._topics: dict[str, tuple[int, str]] = {}
        for channel in self._file.channels.values():
            name = channel.topic.strip("/").removesuffix("/compressed") or channel.topic
            kind = _KINDS.get(self._file.schema_names.get(channel.schema_id, ""), "other")
            self._topics[name] = (channel.id, kind if channel.message_encoding == "cdr" else "other")
        self._entries: dict[str, Entries] = {}
        self._depths: dict[str, StreamDepth] = {}
        try:
            info = session_from(self._file.metadata.get("tipforce.session", {}), str(self.path))
        except InputError:
            self._file.close()
            raise
        self._session_info = replace(info, name=info.name or self.path.stem)

    @property
    def session_info(self) -> SessionInfo:
        """The metadata of the session."""
        return self._session_info

    @cached_property
    def info(self) -> RecordingInfo:
        """Streams, counts, rates, drops, clock map, tare, and pose of the sensor."""
        metadata = self._file.metadata
        streams = {
            name: stream_info(name, self._file.channels[channel].topic, kind, self._of(name).time_ns)
            for name, (channel, kind) in self._topics.items()
        }
        return RecordingInfo(
            streams=streams,
            clock_map=self._fact(ClockMap.of, "tipforce.clock_offset"),
            tare=self._fact(Tare.of, "tipforce.tare"),
            inertia=self._fact(Inertia.of, "tipforce.inertia"),
            sensor=self._sensor(),
            plausibility=self._fact(ForcePlausibility.of, "tipforce.plausibility"),
            metadata=metadata,
            recovered=self.recovered or metadata.get("tipforce.recovered", {}).get("detail", ""),
        )

    def _fact(self, kind: Callable[[Mapping[str, str]], _T], name: str) -> _T:
        return fact_from(kind, self._file.metadata.get(name, {}), name, str(self.path))

    def _sensor(self) -> SensorInfo | None:
        """Returns the sensor if its pose is stated."""
        sensor = self._session_info.sensor
        return None if sensor.angle_deg is None and sensor.reads is None else sensor

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the streams of images: "camera", which is the default, first, then the others by name."""
        names = [stream.name for stream in self.info.streams.values() if stream.kind == "frame" and stream.count]
        return ordered_views(names)

    def __iter__(self) -> Iterator[Event]:
        return self.events()

    def events(self, *streams: str) -> Iterator[Event]:
        """Yields the events of the named streams (of all if none is named), in the order of their stamps."""
        chosen = {name: self._topics[self._known(name)] for name in streams} if streams else self._topics
        names = {channel: (name, kind) for name, (channel, kind) in chosen.items() if kind in _EVENTS}
        for time_ns, channel, raw in self._file.in_time_order(set(names)):
            name, kind = names[channel]
            if kind == "frame":
                where = f"{self.path}, frame at {time_ns} ns"
                data = self._unpacked(unpack_image, raw, time_ns)[2]
                yield Frame(time_ns, decode_image(data, where, self._depth(name)), name)
            elif kind == "wrench":
                _, frame, force, torque = self._unpacked(unpack_wrench, raw, time_ns)
                yield Wrench(time_ns, force, torque, frame)
            else:
                values = self._unpacked(unpack_joints, raw, time_ns)[1]
                for key, value in values.items():
                    limits = actuation_range(key)
                    if value < limits.low or value > limits.high:
                        raise self._implausible(key, time_ns, value, limits)
                yield Actuation(time_ns, values, name)

    def estimates(self, stream: str = ESTIMATE) -> Iterator[ForceEstimate]:
        """Yields the estimates that were made during the recording, if any, in the order of their stamps."""
        channel, kind = self._topics.get(stream, (0, ""))
        if kind != "estimate":
            return
        for time_ns, _, raw in self._file.in_time_order({channel}):
            yield self._unpacked(unpack_estimate, raw, time_ns)

    def _implausible(self, quantity: str, time_ns: int, value: float, limits: Range) -> FileFormatError:
        return FileFormatError(
            f"{self.path}: {quantity} at {time_ns * 1e-9:.3f} s is {value:g}, expected {limits}; record it again"
        )

    def _unpacked(self, unpack: Callable[[bytes | memoryview], _T], raw: bytes | memoryview, time_ns: int) -> _T:
        try:
            return unpack(raw)
        except (struct.error, ValueError, OverflowError, MemoryError, FileFormatError) as error:
            raise FileFormatError(
                f"{self.path}: the message at {time_ns * 1e-9:.3f} s is not of the type of its channel ({error})"
            ) from None

    def frame_at(self, index: int, stream: str = "camera") -> Frame:
        """Returns one image; only its chunk is read.

        Args:
            index: number of the frame in its stream, from 0.
            stream: name of the view.
        """
        entries = self._of(stream)
        chunk, time_ns, offset = (int(column[index]) for column in (entries.chunk, entries.time_ns, entries.offset))
        data = self._image_at(stream, chunk, time_ns, offset)
        image = decode_image(data, f"{self.path}, frame {index}", self._depth(stream))
        return Frame(time_ns, image, stream)

    def _image_at(self, stream: str, chunk: int, time_ns: int, offset: int) -> memoryview:
        raw = self._file.payload(chunk, self._topics[stream][0], time_ns, offset)
        return self._unpacked(unpack_image, raw, time_ns)[2]

    def _depth(self, stream: str) -> StreamDepth:
        """Returns the bit depth of a stream: recordings of others may hold images with more than 8 bits."""
        if stream not in self._depths:
            self._depths[stream] = StreamDepth(partial(self.compressed, stream))
        return self._depths[stream]

    def compressed(self, stream: str = "camera") -> Iterator[memoryview]:
        """Yields the compressed images of ``stream``, in the order of their stamps."""
        entries = self._of(stream)
        for place in zip(entries.chunk.tolist(), entries.time_ns.tolist(), entries.offset.tolist(), strict=True):
            yield self._image_at(stream, *place)

    def stamps(self, stream: str = "camera") -> IntArray:
        """Returns the (n,) sorted stamps of a stream."""
        return self._of(stream).time_ns

    def wrench_blocks(self, stream: str = "force") -> Iterator[tuple[IntArray, FloatArray, str]]:
        """Yields stamps (m,) in ns, force (N) and torque (N m) as (m, 6), and frame of reference, chunk by chunk.

        All messages of a chunk are read as one array of bytes, faster than one by one. Raises FileFormatError for a
        force that no sensor reads.
        """
        channel, _ = self._topics[self._known(stream)]
        for number in range(len(self._file.chunks)):
            times, offsets = self._file.chunk_entries(number, channel)
            if not len(times):
                continue
            data = np.frombuffer(self._file.chunk_data(number), np.uint8)
            # one writer gives all its messages the same frame and so the same length; others are grouped by length
            lengths = self._file.message_lengths(number, channel, times, offsets)
            for length in np.unique(lengths).tolist():
                same_length = lengths == length
                stamps, records = times[same_length], offsets[same_length]
                start = int(records[0]) + MESSAGE_HEAD
                first = data[start : start + length].tobytes()
                frame, numbers_at = self._unpacked(wrench_layout, first, int(stamps[0]))
                number_bytes = records[:, None] + (MESSAGE_HEAD + numbers_at + np.arange(WRENCH_BYTES))
                values = data[number_bytes].view("<f8").astype(np.float64)
                first_outside = FORCE_RANGE.outside(values[:, :3].ravel())
                if first_outside is not None:
                    row, axis = divmod(first_outside, 3)
                    raise self._implausible("force", int(stamps[row]), values[row, axis], FORCE_RANGE)
                yield stamps, values, frame

    def wrenches(self, stream: str = "force") -> tuple[IntArray, FloatArray, FloatArray]:
        """Returns raw stamps (n,), force (n, 3) and torque (n, 3) as the sensor gave them, on its own clock."""
        blocks = list(self.wrench_blocks(stream))
        if not blocks:
            return np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3))
        times = np.concatenate([times for times, _, _ in blocks])
        values = np.concatenate([values for _, values, _ in blocks])
        if np.any(np.diff(times) < 0):
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
        return times, values[:, :3].copy(), values[:, 3:].copy()

    @cached_property
    def _actuation(self) -> ActuationSeries:
        """All readings of the catheter's drives, without those of the stage."""
        series = ActuationSeries()
        for name, (_, kind) in self._topics.items():
            if kind == "actuation" and name != STAGE:
                for event in self.events(name):
                    assert isinstance(event, Actuation)
                    series.add(event)
        return series

    def actuation_at(self, stamps_ns: IntArray, *, wait_s: float = WAIT_S) -> dict[str, FloatArray]:
        """Interpolates the readings of the drives as `observations` does.

        Args:
            stamps_ns: (n,) stamps.
            wait_s: longest time from a stamp to the next reading, s.

        Returns:
            Name -> (n,) values; NaN before the first reading.
        """
        return self._actuation.at(stamps_ns, wait_s=wait_s)

    def stage_readings(self) -> list[tuple[int, Mapping[str, float]]]:
        """Returns stamp and commanded positions by name of each reading; none if the recording has no such stream."""
        events = self.events(STAGE) if STAGE in self._topics else ()
        return [(event.stamp_ns, event.values) for event in events if isinstance(event, Actuation)]

    def _known(self, stream: str) -> str:
        if stream not in self._topics:
            there = ", ".join(sorted(self._topics)) or "none"
            raise InputError(f"{self.path}: has no stream {stream!r}; it has {there}")
        return stream

    def _of(self, stream: str) -> Entries:
        if stream not in self._entries:
            self._entries[stream] = self._file.entries(self._topics[self._known(stream)][0])
        return self._entries[stream]

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def open_recording(path: Path | str) -> RecordingReader:
    """Opens a recording (.mcap) to read its streams.

    Args:
        path: a recording of ours, or any with the same ROS 2 messages; the ``.part`` of a crash is recovered first.

    Returns:
        A context manager and `Source`: iterate over its events, or ask it for ``session_info``, ``info``, ``stamps``,
        ``frame_at`` and ``wrenches`` (N and N m, stamps in ns).

    Raises:
        FileFormatError: there is no such file, or it is no recording.
    """
    return RecordingReader(path)
