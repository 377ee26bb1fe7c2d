"""What every driver is: a typed config, streams that it declares, settings read back, and readings when asked."""

import math
import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict

from ..types import Clock, Event, Frame, Wrench

__all__ = [
    "ClockMap",
    "ClockReport",
    "DeclaredStream",
    "DeviceConfig",
    "Driver",
    "EndOfStream",
    "Setting",
    "StreamKind",
    "monotonic_to",
    "stream_of",
]

StreamKind = Literal["frame", "wrench", "actuation"]


class DeviceConfig(BaseModel):
    """A table of ``bench.toml`` that describes a device; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class EndOfStream(Exception):
    """A device that can end, such as a video file, has ended."""


@dataclass(frozen=True, slots=True)
class DeclaredStream:
    """A stream that a device will give.

    ``name``: as in a recording: a view, "force", "joints" or "stage". ``rate_hz``: as asked for, None where it comes
    when it comes. ``clock``: one line on what its stamps are.
    """

    name: str
    kind: StreamKind
    rate_hz: float | None
    clock: str


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting of a device: what was asked for (None: nothing), and what the device has."""

    name: str
    requested: float | str | None
    actual: float | str

    @property
    def differs(self) -> bool:
        """Whether the device has another value than was asked for; numbers may differ by a thousandth.

        >>> Setting("fps", 60, 59.97).differs, Setting("fps", 60, 30.0).differs
        (False, True)
        """
        if self.requested is None:
            return False
        if isinstance(self.requested, str) or isinstance(self.actual, str):
            return str(self.requested) != str(self.actual)
        return not math.isclose(self.requested, self.actual, rel_tol=1e-3, abs_tol=1e-9)


@dataclass(frozen=True, slots=True)
class ClockReport:
    """How a device's clock lies: ``offset_s`` = host minus device; NaN where its stamps are those of the arrival.

    ``delay_s``: mean delay of the arrival beyond the least one; ``drift_ppm``: of the offset, NaN until it is known.
    """

    offset_s: float = math.nan
    delay_s: float = math.nan
    drift_ppm: float = math.nan


_BUCKET_NS = 1_000_000_000
_BUCKETS = 10
"""The least delay of the last ten seconds counts: a drift of 50 ppm then moves a stamp by half a millisecond."""
_DRIFT_AFTER_S = 20.0
_SHARE = 0.02
"""Of a new reading in the mean delay."""


class ClockMap:
    """Brings stamps of a device's clock to the host's: by the least delay of the arrival in the last seconds.

    A network or an operating system can only delay; the least delay is the nearest to none.

    >>> clock = ClockMap()
    >>> [clock.host_ns(device, arrival) for device, arrival in ((0, 1_005), (100, 1_101), (200, 1_209))]
    [1005, 1101, 1201]
    """

    def __init__(self) -> None:
        self._least: deque[tuple[int, int]] = deque()
        self._last_ns: int | None = None
        self._first: tuple[int, int] | None = None
        self._delay_ns = math.nan

    def host_ns(self, device_ns: int, arrival_ns: int) -> int:
        """The host's time of what the device stamped ``device_ns`` and what arrived at ``arrival_ns``; it rises."""
        delay, bucket = arrival_ns - device_ns, arrival_ns // _BUCKET_NS
        if self._least and self._least[-1][0] == bucket:
            self._least[-1] = bucket, min(delay, self._least[-1][1])
        else:
            if self._first is None and len(self._least) == 2:
                self._first = self._least[1]  # the first whole second
            self._least.append((bucket, delay))
            while self._least[0][0] <= bucket - _BUCKETS:
                self._least.popleft()
        offset = self._offset_ns
        beyond = float(delay - offset)
        self._delay_ns = beyond if math.isnan(self._delay_ns) else self._delay_ns + _SHARE * (beyond - self._delay_ns)
        stamp = device_ns + offset
        if self._last_ns is not None and stamp <= self._last_ns:
            stamp = self._last_ns + 1
        self._last_ns = stamp
        return stamp

    @property
    def _offset_ns(self) -> int:
        return min(delay for _, delay in self._least)

    def report(self) -> ClockReport:
        """How the two clocks lie now."""
        if not self._least:
            return ClockReport()
        drift = math.nan
        if self._first and len(self._least) > 1:
            bucket, delay = self._least[-2]  # the last whole second
            seconds = (bucket - self._first[0]) * _BUCKET_NS * 1e-9
            if seconds >= _DRIFT_AFTER_S:
                drift = 1e-3 * (delay - self._first[1]) / seconds
        return ClockReport(self._offset_ns * 1e-9, self._delay_ns * 1e-9, drift)


class Driver(ABC):
    """One device. All calls come from one thread, but for ``counts``, ``clocks`` and what a driver adds to them.

    ``name``: its table in ``bench.toml``, as "force" or "cameras.a". ``counts``: what went wrong how often, by name,
    over all connections. ``remark``: one sentence on what is wrong with a device that answers, or empty.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.counts: Counter[str] = Counter()
        self.remark = ""

    @property
    @abstractmethod
    def streams(self) -> tuple[DeclaredStream, ...]:
        """What it will give."""

    @abstractmethod
    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Open the device; stamps are on ``clock``. Returns the settings as the device has them. Raises DeviceError."""

    @abstractmethod
    def read(self, timeout_s: float) -> Sequence[Event]:
        """Readings that have come, or that come within ``timeout_s``; may be none.

        Raises DeviceError where the device is lost, to be connected anew, and EndOfStream.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the device, whatever state it is in."""

    def clocks(self) -> Mapping[str, ClockReport]:
        """How the clock of each stream lies; without an entry its stamps are those of the arrival."""
        return {}


def stream_of(event: Event) -> str:
    """The name of the stream that ``event`` belongs to."""
    if isinstance(event, Frame):
        return event.view
    return "force" if isinstance(event, Wrench) else event.stream


def monotonic_to(clock: Clock) -> int:
    """What to add to nanoseconds of the system's monotonic clock for those of ``clock``."""
    return clock.now_ns() - time.monotonic_ns()
