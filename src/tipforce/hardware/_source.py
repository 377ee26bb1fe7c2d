"""A bench of devices as a `Source` that pushes: one thread per device, bounded queues, counted drops, and clocks."""

import logging
import math
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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
"""Start of the clock of a source: an image that was exposed before the first reading arrived needs a positive stamp."""
_POLL_S = 0.1
MIN_WAIT_S, MAX_WAIT_S = 0.1, 5.0
"""Waits between attempts to connect: the first one, doubled each time up to the second."""
QUEUE_LENGTHS = {"frame": 64, "wrench": 65_536, "actuation": 2048}
"""Largest number of readings in a queue: a second of images, a minute of force."""
RATE_WINDOW_NS = 2_000_000_000
MAX_JOIN_S = 2.0
"""Longest wait for the thread of a device; a camera that hangs in its driver ends with the program."""


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """Health of a stream.

    Attributes:
        stream: the stream.
        live_rate_hz: rate over the last two seconds, Hz.
        count: number of readings.
        dropped: number of readings that were not used in time.
        unsorted: number of readings that were refused, because their stamp does not rise.
        age_s: time since the last reading, s; NaN before the first one.
        clock: report on its clock.
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
    """Health of a device.

    Attributes:
        name: name of the device.
        state: whether it is connected.
        connections: number of connections so far.
        settings: its requested and actual settings.
        counts: counts by name, as "lost".
        message: its last fault.
        streams: health of each of its streams.
    """

    name: str
    state: DeviceState
    connections: int
    settings: tuple[Setting, ...]
    counts: Mapping[str, int]
    message: str
    streams: tuple[StreamHealth, ...] = ()


class StreamMeter:
    """Counts the readings of a stream and measures their rate; all times are on one clock."""

    def __init__(self) -> None:
        self.count = 0
        self._times: deque[int] = deque()

    def add(self, now_ns: int) -> None:
        """Adds a reading."""
        self.count += 1
        self._times.append(now_ns)
        self._forget(now_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Returns the readings per second in the last two seconds."""
        self._forget(now_ns)
        if len(self._times) < 2:
            return 0.0
        return 1e9 * (len(self._times) - 1) / max(now_ns - self._times[0], 1)

    def age_s(self, now_ns: int) -> float:
        """Returns the time since the last reading, s; NaN before the first one."""
        return (now_ns - self._times[-1]) * 1e-9 if self._times else math.nan

    def _forget(self, now_ns: int) -> None:
        while len(self._times) > 1 and self._times[0] < now_ns - RATE_WINDOW_NS:
            self._times.popleft()


@dataclass
class _Stream:
    """A stream with its queue.

    Attributes:
        declared: its name, kind and rate.
        room: largest number of readings in the queue.
        waiting: the queue: number in the order of arrival, and reading.
        meter: counts the readings and measures their rate.
        last_ns: stamp of the last reading.
        dropped: see `StreamHealth`.
        unsorted: see `StreamHealth`.
    """

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
        except BaseException as error:  # a bug: raised where the events are read, never ignored
            self.bug = error
            self._source.wake()

    def _connect_again_and_again(self) -> None:
        """Connects the device and reads it until the source stops or the device ends.

        A lost device is connected again. The pause before it doubles until readings have come again.
        """
        stopped, wait_s = self._source.stopped, MIN_WAIT_S
        while not stopped.is_set():
            count_before, failed = self._source.taken_from(self.driver), None
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
                if failed is not None:  # only now, when it accepts no command any more
                    self.message = str(failed)
                    self.state = "lost" if self.connections else "connecting"
                    _log.warning("%s", failed)
                self._source.wake()
            if self._source.taken_from(self.driver) > count_before:
                wait_s = MIN_WAIT_S
            stopped.wait(wait_s)
            wait_s = min(2 * wait_s, MAX_WAIT_S)


class HardwareSource:
    """The devices of a bench: their events in the order of arrival, all stamps on ``clock``. A context manager.

    On entry it starts a thread for each device. The thread connects the device, and connects it again with growing
    pauses where it is lost. Iteration waits for events and ends with `stop`, or when the cameras have ended (video
    files).

    Args:
        drivers: the devices; their streams have different names.
        info: metadata of the session.
        newest_only: whether only the newest frame of a view is kept, for display or estimation; else 64 are, for a
            recording.
        clock: clock of the host; by default a monotonic one that begins at 2 s.
        described: configs of the devices in ``bench.toml``, for `record`.

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
        """Makes a queue for each stream and a thread for each device; `__enter__` starts the threads."""
        self.session_info = info or SessionInfo()
        self.described = dict(described or {})
        self.clock: Clock = clock or SystemClock(START_NS)
        self.stopped = threading.Event()
        self._changed = threading.Condition()
        """Lock of the queues; notified when an event has come or the state of a device has changed."""
        self._order = 0
        """Number of events that have come, which gives each its place in the order of arrival."""
        self._force = ForceMonitor(self.session_info.sensor.range_n)
        self._ends_ns: int | None = None
        """Time on ``clock`` at which iteration ends; None: only `stop` ends it."""
        self._streams: dict[str, _Stream] = {}
        for driver in drivers:
            for declared in driver.streams:
                if declared.name in self._streams:
                    raise ValueError(f"two devices give the stream {declared.name!r}")
                room = 1 if newest_only and declared.kind == "frame" else QUEUE_LENGTHS[declared.kind]
                self._streams[declared.name] = _Stream(declared, room)
        self._devices = [_Device(driver, self) for driver in drivers]

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The streams that will come."""
        return tuple(stream.declared for stream in self._streams.values())

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the cameras' streams."""
        return tuple(stream.name for stream in self.streams if stream.kind == "frame")

    @property
    def actuators(self) -> GrblActuators | None:
        """The drives of the stage of the bench; None where it has none."""
        drivers = (device.driver for device in self._devices)
        return next((driver.actuators for driver in drivers if isinstance(driver, GrblStage)), None)

    def put(self, event: Event) -> None:
        """Adds the next event of a stream, from the thread of its driver; drops the oldest one if the queue is full."""
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
        """Reports a changed state, from the thread of a driver."""
        with self._changed:
            self._changed.notify_all()

    def taken_from(self, driver: Driver) -> int:
        """Returns the number of readings of ``driver`` until now."""
        return sum(self._streams[declared.name].meter.count for declared in driver.streams)

    def wait_connected(self, timeout_s: float) -> tuple[DeviceHealth, ...]:
        """Waits until all devices are connected, or for ``timeout_s``; returns those that are not connected."""
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
        """Ends the iteration after the events that have arrived; from any thread, or a signal handler."""
        self.stopped.set()

    def begin(self, seconds: float | None = None) -> None:
        """Discards waiting events, resets the counts of drops, and ends the iteration after ``seconds`` from now."""
        with self._changed:
            for stream in self._streams.values():
                stream.waiting.clear()
                stream.dropped = stream.unsorted = 0
        self._ends_ns = None if seconds is None else self.clock.now_ns() + round(seconds * 1e9)

    def __iter__(self) -> Iterator[Event]:
        while (event := self._next()) is not None:
            yield event

    def _next(self) -> Event | None:
        """Waits for the event that arrived first; None at the end. Raises the error of a thread that has failed."""
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
        """Returns the devices that are not connected, with the reasons, as text; empty if all are."""
        missing = [device for device in self._devices if device.state != "connected"]
        listed = (f"{device.driver.name} is {device.state}: {device.message}" for device in missing)
        return "; ".join(each.removesuffix(": ") for each in listed)

    def health(self) -> tuple[DeviceHealth, ...]:
        """Returns the present health of each device and its streams."""
        now, force = self.clock.now_ns(), self._force.remark
        with self._changed:
            return tuple(self._health_of(device, now, force) for device in self._devices)

    def _health_of(self, device: _Device, now_ns: int, force_remark: str) -> DeviceHealth:
        """Returns the health of a device; ``force_remark``, on implausible forces, is the message of a force sensor."""
        driver = device.driver
        clocks = driver.clocks()
        streams = tuple(
            StreamHealth(
                declared, stream.meter.rate_hz(now_ns), stream.meter.count, stream.dropped, stream.unsorted,
                stream.meter.age_s(now_ns), clocks.get(declared.name, ClockReport()),
            )
            for declared in driver.streams for stream in (self._streams[declared.name],)
        )  # fmt: skip
        return DeviceHealth(
            driver.name, device.state, device.connections, device.settings, dict(driver.counts),
            device.message or driver.remark or force_remark * any(s.stream.kind == "wrench" for s in streams), streams,
        )  # fmt: skip

    def __enter__(self) -> Self:
        for device in self._devices:
            if device.thread.ident is None:  # `record` also enters a source that its caller entered
                device.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        for device in self._devices:
            if device.thread.ident is not None:
                device.thread.join(MAX_JOIN_S)
