"""Live estimation: a source that happens now, the engine, the page, and whatever else takes the estimates."""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Annotated, Self

from pydantic import Field

from ..datasets import open_source
from ..errors import InputError
from ..estimators import Estimator
from ..io import FileSource
from ..live import Engine, LiveReport, LiveSettings, LiveUpdate, PacedSource, Sink
from ..live.streams import open_sink
from ..simulation import LiveSimulation
from ..types import Clock, Event, SessionInfo, Source, SystemClock
from ..units import newtons_to_grams
from ._estimate import check_inputs
from ._simulate import preset_settings

__all__ = ["LiveRunSettings", "PageAddress", "live", "live_line", "open_live_source"]

_LINE_S = 0.25
"""The line on the terminal changes this often."""


class LiveRunSettings(LiveSettings):
    """Settings of the engine, and of what plays the part of a camera where there is none."""

    rate_hz: Annotated[float, Field(gt=0, le=240)] | None = None
    """Images a second of a file or the simulated bench, in place of its own rate."""
    loop: bool = False
    """A file begins again at its end."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    """Of the simulated bench's session."""


@dataclass(frozen=True, slots=True)
class PageAddress:
    """Where the page is served; ``token`` as `tipforce.live.server.serve` has it."""

    host: str = "127.0.0.1"
    port: int = 0
    token: str | None = None


@contextmanager
def open_live_source(
    frames: str | Path | None = None,
    *,
    preset: str | None = None,
    bench: str | Path | None = None,
    stated: SessionInfo | None = None,
    settings: LiveRunSettings | None = None,
) -> Generator[Source]:
    """A source that happens now; its ``clock`` is what the engine should run on.

    Args:
        frames: a video, DICOM file, folder of images, recording or dataset, played at the pace of its stamps.
        preset: a simulated bench in real time instead; its session begins anew when it ends.
        bench: a ``bench.toml`` whose devices are the source where there is neither of the two.
        stated: metadata in place of those that the file, or the bench, holds.
        settings: rate, loop and seed.

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
            raise InputError(f"{frames}: nothing tells when its images were taken; state rate_hz, as in set rate_hz=30")
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
    changes = {} if settings.rate_hz is None else {"world": {"clock": {"fps": settings.rate_hz}}}
    yield _BenchInRealTime(LiveSimulation(preset_settings(preset, None, changes), settings.seed, real_time=True))


class _BenchInRealTime:
    """A simulated session over and over, on one clock."""

    def __init__(self, simulation: LiveSimulation) -> None:
        self.clock: Clock = SystemClock()
        self._simulation = simulation
        with simulation as bench:  # the session is drawn now, which takes seconds
            self.session_info = bench.source.session_info

    def __iter__(self) -> Iterator[Event]:
        while True:
            with self._simulation as bench:
                ahead_ns = self.clock.now_ns() - bench.clock.now_ns()
                for event in bench.source:
                    yield replace(event, stamp_ns=event.stamp_ns + ahead_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """The session ends with the iteration."""


def live(
    estimator: Estimator,
    source: Source,
    *,
    model: str = "",
    outputs: Sequence[str] = (),
    page: PageAddress | None = None,
    settings: LiveSettings | None = None,
    seconds: float | None = None,
    on_page: Callable[[str], None] | None = None,
    on_update: Callable[[LiveUpdate], None] | None = None,
    on_report: Callable[[LiveReport], None] | None = None,
) -> LiveReport:
    """Estimates live until the source ends, ``seconds`` have passed, or an exception (as Ctrl-C) ends it.

    Args:
        estimator: a fitted one.
        source: of `open_live_source`, or any that pushes events.
        model: what the model is called.
        outputs: where else the estimates go, as `tipforce.live.streams.open_sink` has it.
        page: where the page is served; None: no page.
        settings: of the engine; of a file, failures are not waited for.
        seconds: at most so long.
        on_page: gets the page's address.
        on_update: gets the newest update four times a second.
        on_report: gets the report at the end, also where an exception ends the run.

    Raises:
        InputError: readings or metadata that ``estimator`` needs are missing, or an output or the page cannot start.
    """
    settings = settings or LiveSettings()
    check_inputs(estimator, source.file if isinstance(source, PacedSource) else source)
    if isinstance(source, PacedSource):
        settings = settings.model_copy(update={"max_reconnects": 0})
    clock = getattr(source, "clock", None) or SystemClock()
    sinks = [open_sink(each) for each in outputs]
    engine = Engine(source, estimator, sinks, settings=settings, clock=clock, model=model)
    with ExitStack() as stack:
        if on_report is not None:
            stack.callback(lambda: on_report(engine.report))
        if page is not None:
            address = stack.enter_context(_page(engine, clock, page))
            if on_page is not None:
                on_page(address)
        stack.enter_context(engine.running())
        end = None if seconds is None else time.monotonic() + seconds
        while not engine.wait(_LINE_S) and (end is None or time.monotonic() < end):
            latest = engine.latest()
            if on_update is not None and latest is not None:
                on_update(latest)
    return engine.report


@contextmanager
def _page(engine: Engine, clock: Clock, page: PageAddress) -> Generator[str]:
    """Serves the page; yields its address."""
    from ..live.server import PageSettings, serve  # a web server is loaded where there is a page

    recorder = _Recorder(engine)
    settings = PageSettings(
        clock=clock,
        contact=engine.contact,
        on_contact=lambda contact: setattr(engine, "contact", contact),
        on_record=recorder.switch,
    )
    with serve(engine, host=page.host, port=page.port, token=page.token, settings=settings) as server:
        engine.add_sink(server.sink)
        yield server.address


class _Recorder:
    """The page's record button: each time a file of its own in the current folder, named by the time of the day."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._sink: Sink | None = None

    def switch(self, on: bool) -> None:
        """Begins or ends a recording. Raises InputError where its file cannot be made."""
        if on and self._sink is None:
            self._sink = open_sink(f"recording:{time.strftime('live-%Y%m%d-%H%M%S')}.mcap")
            self._engine.add_sink(self._sink)
        elif not on and self._sink is not None:
            sink, self._sink = self._sink, None
            health = self._engine.remove_sink(sink)
            if health.failures:
                raise InputError(f"{sink.name}: {health.message}")


def live_line(update: LiveUpdate) -> str:
    """An update in one line for people: force with its interval, or why there is none, latency, drops.

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
    if health.latency_p50_s == health.latency_p50_s:
        parts.append(f"{1e3 * health.latency_p50_s:.1f} ms (p99 {1e3 * health.latency_p99_s:.1f})")
    parts.append(f"{health.frames_per_s:.1f} images/s")
    if health.dropped:
        parts.append(f"{health.dropped} of {health.frames_in} dropped")
    parts += [f"{name}: {sink.message or 'hangs'}" for name, sink in health.sinks.items() if sink.hung or sink.message]
    return " | ".join(parts)
