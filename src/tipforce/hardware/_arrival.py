"""Determines the time for which an image has waited in buffers between its camera and its driver.

While no program reads, the kernel, FFmpeg, the network and the server in the camera keep images. When reading
continues, these come first, and faster than a camera takes images: each of them is older than its arrival shows.
"""

from collections import deque

from .._system.arrival_clock import ArrivalClock
from ..errors import DeviceError

MAX_WAIT_NS = 200_000_000
"""An image without a stamp is discarded where it may have waited longer, because its time is then unknown."""
LATE_NS = 1_000_000_000
MAX_LATE_NS = 2_000_000_000
"""Images that are late by `LATE_NS` for this time do not catch up: the camera is connected again."""
MAX_INTERVALS = 32
MIN_PAUSE_PERIODS, MIN_PAUSE_NS = 4.0, 250_000_000
"""A longer interval between two images is a pause of the camera, of the network or of this program."""
MIN_WAITED_SHARE = 0.5
"""A driver that waited this share of a period for an image had found the buffer empty, if the machine is not busy."""
MIN_SUCCESSIVE_WAITS = 8
"""Successive waits that show an empty buffer on a busy machine, too: drivers of a machine keep fewer images."""


class LatenessCheck:
    """Finds a connection whose images stay late, so that only a new connection gives current images."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def check(self, where: str, wait_ns: int, arrival_ns: int) -> None:
        """Checks an image that has waited for ``wait_ns``.

        Args:
            where: the camera, for the message.
            wait_ns: time for which the image has, or may have, waited in buffers.
            arrival_ns: time of its arrival on the clock of the host.

        Raises:
            DeviceError: all images of the last two seconds were late by more than a second.
        """
        if wait_ns <= LATE_NS:
            self._since_ns = None
            return
        if self._since_ns is None:
            self._since_ns = arrival_ns
        elif arrival_ns - self._since_ns > MAX_LATE_NS:
            raise DeviceError(f"{where}: its images arrive {wait_ns * 1e-9:.1f} s late, so it is connected anew")


class ArrivalWait:
    """Bounds the time for which images without stamps waited in buffers, by the times of their arrival alone.

    The clock of the camera is its count of images: each is one mean period later than the one before. After a pause of
    T seconds an image may have waited for T, and the bound falls as images arrive faster than the period. If images are
    still missing when they come at the period again, they were lost, not kept.

    Args:
        local: whether the buffers are those of this machine and hold few images: a driver that had to wait for eight
            images in a row has emptied them.
    """

    def __init__(self, *, local: bool) -> None:
        self._local = local
        self._intervals: deque[int] = deque(maxlen=MAX_INTERVALS)
        self._last_ns: int | None = None
        self._counted_ns = self._wait_ns = self._waits = 0
        self._map = ArrivalClock(LATE_NS)

    def wait_ns(self, asked_ns: int, arrival_ns: int) -> int:
        """Adds the next image.

        Args:
            asked_ns: time at which the driver began to wait for it, on the clock of the host.
            arrival_ns: time of its arrival.

        Returns:
            The longest time for which it may have waited, ns.
        """
        last_ns, self._last_ns = self._last_ns, arrival_ns
        if last_ns is None:
            return self._restart(arrival_ns)
        interval_ns = arrival_ns - last_ns
        pause = interval_ns > max(MIN_PAUSE_PERIODS * self._period_ns, MIN_PAUSE_NS) and len(self._intervals) > 1
        catching_up = self._wait_ns > MIN_PAUSE_NS and interval_ns < self._period_ns
        if not pause and not catching_up:  # neither shows the period of the camera
            self._intervals.append(interval_ns)
        self._counted_ns += round(self._period_ns)
        self._wait_ns = arrival_ns - self._map.host_ns(self._counted_ns, arrival_ns)
        waited = arrival_ns - asked_ns >= MIN_WAITED_SHARE * self._period_ns and interval_ns < 2.0 * self._period_ns
        self._waits = self._waits + 1 if waited else 0
        if self._local and self._waits >= MIN_SUCCESSIVE_WAITS:
            return self._restart(arrival_ns)
        return self._wait_ns

    @property
    def _period_ns(self) -> float:
        """Mean period of the images; 0 until it is known."""
        return sum(self._intervals) / len(self._intervals) if self._intervals else 0.0

    def _restart(self, arrival_ns: int) -> int:
        """Starts again: the image that arrived now has not waited."""
        self._map = ArrivalClock(LATE_NS)
        self._map.host_ns(self._counted_ns, arrival_ns)
        self._wait_ns = 0
        return 0
