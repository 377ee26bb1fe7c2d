"""Reading a recording: streams, single frames and whole force series, without holding the file in memory."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from ..types import Context, Event, FloatArray, Frame, IntArray
from ._facts import ClockOffset, SensorPose, Tare

__all__ = ["RecordingInfo", "RecordingReader", "StreamInfo"]


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """One stream: its ROS topic, what it carries, and how regularly.

    ``kind``: "frame", "wrench", "actuation", or "other" (carried by the file, not read by this program).
    ``dropped``: readings that a regular stream should have had between its first and last stamp.
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
    """What a recording holds. ``recovered``: empty, or one line on what a cut-off file lost."""

    streams: Mapping[str, StreamInfo]
    clock_offset: ClockOffset
    tare: Tare
    sensor: SensorPose | None
    metadata: Mapping[str, Mapping[str, str]]
    recovered: str = ""


class RecordingReader:
    """A `Source` that reads one ``.mcap``; recovers it first where only its ``.part`` is there."""

    def __init__(self, path: Path | str) -> None:
        raise NotImplementedError

    @property
    def context(self) -> Context:
        """What is publicly known of the session."""
        raise NotImplementedError

    @property
    def info(self) -> RecordingInfo:
        """Streams, counts, rates, drops, offset, tare, sensor pose."""
        raise NotImplementedError

    def __iter__(self) -> Iterator[Event]:
        raise NotImplementedError

    def events(self, *streams: str) -> Iterator[Event]:
        """Events of the named streams (all where none is named), in the order of their stamps."""
        raise NotImplementedError

    def frame_at(self, index: int, stream: str = "camera") -> Frame:
        """The ``index``-th picture of ``stream``, decoded from its place in the file."""
        raise NotImplementedError

    def stamps(self, stream: str = "camera") -> IntArray:
        """(n,) stamps of a stream."""
        raise NotImplementedError

    def wrenches(self, stream: str = "force") -> tuple[IntArray, FloatArray, FloatArray]:
        """Raw stamps (n,), force (n, 3), torque (n, 3): as the sensor gave them, on its own clock."""
        raise NotImplementedError

    def actuation_at(self, stamps_ns: IntArray) -> dict[str, FloatArray]:
        """Name -> (n,) values at ``stamps_ns``; NaN before the first reading. The rule of `observations`."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        raise NotImplementedError
