"""A bench of devices, or a simulated one in real time, into one recording, with all that is known of its health."""

import json
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from .._system.contexts import ClosedAtExit
from .._system.json_files import finite_values
from ..alignment import OffsetChoice, TareChoice
from ..errors import DeviceError, InputError
from ..hardware import (
    ClockReport,
    DeclaredStream,
    DeviceHealth,
    GrblConfig,
    HardwareSource,
    StreamHealth,
    StreamMeter,
    open_bench,
    read_devices,
)
from ..plausibility import ForceMonitor
from ..simulation import LiveSimulation
from ..types import Clock, Event, Frame, SessionInfo, Source, Wrench
from ._guided import Guide, missing_for_training
from ._live import slow_bench
from ._record import Ended, RecordingReport, record
from ._simulate import preset_settings
from ._stage_motion import StageMotion

_TO_START_S = 60.0
"""For the stage to get to where its motion begins."""
_CONNECT_S = 10.0
"""For all devices to answer."""


class BenchRecording:
    """A recording that can be watched: ``health`` and ``prompt`` may be called from another thread.

    Args:
        bench: ``bench.toml`` with its devices.
        simulated: preset of a simulated bench, in place of devices, in real time.
        stated: metadata in place of those of ``bench``.
        seconds: duration in s; None: until `stop`, the end of the guide, or of a simulated session.
        guide: a guided first session, or None.
        partial: record also where a device does not answer.
        seed: seed of the simulated bench.

    Raises:
        InputError: neither or both of ``bench`` and ``simulated`` are given, or the bench is refused.
    """

    def __init__(
        self,
        bench: Path | None = None,
        *,
        simulated: str | None = None,
        stated: SessionInfo | None = None,
        seconds: float | None = None,
        guide: Guide | None = None,
        partial: bool = False,
        seed: int = 0,
    ) -> None:
        if (bench is None) == (simulated is None):
            raise InputError("state either a bench.toml with its devices, or the preset of a simulated bench")
        if seconds is not None and not seconds > 0:
            raise InputError(f"seconds = {seconds:g} is refused: expected more than 0")
        self.guide, self._seconds, self._partial = guide, seconds, partial
        self._stated = stated or SessionInfo()
        self._hardware = None if bench is None else open_bench(bench)
        stage = None if bench is None else read_devices(bench).stage
        self._stage = stage if isinstance(stage, GrblConfig) else None
        self._simulation = (
            None if simulated is None else LiveSimulation(preset_settings(simulated), seed, real_time=True)
        )
        self._watched: _Watched | None = None
        self._stopped = False
        self.health_at_end: tuple[DeviceHealth, ...] = ()

    def stop(self) -> None:
        """Ends the recording after the events that have arrived; from any thread, or a signal's handler."""
        self._stopped = True
        if self._watched is not None:
            self._watched.stop()

    def health(self) -> tuple[DeviceHealth, ...]:
        """Returns the present health of the devices."""
        if self._hardware is not None:
            return self._hardware.health()
        return self._watched.health() if self._watched is not None else ()

    def seconds_so_far(self) -> float:
        """Returns the duration of the recording in s; 0 before it has begun."""
        return self._watched.seconds() if self._watched is not None else 0.0

    def connect(self) -> list[str]:
        """Waits for the devices; returns remarks on settings that differ from the requested ones.

        Raises:
            DeviceError: a device does not answer, unless ``partial``; all of them are named.
        """
        if self._hardware is None:
            return []
        self._hardware.__enter__()
        missing = self._hardware.wait_connected(_CONNECT_S)
        faults = [device.message or f"hardware.{device.name} does not answer" for device in missing]
        if faults and not self._partial:
            self._hardware.__exit__(None, None, None)
            raise DeviceError(f"{'; '.join(faults)}; to record without, state partial=True")
        return faults + [
            f"hardware.{device.name}: {setting.name} is {_shown(setting.actual)}, not {_shown(setting.requested)} as "
            "asked for"
            for device in self._hardware.health()
            for setting in device.settings
            if setting.differs
        ]

    def run(
        self,
        target: Path,
        *,
        tare: TareChoice = "auto",
        offset_ms: OffsetChoice = "auto",
        lossless: bool = False,
        overwrite: bool = False,
    ) -> RecordingReport:
        """Records until the end.

        With a guide the remarks end with the conditions that are missing for training, or state that none is.

        Args:
            target: the recording (.mcap).
            tare: see `import_session`.
            offset_ms: see `import_session`.
            lossless: keep images as PNG.
            overwrite: replace a recording that is there already.

        Returns:
            The report of `record`.

        Raises:
            InputError, FileFormatError, TimeError, OutputError: see `record`.
        """
        if self._hardware is not None:
            with self._hardware as source, self._motion(source):
                source.begin(self._seconds)
                return self._run(source, source.clock, target, tare, offset_ms, lossless, overwrite)
        assert self._simulation is not None
        with self._simulation as simulation:
            return self._run(simulation.source, simulation.clock, target, tare, offset_ms, lossless, overwrite)

    @contextmanager
    def _motion(self, source: HardwareSource) -> Generator[None]:
        """Moves the stage meanwhile if ``bench.toml`` states a motion; it brakes at every end of the recording."""
        if self._stage is None or self._stage.motion is None or (stage := source.actuators) is None:
            yield
            return
        with stage:
            StageMotion(self._stage.motion).begin(stage, _TO_START_S, lambda: self._stopped)
            yield

    def _run(
        self,
        source: Source,
        clock: Clock,
        target: Path,
        tare: TareChoice,
        offset_ms: OffsetChoice,
        lossless: bool,
        overwrite: bool,
    ) -> RecordingReport:
        """Records a source that is open, and adds remarks on devices, speed and missing conditions; see `run`.

        Args:
            source: the devices or the simulated session.
            clock: the clock of its stamps.
            target: the recording (.mcap).
            tare: see `import_session`.
            offset_ms: see `import_session`.
            lossless: keep images as PNG.
            overwrite: replace a recording that is there already.
        """
        info = source.session_info.updated(self._stated)
        self._watched = _Watched(source, clock, info, self._seconds, self.guide)
        if self._stopped:  # before there was anything to stop
            self._watched.stop()
        report = record(
            self._watched, target, tare=tare, offset_ms=offset_ms, lossless=lossless, overwrite=overwrite,
            ended=self._ended,
        )  # fmt: skip
        remarks = describe_health(self.health_at_end)
        if self._simulation is not None:
            faster = "use `tipforce simulate`, which needs no real time"
            slow = slow_bench(clock, self._simulation.settings.world.clock.fps, faster)
            remarks += [slow] if slow else []
        if self.guide is not None:
            missing = missing_for_training(report.summary, self.guide)
            remarks += [f"missing: {condition}" for condition in missing] or [
                f"you can train now: `tipforce train {target} -o models/svr`; record more sessions to judge it by"
            ]
        return RecordingReport(report.summary, (*report.remarks, *remarks))

    def _ended(self) -> Ended:
        """Returns the facts that are known at the end: clock, health and description of the devices; the guide's tare.

        Keeps the health: the devices are released soon after.
        """
        assert self._watched is not None
        self.health_at_end = self.health()
        notes = {
            "tipforce.clock": _clock_statement(self._watched.clock, self.health_at_end),
            "tipforce.devices": {"json": _json([asdict(device) for device in self.health_at_end])},
        }
        if self._hardware is not None:
            notes["tipforce.hardware"] = {"json": _json(self._hardware.described)}
        return Ended(notes, None if self.guide is None else self.guide.tare_s)


class _Watched(ClosedAtExit):
    """A source that counts its events, passes them to a guide, and ends in time.

    Args:
        source: the source of the events.
        clock: the clock of its stamps.
        info: metadata of the session.
        seconds: duration in s from the first event; None: until `stop`, or the end of the guide or the source.
        guide: the guide of a first session, which the events move on; None without one.
    """

    def __init__(
        self, source: Source, clock: Clock, info: SessionInfo, seconds: float | None, guide: Guide | None
    ) -> None:
        self._source, self.clock, self.session_info = source, clock, info
        self._seconds, self._guide = seconds, guide
        self._stopped = False
        self._began_ns: int | None = None
        """Stamp of the first event; None before it."""
        self._meters: dict[tuple[str, str], StreamMeter] = {}
        """Count and rate of the events by stream and kind, as ("camera", "frame")."""
        self._force_monitor = ForceMonitor(info.sensor.range_n)
        """Watches the force for a fault of the sensor, where no device does so."""

    def stop(self) -> None:
        """Ends after the event that comes next."""
        self._stopped = True
        if isinstance(self._source, HardwareSource):
            self._source.stop()

    def seconds(self) -> float:
        """Returns the time in s since the first event's stamp."""
        return 0.0 if self._began_ns is None else (self.clock.now_ns() - self._began_ns) * 1e-9

    def __iter__(self) -> Iterator[Event]:
        """Yields the events of the source until the duration has passed, the guide is done, or `stop` was called."""
        for event in self._source:
            if self._began_ns is None:
                self._began_ns = event.stamp_ns
            name, kind = _stream(event)
            self._meters.setdefault((name, kind), StreamMeter()).add(self.clock.now_ns())
            if isinstance(event, Wrench) and not isinstance(self._source, HardwareSource):  # which checks its own
                self._force_monitor.add(event.stamp_ns, event.force_n)
            yield event
            if self._guide is not None:
                self._guide.take(event)
            over = self._seconds is not None and event.stamp_ns - self._began_ns >= self._seconds * 1e9
            if over or self._stopped or (self._guide is not None and self._guide.done):
                self.stop()
                # a hardware source ends by itself, after the events that have arrived
                if not isinstance(self._source, HardwareSource):
                    return

    def health(self) -> tuple[DeviceHealth, ...]:
        """Returns the health of a source without devices, as one device."""
        now = self.clock.now_ns()
        streams = tuple(
            StreamHealth(
                DeclaredStream(name, kind, None, "simulated"),  # type: ignore[arg-type]
                meter.rate_hz(now), meter.count, 0, 0, meter.age_s(now), ClockReport(),
            )
            for (name, kind), meter in tuple(self._meters.items())
        )  # fmt: skip
        return (DeviceHealth("simulated bench", "connected", 1, (), {}, self._force_monitor.remark, streams),)


def _stream(event: Event) -> tuple[str, Any]:
    """Returns stream and kind of an event, as ("camera", "frame")."""
    if isinstance(event, Frame):
        return event.view, "frame"
    return ("force", "wrench") if isinstance(event, Wrench) else (event.stream, "actuation")


def describe_health(devices: tuple[DeviceHealth, ...]) -> list[str]:
    """Returns one line for each device or stream with a fault during the recording."""
    lines: list[str] = []
    for device in devices:
        faults = [f"{count} {kind}" for kind, count in sorted(device.counts.items()) if count]
        if device.connections > 1:
            faults.append(f"connected {device.connections} times")
        for stream in device.streams:
            if stream.dropped:
                faults.append(f"{stream.dropped} of {stream.stream.name} dropped, for the writing was behind")
            if stream.unsorted:
                faults.append(f"{stream.unsorted} of {stream.stream.name} refused, for their stamps did not rise")
            if not stream.count:
                faults.append(f"nothing came of {stream.stream.name}")
        if faults:
            lines.append(f"{device.name}: {', '.join(faults)}" + (f" ({device.message})" if device.message else ""))
    return lines


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float | int) else str(value)


def _json(value: object) -> str:
    return json.dumps(finite_values(value), ensure_ascii=False)


def _clock_statement(clock: Clock, devices: tuple[DeviceHealth, ...]) -> dict[str, str]:
    """Returns the meaning of the stamps of each stream, and the time of their zero."""
    zero = datetime.now(UTC) - timedelta(microseconds=clock.now_ns() / 1000)
    return {
        "zero_utc": zero.isoformat(timespec="milliseconds"),
        "meaning": "all stamps are nanoseconds on the recording machine's monotonic clock since zero_utc",
        "streams": _json(
            {
                stream.stream.name: {
                    "stamps": stream.stream.clock,
                    "offset_s": stream.clock.offset_s,
                    "mean_delay_s": stream.clock.delay_s,
                    "drift_ppm": stream.clock.drift_ppm,
                }
                for device in devices
                for stream in device.streams
            }
        ),
    }
