"""Reads and writes serial ports with a time-out; each fault of a port gives one sentence."""

from typing import Any

from .._system.contexts import ClosedAtExit
from .._system.extras import import_extra
from ..errors import DeviceError

MAX_LINE_BYTES = 1024
"""A longer line is noise, or has another baud rate."""


class LinePort(ClosedAtExit):
    """A serial port that is read line by line.

    Args:
        port: its path or name.
        baud: bits per second.
        where: the device, for messages.

    Raises:
        DeviceError: the port cannot be opened.
        MissingExtraError: pyserial is not installed.
    """

    def __init__(self, port: str, baud: int, where: str) -> None:
        serial = import_extra("serial", "hardware", package="pyserial")
        self._lost: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        self._where = f"{where}: {port}"
        self._rest = b""
        self.overlong = 0
        try:
            self._port: Any = serial.Serial(port, baud, timeout=0, write_timeout=1.0)
        except (*self._lost, ValueError) as error:
            raise DeviceError(f"{self._where} cannot be opened: {error}") from None

    def write(self, data: bytes) -> None:
        """Writes all of ``data``."""
        try:
            self._port.write(data)
        except self._lost as error:
            raise DeviceError(f"{self._where} is lost: {error}") from None

    def lines(self, timeout_s: float) -> list[str]:
        """Returns the complete lines that have come, or that come within ``timeout_s``, without their ends."""
        try:
            self._port.timeout = timeout_s
            data: bytes = self._port.read(1)
            if data:
                data += self._port.read(self._port.in_waiting)
        except (*self._lost, TypeError) as error:  # pyserial reads from a port that was closed in the meantime
            raise DeviceError(f"{self._where} is lost: {error}") from None
        *whole, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > MAX_LINE_BYTES:
            self._rest = b""
            self.overlong += 1
        return [line.decode("ascii", "replace").strip() for line in whole if line.strip()]

    def close(self) -> None:
        """Releases the port."""
        try:
            self._port.close()
        except self._lost:  # it was pulled out
            self._port = None
