"""Interfaces between the packages and their environment: sources of events, driven axes, and clocks."""

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
        """The metadata of this session."""
        ...

    def __iter__(self) -> Iterator[Event]: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...


@runtime_checkable
class Actuators(Protocol):
    """Drives of a bench. A context manager: leaving it stops all of them.

    Each axis has a name that ends in its unit: ``advance_mm``, ``knob_deg``, ``stage_forward_mm``, ``stage_across_mm``;
    a bench may have only some of them. Advancing the catheter moves its clamp along the base tangent; the free length
    stays. Positions count from the setup of the bench. A motor controller needs only common functions: a target that
    may be changed during the motion, soft limits, a stop with the ramp of its acceleration, and a position that can be
    read.
    """

    @property
    def limits(self) -> Mapping[str, AxisLimits]:
        """The limits of each axis, by name."""
        ...

    def command(self, targets: Mapping[str, float]) -> Commanded:
        """Starts the motion of each axis to its own target and returns immediately; the other axes are not affected.

        Args:
            targets: target of each axis, by name. One beyond the limits of its axis is clipped.

        Raises:
            ValueError: an axis is unknown or a value is not finite; nothing moves.
        """
        ...

    def read(self) -> Actuation:
        """Returns the measured positions of all axes; their resolution is one step of the motor."""
        ...

    def stop(self, *axes: str) -> None:
        """Brings these axes, or all, to rest with their largest deceleration; they stay there until the next command.

        Raises:
            ValueError: an axis is unknown.
        """
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...


class Clock(Protocol):
    """Clock of a loop: real, or simulated and then faster than real."""

    def now_ns(self) -> int:
        """Returns the nanoseconds since the zero of this clock."""
        ...

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Returns at ``stamp_ns``, immediately if this has passed."""
        ...


def _machine_ns() -> int:
    """Returns a monotonic time that includes the sleep of the computer; `time.monotonic_ns` of Linux excludes it."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) if sys.platform == "linux" else time.monotonic_ns()


class SystemClock:
    """The monotonic clock of the machine, which includes its sleep; it starts at ``start_ns``, or anywhere."""

    def __init__(self, start_ns: int | None = None) -> None:
        self._zero_ns = 0 if start_ns is None else _machine_ns() - start_ns

    def now_ns(self) -> int:
        """Returns the nanoseconds since its zero."""
        return _machine_ns() - self._zero_ns

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Sleeps until ``stamp_ns``."""
        time.sleep(max(0, stamp_ns - self.now_ns()) * 1e-9)


class SimulatedClock:
    """A clock that only advances when it is set.

    >>> clock = SimulatedClock()
    >>> clock.sleep_until_ns(1_000_000)
    >>> clock.now_ns()
    1000000
    """

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Returns the nanoseconds of simulated time."""
        return self._now_ns

    def sleep_until_ns(self, stamp_ns: int) -> None:
        """Advances to ``stamp_ns`` without waiting."""
        self._now_ns = max(self._now_ns, stamp_ns)
