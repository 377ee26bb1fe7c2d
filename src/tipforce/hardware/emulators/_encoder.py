"""Emulates an encoder at a serial port that writes one number per line."""

import time
from collections.abc import Callable
from pathlib import Path

from ._pty import PtyDevice


class EncoderEmulator(PtyDevice):
    """Emulated encoder. ``garbage`` True: it writes no numbers; ``silent`` True: it writes nothing.

    Args:
        path: its serial port.
        angle: time since the start in s -> reading.
        rate_hz: readings per second.
    """

    def __init__(self, path: Path, angle: Callable[[float], float], rate_hz: float = 100.0) -> None:
        super().__init__(path)
        self._angle, self._rate_hz = angle, rate_hz
        self._zero, self._done = time.monotonic(), 0
        self.garbage = self.silent = False

    def step(self) -> None:
        """Writes the lines that are due."""
        seconds = time.monotonic() - self._zero
        due = int(seconds * self._rate_hz)
        if due > self._done:
            self._done = due
            if not self.silent:
                self.send("#\x00!?\r\n" if self.garbage else f"{self._angle(seconds):.3f}\r\n")
