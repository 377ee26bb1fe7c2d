"""The seams between the rooms and the world: sources of events, and time."""

import time
from collections.abc import Iterator
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from ._device import Context
from ._streams import Event

__all__ = ["Clock", "SimulatedClock", "Source", "SystemClock"]


@runtime_checkable
class Source(Protocol):
    """Yields events: a camera, a video, a folder of images, a recording, the twin. A context manager."""

    @property
    def context(self) -> Context:
        """What is publicly known of this session."""
        ...

    def __iter__(self) -> Iterator[Event]: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Clock(Protocol):
    """Time of a loop: real, or simulated and then faster than real."""

    def now_ns(self) -> int:
        """Nanoseconds since this clock's own zero."""
        ...

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Return at ``stamp_ns``, at once where that has passed."""
        ...


class SystemClock:
    """The machine's monotonic clock."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary zero."""
        return time.monotonic_ns()

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Sleep for what is left until ``stamp_ns``."""
        time.sleep(max(0, stamp_ns - time.monotonic_ns()) * 1e-9)


class SimulatedClock:
    """A clock that stands still until it is told to go on.

    >>> clock = SimulatedClock()
    >>> clock.sleep_until_ns(1_000_000)
    >>> clock.now_ns()
    1000000
    """

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Nanoseconds of simulated time."""
        return self._now_ns

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Move on to ``stamp_ns`` without waiting."""
        self._now_ns = max(self._now_ns, stamp_ns)
