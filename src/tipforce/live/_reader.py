"""Reads events on the thread of the source, and opens a source that failed again."""

import logging
import threading

from ..types import Clock, Source
from ._intake import Intake
from ._settings import LiveSettings

_log = logging.getLogger(__name__)


class SourceReader:
    """Passes events to an intake until the source ends and is not opened again.

    Attributes:
        end: reason why the source ended; "" before that.
        reconnects: number of times that the source was opened again.
    """

    def __init__(
        self, source: Source, intake: Intake, settings: LiveSettings, clock: Clock, stop: threading.Event
    ) -> None:
        self._source, self._intake, self._settings, self._clock, self._stop = source, intake, settings, clock, stop
        self.reconnects = 0
        self.end = ""

    def run(self) -> None:
        """Reads until the source has ended and is not opened again, or until ``stop`` is set.

        A source that failed is opened again, at most ``max_reconnects`` times without any event between, after a wait
        that doubles each time. A source that ended is opened again only with ``reopen_ended``.
        """
        first_wait_s, max_reconnects = self._settings.reconnect_s, self._settings.max_reconnects
        wait_s, in_a_row = first_wait_s, 0
        while not self._stop.is_set():
            why, worked = self._read()
            if self._stop.is_set():
                return
            if worked:
                wait_s, in_a_row = first_wait_s, 0
            may_reopen = self._settings.reopen_ended or why != _ENDED
            if not may_reopen or (max_reconnects is not None and in_a_row >= max_reconnects):
                self.end = why
                self._intake.fail(why)
                return
            _log.warning(why)
            self._intake.fail(f"{why}; it is opened again in {wait_s:g} s")
            self._stop.wait(wait_s)
            wait_s, in_a_row = min(2.0 * wait_s, self._settings.reconnect_max_s), in_a_row + 1
            self.reconnects += 1

    def _read(self) -> tuple[str, bool]:
        """Reads until the source ends or fails; returns the reason, and whether any event came."""
        worked = False
        try:
            with self._source as events:
                for event in events:
                    if self._stop.is_set():
                        break
                    if not worked:
                        worked = True
                        self._intake.restart()
                    self._intake.add(event, self._clock.now_ns())
        except Exception as error:  # a driver is other people's code: report any error, and try again
            return f"the source failed: {type(error).__name__}: {error}", worked
        return _ENDED, worked


_ENDED = "the source has ended"
