"""Interpolates the readings of drives at the stamps of frames: one rule for files and live streams."""

import math

import numpy as np

from ..types import Actuation, FloatArray, IntArray

WAIT_S = 0.5
"""A reading that comes at most this much later than a frame is used to interpolate at the frame."""


class ActuationSeries:
    """Readings of all drives by name, in the order in which they came."""

    def __init__(self) -> None:
        self._stamps: dict[str, list[int]] = {}
        self._values: dict[str, list[float]] = {}

    def add(self, event: Actuation) -> None:
        """Adds a reading; it replaces earlier readings of the same drive whose stamps are not before its own."""
        for name, value in event.values.items():
            stamps = self._stamps.setdefault(name, [])
            values = self._values.setdefault(name, [])
            while stamps and stamps[-1] >= event.stamp_ns:
                stamps.pop()
                values.pop()
            stamps.append(event.stamp_ns)
            values.append(value)

    def final_at(self, stamp_ns: int) -> bool:
        """Returns whether every drive has a reading at or after ``stamp_ns``, so that later ones change nothing."""
        return bool(self._stamps) and all(stamps[-1] >= stamp_ns for stamps in self._stamps.values())

    def forget_before(self, stamp_ns: int) -> None:
        """Drops the readings that no frame at or after ``stamp_ns`` needs."""
        for name, stamps in self._stamps.items():
            first_kept = 0  # the last reading before the frame holds until the next one, so it stays
            while first_kept + 1 < len(stamps) and stamps[first_kept + 1] <= stamp_ns:
                first_kept += 1
            if first_kept:
                del stamps[:first_kept], self._values[name][:first_kept]

    def at(self, stamps_ns: IntArray, *, wait_s: float = WAIT_S) -> dict[str, FloatArray]:
        """Returns the readings at the stamps of frames.

        Between two readings the value is linear where the later one comes within ``wait_s`` of the stamp; otherwise the
        earlier reading holds.

        Args:
            stamps_ns: (n,) stamps of the frames.
            wait_s: longest time from a frame to the next reading, s.

        Returns:
            Name -> (n,) values in the unit of the name; NaN before the first reading.

        >>> series = ActuationSeries()
        >>> for second, knob_deg in ((0, 0.0), (1, 10.0), (9, 90.0)):
        ...     series.add(Actuation(second * 10**9, {"knob_deg": knob_deg}))
        >>> series.at(np.array([-1, 0, 600_000_000, 5_000_000_000]))["knob_deg"]
        array([nan,  0.,  6., 10.])
        """
        interpolated: dict[str, FloatArray] = {}
        for name, reading_ns in self._stamps.items():
            stamps, values = np.array(reading_ns, dtype=np.int64), np.array(self._values[name])
            last = np.searchsorted(stamps, stamps_ns, side="right") - 1  # -1: the frame is before the first reading
            after = np.minimum(last + 1, len(stamps) - 1)
            before = np.maximum(last, 0)
            step = np.maximum(stamps[after] - stamps[before], 1)  # ns
            soon_after = (after > last) & (stamps[after] - stamps_ns <= wait_s * 1e9)
            share = np.where(soon_after, (stamps_ns - stamps[before]) / step, 0.0)
            value = values[before] + share * (values[after] - values[before])
            interpolated[name] = np.where(last < 0, math.nan, value)
        return interpolated
