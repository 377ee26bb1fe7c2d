"""Checks the last seconds of a live stream of forces."""

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..types import FloatArray
from ._check import check_force_log
from ._findings import ForceFinding, ForcePlausibility
from ._zero_steps import find_zero_steps

WINDOW_NS, CHECK_PERIOD_NS = 10_000_000_000, 1_000_000_000
"""The check runs at most once a second, on the readings of the last ten seconds."""
_MAX_READINGS = 20_000
"""Largest number of readings in the window, which is shorter for faster sensors."""


class ForceMonitor:
    """Checks the readings of one force sensor as they come; `check_force_log` checks a complete log in the same way.

    One thread may add readings while another one requests the findings, which are then computed.

    Args:
        range_n: (3,) largest reading of each axis by the sensor's data sheet, N.
    """

    def __init__(self, range_n: tuple[float, float, float] | None = None) -> None:
        self._range_n = range_n
        self._readings: deque[tuple[int, FloatArray]] = deque(maxlen=_MAX_READINGS)
        self._lock = threading.Lock()
        self._checked_ns: int | None = None
        self._first_ns: int | None = None
        self._now = ForcePlausibility()
        self._steps: dict[int, ForceFinding] = {}

    def add(self, stamp_ns: int, force_n: FloatArray) -> None:
        """Adds the next reading.

        Args:
            stamp_ns: its stamp.
            force_n: (3,) force, N.
        """
        with self._lock:
            if self._first_ns is None:
                self._first_ns = stamp_ns
            self._readings.append((stamp_ns, force_n))
            while stamp_ns - self._readings[0][0] > WINDOW_NS:
                self._readings.popleft()

    @property
    def findings(self) -> tuple[ForceFinding, ...]:
        """Findings of the last ten seconds, and all steps of the zero; seconds since the first reading."""
        with self._lock:
            readings = list(self._readings)
        if readings and (self._checked_ns is None or readings[-1][0] - self._checked_ns >= CHECK_PERIOD_NS):
            self._checked_ns = readings[-1][0]
            self._check(readings)
        return (*self._now.findings, *self._steps.values())

    @property
    def remark(self) -> str:
        """The findings in one line, or empty."""
        return "; ".join(ForcePlausibility(self.findings).lines())

    def _check(self, readings: Sequence[tuple[int, FloatArray]]) -> None:
        """Checks the window's readings (stamp, force (3,), N), and adds new steps of the zero to the known ones."""
        stamps = np.array([stamp for stamp, _ in readings], np.int64)
        force = np.array([reading for _, reading in readings])
        plausibility = check_force_log(stamps, force, range_n=self._range_n)
        first_ns = self._first_ns or 0
        # the check counts seconds from the window's first reading, the monitor from the stream's
        window_s = (int(stamps[0]) - first_ns) * 1e-9
        findings = (
            replace(finding, start_s=finding.start_s + window_s, end_s=finding.end_s + window_s)
            for finding in plausibility.findings
        )
        self._now = replace(plausibility, findings=tuple(findings))
        axes = ~np.isnan(force).all(axis=0)
        rows = np.flatnonzero(plausibility.usable(stamps) & np.isfinite(force[:, axes]).all(axis=1))
        for step in find_zero_steps(stamps[rows], force[rows]):
            at_ns = int(stamps[rows[step.row]])
            # the windows overlap: the same step is found again, perhaps a few readings earlier or later
            if all(abs(at_ns - known_ns) > CHECK_PERIOD_NS for known_ns in self._steps):
                self._steps[at_ns] = ForceFinding.of_step((at_ns - first_ns) * 1e-9, step.step_n)
