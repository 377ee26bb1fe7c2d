"""Emulates a GRBL 1.1 controller at a serial port: jogs with ramps, status, feed hold, cancel, reset, alarms."""

import math
import operator
import time
from collections import deque
from pathlib import Path
from typing import ClassVar

from .._grbl import CANCEL, HOLD, RESET, STATUS
from ._pty import PtyDevice

_LETTERS = "XYZ"
MAX_PLANNED_MOVES = 15
"""Number of moves that the planner holds."""
_RECEIVE_BYTES = 127
STATUS_PER_WCO = 10
"""Every tenth status has the work offset, as GRBL sends it while idle."""


class GrblEmulator(PtyDevice):
    """Emulated controller of three axes.

    Moves are straight. The planner looks ahead over `MAX_PLANNED_MOVES` of them, so that moves in the same direction
    join, and a reversal comes to rest. Further lines wait in the receive buffer without a response.

    Attributes:
        mute: it responds to nothing.
        overruns: number of bytes that found the buffer full, which GRBL loses.
        heard: the lines that it received.
        realtime: the holds, resets and cancels that it received.
        place: position of each axis in machine coordinates, mm.
    """

    DEFAULTS: ClassVar[dict[str, float]] = {
        "10": 1.0, "13": 0.0, "20": 0.0, "21": 0.0,
        "110": 6000.0, "111": 6000.0, "112": 3000.0,
        "120": 2000.0, "121": 2000.0, "122": 1000.0,
        "130": 200.0, "131": 200.0, "132": 100.0,
    }  # fmt: skip

    def __init__(self, path: Path, settings: dict[str, float] | None = None, *, alarm: bool = False) -> None:
        super().__init__(path)
        self.settings = {**self.DEFAULTS, **(settings or {})}
        self.place = [0.0, 0.0, 0.0]
        self.heard: list[str] = []
        self.realtime = b""
        self.mute = False
        self.peak_mm_s = 0.0
        self._offset = [0.0, 0.0, 0.0]
        self._state = "Alarm" if alarm else "Idle"
        self._queue: deque[tuple[list[float], float]] = deque()
        self._lines: deque[str] = deque()
        self.overruns = 0
        self._speed = 0.0
        self._braking = False
        self._reports = 0
        self._line = b""
        self._last_s = time.monotonic()

    def trigger_limit(self) -> None:
        """Triggers a limit switch: GRBL stops immediately and is locked."""
        self._alarm(1)

    def _alarm(self, number: int) -> None:
        self._queue.clear()
        self._speed, self._state = 0.0, "Alarm"
        self._say(f"ALARM:{number}")

    def _say(self, line: str) -> None:
        if not self.mute:
            self.send(line + "\r\n")

    def received(self, data: bytes) -> None:
        """Executes real-time commands at any position in the bytes; the other bytes form lines."""
        for value in data:
            byte = bytes([value])
            if byte in (HOLD, RESET, CANCEL):
                self.realtime += byte
            if byte == STATUS:
                self._report()
            elif byte == RESET:
                self._reset()
            elif byte == CANCEL:
                if self._state == "Jog":
                    self._braking = True
            elif byte == HOLD:
                if self._state == "Jog":
                    self._braking = True
                elif self._state == "Idle":
                    self._state = "Hold"
            elif byte == b"~":
                self._state = "Idle" if self._state == "Hold" else self._state
            elif byte in b"\r\n":
                line, self._line = self._line.decode("ascii", "replace").strip(), b""
                if line:
                    self._lines.append(line)
                    self._obey_what_fits()
            elif sum(map(len, self._lines)) + len(self._lines) + len(self._line) >= _RECEIVE_BYTES:
                self.overruns += 1
            else:
                self._line += byte

    def _obey_what_fits(self) -> None:
        while self._lines and not (self._lines[0].startswith("$J=") and len(self._queue) >= MAX_PLANNED_MOVES):
            line = self._lines.popleft()
            self.heard.append(line)
            self._obey(line)

    def _reset(self) -> None:
        """Discards all moves; GRBL raises alarm 3 where it moved, because the position may be lost."""
        moving = self._state == "Jog"
        self._queue.clear()
        self._lines.clear()
        self._line, self._speed, self._braking = b"", 0.0, False
        self._say("\r\nGrbl 1.1h ['$' for help]")
        if moving:
            self._alarm(3)
        elif self._state != "Alarm":
            self._state = "Idle"
        else:
            self._say("[MSG:'$H'|'$X' to unlock]")

    def _obey(self, line: str) -> None:
        """Executes a line and responds "ok" or an error of GRBL (9: locked, 20: unknown command)."""
        if line == "$$":
            for number, value in self.settings.items():
                self._say(f"${number}={value:g}" if float(value).is_integer() else f"${number}={value:.3f}")
        elif line == "$X":
            self._state = "Idle"
            self._say("[MSG:Caution: Unlocked]")
        elif self._state == "Alarm":
            self._say("error:9")
            return
        elif line.startswith("$J="):
            if (refused := self._jog(line[3:])) is not None:
                self._say(f"error:{refused}")
                return
        elif line.startswith("G10 L20 P1"):
            for word in line.split()[3:]:
                axis = _LETTERS.index(word[0])
                self._offset[axis] = self.place[axis] - float(word[1:])
            self._reports = 0
        else:
            self._say("error:20")
            return
        self._say("ok")

    def _jog(self, words: str) -> int | None:
        """Queues a move; returns None, or the error of GRBL (22: no feed rate, 15: beyond the soft limits).

        Args:
            words: targets in work coordinates, mm, and feed rate, mm/min, as "G90 G21 X1.5 F300".
        """
        target = list(self._queue[-1][0] if self._queue else self.place)
        feed = 0.0
        for word in words.split():
            if word[0] in _LETTERS:
                axis = _LETTERS.index(word[0])
                target[axis] = float(word[1:]) + self._offset[axis]
            elif word[0] == "F":
                feed = float(word[1:])
        if feed <= 0:
            return 22
        if self.settings["20"] and any(abs(target[k]) > self.settings[str(130 + k)] for k in range(3)):
            return 15
        self._queue.append((target, feed / 60.0))
        self._state = "Jog"
        return None

    def step(self) -> None:
        """Moves for the time that has passed, in steps of at most 1 ms."""
        now = time.monotonic()
        left_s, self._last_s = now - self._last_s, now
        while left_s > 0 and self._state == "Jog":
            step_s = min(left_s, 1e-3)
            left_s -= step_s
            self._move(step_s)
            self._obey_what_fits()

    def _move(self, seconds: float) -> None:
        """Moves along the first queued move for a time step, with a speed from which it can still brake at its end."""
        target, feed = self._queue[0]
        remaining = [end - here for end, here in zip(target, self.place, strict=True)]
        remaining_mm = math.hypot(*remaining)
        share = [abs(component) / remaining_mm if remaining_mm else 0.0 for component in remaining]
        ramp, max_speed = self._limits_along(share, feed)
        end_speed = self._end_speed(remaining, remaining_mm)
        braking_speed = 0.0 if self._braking else math.sqrt(end_speed * end_speed + 2 * ramp * remaining_mm)
        self._speed = max(
            min(self._speed + ramp * seconds, max_speed, braking_speed), self._speed - ramp * seconds, 0.0
        )
        self.peak_mm_s = max(self.peak_mm_s, self._speed)
        step_mm = min(self._speed * seconds, remaining_mm)
        if remaining_mm:
            self.place = [
                here + component * step_mm / remaining_mm for here, component in zip(self.place, remaining, strict=True)
            ]
        if self._braking and self._speed <= 0:
            self._queue.clear()
            self._braking, self._state = False, "Idle"
        elif remaining_mm - step_mm < 1e-3:  # the target is reached
            self.place, self._speed = list(target), min(self._speed, end_speed)
            self._queue.popleft()
            if not self._queue:
                self._state, self._braking = "Idle", False

    def _limits_along(self, share: list[float], feed: float) -> tuple[float, float]:
        """Returns the largest acceleration (mm/s^2) and speed (mm/s) of a move; each axis has its ``share`` of them."""
        brake = min((self.settings[str(120 + k)] / share[k] for k in range(3) if share[k]), default=1e9)
        return brake, min([feed, *(self.settings[str(110 + k)] / 60.0 / share[k] for k in range(3) if share[k])])

    def _end_speed(self, way: list[float], length: float) -> float:
        """Returns the speed in mm/s at the end of the first move from which the next moves can come to rest in time.

        ``way`` is the rest of the first move by axis, ``length`` its length, mm. At a corner the speed is that of the
        slower move times the cosine of the angle.
        """
        (start, feed), *next_moves = self._queue
        junctions: list[tuple[float, float, float]] = []  # speed at a corner; length and brake of the move after it
        for target, next_feed in next_moves:
            next_way = [end - begin for end, begin in zip(target, start, strict=True)]
            next_length = math.hypot(*next_way)
            cosine = sum(map(operator.mul, way, next_way)) / (length * next_length or 1.0)
            share = [abs(component) / next_length if next_length else 0.0 for component in next_way]
            brake, top = self._limits_along(share, next_feed)
            junctions.append((min(feed, top) * max(0.0, cosine), next_length, brake))
            start, way, length, feed = target, next_way, next_length, next_feed
        speed = 0.0  # at the end of the last move; backwards from there, each move brakes to the speed after it
        for corner_speed, next_length, brake in reversed(junctions):
            speed = min(corner_speed, math.sqrt(speed * speed + 2 * brake * next_length))
        return speed

    def _report(self) -> None:
        """Sends a status: state, machine position in mm, feed in mm/min, and at times the work offset."""
        numbers = ",".join(f"{value:.3f}" for value in self.place)
        state = "Hold:0" if self._state == "Hold" else self._state
        extra = ""
        if self._reports % STATUS_PER_WCO == 0:
            extra = "|WCO:" + ",".join(f"{value:.3f}" for value in self._offset)
        self._reports += 1
        self._say(f"<{state}|MPos:{numbers}|FS:{60 * self._speed:.0f},0{extra}>")
