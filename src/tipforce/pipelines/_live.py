"""Live estimation: a source of the present, the engine, the page, and all other receivers of the estimates."""

import math
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Protocol, Self, TypeVar, runtime_checkable

from pydantic import Field, model_validator

from .._system.contexts import ClosedAtExit
from ..datasets import open_source
from ..errors import InputError
from ..estimators import Estimator
from ..io import FileSource
from ..live import Engine, LiveReport, LiveSettings, LiveUpdate, PacedSource
from ..live.streams import open_sink
from ..simulation import AnySimulationSettings, LiveSimulation, RealTimeClock
from ..types import Actuation, Actuators, AxisLimits, Clock, Commanded, Event, Frame, SessionInfo, Source, SystemClock
from ..units import newtons_to_grams
from ._control import bench_of_regime, path_of_drives
from ._estimate import for_source
from ._live_control import HoldSettings, LiveControl
from ._live_page import LivePage, PageAddress
from ._simulate import preset_settings

SESSION_S = 95.0
"""Length of a simulated session with drives after its beginning, in s: longer ones take longer to draw."""
_FRAME_S = 1 / 30
"""Time between images of a camera that states no rate."""
_OTHER_SESSION = "the simulated session has ended; its drives are at the beginning of another one"
_SLOW_PACE = 0.9
"""A simulated bench that runs slower than this share of real time is too slow, and a message says so."""
_T = TypeVar("_T")
_LINE_S = 0.25
"""The line on the terminal changes this often."""


class LiveRunSettings(LiveSettings):
    """Settings of the engine, and of the source that replaces a camera."""

    rate_hz: Annotated[float, Field(gt=0, le=240)] | None = None
    """Images a second of a file or the simulated bench, in place of its own rate."""
    loop: bool = False
    """A file begins again at its end."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    """Seed of the simulated bench's session."""
    hold: HoldSettings | None = None
    """A loop that holds a force with the drives of the bench, commanded from the page; None: nothing moves."""

    @model_validator(mode="after")
    def _below_both_limits(self) -> Self:
        hold, contact = self.hold, self.contact
        if hold is not None and hold.target_n >= contact.limit_n:
            raise ValueError(
                f"expected hold.target_n below contact.limit_n = {contact.limit_n:g}, got {hold.target_n:g}"
            )
        if hold is not None and contact.window_n[0] > hold.safety.limit_n:
            raise ValueError(
                f"expected contact.window_n[0] of at most hold.safety.limit_n = {hold.safety.limit_n:g}, "
                f"got {contact.window_n[0]:g}"
            )
        return self


@contextmanager
def open_live_source(
    frames: str | Path | None = None,
    *,
    preset: str | None = None,
    bench: str | Path | None = None,
    stated: SessionInfo | None = None,
    settings: LiveRunSettings | None = None,
) -> Generator[Source]:
    """Opens a source of the present; the engine runs on its ``clock``.

    Args:
        frames: a video, DICOM file, folder of images, recording or dataset, played at the pace of its stamps.
        preset: a simulated bench in real time instead; its session begins anew when it ends.
        bench: a ``bench.toml`` whose devices are the source where there is neither of the two.
        stated: metadata in place of those that the file, or the bench, holds.
        settings: rate, loop and seed.

    Yields:
        The source, not yet entered.

    Raises:
        InputError: there is no source or more than one, the file cannot be read, the bench has no device, or there is
            no such preset.
    """
    settings = settings or LiveRunSettings()
    if (frames is not None and preset is not None) or (frames, preset, bench) == (None, None, None):
        raise InputError(
            "expected one source: a file or folder with images, the preset of a simulated bench, or a bench.toml with "
            "devices"
        )
    if frames is not None:
        file = open_source(frames, stated=stated)
        if settings.rate_hz is None and isinstance(file, FileSource) and file.numbered:
            raise InputError(
                f"{frames}: no stamps state when its images were taken; state rate_hz, as in set rate_hz=30"
            )
        yield PacedSource(file, rate_hz=settings.rate_hz, loop=settings.loop)
        return
    if preset is None:
        from ..hardware import open_bench  # drivers are loaded where there are devices

        assert bench is not None
        devices = open_bench(bench, newest_only=True)
        devices.session_info = stated or devices.session_info
        yield devices
        return
    if stated not in (None, SessionInfo()):
        raise InputError("a simulated bench has metadata of its own; leave bench and fact out")
    bench_settings = simulated_bench(preset, settings)
    yield _BenchInRealTime(
        LiveSimulation(bench_settings, settings.seed, real_time=True),
        home_mm=1e3 * bench_settings.world.clamp.home_m,
        frame_period_s=1.0 / bench_settings.world.clock.fps,
    )


def simulated_bench(preset: str, settings: LiveRunSettings) -> AnySimulationSettings:
    """Makes the settings of a simulated bench; where a force is held, with wall and drives of `bench_of_regime`.

    Args:
        preset: name of the preset.
        settings: rate of the camera, and the loop that holds a force.

    Returns:
        The changed settings of the preset.

    Raises:
        InputError: there is no such preset.
    """
    changes = {} if settings.rate_hz is None else {"world": {"clock": {"fps": settings.rate_hz}}}
    bench = preset_settings(preset, None, changes)
    if settings.hold is None:
        return bench
    moving = bench_of_regime(bench, settings.hold.contact, SESSION_S)
    if settings.rate_hz is None:
        return moving
    clock = moving.world.clock.model_copy(update={"fps": settings.rate_hz})  # the regime has set a rate of its own
    return moving.model_copy(update={"world": moving.world.model_copy(update={"clock": clock})})


def slow_bench(clock: Clock, rate_hz: float, remedy: str) -> str:
    """Returns the message that a computer is too slow for a simulated bench in real time; empty if it is fast enough.

    Args:
        clock: clock of the bench.
        rate_hz: rate of the camera in images per second.
        remedy: a remedy besides ending other programs.
    """
    if not isinstance(clock, RealTimeClock) or clock.pace >= _SLOW_PACE:
        return ""
    return (
        f"the computer is too slow for the simulated bench at {rate_hz:g} images a second: it runs at {clock.pace:.0%} "
        f"of real time; end other programs, or {remedy}"
    )


class _CurrentDrives(ClosedAtExit):
    """The drives of the simulated session that is in progress."""

    def __init__(self, simulation: LiveSimulation) -> None:
        self._simulation = simulation
        self.sessions = 0
        """Number of sessions that have begun."""
        self._session = 0

    @property
    def limits(self) -> Mapping[str, AxisLimits]:
        """See `Actuators`."""
        return self._simulation.actuators.limits

    def command(self, targets: Mapping[str, float]) -> Commanded:
        """See `Actuators`. Raises InputError between two sessions, and once at the beginning of another one."""
        return self._of_same_session(lambda drives: drives.command(targets))

    def read(self) -> Actuation:
        """See `Actuators`. Raises InputError as `command`."""
        return self._of_same_session(lambda drives: drives.read())

    def stop(self, *axes: str) -> None:
        """See `Actuators`."""
        self._simulation.actuators.stop(*axes)

    def _of_same_session(self, use: Callable[[Actuators], _T]) -> _T:
        """Uses the drives and returns the result, which counts only if no other session has begun since the last call.

        The first call in a new session raises InputError: the drives have jumped to their first positions, so that a
        loop must not continue with them.
        """
        same, self._session = self.sessions == self._session, self.sessions
        try:
            result = use(self._simulation.actuators)
        except RuntimeError:  # the bench is closed
            same, result = False, None
        if not same or result is None:
            raise InputError(_OTHER_SESSION if self.sessions > 1 else "the simulated session begins")
        return result


class _BenchInRealTime(ClosedAtExit):
    """A simulated session over and over, on one clock.

    ``actuators``: the drives of the present session. ``home_mm``: position of its clamp when it begins.
    """

    def __init__(self, simulation: LiveSimulation, home_mm: float, frame_period_s: float) -> None:
        self.clock: Clock = SystemClock()
        self._simulation = simulation
        with simulation as bench:  # the session is drawn now, which takes seconds
            self.session_info = bench.source.session_info
        self.home_mm, self.frame_period_s = home_mm, frame_period_s
        self.actuators = _CurrentDrives(simulation)
        self._drawn = False

    def __iter__(self) -> Iterator[Event]:
        """Yields the events of one session after another; the stamps of each count from 0 and are moved to `clock`."""
        while True:
            with self._simulation as bench:
                self.actuators.sessions += 1
                for event in bench.source:
                    self._drawn = self._drawn or isinstance(event, Frame)  # for `trouble`
                    # anew for each event: a bench that draws too slowly sets its clock back
                    ahead_ns = self.clock.now_ns() - bench.clock.now_ns()
                    yield replace(event, stamp_ns=event.stamp_ns + ahead_ns)

    def true_force_n(self) -> float:
        """Returns the tissue's force on the tip now, in newtons: for a record only."""
        return self._simulation.true_force_n()

    def trouble(self) -> str:
        """Returns why no image comes in time: one sentence, or empty."""
        if not self._drawn:
            return (
                "the simulated bench draws its first image; it is compiled when a computer draws one for the first time"
            )
        rate_hz = 1.0 / self.frame_period_s
        fewer = f"state fewer images, as in `--set rate_hz={max(1.0, rate_hz / 2):.0f}`"
        return slow_bench(self._simulation.clock, rate_hz, fewer)


@runtime_checkable
class _Driven(Protocol):
    @property
    def actuators(self) -> Actuators | None: ...


def live(
    estimator: Estimator,
    source: Source,
    *,
    model: str = "",
    outputs: Sequence[str] = (),
    page: LivePage | PageAddress | None = None,
    settings: LiveSettings | None = None,
    seconds: float | None = None,
    on_page: Callable[[str], None] | None = None,
    on_update: Callable[[LiveUpdate], None] | None = None,
    on_report: Callable[[LiveReport], None] | None = None,
) -> LiveReport:
    """Estimates live until the source ends, ``seconds`` have passed, or an exception (as Ctrl-C) ends it.

    Args:
        estimator: a fitted method.
        source: a source of `open_live_source`, or any that pushes events.
        model: name of the model.
        outputs: other receivers of the estimates, as `tipforce.live.streams.open_sink` has them.
        page: a page that is served already, or where it is to be served; None: no page.
        settings: settings of the engine; of a file, failures are not waited for. Where they hold ``hold`` the page gets
            the panel of a loop that holds a force with the drives of ``source``; nothing moves before it is started
            there.
        seconds: longest duration in s; None: until the source ends.
        on_page: gets the page's address.
        on_update: gets the newest update four times a second.
        on_report: gets the report at the end, also where an exception ends the run.

    Returns:
        The report of the run.

    Raises:
        InputError: readings or metadata that ``estimator`` needs are missing, an output or the page cannot start, or a
            force shall be held without drives or a page.
    """
    settings = settings or LiveSettings()
    hold = settings.hold if isinstance(settings, LiveRunSettings) else None
    estimator = for_source(estimator, source.file if isinstance(source, PacedSource) else source)
    if isinstance(source, PacedSource):
        settings = settings.model_copy(update={"max_reconnects": 0})
    clock = getattr(source, "clock", None) or SystemClock()
    control = None if hold is None else _control(source, clock, hold, with_page=page is not None)
    if control is not None:  # one limit: the smaller of the two
        limit_n = min(settings.contact.limit_n, control.settings.safety.limit_n)
        control.set_limit(limit_n)
        settings = settings.model_copy(update={"contact": settings.contact.model_copy(update={"limit_n": limit_n})})
    sinks = [open_sink(address) for address in outputs]
    engine = Engine(source, estimator, sinks, settings=settings, clock=clock, model=model)

    def report() -> LiveReport:
        return engine.report if control is None else replace(engine.report, loop_runs=control.runs)

    with ExitStack() as stack:
        if on_report is not None:
            stack.callback(lambda: on_report(report()))
        if page is not None:
            served = stack.enter_context(LivePage(page)) if isinstance(page, PageAddress) else page
            served.begin(engine, clock, control)
            if on_page is not None:
                on_page(served.address)
        stack.enter_context(engine.running())
        if control is not None:
            stack.enter_context(control)  # it ends first, so the drives stop immediately
        end_s = None if seconds is None else time.monotonic() + seconds
        while not engine.wait(_LINE_S) and (end_s is None or time.monotonic() < end_s):
            latest = engine.latest()
            if on_update is not None and latest is not None:
                on_update(latest)
    return report()


def _control(source: Source, clock: Clock, hold: HoldSettings, *, with_page: bool) -> LiveControl:
    """Makes the loop that holds a force with the drives of ``source``.

    On a simulated bench its path is that of the benchmark, and the true force is recorded; else the operator marks it.

    Args:
        source: the source of images and drives.
        clock: the engine's clock.
        hold: settings of the loop.
        with_page: whether there is a page, on which the operator can stop.

    Raises:
        InputError: the source has no drives, or there is no page.
    """
    drives = source.actuators if isinstance(source, _Driven) else None
    if drives is None:
        raise InputError(
            "hold: this source has no drives; expected a simulated bench, or a bench.toml with [hardware.stage]"
        )
    if not with_page:
        raise InputError("hold: a run is started and stopped on the page, so there has to be one")
    if isinstance(source, _BenchInRealTime):
        path = path_of_drives(hold.drives, source.home_mm)
        return LiveControl(
            drives, clock, hold, (path.start, path.goal),
            frame_period_s=source.frame_period_s, true_force_n=source.true_force_n,
        )  # fmt: skip
    from ..hardware import HardwareSource  # as in `open_live_source`

    streams = source.streams if isinstance(source, HardwareSource) else ()
    rates = [stream.rate_hz for stream in streams if stream.kind == "frame"]
    period_s = max((1.0 / rate for rate in rates if rate), default=_FRAME_S)
    return LiveControl(drives, clock, hold, frame_period_s=period_s)


def live_line(update: LiveUpdate) -> str:
    """Returns an update in one line for people: force with its interval, or why there is none, latency, drops.

    >>> import numpy as np
    >>> from tipforce.live import LiveHealth
    >>> from tipforce.types import ForceEstimate, Status
    >>> lost = ForceEstimate.invalid(0, Status.STALE, "the last image of the view camera is 250 ms old")
    >>> live_line(LiveUpdate(0, lost, None, {}, 0, 250_000_000, LiveHealth(30.0, 90, camera="late")))
    'NOT VALID (stale): the last image of the view camera is 250 ms old | 30.0 images/s'
    """
    estimate, health = update.estimate, update.health
    if estimate.valid:
        low, high = estimate.magnitude_interval_n.tolist()
        force = (
            f"{newtons_to_grams(estimate.magnitude_n):5.1f} g  {estimate.magnitude_n:.3f} N ({low:.3f} to {high:.3f})"
        )
    else:
        force = f"NOT VALID ({estimate.status}): {estimate.detail}"
    parts = [force]
    if update.clinical is not None and estimate.valid:
        parts.append(update.clinical.contact.value.replace("_", " "))
    if update.zero is not None:
        parts.append(f"zero {newtons_to_grams(update.zero.magnitude_n):+.1f} g")
    if not math.isnan(health.latency_p50_s):
        parts.append(f"{1e3 * health.latency_p50_s:.1f} ms (p99 {1e3 * health.latency_p99_s:.1f})")
    parts.append(f"{health.frames_per_s:.1f} images/s")
    if health.dropped:
        parts.append(f"{health.dropped} of {health.frames_in} dropped")
    failing = {name: sink for name, sink in health.sinks.items() if sink.hung or sink.message}
    parts += [sink.message if sink.ended else f"{name}: {sink.message or 'hangs'}" for name, sink in failing.items()]
    return " | ".join(parts)
