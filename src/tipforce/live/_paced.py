"""Plays files as a live source: each event comes at the time of its own stamp."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Self

from ..errors import InputError
from ..types import Clock, Event, Frame, SessionInfo, Source, SystemClock, views_of

MAX_BEHIND_NS = 50_000_000
"""A reader that is later than this delays the file from then on. A camera would continue; a file waits."""
REPEAT_GAP_NS = 33_000_000
"""Time between the last frame of a file and the first one of its repetition, if the file does not state its rate."""


class PacedSource:
    """A video, a folder of images or a recording as a live source.

    Each event comes when the time since the first one has passed, and its stamp is mapped to ``clock``: mid-exposure is
    the time at which it comes. On a computer that is too slow the file plays more slowly.

    Args:
        source: the file, as a source; available as ``file``.
        clock: clock of the engine; by default the machine's monotonic clock.
        rate_hz: replaces the stamps of a file whose images have none, or that shall play faster or more slowly; other
            events then come with the frame before them.
        loop: whether the file begins again after its end; the stamps continue to increase.
    """

    def __init__(
        self, source: Source, *, clock: Clock | None = None, rate_hz: float | None = None, loop: bool = False
    ) -> None:
        self.file, self._loop = source, loop
        self.clock: Clock = clock or SystemClock()
        self._period_ns = None if rate_hz is None else round(1e9 / rate_hz)

    @property
    def views(self) -> tuple[str, ...]:
        """Views of the file."""
        return views_of(self.file)

    @property
    def session_info(self) -> SessionInfo:
        """Session metadata of the file."""
        return self.file.session_info

    def __iter__(self) -> Iterator[Event]:
        """Yields each event when its time has come, stamped with that time on ``clock``.

        A reader that is late by more than `MAX_BEHIND_NS` delays the rest of the file: it does not skip frames. With
        ``loop`` the file begins again one frame period after its last frame.
        """
        start_ns = self.clock.now_ns()
        while True:
            last_ns = step_ns = None
            newest_ns = 0
            for event, at_ns in self._timed():
                if isinstance(event, Frame) and last_ns is not None and at_ns > last_ns:
                    step_ns = at_ns - last_ns
                last_ns = at_ns if isinstance(event, Frame) else last_ns
                newest_ns = max(newest_ns, at_ns)  # each stream of a recording is in order, all together are not
                behind_ns = self.clock.now_ns() - (start_ns + newest_ns)
                start_ns += behind_ns if behind_ns > MAX_BEHIND_NS else 0
                stamp_ns = start_ns + at_ns
                self.clock.sleep_until_ns(stamp_ns)
                yield replace(event, stamp_ns=stamp_ns)
            if not self._loop:
                return
            if last_ns is None:
                raise InputError(f"{getattr(self.file, 'path', self.session_info.name)}: holds no frame to loop")
            start_ns = max(start_ns + last_ns + (step_ns or REPEAT_GAP_NS), self.clock.now_ns())

    def _timed(self) -> Iterator[tuple[Event, int]]:
        """Yields events with the time in ns since the first of them; with a stated rate, by the count of frames."""
        first_ns, frames = None, dict[str, int]()
        for event in self.file:
            if self._period_ns is not None:
                if isinstance(event, Frame):
                    frames[event.view] = frames.get(event.view, -1) + 1
                at_ns = max(frames.values(), default=0) * self._period_ns
            else:
                first_ns = event.stamp_ns if first_ns is None else first_ns
                at_ns = max(0, event.stamp_ns - first_ns)
            yield event, at_ns

    def __enter__(self) -> Self:
        self.file.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self.file.__exit__(*error)
