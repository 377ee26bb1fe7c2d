"""Runs each sink on a thread of its own: a sink that hangs or raises does not stop the others."""

import logging
import threading
from collections import deque
from collections.abc import Callable

from ..errors import InputError
from ..types import Clock, SessionInfo
from ._settings import LiveSettings
from ._sinks import Sink
from ._update import LiveUpdate, SinkHealth

_log = logging.getLogger(__name__)

CHECK_INTERVAL_S = 0.05
"""Interval at which it is checked whether a sink that is closing still works."""


class SinkRunner:
    """Feeds one sink. ``offer`` does not wait for the sink.

    Args:
        sink: the sink.
        info: metadata of the session.
        model: name of the model.
        settings: length of the queue, and waits after errors.
        clock: the engine's clock.
        on_end: gets the reason when the sink has ended and is not started again.
    """

    def __init__(
        self,
        sink: Sink,
        info: SessionInfo,
        model: str,
        settings: LiveSettings,
        clock: Clock,
        on_end: Callable[[str], None] | None = None,
    ) -> None:
        self.sink, self._on_end = sink, on_end
        self._info, self._model, self._settings, self._clock = info, model, settings, clock
        self._queue: deque[LiveUpdate] = deque()
        self._most = settings.queue if sink.keeps_all else 1
        self._new = threading.Condition()
        self._closing = self._ended = False
        self._busy_since_ns: int | None = None
        self._taken = self._dropped = self._failures = 0
        self._message = ""
        self._thread = threading.Thread(target=self._serve, name=f"sink-{sink.name}", daemon=True)

    @property
    def name(self) -> str:
        """Name of the sink."""
        return self.sink.name

    def start(self) -> None:
        """Begins to feed the sink."""
        self._thread.start()

    def offer(self, update: LiveUpdate) -> None:
        """Offers an update. It replaces the one in a full slot; if a queue is full, the offered update is dropped."""
        with self._new:
            if self._ended:
                return
            if len(self._queue) >= self._most:
                self._dropped += 1
                if self.sink.keeps_all:
                    return
                self._queue.clear()
            self._queue.append(update)
            self._new.notify()

    def health(self, now_ns: int) -> SinkHealth:
        """Returns the health of the sink at ``now_ns``."""
        since = self._busy_since_ns
        hung = since is not None and now_ns - since > self._settings.hung_s * 1e9
        return SinkHealth(self._taken, self._dropped, self._failures, hung, self._ended, self._message)

    def ask_to_close(self) -> None:
        """Requests the end: the sink takes the waiting updates, then ends."""
        with self._new:
            self._closing = True
            self._new.notify()

    def wait_closed(self) -> bool:
        """Waits for the end while the sink works; returns False if it hangs."""
        while self._thread.is_alive() and not self.health(self._clock.now_ns()).hung:
            self._thread.join(CHECK_INTERVAL_S)
        return not self._thread.is_alive()

    def _serve(self) -> None:
        """Starts the sink and gives it each update, on the thread of the sink, until it shall close.

        After an `InputError` the sink ends, since starting it again would fail, too. After another error it is closed
        and started again, after a wait that doubles with each failure.
        """
        wait_s, started = self._settings.reconnect_s, False
        while True:
            try:
                if not started:
                    self._busy_since_ns = self._clock.now_ns()
                    self.sink.start(self._info, self._model)
                    started, self._message = True, ""
                self._busy_since_ns = None
                update = self._next()
                if update is None:
                    break
                self._busy_since_ns = now_ns = self._clock.now_ns()
                self.sink.put(update if self.sink.keeps_all else update.as_of(now_ns))
                self._taken += 1
                wait_s = self._settings.reconnect_s
            except InputError as error:
                self._end(str(error))
                return
            except Exception as error:  # a sink is other people's code: after any error the other sinks continue
                self._failures += 1
                self._message = f"{type(error).__name__}: {error}"
                _log.warning("sink %s failed: %s", self.name, self._message)
                started = False
                self._close()
                if self._pause(wait_s):
                    break
                wait_s = min(2.0 * wait_s, self._settings.reconnect_max_s)
        self._close()

    def _end(self, why: str) -> None:
        """Ends a sink that failed in such a way that starting it again would fail, too."""
        with self._new:
            self._ended = True
            self._dropped += len(self._queue)
            self._queue.clear()
        self._failures, self._message = self._failures + 1, why
        _log.warning("sink %s has ended: %s", self.name, why)
        self._close()
        self._busy_since_ns = None
        if self._on_end is not None:
            self._on_end(why)

    def _next(self) -> LiveUpdate | None:
        with self._new:
            while not self._queue:
                if self._closing:
                    return None
                self._new.wait()
            return self._queue.popleft()

    def _pause(self, seconds: float) -> bool:
        """Waits; returns True if the run ends meanwhile. Only a queue keeps the updates that come during the wait."""
        self._busy_since_ns = None
        with self._new:
            return self._new.wait_for(lambda: self._closing, seconds)

    def _close(self) -> None:
        self._busy_since_ns = self._clock.now_ns()
        try:
            self.sink.close()
        except Exception as error:
            self._failures += 1
            self._message = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            _log.warning("sink %s did not close: %s", self.name, self._message)
