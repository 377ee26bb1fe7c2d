"""How long an image has waited in buffers between its camera and its driver.

While nobody reads, the kernel, FFmpeg, the network and the camera's own server keep images. When reading goes on, these
come first, and faster than a camera takes images: each of them is older than its arrival shows.
"""

from collections import deque

from .._system.arrival_clock import ArrivalClock
from ..errors import DeviceError

MAX_WAIT_NS = 200_000_000
"""An image without a stamp is discarded where it may have waited for longer: nobody knows when it was taken."""
_LATE_NS = 1_000_000_000
_PATIENCE_NS = 2_000_000_000
"""Images that are late by `_LATE_NS` for so long do not catch up: the camera is connected again."""
_INTERVALS = 32
_GAP_PERIODS, _GAP_NS = 4.0, 250_000_000
"""A longer interval between two images is a pause of the camera, of the network or of this program."""
_WAITED_SHARE = 0.5
"""Of a period: a driver that waited for so long for an image had found the buffer empty, if the machine is not busy."""
_LOCAL_IMAGES = 8
"""More images than the drivers of a machine keep: so many waits in a row show that the buffer is empty, busy or not."""


class LatenessCheck:
    """Finds a connection whose images stay late, so that only a new one gives current images."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def check(self, where: str, wait_ns: int, arrival_ns: int) -> None:
        """Takes an image that has waited for ``wait_ns``.

        Args:
            where: the camera, for the message.
            wait_ns: for which the image has waited in buffers, or has at most.
            arrival_ns: when it arrived, on the host's clock.

        Raises:
            DeviceError: all images of the last two seconds were late by more than a second.
        """
        if wait_ns <= _LATE_NS:
            self._since_ns = None
            return
        if self._since_ns is None:
            self._since_ns = arrival_ns
        elif arrival_ns - self._since_ns > _PATIENCE_NS:
            raise DeviceError(f"{where}: its images arrive {wait_ns * 1e-9:.1f} s late, so it is connected anew")


class ArrivalWait:
    """Bounds how long images without stamps waited in buffers, from the times of their arrival alone.

    The camera's clock is its count of images: each is one mean period later than the one before. After a pause of T
    seconds an image may have waited for T, and the bound falls as images arrive faster than the period. What is still
    missing when they come at the period again was lost, not kept.

    Args:
        local: the buffers are those of this machine, and hold few images: a driver that had to wait for eight images in
            a row has emptied them.
    """

    def __init__(self, *, local: bool) -> None:
        self._local = local
        self._intervals: deque[int] = deque(maxlen=_INTERVALS)
        self._last_ns: int | None = None
        self._counted_ns = self._wait_ns = self._waits = 0
        self._map = ArrivalClock(_LATE_NS)

    def wait_ns(self, asked_ns: int, arrival_ns: int) -> int:
        """Takes the next image; returns for how long it may have waited, nanoseconds.

        Args:
            asked_ns: when the driver began to wait for it, on the host's clock.
            arrival_ns: when it came.
        """
        last_ns, self._last_ns = self._last_ns, arrival_ns
        if last_ns is None:
            return self._restart(arrival_ns)
        interval_ns = arrival_ns - last_ns
        pause = interval_ns > max(_GAP_PERIODS * self._period_ns, _GAP_NS) and len(self._intervals) > 1
        catching_up = self._wait_ns > _GAP_NS and interval_ns < self._period_ns
        if not pause and not catching_up:
            self._intervals.append(interval_ns)
        self._counted_ns += round(self._period_ns)
        self._wait_ns = arrival_ns - self._map.host_ns(self._counted_ns, arrival_ns)
        waited = arrival_ns - asked_ns >= _WAITED_SHARE * self._period_ns and interval_ns < 2.0 * self._period_ns
        self._waits = self._waits + 1 if waited else 0
        if self._local and self._waits >= _LOCAL_IMAGES:
            return self._restart(arrival_ns)
        return self._wait_ns

    @property
    def _period_ns(self) -> float:
        return sum(self._intervals) / len(self._intervals) if self._intervals else 0.0

    def _restart(self, arrival_ns: int) -> int:
        """The image that arrived now has not waited."""
        self._map = ArrivalClock(_LATE_NS)
        self._map.host_ns(self._counted_ns, arrival_ns)
        self._wait_ns = 0
        return 0
