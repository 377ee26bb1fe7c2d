"""The angle of the catheter's knob: from a serial encoder, from a log, or constant."""

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
_SILENT_S = 1.0
_EVERY_NS = 1_000_000_000
"""A constant is told again each second."""


class SerialKnobConfig(DeviceConfig, frozen=True):
    """``[hardware.knob]`` with ``driver = "serial"``: an encoder that writes a number a line.

    The angle is ``offset`` + ``scale`` x number, of the drive ``quantity`` (NAME_UNIT). ``rate_hz``: lines a second,
    where it writes always; then a second of silence means that it is lost.
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
    """``[hardware.knob]`` with ``driver = "log"``: readings of a table, its first row when the recording begins.

    ``log``: how the table is written, with the keys of ``actuation.log``.
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
    """An encoder at a serial port."""

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
        """Open the port."""
        self._port = LinePort(self.config.port, self.config.baud, f"hardware.{self.name}")
        self._clock, self._heard_ns = clock, clock.now_ns()
        return (Setting("baud", self.config.baud, self.config.baud),)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """The newest of the lines that have come: an encoder has no stamps, and the older ones are older."""
        assert self._port is not None
        assert self._clock is not None
        values = [value for line in self._port.lines(timeout_s) if (value := self._value(line)) is not None]
        now = self._clock.now_ns()
        if values:
            self._heard_ns = now
            stamp = now - round(self.config.latency_ms * 1e6)
            return (Actuation(stamp, {self.config.quantity: values[-1]}, STREAM),)
        if self.config.rate_hz and now - self._heard_ns > _SILENT_S * 1e9:
            raise DeviceError(f"hardware.{self.name}: {self.config.port} has written no number for {_SILENT_S:g} s")
        return ()

    def _value(self, line: str) -> float | None:
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
        """Let go of the port."""
        if self._port is not None:
            self._port.close()
            self._port = None


class _Played(Driver):
    """Readings known beforehand, given when their time has come."""

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
        """Nothing is open."""

    def _begin(self, clock: Clock) -> None:
        self._clock, self._zero_ns, self._next = clock, clock.now_ns(), 0

    def _wait(self, due_ns: int, timeout_s: float) -> bool:
        """Whether ``due_ns`` has come within ``timeout_s``."""
        assert self._clock is not None
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        self._clock.sleep_until_ns(min(due_ns, end_ns))
        return due_ns <= end_ns


class LogKnob(_Played):
    """The readings of a log, once."""

    config_type = LogKnobConfig

    def __init__(self, config: LogKnobConfig, name: str = "knob") -> None:
        super().__init__(name)
        self.config = config
        self._stamps = np.empty(0, np.int64)
        self._values: dict[str, list[float]] = {}

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Read the log. Raises FileFormatError or TableError."""
        log = read_drive_log(self.config.path, self.config.log, "hardware.knob.log")
        self._stamps = log.stamp_ns - log.stamp_ns[0]
        self._values = {name: column.tolist() for name, column in log.values.items()}
        self._begin(clock)
        return (Setting("rows", None, len(log.stamp_ns)),)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """The next row when it is due; afterwards nothing."""
        row = self._next
        if row == len(self._stamps):
            self._wait(1 << 62, timeout_s)
            return ()
        due_ns = self._zero_ns + int(self._stamps[row])
        if not self._wait(due_ns, timeout_s):
            return ()
        self._next += 1
        here = {name: column[row] for name, column in self._values.items() if not math.isnan(column[row])}
        return (Actuation(due_ns, here, STREAM),)


class ConstantKnob(_Played):
    """The same angle, each second."""

    config_type = ConstantKnobConfig

    def __init__(self, config: ConstantKnobConfig, name: str = "knob") -> None:
        super().__init__(name)
        self.config = config

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Begin."""
        self._begin(clock)
        return (Setting(self.config.quantity, self.config.value, self.config.value),)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """The angle, when a second is over."""
        due_ns = self._zero_ns + self._next * _EVERY_NS
        if not self._wait(due_ns, timeout_s):
            return ()
        self._next += 1
        return (Actuation(due_ns, {self.config.quantity: self.config.value}, STREAM),)
