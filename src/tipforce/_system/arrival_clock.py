"""Converts stamps of a device to the clock of the host, by the delay of their arrival.

This module is here because `hardware` and `live` need it and do not import one another.
"""

import math
from dataclasses import dataclass

_BUCKET_NS = 1_000_000_000
MAX_BUCKETS = 10
"""Number of seconds with readings whose smallest delay counts: a drift of 50 ppm then moves a stamp by half a
millisecond."""
_MIN_STANDSTILL_NS = 100_000_000
_MIN_SPREAD_NS = 500_000_000
"""A second whose readings arrived within a shorter time gives no delay: they may have waited in a buffer."""
_CAUGHT_UP_SHARE = 0.1
"""Readings whose delay falls by more than this share of the elapsed time come out of a buffer."""
_DRIFT_AFTER_S = 20.0
_NEW_DELAY_WEIGHT = 0.02
"""Weight of a new reading in the mean delay."""


@dataclass(frozen=True, slots=True)
class ClockReport:
    """Offset of a device's clock.

    Attributes:
        offset_s: clock of the host minus that of the device; NaN where its stamps are those of the arrival.
        delay_s: mean delay of the arrival beyond the smallest one.
        drift_ppm: drift of the offset, NaN until known.
    """

    offset_s: float = math.nan
    delay_s: float = math.nan
    drift_ppm: float = math.nan


class ArrivalClock:
    """Converts stamps of a device's clock to the host's, by the smallest delay of the arrival in the last seconds.

    A network or an operating system can only delay, so the smallest delay is the nearest to zero. If all readings of a
    second arrive later than that, and do not catch up, the device's clock stood still: the smallest delay is then found
    again.

    Args:
        longest_step_ns: longest standstill of the clock; a longer one counts as a delay of the readings. None: no
            limit.

    >>> clock = ArrivalClock()
    >>> [clock.host_ns(device, arrival) for device, arrival in ((0, 1_005), (100, 1_101), (200, 1_209))]
    [1005, 1101, 1201]
    """

    def __init__(self, longest_step_ns: int | None = None) -> None:
        self._longest_step_ns = longest_step_ns
        self._least: list[tuple[int, int]] = []
        """Second of arrival, and the smallest delay in it."""
        self._second: list[tuple[int, int]] = []
        """First and last reading of this second: arrival and delay."""
        self._last_ns: int | None = None
        self._first: tuple[int, int] | None = None
        self._delay_ns = math.nan

    def host_ns(self, device_ns: int, arrival_ns: int) -> int:
        """Returns the time of a reading on the clock of the host; it is later than that of the reading before.

        Args:
            device_ns: stamp of the reading on the clock of the device, ns.
            arrival_ns: its arrival on the clock of the host, ns.
        """
        delay, bucket = arrival_ns - device_ns, arrival_ns // _BUCKET_NS
        if self._least and self._least[-1][0] == bucket:
            self._least[-1] = bucket, min(delay, self._least[-1][1])
        else:
            if self._first is None and len(self._least) == 2:
                self._first = self._least[1]  # the first whole second
            if len(self._least) > 1 and self._stood_still():
                self._least = [self._least[-1]]
            if len(self._least) == MAX_BUCKETS:
                del self._least[self._oldest()]
            self._least.append((bucket, delay))
            self._second = [(arrival_ns, delay)]
        self._second[1:] = [(arrival_ns, delay)]
        offset = self.offset_ns
        beyond = float(delay - offset)
        self._delay_ns = (
            beyond if math.isnan(self._delay_ns) else self._delay_ns + _NEW_DELAY_WEIGHT * (beyond - self._delay_ns)
        )
        stamp = device_ns + offset
        if self._last_ns is not None and stamp <= self._last_ns:
            stamp = self._last_ns + 1
        self._last_ns = stamp
        return stamp

    def _oldest(self) -> int:
        """Returns the index of the second that is forgotten: not that of the smallest delay while readings are late."""
        late = self._longest_step_ns is not None and self._least[-1][1] - self.offset_ns > self._longest_step_ns
        kept = late or self._catches_up()
        return 1 if kept and self._least[0][1] == self.offset_ns else 0

    def _stood_still(self) -> bool:
        """Returns whether all readings of a whole second arrived later than before, and no buffer was emptied."""
        step_ns = self._least[-1][1] - self.offset_ns
        if step_ns <= _MIN_STANDSTILL_NS or (self._longest_step_ns is not None and step_ns > self._longest_step_ns):
            return False
        return self._second[-1][0] - self._second[0][0] >= _MIN_SPREAD_NS and not self._catches_up()

    def _catches_up(self) -> bool:
        """Returns whether the delay fell over the last second."""
        (began_ns, first_ns), (ended_ns, last_ns) = self._second[0], self._second[-1]
        return first_ns - last_ns > max(_MIN_STANDSTILL_NS, _CAUGHT_UP_SHARE * (ended_ns - began_ns))

    @property
    def offset_ns(self) -> int:
        """Offset that is added to a stamp, ns; 0 before the first stamp."""
        return min((delay for _, delay in self._least), default=0)

    def report(self) -> ClockReport:
        """Returns the present offset between the two clocks, the mean delay and the drift."""
        if not self._least:
            return ClockReport()
        drift = math.nan
        if self._first and len(self._least) > 1:
            bucket, delay = self._least[-2]  # the last whole second
            seconds = (bucket - self._first[0]) * _BUCKET_NS * 1e-9
            if seconds >= _DRIFT_AFTER_S:
                drift = 1e-3 * (delay - self._first[1]) / seconds
        return ClockReport(self.offset_ns * 1e-9, self._delay_ns * 1e-9, drift)
