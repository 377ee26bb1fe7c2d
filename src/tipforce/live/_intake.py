"""Passes the newest images of one instant, with the actuation at it, from the source to the estimator."""

import math
import threading
import time
from bisect import insort
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .._system.arrival_clock import ArrivalClock
from ..alignment import PAIR_S, Pairing
from ..io import ActuationSeries
from ..types import STAGE, Actuation, Event, Frame, Image, Observation, SessionInfo
from ._latency import Rate
from ._settings import LiveSettings
from ._watchdog import CameraWatch, Fault, worst

_PAIR_NS = round(PAIR_S * 1e9)
MAX_LATE_STAMP_NS = 1_000_000_000
"""A stamp that goes back by more than this means that the source's clock restarted; by less, that the frame is late."""
KEPT_NS = 2_000_000_000
"""Readings and images of further views are kept for this time, for a frame that they belong to."""
MAX_CLOCK_STEP_NS = 1_000_000_000
"""A jump of the source's clock above this is treated as a delay of the images, which are then stale."""
MAX_WAITING_FRAMES = 16
"""Largest number of frames that wait for their partners: two thirds of `PAIR_S` at 1 kHz."""
MAX_EXTRA_WAIT_NS = 80_000_000
"""A frame waits for `PAIR_S`, and for images that arrive later than its own by at most this time longer."""
RECENT_DELAYS = 16
"""The delay of a view is the largest of this number of its last images."""
MAX_OTHER_VIEWS = 8
"""The newest images of this number of views that the estimator does not read are kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """The next input of the estimator.

    Attributes:
        observation: images and actuation, on the source's clock.
        captured_ns: mid-exposure on the engine's clock; the earliest possible time where the driver states a bound.
        run: number that changes when the source's clock restarts.
        beside: newest images of the views that are not in ``observation``, to be shown.
        too_old_s: age of the last reading of each drive whose reading is too old; these drives are absent from
            ``observation``.
    """

    observation: Observation
    captured_ns: int
    run: int
    beside: Mapping[str, Image] = field(default_factory=dict[str, Image])
    too_old_s: Mapping[str, float] = field(default_factory=dict[str, float])


class Intake:
    """Takes events as they arrive; the newest complete instant waits for the estimator, older ones are dropped.

    May be used from several threads. Its memory does not grow with time.

    Args:
        views: views that the estimator needs; the first one sets the time of an instant.
        info: session metadata.
        settings: time limits of the engine.
        same_clock: whether the stamps of the source are on the engine's clock already.
        apart: whether an image that no image of another view is near is an instant of its own; then there is no fault
            while one view has none.
        on_fault: called on the thread of the source for each unusable image.
    """

    def __init__(
        self,
        views: Sequence[str],
        info: SessionInfo,
        settings: LiveSettings,
        *,
        same_clock: bool,
        apart: bool = False,
        on_fault: Callable[[], None],
    ) -> None:
        self._views, self._settings, self._on_fault = tuple(views), settings, on_fault
        self._constant = dict(info.actuation.constant)
        self._same_clock, self._apart = same_clock, apart
        self._watches = {view: CameraWatch(view, settings) for view in self._views}
        self._new = threading.Condition()
        self._source: Fault | None = None
        self._beside: dict[str, Frame] = {}
        """Newest frame of each view that is shown, whether it is read or not."""
        self._delays_ns = {view: deque[int](maxlen=RECENT_DELAYS) for view in self._views}
        self._rate = Rate()
        self.frames_in = self.dropped = self.unusable = self._run = 0
        self._begin_run()

    def _begin_run(self) -> None:
        self._clock = ArrivalClock(MAX_CLOCK_STEP_NS)
        self._series, self._read_ns = ActuationSeries(), dict[str, int]()
        self._pairing = Pairing(self._views, apart=self._apart)
        self._waiting: list[tuple[Frame, int, int]] = []
        """Frame, mid-exposure on the engine's clock, and the time of the machine's clock until which it waits; in the
        order of their stamps."""
        self._newest_ns = 0
        """Largest stamp of the images so far."""
        self._taken_ns = -1
        """Stamp of the last instant that was taken."""
        self._slots: dict[str, tuple[Frame, int]] = {}
        """By view: the newest frame that sets the time of an instant; the oldest of them is taken next."""
        self._stamps: dict[str, int] = {}

    def add(self, event: Event, now_ns: int) -> None:
        """Adds an event.

        Args:
            event: an image, or readings of the drives; other events are ignored.
            now_ns: time of its arrival on the engine's clock.
        """
        if isinstance(event, Frame):
            self._add_frame(event, now_ns)
        elif isinstance(event, Actuation) and event.stream != STAGE:
            with self._new:
                self._series.add(event)
                self._series.forget_before(event.stamp_ns - KEPT_NS)
                for name in event.values:
                    self._read_ns[name] = event.stamp_ns

    def restart(self) -> None:
        """Notes that the source was opened again."""
        with self._new:
            self._source = None
            self._clock = ArrivalClock(MAX_CLOCK_STEP_NS)
            for watch in self._watches.values():
                watch.restart()

    def fail(self, message: str) -> None:
        """Notes that the source failed or ended; images are used again after `restart`."""
        with self._new:
            self._source = Fault("lost", message)
        self._on_fault()

    def take(self, timeout_s: float) -> Instant | None:
        """Returns the newest instant that was not taken yet; None if none comes within ``timeout_s``."""
        end_s = time.monotonic() + timeout_s
        with self._new:
            while True:
                wait_s = min(self._release(), end_s - time.monotonic())
                if self._slots or wait_s <= 0.0:
                    break
                self._new.wait(wait_s)
            if not self._slots:
                return None
            view = min(self._slots, key=lambda name: self._slots[name][0].stamp_ns)
            frame, captured_ns = self._slots.pop(view)
            self._taken_ns = frame.stamp_ns
            return self._instant(frame, captured_ns)

    @property
    def empty(self) -> bool:
        """Whether no instant is waiting."""
        return not self._slots

    def fault(self, now_ns: int) -> Fault | None:
        """Returns the fault of the source or of the cameras at ``now_ns``; None if every view has a valid image.

        With ``apart`` one view with a valid image is enough.
        """
        with self._new:
            if self._source is not None:
                return self._source
            faults = [fault for watch in self._watches.values() if (fault := watch.fault(now_ns))]
            if self._apart and len(faults) < len(self._watches):
                return None
            reported = worst(faults)
            if reported is not None and reported.camera == "waiting" and self._beside:
                sent_views = ", ".join(sorted(self._beside))
                return Fault("waiting", f"{reported.message}; the source sends {sent_views}")
            return reported

    def lost_view(self, now_ns: int) -> str:
        """Returns with ``apart`` the fault of the views without a valid image, where another has one; else ""."""
        with self._new:
            faults = [fault for watch in self._watches.values() if (fault := watch.fault(now_ns))]
            reported = worst(faults) if self._apart and len(faults) < len(self._watches) else None
            return "" if reported is None else reported.message

    @property
    def limit_ns(self) -> int:
        """Age at which the image of a view is stale; the largest over the views."""
        return max(watch.limit_ns for watch in self._watches.values())

    @property
    def deadline_ns(self) -> int | None:
        """Time at which the first of the views becomes stale; None if a view has a fault. With ``apart``: the last."""
        deadlines = [watch.deadline_ns for watch in self._watches.values()]
        known = [each for each in deadlines if each is not None]
        if self._apart:
            return max(known, default=None)
        return min(known) if len(known) == len(deadlines) else None

    @property
    def last_captured_ns(self) -> int | None:
        """Mid-exposure of the last good image of the first view, on the engine's clock. With ``apart``: of any view."""
        views = self._views if self._apart else self._views[:1]
        known = [at_ns for view in views if (at_ns := self._watches[view].fresh_ns) is not None]
        return max(known, default=None)

    def stamp_at(self, now_ns: int) -> int:
        """Converts a time of the engine's clock to the source's clock."""
        return max(0, now_ns - (0 if self._same_clock else self._clock.offset_ns))

    def frames_per_s(self, now_ns: int) -> float:
        """Returns the rate at which images of the first view arrive."""
        with self._new:
            return self._rate.per_s(now_ns)

    def _add_frame(self, frame: Frame, now_ns: int) -> None:
        """Checks an image and lets it wait for the images of the other views; it arrives at ``now_ns``.

        The image of a view that the estimator does not read is only kept for display. A late image is dropped; a stamp
        more than `MAX_LATE_STAMP_NS` back shows that the source's clock restarted, and begins a new run.
        """
        view = frame.view
        if view not in self._watches:
            if view in self._beside or len(self._beside) < MAX_OTHER_VIEWS:
                self._beside[view] = frame
            return
        good = True
        with self._new:
            first = view == self._views[0]
            if first:
                self.frames_in += 1
                self._rate.add(now_ns)
            last_ns = self._stamps.get(view)
            if last_ns is not None and frame.stamp_ns <= last_ns:
                if last_ns - frame.stamp_ns <= MAX_LATE_STAMP_NS:
                    self.dropped += first
                    return
                self._run += 1
                self._begin_run()
            self._stamps[view] = frame.stamp_ns
            captured_ns = self._clock.host_ns(frame.stamp_ns, now_ns)
            if self._same_clock:
                captured_ns = frame.stamp_ns
            captured_ns -= frame.max_delay_ns
            good = self._watches[view].see(frame.image, frame.stamp_ns, captured_ns, now_ns) == "running"
            if good:
                self._wait_for_partners(frame, captured_ns, now_ns)
            else:
                self.unusable += first
        if not good:
            self._on_fault()

    def _wait_for_partners(self, frame: Frame, captured_ns: int, now_ns: int) -> None:
        """Holds a frame until it has its partners, or until no partner can come any more.

        Args:
            frame: a good image of a view that the estimator reads.
            captured_ns: its mid-exposure, on the engine's clock.
            now_ns: its arrival, on the engine's clock.
        """
        delay_ns = now_ns - captured_ns
        if self._pairing.add(frame):
            # the partners may arrive later than this frame by the difference of the delays of their views
            delays_of_others = (delays for view, delays in self._delays_ns.items() if view != frame.view)
            longest_ns = max((longest for delays in delays_of_others for longest in delays), default=0)
            extra_ns = min(max(0, longest_ns - delay_ns), MAX_EXTRA_WAIT_NS)
            entry = frame, captured_ns, time.monotonic_ns() + _PAIR_NS + extra_ns
            insort(self._waiting, entry, key=lambda waiting: waiting[0].stamp_ns)
            del self._waiting[:-MAX_WAITING_FRAMES]
        self._delays_ns[frame.view].append(delay_ns)
        if self._apart:
            self._beside[frame.view] = frame
        self._newest_ns = max(self._newest_ns, frame.stamp_ns)
        self._release()
        self._new.notify()
        self._pairing.forget_before(frame.stamp_ns - KEPT_NS)

    def _release(self) -> float:
        """Passes the frames on that have their partners or waited long enough; returns the time until the next in s."""
        now_ns = time.monotonic_ns()
        while self._waiting:
            frame, captured_ns, due_ns = self._waiting[0]
            passed = self._newest_ns - frame.stamp_ns > _PAIR_NS
            if due_ns > now_ns and not passed and not self._pairing.final_at(frame):
                return (due_ns - now_ns) * 1e-9
            del self._waiting[0]
            if frame.stamp_ns <= self._taken_ns:  # an image of another view, which was taken later, came earlier
                self.dropped += frame.view == self._views[0]
            elif self._pairing.views_of(frame):
                self.dropped += frame.view == self._views[0] and frame.view in self._slots
                self._slots[frame.view] = frame, captured_ns
        return math.inf

    def _instant(self, frame: Frame, captured_ns: int) -> Instant:
        """Makes the input of the estimator from a frame: the images of one instant, and the drives' readings at it.

        Args:
            frame: the frame that sets the time.
            captured_ns: its mid-exposure, on the engine's clock.
        """
        stamp_ns = frame.stamp_ns
        views = self._pairing.views_of(frame) or {frame.view: frame.image}
        self._pairing.forget_before(stamp_ns - _PAIR_NS)
        readings = self._series.at(np.array([stamp_ns]))
        known = {name: float(value[0]) for name, value in readings.items() if not np.isnan(value[0])}
        ages_s = {name: (stamp_ns - read_ns) * 1e-9 for name, read_ns in self._read_ns.items()}
        # a reading that equals the stated constant stays valid at any age
        too_old = {
            name: age_s
            for name, age_s in ages_s.items()
            if age_s > self._settings.actuation_age_s and known.get(name) != self._constant.get(name)
        }
        current = {name: value for name, value in known.items() if name not in too_old}
        observation = Observation(stamp_ns, views, {**self._constant, **current})
        beside = {
            view: shown.image
            for view, shown in self._beside.items()
            if view not in views and (view not in self._watches or stamp_ns - shown.stamp_ns <= self.limit_ns)
        }
        return Instant(observation, captured_ns, self._run, beside, too_old)
