"""Drivers of the catheter's knob: its angle from a serial encoder, from a log, or constant."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ..errors import DeviceError
from ..io import read_drive_log
from ..types import KNOB, Actuation, Clock, Event, LogInfo, actuation_range
from ._driver import DeclaredStream, DeviceConfig, Driver, Number, Setting
from ._serial import LinePort

STREAM = "knob"
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MAX_SILENCE_S = 1.0
_NEVER_NS = 1 << 62
CONSTANT_PERIOD_NS = 1_000_000_000
"""A constant angle is sent again after this time."""


class SerialKnobConfig(DeviceConfig, frozen=True):
    """``[hardware.knob]`` with ``driver = "serial"``: an encoder that writes a number a line.

    The angle is ``offset`` + ``scale`` x number.

    Attributes:
        port: serial port.
        baud: baud rate.
        quantity: the drive, NAME_UNIT.
        scale: see above.
        offset: see above.
        rate_hz: lines per second, if it writes continuously; then a second of silence means that it is lost.
        latency_ms: delay of a line, which is subtracted from the stamps, ms.
    """

    driver: Literal["serial"] = "serial"
    port: str
    baud: Annotated[int, Field(gt=0, le=10_000_000)] = 115200
    quantity: str = KNOB
    scale: Number = 1.0
    offset: Number = 0.0
    rate_hz: Annotated[float, Field(gt=0, le=100_000)] | None = None
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0


class LogKnobConfig(DeviceConfig, frozen=True):
    """``[hardware.knob]`` with ``driver = "log"``: readings of a table; its first row is at the start of the recording.

    ``log``: format of the table, with the keys of ``actuation.log``.
    """

    driver: Literal["log"] = "log"
    path: Path
    log: LogInfo = LogInfo()


class ConstantKnobConfig(DeviceConfig, frozen=True):
    """``[hardware.knob]`` with ``driver = "constant"``: an angle that a person has set."""

    driver: Literal["constant"] = "constant"
    value: Number
    quantity: str = KNOB


class SerialKnob(Driver):
    """Driver of an encoder at a serial port.

    Args:
        config: settings of the device.
        name: name of the device in ``[hardware]``.
    """

    config_type = SerialKnobConfig

    def __init__(self, config: SerialKnobConfig, name: str = "knob") -> None:
        super().__init__(name)
        self.config = config
        self._port: LinePort | None = None
        self._clock: Clock | None = None
        self._heard_ns = 0
        self._range = actuation_range(config.quantity)

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The knob."""
        clock = f"the host's, on arrival, minus latency_ms = {self.config.latency_ms:g}"
        return (DeclaredStream(STREAM, "actuation", self.config.rate_hz, clock),)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Opens the port."""
        self._port = LinePort(self.config.port, self.config.baud, f"hardware.{self.name}")
        self._clock, self._heard_ns = clock, clock.now_ns()
        return (Setting("baud", self.config.baud, self.config.baud),)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the newest of the lines that have come: an encoder has no stamps, and earlier lines are older."""
        assert self._port is not None
        assert self._clock is not None
        values = [value for line in self._port.lines(timeout_s) if (value := self._value(line)) is not None]
        now = self._clock.now_ns()
        if values:
            self._heard_ns = now
            stamp = now - round(self.config.latency_ms * 1e6)
            return (Actuation(stamp, {self.config.quantity: values[-1]}, STREAM),)
        if self.config.rate_hz and now - self._heard_ns > MAX_SILENCE_S * 1e9:
            raise DeviceError(f"hardware.{self.name}: {self.config.port} has written no number for {MAX_SILENCE_S:g} s")
        return ()

    def _value(self, line: str) -> float | None:
        """Returns the angle in the unit of ``quantity``; None for a line that is no number or out of range."""
        if not _NUMBER.fullmatch(line):
            self.counts["malformed"] += 1
            return None
        value = self.config.offset + self.config.scale * float(line)
        if not self._range.low <= value <= self._range.high:
            self.counts["malformed"] += 1
            self.remark = f"hardware.{self.name}: {value:g} is refused: expected {self._range}; check scale and baud"
            return None
        return value

    def close(self) -> None:
        """Releases the port."""
        if self._port is not None:
            self._port.close()
            self._port = None


class _Played(Driver):
    """Gives known readings at their times."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._clock: Clock | None = None
        self._zero_ns = 0
        self._next = 0

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The knob."""
        return (DeclaredStream(STREAM, "actuation", None, "the host's, from when the source began"),)

    def close(self) -> None:
        """Does nothing: no port is open."""

    def _begin(self, clock: Clock) -> None:
        self._clock, self._zero_ns, self._next = clock, clock.now_ns(), 0

    def _wait(self, due_ns: int, timeout_s: float) -> bool:
        """Waits; returns whether ``due_ns`` has come within ``timeout_s``."""
        assert self._clock is not None
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        self._clock.sleep_until_ns(min(due_ns, end_ns))
        return due_ns <= end_ns


class LogKnob(_Played):
    """Gives the readings of a log, once.

    Args:
        config: settings of the device.
        name: name of the device in ``[hardware]``.
    """

    config_type = LogKnobConfig

    def __init__(self, config: LogKnobConfig, name: str = "knob") -> None:
        super().__init__(name)
        self.config = config
        self._stamps = np.empty(0, np.int64)
        self._values: dict[str, list[float]] = {}

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Reads the log. Raises FileFormatError or TableError."""
        log = read_drive_log(self.config.path, self.config.log, "hardware.knob.log")
        self._stamps = log.stamp_ns - log.stamp_ns[0]
        self._values = {name: column.tolist() for name, column in log.values.items()}
        self._begin(clock)
        return (Setting("rows", None, len(log.stamp_ns)),)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the next row when it is due; none after the last one."""
        row = self._next
        if row == len(self._stamps):
            self._wait(_NEVER_NS, timeout_s)
            return ()
        due_ns = self._zero_ns + int(self._stamps[row])
        if not self._wait(due_ns, timeout_s):
            return ()
        self._next += 1
        readings = {name: column[row] for name, column in self._values.items() if not math.isnan(column[row])}
        return (Actuation(due_ns, readings, STREAM),)


class ConstantKnob(_Played):
    """Gives the same angle each second.

    Args:
        config: settings of the device.
        name: name of the device in ``[hardware]``.
    """

    config_type = ConstantKnobConfig

    def __init__(self, config: ConstantKnobConfig, name: str = "knob") -> None:
        super().__init__(name)
        self.config = config

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Starts the clock."""
        self._begin(clock)
        return (Setting(self.config.quantity, self.config.value, self.config.value),)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the angle once per second."""
        due_ns = self._zero_ns + self._next * CONSTANT_PERIOD_NS
        if not self._wait(due_ns, timeout_s):
            return ()
        self._next += 1
        return (Actuation(due_ns, {self.config.quantity: self.config.value}, STREAM),)
