"""Delays and rates of a live run, kept in ring buffers of fixed size."""

from bisect import bisect_left
from collections import deque

import numpy as np


class Rate:
    """Events per second.

    Args:
        window_s: duration in s over which events count.
        most: largest number of events that are kept.
    """

    def __init__(self, window_s: float = 1.0, most: int = 512) -> None:
        self._window_ns = round(window_s * 1e9)
        self._at: deque[int] = deque(maxlen=most)

    def add(self, now_ns: int) -> None:
        """Adds one event."""
        self._at.append(now_ns)

    def per_s(self, now_ns: int) -> float:
        """Returns the rate at ``now_ns`` in 1/s; 0 if the window has fewer than two events."""
        while self._at and self._at[0] < now_ns - self._window_ns:
            self._at.popleft()
        span = self._at[-1] - self._at[0] if self._at else 0
        return (len(self._at) - 1) * 1e9 / span if span > 0 else 0.0


class RecentDelays:
    """Percentiles of the last delays.

    Args:
        window_s: duration in s over which delays count.
        most: largest number of delays that are kept.
        every_s: shortest time in s between two computations.
    """

    def __init__(self, window_s: float = 10.0, most: int = 2048, every_s: float = 0.25) -> None:
        self._at_ns, self._delay_s = np.zeros(most, np.int64), np.zeros(most)
        self._count, self._window_ns = 0, round(window_s * 1e9)
        self._next_ns, self._every_ns = 0, round(every_s * 1e9)
        self._last_percentiles = (float("nan"), float("nan"))

    def add(self, now_ns: int, delay_s: float) -> None:
        """Adds one delay.

        Args:
            now_ns: present time on the engine's clock.
            delay_s: the delay, s.
        """
        row = self._count % len(self._at_ns)
        self._at_ns[row], self._delay_s[row] = now_ns, delay_s
        self._count += 1

    def percentiles(self, now_ns: int) -> tuple[float, float]:
        """Returns p50 and p99 of the last ``window_s`` in seconds; NaN without a delay.

        They are computed at most every ``every_s``, because each update asks for them.
        """
        if self._count and now_ns >= self._next_ns:
            self._next_ns = now_ns + self._every_ns
            filled = slice(0, min(self._count, len(self._at_ns)))
            recent = self._delay_s[filled][self._at_ns[filled] >= now_ns - self._window_ns]
            p50, p99 = np.percentile(recent, [50, 99]).tolist() if len(recent) else (float("nan"),) * 2
            self._last_percentiles = (p50, p99)
        return self._last_percentiles


class Histogram:
    """Percentiles of all delays of a run of any length; a percentile is at most 2 % too large.

    >>> delays = Histogram()
    >>> for milliseconds in range(1, 101):
    ...     delays.add(milliseconds * 1e-3)
    >>> [0.99 < delays.percentile(p) / (p * 1e-3) < 1.025 for p in (50, 99)]
    [True, True]
    """

    _EDGES_S = np.geomspace(1e-5, 100.0, 814).tolist()
    """Upper edges of the bins; each is 2 % above the one before."""

    def __init__(self) -> None:
        self._counts = np.zeros(len(self._EDGES_S) + 1, np.int64)

    def add(self, delay_s: float) -> None:
        """Adds one delay in seconds."""
        self._counts[bisect_left(self._EDGES_S, delay_s)] += 1

    def percentile(self, p: float) -> float:
        """Returns the percentile ``p`` (0 to 100) in seconds; NaN without a delay."""
        total = int(self._counts.sum())
        if not total:
            return float("nan")
        row = int(np.searchsorted(np.cumsum(self._counts), p / 100.0 * total))  # first bin that reaches the share
        return self._EDGES_S[min(row, len(self._EDGES_S) - 1)]
