"""A causal window over the frames of one session."""

from collections import deque

import numpy as np

from ...types import FloatArray
from ._settings import WindowSettings


class Window:
    """Converts rows (k,) to rows (k * lags,), in the order of the lags in the settings."""

    def __init__(self, settings: WindowSettings) -> None:
        self._lags_ns = [round(lag * 1e6) for lag in settings.lags_ms]
        self._average_ns = round(settings.average_ms * 1e6)
        self._gap_ns = round(settings.gap_ms * 1e6)
        self._reach_ns = settings.reach_ns
        self._past: deque[tuple[int, FloatArray]] = deque()

    def push(self, stamp_ns: int, row: FloatArray) -> FloatArray:
        """Returns the window that ends with a row; its history is cleared after a gap, or if the time decreases.

        Args:
            stamp_ns: stamp of the row.
            row: (k,) features.

        Returns:
            (k * lags,) features of each lag.

        >>> window = Window(WindowSettings(lags_ms=(0, 20)))
        >>> [window.push(t * 10_000_000, np.array([float(t)])).tolist() for t in range(4)]
        [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 1.0]]
        """
        past = self._past
        if past and not 0 < stamp_ns - past[-1][0] <= self._gap_ns:
            past.clear()
        past.append((stamp_ns, row))
        # one frame that is older than the reach is kept: it is the newest that is at least that old
        while len(past) > 1 and past[1][0] <= stamp_ns - self._reach_ns:
            past.popleft()
        return np.concatenate([self._at(stamp_ns - lag) for lag in self._lags_ns])

    def _at(self, end_ns: int) -> FloatArray:
        """Returns the newest row (k,) not after ``end_ns``, or the mean of the rows in ``average_ms`` before it."""
        newest = self._past[0][1]
        rows: list[FloatArray] = []
        for stamp, row in self._past:
            if stamp > end_ns:
                break
            newest = row
            if self._average_ns and stamp > end_ns - self._average_ns:
                rows.append(row)
        return np.mean(rows, axis=0) if len(rows) > 1 else newest
