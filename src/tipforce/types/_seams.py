"""The seams between the packages and the world: sources of events, driven axes, and time."""

import sys
import time
from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from ._axes import AxisLimits, Commanded
from ._session import SessionInfo
from ._streams import Actuation, Event


@runtime_checkable
class Source(Protocol):
    """Yields events: a camera, a video, a folder of images, a recording, a simulated bench. A context manager."""

    @property
    def session_info(self) -> SessionInfo:
        """What is publicly known of this session."""
        ...

    def __iter__(self) -> Iterator[Event]: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@runtime_checkable
class Actuators(Protocol):
    """Drives of a bench. A context manager: leaving it stops all of them.

    Each axis has a name that ends in its unit: ``advance_mm``, ``knob_deg``, ``stage_forward_mm``, ``stage_across_mm``,
    or those of them that there are. Advancing the catheter moves its clamp along the base tangent; the free length
    stays. Positions count from where the bench was set up. What is asked of a motor controller is no more than most
    have: a target that may be changed while the axis is still on its way, soft limits, a stop with the ramp of its
    acceleration, a position to be read.
    """

    @property
    def limits(self) -> Mapping[str, AxisLimits]:
        """The axes that there are, and what each keeps to."""
        ...

    def command(self, targets: Mapping[str, float]) -> Commanded:
        """Send axes on their way, each to its own target, and return at once; the others go on as they were.

        A target beyond an axis's limits is clipped, which the answer tells. Raises ValueError, and moves nothing,
        where an axis is unknown or a value is not finite.
        """
        ...

    def read(self) -> Actuation:
        """Where all axes are now, as measured; no more exact than their steps."""
        ...

    def stop(self, *axes: str) -> None:
        """Bring these axes, or all, to rest as fast as they can brake; they stay there until they are commanded.

        Raises ValueError where an axis is unknown.
        """
        ...

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


def _machine_ns() -> int:
    """A monotonic clock that goes on while the computer sleeps: that of Linux with this name stands still."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) if sys.platform == "linux" else time.monotonic_ns()


class SystemClock:
    """The machine's monotonic clock, which goes on while it sleeps; it starts at ``start_ns``, or anywhere."""

    def __init__(self, start_ns: int | None = None) -> None:
        self._zero_ns = 0 if start_ns is None else _machine_ns() - start_ns

    def now_ns(self) -> int:
        """Nanoseconds since its zero."""
        return _machine_ns() - self._zero_ns

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Sleep for what is left until ``stamp_ns``."""
        time.sleep(max(0, stamp_ns - self.now_ns()) * 1e-9)


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
