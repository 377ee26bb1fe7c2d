"""Source -> newest frame -> estimator -> sinks, each on a thread of its own, and a watchdog on another thread."""

import logging
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np

from ..clinical import ContactSettings
from ..estimators import Estimator, Stream
from ..types import ADVANCE, Clock, ForceEstimate, Image, Source, Status, SystemClock
from ._contact import ContactTotals
from ._intake import Instant, Intake
from ._latency import Histogram, RecentDelays
from ._reader import SourceReader
from ._report import LiveReport
from ._runner import SinkRunner
from ._settings import LiveSettings
from ._shape import ShapeFinder
from ._sinks import Sink
from ._update import LiveHealth, LiveUpdate, SinkHealth
from ._watchdog import Fault
from ._zero import ZeroButton

_log = logging.getLogger(__name__)

CHECK_INTERVAL_S = 0.1
"""Interval at which waiting threads check whether the run has ended."""
DEADLINE_MARGIN_NS = 500_000
"""The watchdog wakes up this long after a deadline, so that the deadline has passed."""
_NO_FRAMES: Mapping[str, Image] = MappingProxyType({})


@runtime_checkable
class _Clocked(Protocol):
    @property
    def clock(self) -> Clock: ...


@runtime_checkable
class _Stoppable(Protocol):
    def stop(self) -> None: ...


@runtime_checkable
class _Explaining(Protocol):
    def trouble(self) -> str: ...


class Engine:
    """Estimates forces live. An engine runs once.

    Args:
        source: yields events as they happen. Each image is an array of its own, which nobody changes afterwards. Where
            the ``clock`` of the source is this ``clock``, its stamps are used unchanged; otherwise they are mapped to
            this clock by the smallest delay of arrival. A source that may wait long for events has a method ``stop``;
            a source that knows the reason of a fault has a method ``trouble``, which returns a sentence or "".
        estimator: a fitted estimator. It is started with the session metadata alone, so a method that resolves its
            detection settings on images does so on the first ones.
        sinks: get every update, each at its own pace.
        settings: time limits, and the reactions to failures.
        clock: clock of the engine; by default the machine's monotonic clock.
        model: name of the model, for the sinks.
    """

    def __init__(
        self,
        source: Source,
        estimator: Estimator,
        sinks: Sequence[Sink] = (),
        *,
        settings: LiveSettings | None = None,
        clock: Clock | None = None,
        model: str = "",
    ) -> None:
        self.settings = settings or LiveSettings()
        self.clock = clock or SystemClock()
        self._source, self._estimator, self._info = source, estimator, source.session_info
        self._model = model or estimator.name
        self._stop, self._done, self._wake = threading.Event(), threading.Event(), threading.Event()
        same_clock = isinstance(source, _Clocked) and source.clock is self.clock
        self._intake = Intake(
            estimator.views,
            self._info,
            self.settings,
            same_clock=same_clock,
            apart=not estimator.needs_all_views,
            on_fault=self._wake.set,
        )
        self._reader = SourceReader(source, self._intake, self.settings, self.clock, self._stop)
        self._runners: tuple[SinkRunner, ...] = ()
        self._publishing = threading.RLock()
        self._contact, self._zero = ContactTotals(self.settings.contact), ZeroButton(self.settings)
        self._recent, self._all = RecentDelays(), Histogram()
        self._shapes = ShapeFinder(estimator.views[0], self._info) if self.settings.detect else None
        self._latest: LiveUpdate | None = None
        self._answered_ns: int | None = None
        self._trouble = ""
        self._over = False
        self._report = LiveReport()
        self._began_ns = 0
        self._threads: list[threading.Thread] = []
        for sink in sinks:
            self.add_sink(sink)

    def run(self) -> LiveReport:
        """Runs until the source ends or `stop` is called. Raises RuntimeError the second time."""
        with self.running():
            while not self.wait(CHECK_INTERVAL_S):
                pass
        return self._report

    @contextmanager
    def running(self) -> Generator[None]:
        """Runs the engine during the block of the caller; then the run has ended and `report` is complete."""
        if self._threads:
            raise RuntimeError("an engine runs once; make another one")
        self._began_ns, cpu_s = self.clock.now_ns(), time.process_time()
        loops = {
            "live-source": self._reader.run,
            "live-estimator": lambda: self._last(self._estimate),
            "live-watchdog": lambda: self._last(self._watch),
        }
        with self._publishing:
            self._threads = [threading.Thread(target=loop, name=name, daemon=True) for name, loop in loops.items()]
            for each in (*self._runners, *self._threads):
                each.start()
        try:
            yield
        finally:
            self.stop()
            for thread in self._threads:  # a thread that hangs in a driver or a method ends with the program
                thread.join(self.settings.hung_s)
            self._say_last(self._reader.end or "the run was stopped")
            self._close_sinks()
            self._finish_report(time.process_time() - cpu_s)

    def add_sink(self, sink: Sink, on_end: Callable[[str], None] | None = None) -> None:
        """Adds a sink, also while the engine runs; the sink is started with the engine.

        Args:
            sink: gets every update from now on.
            on_end: gets the reason if the sink fails and is not started again; called on the thread of the sink.
        """
        runner = SinkRunner(sink, self._info, self._model, self.settings, self.clock, on_end)
        with self._publishing:
            self._runners = (*self._runners, runner)
            if self._threads:
                runner.start()

    def remove_sink(self, sink: Sink) -> SinkHealth:
        """Ends a sink while the others continue: it takes the waiting updates and is closed.

        Returns:
            The health of the sink at its end.

        Raises:
            KeyError: the engine does not have this sink.
        """
        with self._publishing:
            runner = next((each for each in self._runners if each.sink is sink), None)
            if runner is None:
                raise KeyError(sink.name)
            self._runners = tuple(each for each in self._runners if each is not runner)
        runner.ask_to_close()
        runner.wait_closed()
        return runner.health(self.clock.now_ns())

    @property
    def report(self) -> LiveReport:
        """Summary of the run; complete when the run has ended."""
        return self._report

    def wait(self, timeout_s: float) -> bool:
        """Waits for the end of the run; returns True if the source has ended or `stop` was called."""
        return self._done.wait(timeout_s)

    def stop(self) -> None:
        """Ends the run; may be called from any thread, and more than once."""
        self._stop.set()
        self._done.set()
        self._wake.set()
        if isinstance(self._source, _Stoppable):
            self._source.stop()

    def zero(self, *, by: str = "", confirmed_n: float | None = None) -> None:
        """Subtracts the present force from every estimate from now on; `LiveUpdate.zero` states it.

        The intervals then span the force with and without the zero, so a zero never lowers their upper ends, on which
        alarm and limit act.

        Args:
            by: name of the person or page that requests the zero.
            confirmed_n: the magnitude that may be subtracted although the tip may be in contact; it is the
                magnitude of a preceding `ZeroInContactError`.

        Raises:
            InputError: the last second has too few valid estimates, or the force is too large to be an error of the
                zero.
            ZeroInContactError: the tip may be in contact, and this magnitude was not confirmed.
        """
        with self._publishing:
            self._zero.press(self.clock.now_ns(), by=by, confirmed_n=confirmed_n)

    def clear_zero(self) -> None:
        """Removes the zero: nothing is subtracted from now on."""
        with self._publishing:
            self._zero.clear()

    def start_integral(self) -> None:
        """Starts the force-time integral and the contact times from 0."""
        with self._publishing:
            self._contact.start()

    def stop_integral(self) -> None:
        """Stops the force-time integral; its value stays."""
        with self._publishing:
            self._contact.stop()

    @property
    def contact(self) -> ContactSettings:
        """Force window, limit and contact threshold; may be set during the run."""
        return self._contact.settings

    @contact.setter
    def contact(self, settings: ContactSettings) -> None:
        with self._publishing:
            self._contact.settings = settings

    def latest(self) -> LiveUpdate | None:
        """Returns the last update as of now; None before the first one. After a fault it is that of the watchdog."""
        latest = self._latest
        return None if latest is None else latest.as_of(self.clock.now_ns())

    def _last(self, loop: Callable[[], None]) -> None:
        """Runs a loop that the run needs: when the loop ends, for any reason, the run ends."""
        try:
            loop()
        finally:
            self.stop()

    def _estimate(self) -> None:
        """Estimates and publishes each instant of the intake, on the thread of the estimator.

        A method that raises is started again, after a wait that doubles up to ``reconnect_max_s``. The loop ends with
        `stop`, or when the source has ended and no instant is left.
        """
        stream: Stream | None = None
        run, wait_s = 0, self.settings.reconnect_s
        while not self._stop.is_set():
            source_ended = not self._threads[0].is_alive()
            instant = self._intake.take(CHECK_INTERVAL_S)
            if instant is None:
                if source_ended:
                    break
                continue
            try:
                if stream is None or instant.run != run:  # the clock of the source restarted: old images do not count
                    stream, run = self._start_stream(), instant.run
                estimate = self._with_shape(stream.update(instant.observation).checked(), instant)
                self._trouble, wait_s = "", self.settings.reconnect_s
            except Exception as error:  # a method should never raise; the run continues and reports the error
                _log.exception("the method failed")
                stream, self._trouble = None, f"the method failed: {type(error).__name__}: {error}"
                estimate = ForceEstimate.invalid(instant.observation.stamp_ns, Status.STALE, self._trouble)
            self._publish_frame(instant, estimate)
            if self._trouble:
                self._stop.wait(wait_s)
                wait_s = min(2.0 * wait_s, self.settings.reconnect_max_s)
        if self._shapes is not None:
            self._shapes.close()

    def _with_shape(self, estimate: ForceEstimate, instant: Instant) -> ForceEstimate:
        """Returns ``estimate`` with a shape for page and recording if the method detects none."""
        image = instant.observation.views.get(self._estimator.views[0])
        if self._shapes is None or estimate.shape is not None or not isinstance(image, np.ndarray):
            return estimate
        try:
            shape = self._shapes.find(image, instant.observation.actuation.get(ADVANCE, 0.0))
        except Exception:  # only the drawing is missing then; the force is not affected
            _log.exception("the catheter is not detected for display any more")
            self._shapes = None
            return estimate
        return estimate if shape is None else replace(estimate, shape=shape)

    def _start_stream(self) -> Stream:
        with self._publishing:
            self._zero.clear()  # the zero of the method itself is also taken again
        return self._estimator.start(self._info)

    def _publish_frame(self, instant: Instant, estimate: ForceEstimate) -> None:
        """Rejects an estimate that is too old or has too old inputs, counts it in the report, and publishes it."""
        with self._publishing:
            now_ns = self.clock.now_ns()
            # an estimate of an earlier image is as old as that image
            captured_ns = instant.captured_ns - max(0, instant.observation.stamp_ns - estimate.stamp_ns)
            self._answered_ns = captured_ns
            rejection = self._rejection(instant, estimate.stamp_ns, captured_ns, now_ns)
            if rejection is not None:
                estimate = ForceEstimate.invalid(estimate.stamp_ns, *rejection, estimate.shape)
            delay_s = (now_ns - captured_ns) * 1e-9
            self._recent.add(now_ns, delay_s)
            self._all.add(delay_s)
            self._report.estimated += 1
            self._report.statuses[estimate.status.value] += 1
            self._report.valid += estimate.valid
            frames = {view: image for view, image in instant.observation.views.items() if isinstance(image, np.ndarray)}
            fault = self._camera_fault(now_ns)
            self._publish(estimate, MappingProxyType(frames), captured_ns, now_ns, fault, instant.beside)

    def _camera_fault(self, now_ns: int) -> Fault | None:
        """Returns the fault of the cameras, with the reason that the source states; None without a fault."""
        fault = self._intake.fault(now_ns)
        if fault is None or not isinstance(self._source, _Explaining):
            return fault
        try:
            why = self._source.trouble()
        except Exception as error:  # an error in the driver's status method must not stop the watchdog
            why = f"the source cannot state the reason: {type(error).__name__}"
        return Fault(fault.camera, f"{fault.message}; {why}") if why else fault

    def _rejection(self, instant: Instant, stamp_ns: int, captured_ns: int, now_ns: int) -> tuple[Status, str] | None:
        """Returns status and reason with which an estimate is rejected regardless of its values; None: it is accepted.

        Args:
            instant: input of the estimator.
            stamp_ns: stamp of the estimate, on the source's clock.
            captured_ns: mid-exposure of the image of the estimate, on the engine's clock.
            now_ns: present time, on the engine's clock.
        """
        fault = self._camera_fault(now_ns)
        if fault is not None:
            return Status.STALE, fault.message
        ahead_ns = stamp_ns - instant.observation.stamp_ns
        if ahead_ns > 0:
            return Status.STALE, (
                f"the method stamped its estimate {ahead_ns * 1e-6:.0f} ms after the image; expected the image's stamp"
            )
        age_ns, limit_ns = now_ns - captured_ns, self._intake.limit_ns
        if age_ns > limit_ns:
            return Status.STALE, (
                f"the image was {age_ns * 1e-6:.0f} ms old when its force was ready; "
                f"at most {limit_ns * 1e-6:.0f} ms are allowed"
            )
        for name in (*self._estimator.required_actuation, ADVANCE):  # without the advance the base position is wrong
            if name in instant.too_old_s:
                return Status.MISSING_INPUT, (
                    f"{name} was read {instant.too_old_s[name]:.1f} s before the image; "
                    f"at most {self.settings.actuation_age_s:g} s are allowed"
                )
        return None

    def _watch(self) -> None:
        """Runs on the thread of the watchdog: publishes that no force is valid, also while other threads are busy.

        Without a fault it sleeps until the present estimate becomes stale; during a fault it repeats the notice every
        ``notice_s`` seconds. `_wake` ends a sleep early: for an unusable image, a failed source, or the end.
        """
        while not self._done.is_set():
            self._wake.clear()
            with self._publishing:
                now_ns = self.clock.now_ns()
                fault = self._fault(now_ns)
                if fault is not None and self._notice_due(fault, now_ns):
                    self._notify(fault, now_ns)
            deadline_ns = self._deadline_ns() if fault is None else None
            wait_s = self.settings.notice_s
            if deadline_ns is not None:
                wait_s = (deadline_ns + DEADLINE_MARGIN_NS - now_ns) * 1e-9
            self._wake.wait(max(0.0, wait_s))

    def _fault(self, now_ns: int) -> Fault | None:
        """Returns the fault of the camera, or of the method if the camera has none."""
        fault = self._camera_fault(now_ns)
        if fault is not None:
            return fault
        if self._answered_ns is None:
            seconds = (now_ns - self._began_ns) * 1e-9
            starting = (
                f"starting the method ({seconds:.0f} s so far); it is compiled, which takes up to a minute, when a "
                "computer starts it for the first time"
            )
            return Fault("running", self._trouble or starting)
        age_ns = now_ns - self._answered_ns
        if age_ns <= self._intake.limit_ns:
            return None
        return Fault("running", self._trouble or f"the method has not answered for {age_ns * 1e-9:.1f} s")

    def _deadline_ns(self) -> int | None:
        """Returns the time at which the present estimate becomes stale."""
        camera_ns = self._intake.deadline_ns
        if camera_ns is None or self._answered_ns is None:
            return None
        return min(camera_ns, self._answered_ns + self._intake.limit_ns)

    def _notice_due(self, fault: Fault, now_ns: int) -> bool:
        latest = self._latest
        if latest is None or latest.estimate.valid or latest.health.camera != fault.camera:
            return True
        return now_ns - latest.published_ns >= self.settings.notice_s * 1e9

    def _notify(self, fault: Fault, now_ns: int) -> None:
        estimate = ForceEstimate.invalid(self._intake.stamp_at(now_ns), Status.STALE, fault.message)
        captured_ns = self._intake.last_captured_ns
        self._report.notices += 1
        self._publish(estimate, _NO_FRAMES, self._began_ns if captured_ns is None else captured_ns, now_ns, fault)

    def _publish(
        self,
        estimate: ForceEstimate,
        frames: Mapping[str, Image],
        captured_ns: int,
        now_ns: int,
        fault: Fault | None,
        beside: Mapping[str, Image] = _NO_FRAMES,
    ) -> None:
        """Subtracts the operator's zero, updates the contact state, and offers the result to every sink.

        Args:
            estimate: the estimate of the method, or an invalid one of the watchdog.
            frames: view -> image of the estimate; empty for a notice of the watchdog.
            captured_ns: mid-exposure of the image, on the engine's clock.
            now_ns: present time, on the engine's clock.
            fault: present fault of camera or method; None without one.
            beside: view -> newest image of each view that the method does not read.
        """
        if self._over:  # a method that hung returns after the end of the run
            return
        raw = estimate
        estimate = self._zero.apply(raw, now_ns)
        clinical = self._contact.update(estimate, raw)
        self._latest = LiveUpdate(
            number=0 if self._latest is None else self._latest.number + 1,
            estimate=estimate,
            clinical=clinical,
            frames=frames,
            captured_ns=captured_ns,
            published_ns=now_ns,
            health=self._health(fault, now_ns),
            zero=self._zero.zero,
            integral_running=self._contact.running,
            max_age_s=self._intake.limit_ns * 1e-9,
            beside=beside,
            reads=self._estimator.views,
        )
        for runner in self._runners:
            runner.offer(self._latest)

    def _health(self, fault: Fault | None, now_ns: int) -> LiveHealth:
        p50_s, p99_s = self._recent.percentiles(now_ns)
        return LiveHealth(
            frames_per_s=self._intake.frames_per_s(now_ns),
            frames_in=self._intake.frames_in,
            dropped=self._intake.dropped,
            latency_p50_s=p50_s,
            latency_p99_s=p99_s,
            camera="running" if fault is None else fault.camera,
            reconnects=self._reader.reconnects,
            message=(self._trouble or self._intake.lost_view(now_ns)) if fault is None else fault.message,
            starting=self._answered_ns is None,
            sinks=MappingProxyType({runner.name: runner.health(now_ns) for runner in self._runners}),
        )

    def _say_last(self, why: str) -> None:
        """Publishes as the last update of a run that its force is no longer valid."""
        with self._publishing:
            self._notify(Fault("lost", why), self.clock.now_ns())
            self._over = True

    def _close_sinks(self) -> None:
        for runner in self._runners:
            runner.ask_to_close()
        for runner in self._runners:
            runner.wait_closed()

    def _finish_report(self, cpu_s: float) -> None:
        now_ns = self.clock.now_ns()
        seconds = (now_ns - self._began_ns) * 1e-9
        self._report = replace(
            self._report,
            seconds=seconds,
            frames_in=self._intake.frames_in,
            dropped=self._intake.dropped,
            unusable=self._intake.unusable,
            reconnects=self._reader.reconnects,
            latency_p50_s=self._all.percentile(50),
            latency_p99_s=self._all.percentile(99),
            cpu_share=cpu_s / seconds if seconds > 0 else 0.0,
            sinks={runner.name: runner.health(now_ns) for runner in self._runners},
            end=self._reader.end,
        )
