"""A bench of devices as a `Source` that pushes: one thread a device, bounded queues, drops and clocks counted."""

import logging
import math
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Literal, Self

from .._system.arrival_clock import ClockReport
from ..errors import DeviceError
from ..plausibility import ForceMonitor
from ..types import Clock, Event, SessionInfo, SystemClock, Wrench
from ._driver import DeclaredStream, Driver, EndOfStream, Setting, stream_of
from ._grbl import GrblActuators, GrblStage

_log = logging.getLogger(__name__)

DeviceState = Literal["connecting", "connected", "lost", "ended"]
START_NS = 2_000_000_000
"""A source's clock begins at 2 s: what was exposed before the first reading arrived must not lie below zero."""
_POLL_S = 0.1
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 5.0
"""Between attempts to connect: doubled each time, up to the latter."""
_ROOM = {"frame": 64, "wrench": 65_536, "actuation": 2048}
"""Readings that wait for whoever takes them: a second of images, a minute of force."""
_RATE_OVER_NS = 2_000_000_000
_LEAVE_S = 2.0
"""A camera that hangs in its driver is left behind; its thread ends with the program."""


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """How a stream does.

    ``live_rate_hz``: over the last two seconds. ``count``: readings taken; ``dropped``: those that nobody took in time;
    ``unsorted``: those refused for a stamp that does not rise. ``age_s``: since the last one came, NaN before.
    """

    stream: DeclaredStream
    live_rate_hz: float
    count: int
    dropped: int
    unsorted: int
    age_s: float
    clock: ClockReport


@dataclass(frozen=True, slots=True)
class DeviceHealth:
    """How a device does. ``counts``: what it counts itself, as "lost"; ``message``: what went wrong last."""

    name: str
    state: DeviceState
    connections: int
    settings: tuple[Setting, ...]
    counts: Mapping[str, int]
    message: str
    streams: tuple[StreamHealth, ...] = ()


class StreamMeter:
    """Counts the readings of a stream and how fast they come; times on any one clock."""

    def __init__(self) -> None:
        self.count = 0
        self._times: deque[int] = deque()

    def add(self, now_ns: int) -> None:
        """A reading came."""
        self.count += 1
        self._times.append(now_ns)
        self._forget(now_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Readings a second of late."""
        self._forget(now_ns)
        if len(self._times) < 2:
            return 0.0
        return 1e9 * (len(self._times) - 1) / max(now_ns - self._times[0], 1)

    def age_s(self, now_ns: int) -> float:
        """Since the last reading; NaN where there was none of late."""
        return (now_ns - self._times[-1]) * 1e-9 if self._times else math.nan

    def _forget(self, now_ns: int) -> None:
        while len(self._times) > 1 and self._times[0] < now_ns - _RATE_OVER_NS:
            self._times.popleft()


@dataclass
class _Stream:
    declared: DeclaredStream
    room: int
    waiting: deque[tuple[int, Event]] = field(default_factory=deque[tuple[int, Event]])
    meter: StreamMeter = field(default_factory=StreamMeter)
    last_ns: int = -1
    dropped: int = 0
    unsorted: int = 0


class _Device:
    """A driver and its thread."""

    def __init__(self, driver: Driver, source: "HardwareSource") -> None:
        self.driver, self._source = driver, source
        self.state: DeviceState = "connecting"
        self.connections = 0
        self.settings: tuple[Setting, ...] = ()
        self.message = ""
        self.bug: BaseException | None = None
        self.thread = threading.Thread(target=self._run, name=f"device-{driver.name}", daemon=True)

    def _run(self) -> None:
        try:
            self._connect_again_and_again()
        except BaseException as error:  # a bug: raised where the events are taken, never swallowed
            self.bug = error
            self._source.wake()

    def _connect_again_and_again(self) -> None:
        stopped, wait_s = self._source.stopped, _FIRST_WAIT_S
        while not stopped.is_set():
            before, failed = self._source.taken_from(self.driver), None
            try:
                self.settings = self.driver.connect(self._source.clock)
                self.connections, self.state = self.connections + 1, "connected"
                self._source.wake()
                while not stopped.is_set():
                    for event in self.driver.read(_POLL_S):
                        self._source.put(event)
            except DeviceError as error:
                failed = error
            except EndOfStream:
                self.state = "ended"
                return
            finally:
                self.driver.close()
                if failed is not None:  # only now, when it takes no command any more
                    self.message = str(failed)
                    self.state = "lost" if self.connections else "connecting"
                    _log.warning("%s", failed)
                self._source.wake()
            if self._source.taken_from(self.driver) > before:
                wait_s = _FIRST_WAIT_S
            stopped.wait(wait_s)
            wait_s = min(2 * wait_s, _LONGEST_WAIT_S)


class HardwareSource:
    """The devices of a bench: their events in the order of arrival, all stamps on ``clock``. A context manager.

    Entering it starts a thread for each device, which connects, and connects again with growing pauses where the
    device is lost. Iteration waits for events and ends with `stop`, or when the cameras have ended (video files).

    Args:
        drivers: the devices; their streams have different names.
        info: what is publicly known of the session.
        newest_only: only the newest frame of a view waits, for who shows or estimates; else 64 do, for a recording.
        clock: the host's; by default a monotonic one that begins at 2 s.
        described: the devices as ``bench.toml`` describes them, for `record`.

    Raises ValueError where two drivers declare the same stream.
    """

    def __init__(
        self,
        drivers: Sequence[Driver],
        info: SessionInfo | None = None,
        *,
        newest_only: bool = False,
        clock: Clock | None = None,
        described: Mapping[str, Any] | None = None,
    ) -> None:
        self.session_info = info or SessionInfo()
        self.described = dict(described or {})
        self.clock: Clock = clock or SystemClock(START_NS)
        self.stopped = threading.Event()
        self._changed = threading.Condition()
        self._order = 0
        self._force = ForceMonitor(self.session_info.sensor.range_n)
        self._ends_ns: int | None = None
        self._streams: dict[str, _Stream] = {}
        for driver in drivers:
            for declared in driver.streams:
                if declared.name in self._streams:
                    raise ValueError(f"two devices give the stream {declared.name!r}")
                room = 1 if newest_only and declared.kind == "frame" else _ROOM[declared.kind]
                self._streams[declared.name] = _Stream(declared, room)
        self._devices = [_Device(driver, self) for driver in drivers]

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """What will come."""
        return tuple(stream.declared for stream in self._streams.values())

    @property
    def actuators(self) -> GrblActuators | None:
        """The drives of the bench's stage; None where it has none."""
        drivers = (device.driver for device in self._devices)
        return next((driver.actuators for driver in drivers if isinstance(driver, GrblStage)), None)

    def put(self, event: Event) -> None:
        """Of a driver's thread: the next event of its stream; the oldest one that waits gives way where it is full."""
        now = self.clock.now_ns()
        with self._changed:
            stream = self._streams[stream_of(event)]
            if event.stamp_ns <= stream.last_ns:
                stream.unsorted += 1
                return
            stream.last_ns = event.stamp_ns
            stream.meter.add(now)
            if isinstance(event, Wrench):
                self._force.add(event.stamp_ns, event.force_n)
            if len(stream.waiting) >= stream.room:
                stream.waiting.popleft()
                stream.dropped += 1
            self._order += 1
            stream.waiting.append((self._order, event))
            self._changed.notify()

    def wake(self) -> None:
        """Of a driver's thread: its state changed."""
        with self._changed:
            self._changed.notify_all()

    def taken_from(self, driver: Driver) -> int:
        """Readings that ``driver`` has given so far."""
        return sum(self._streams[declared.name].meter.count for declared in driver.streams)

    def wait_connected(self, timeout_s: float) -> tuple[DeviceHealth, ...]:
        """Wait until all devices are connected, or for ``timeout_s``; returns those that are not."""
        end_ns = self.clock.now_ns() + round(timeout_s * 1e9)
        with self._changed:
            while any(not device.connections for device in self._devices):
                left_s = (end_ns - self.clock.now_ns()) * 1e-9
                if left_s <= 0:
                    break
                self._changed.wait(left_s)
        missing = {device.driver.name for device in self._devices if not device.connections}
        return tuple(health for health in self.health() if health.name in missing)

    def stop(self) -> None:
        """End the iteration after what has arrived; from any thread, or a signal's handler."""
        self.stopped.set()

    def begin(self, seconds: float | None = None) -> None:
        """Forget what has waited, count drops anew, and end the iteration after ``seconds`` from now."""
        with self._changed:
            for stream in self._streams.values():
                stream.waiting.clear()
                stream.dropped = stream.unsorted = 0
        self._ends_ns = None if seconds is None else self.clock.now_ns() + round(seconds * 1e9)

    def __iter__(self) -> Iterator[Event]:
        while (event := self._next()) is not None:
            yield event

    def _next(self) -> Event | None:
        with self._changed:
            while True:
                for device in self._devices:
                    if device.bug is not None:
                        raise device.bug
                ready = [stream for stream in self._streams.values() if stream.waiting]
                if self._ends_ns is not None and self.clock.now_ns() >= self._ends_ns:
                    self.stop()
                if ready:
                    return min(ready, key=lambda stream: stream.waiting[0][0]).waiting.popleft()[1]
                if self.stopped.is_set() or self._cameras_ended():
                    return None
                self._changed.wait(_POLL_S)

    def _cameras_ended(self) -> bool:
        states = [
            device.state for device in self._devices if any(stream.kind == "frame" for stream in device.driver.streams)
        ]
        return bool(states) and all(state == "ended" for state in states)

    def trouble(self) -> str:
        """Which devices are not connected, and why; empty where all are."""
        missing = [device for device in self._devices if device.state != "connected"]
        told = (f"{device.driver.name} is {device.state}: {device.message}" for device in missing)
        return "; ".join(each.removesuffix(": ") for each in told)

    def health(self) -> tuple[DeviceHealth, ...]:
        """How each device and its streams do now."""
        now, force = self.clock.now_ns(), self._force.remark
        with self._changed:
            return tuple(self._health_of(device, now, force) for device in self._devices)

    def _health_of(self, device: _Device, now_ns: int, force_remark: str) -> DeviceHealth:
        driver = device.driver
        clocks = driver.clocks()
        streams = tuple(
            StreamHealth(
                declared,
                stream.meter.rate_hz(now_ns),
                stream.meter.count,
                stream.dropped,
                stream.unsorted,
                stream.meter.age_s(now_ns),
                clocks.get(declared.name, ClockReport()),
            )
            for declared in driver.streams
            for stream in (self._streams[declared.name],)
        )
        return DeviceHealth(
            driver.name, device.state, device.connections, device.settings, dict(driver.counts),
            device.message or driver.remark or force_remark * any(s.stream.kind == "wrench" for s in streams), streams,
        )  # fmt: skip

    def __enter__(self) -> Self:
        for device in self._devices:
            if device.thread.ident is None:  # entered already: `record` enters what a caller may have opened before
                device.thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        for device in self._devices:
            if device.thread.ident is not None:
                device.thread.join(_LEAVE_S)
