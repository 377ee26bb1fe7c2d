"""Files as if they happened now: events at the pace of their own stamps."""

from collections.abc import Iterator
from dataclasses import replace
from types import TracebackType
from typing import Self

from ..errors import InputError
from ..types import Clock, Event, Frame, SessionInfo, Source, SystemClock

_BEHIND_NS = 50_000_000
"""Who reads a file this much too late plays it slower from then on: a camera that is read too late sends on, a file
waits."""
_GAP_NS = 33_000_000
"""Time between the last frame of a file and the first one of the next round, where the file does not tell its rate."""


class PacedSource:
    """A video, a folder of images or a recording as a live source.

    Each event comes when the time since the first one has passed, its stamp moved to ``clock``: mid-exposure is when
    it comes. On a computer that is too slow for it the file plays slower. ``rate_hz`` replaces the stamps of a file
    whose images have none, or are to come faster or slower; other events then come with the frame before them.
    ``loop``: the file begins again at its end, the stamps go on. ``file``: what is played.
    """

    def __init__(
        self, source: Source, *, clock: Clock | None = None, rate_hz: float | None = None, loop: bool = False
    ) -> None:
        self.file, self._loop = source, loop
        self.clock: Clock = clock or SystemClock()
        self._period_ns = None if rate_hz is None else round(1e9 / rate_hz)

    @property
    def session_info(self) -> SessionInfo:
        """That of the file."""
        return self.file.session_info

    def __iter__(self) -> Iterator[Event]:
        start_ns = self.clock.now_ns()
        while True:
            last_ns = step_ns = None
            newest_ns = 0
            for event, at_ns in self._timed():
                if isinstance(event, Frame) and last_ns is not None and at_ns > last_ns:
                    step_ns = at_ns - last_ns
                last_ns = at_ns if isinstance(event, Frame) else last_ns
                newest_ns = max(newest_ns, at_ns)  # streams of a recording are in order each, not together
                behind_ns = self.clock.now_ns() - (start_ns + newest_ns)
                start_ns += behind_ns if behind_ns > _BEHIND_NS else 0
                stamp_ns = start_ns + at_ns
                self.clock.sleep_until_ns(stamp_ns)
                yield replace(event, stamp_ns=stamp_ns)
            if not self._loop:
                return
            if last_ns is None:
                raise InputError(f"{getattr(self.file, 'path', self.session_info.name)}: holds no frame to loop")
            start_ns = max(start_ns + last_ns + (step_ns or _GAP_NS), self.clock.now_ns())

    def _timed(self) -> Iterator[tuple[Event, int]]:
        """Events with the time since the first of them."""
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.file.__exit__(kind, error, trace)
