"""Driver of ATI Net F/T over Ethernet: Raw Data Transfer (RDT) by UDP, configuration by HTTP.

By ATI's manual 9620-05-NET FT, a request is ``!HHI``, and a reply ``!3I6i`` with two sequence numbers, a status word
and the counts of Fx, Fy, Fz, Tx, Ty, Tz. The unit and the counts per unit are in ``netftapi2.xml`` of the box.
"""

import math
import socket
import struct
import sys
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal
from xml.etree import ElementTree

import numpy as np
from pydantic import Field

from .._system.arrival_clock import ArrivalClock, ClockReport
from ..errors import DeviceError
from ..types import Clock, Event, Wrench
from ._driver import DeclaredStream, DeviceConfig, Driver, Setting

RDT_REQUEST = struct.Struct("!HHI")
"""Header 0x1234, command, number of samples (0: until stopped)."""
RDT_REPLY = struct.Struct("!3I6i")
"""RDT sequence, F/T sequence, status, counts of Fx, Fy, Fz, Tx, Ty, Tz."""
_COUNT = 1 << 32
"""Sequence numbers begin again at 0 after this number of packets."""
HEADER, STOP, STREAM, BIAS = 0x1234, 0x0000, 0x0002, 0x0042

_POUND_N, _KILOGRAM_N, _INCH_M, _FOOT_M = 4.4482216152605, 9.80665, 0.0254, 0.3048
_FORCE_UNITS = {
    "n": 1.0, "kn": 1e3, "lbf": _POUND_N, "klbf": 1e3 * _POUND_N, "kgf": _KILOGRAM_N, "gf": 1e-3 * _KILOGRAM_N,
    "lb": _POUND_N, "klb": 1e3 * _POUND_N, "kg": _KILOGRAM_N, "g": 1e-3 * _KILOGRAM_N,
}  # fmt: skip
_TORQUE_UNITS = {
    "nm": 1.0, "nmm": 1e-3, "knm": 1e3, "lbfin": _POUND_N * _INCH_M, "lbfft": _POUND_N * _FOOT_M,
    "kgfcm": 1e-2 * _KILOGRAM_N, "inlb": _POUND_N * _INCH_M, "ftlb": _POUND_N * _FOOT_M, "kgcm": 1e-2 * _KILOGRAM_N,
    "inlbf": _POUND_N * _INCH_M, "ftlbf": _POUND_N * _FOOT_M, "lbin": _POUND_N * _INCH_M, "lbft": _POUND_N * _FOOT_M,
}  # fmt: skip
_HTTP_S = 2.0
REQUEST_AGAIN_S, MAX_SILENCE_S = 0.25, 1.0
"""Silence after which the stream is requested again, and after which the box counts as lost."""
_BUFFER_BYTES = 4 << 20
"""Size for a busy host: some 5000 packets, which take 768 bytes each in Linux; the system may grant less."""
MAX_BACKWARD_STEP = 1000
"""Number of packets; one that is further behind is from a box that restarted its count."""
RATE_RANGE_HZ = (1.0, 7000.0)


def unit_in_newtons(unit: str) -> float:
    """Returns the newtons in one ``unit`` of force, as ATI writes it.

    Raises DeviceError for an unknown unit.

    >>> unit_in_newtons("N"), round(unit_in_newtons("lbf"), 4)
    (1.0, 4.4482)
    """
    return _known_unit(unit, _FORCE_UNITS, "force")


def unit_in_newton_metres(unit: str) -> float:
    """Returns the N m in one ``unit`` of torque, as ATI writes it. Raises DeviceError for an unknown unit.

    >>> unit_in_newton_metres("N-mm")
    0.001
    """
    return _known_unit(unit, _TORQUE_UNITS, "torque")


def _known_unit(unit: str, known: Mapping[str, float], quantity: str) -> float:
    key = "".join(letter for letter in unit.lower() if letter.isalpha())
    if key not in known:
        raise DeviceError(f"the {quantity} unit {unit!r} is not known; expected one of {', '.join(known)}")
    return known[key]


class NetFtConfig(DeviceConfig, frozen=True):
    """``[hardware.force]`` with ``driver = "net-ft"``.

    Attributes:
        host: address of the box.
        port: UDP port.
        http_port: HTTP port.
        rate_hz: expected RDT output rate of the box, Hz.
        latency_ms: shortest time from the force to the arrival of its packet (filter of the box and network), ms.
        bias: whether the zero of the box is set when connected.
    """

    driver: Literal["net-ft"] = "net-ft"
    host: str
    port: Annotated[int, Field(ge=1, le=65535)] = 49152
    http_port: Annotated[int, Field(ge=1, le=65535)] = 80
    rate_hz: Annotated[float, Field(ge=RATE_RANGE_HZ[0], le=RATE_RANGE_HZ[1])] | None = None
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0
    bias: bool = False


class RdtCheck:
    """Checks the sequence numbers and the status of every packet; only a new and valid packet becomes a reading.

    ``counts``: "lost" packets; "late", which came after a later one (and no longer count as lost); "duplicate";
    "status", refused for a status word other than 0; "frozen", with a new RDT sequence but the previous F/T sequence;
    "malformed"; "restarts" of the count after the request for a new stream. ``status``: the last status word other
    than 0.
    """

    def __init__(self, counts: dict[str, int]) -> None:
        self._counts = counts
        self.status = 0
        self._last: tuple[int, int] | None = None
        self._asked_anew = False
        self._missing: set[int] = set()

    def take(self, packet: bytes) -> tuple[int, tuple[int, ...]] | None:
        """Returns RDT sequence and the six counts; None where the packet gives no reading.

        Raises DeviceError where the box restarted its count.
        """
        if len(packet) != RDT_REPLY.size:
            self._count("malformed")
            return None
        sequence, ft_sequence, status, *counts = RDT_REPLY.unpack(packet)
        if self._last is not None and self._asked_anew and self._step(sequence) <= 0:  # a new count, as requested
            self._last = None
            self._missing.clear()
            self._count("restarts")
        self._asked_anew = False
        if self._last is not None:
            step = self._step(sequence)
            if step < -MAX_BACKWARD_STEP:
                self._last = None
                raise DeviceError("the Net F/T box counts its packets anew: it was restarted, or somebody else uses it")
            if step <= 0:
                if sequence in self._missing:
                    self._missing.discard(sequence)
                    self._counts["lost"] -= 1
                    self._count("late")
                else:
                    self._count("duplicate")
                return None
            if step > 1:  # those between may still come
                self._count("lost", step - 1)
                self._missing |= {(sequence - back) % _COUNT for back in range(1, min(step, MAX_BACKWARD_STEP))}
                if len(self._missing) > 2 * MAX_BACKWARD_STEP:
                    self._missing = {old for old in self._missing if (sequence - old) % _COUNT <= MAX_BACKWARD_STEP}
        frozen = self._last is not None and ft_sequence == self._last[1]
        self._last = sequence, ft_sequence
        if status:
            self._count("status")
            self.status = status
            return None
        if frozen:
            self._count("frozen")
            return None
        return sequence, tuple(counts)

    def restart(self) -> None:
        """Notes the request for a new stream, whose packets may count from any number."""
        self._asked_anew = True

    def _step(self, rdt: int) -> int:
        """Returns the number of packets from the last one to ``rdt``; the count overflows at 32 bits."""
        assert self._last is not None
        return (rdt - self._last[0] + _COUNT // 2) % _COUNT - _COUNT // 2

    def _count(self, fault: str, by: int = 1) -> None:
        self._counts[fault] = self._counts.get(fault, 0) + by


class NetFt(Driver):
    """Driver of one Net F/T box.

    Args:
        config: settings of the device.
        name: name of the device in ``[hardware]``.
    """

    config_type = NetFtConfig

    def __init__(self, config: NetFtConfig, name: str = "force") -> None:
        super().__init__(name)
        self.config = config
        self._socket: socket.socket | None = None
        self._rate_hz = config.rate_hz or 1000.0
        self._scale = np.ones(6)
        self._clock: Clock | None = None
        self._map = ArrivalClock()
        self._check = RdtCheck(self.counts)
        self._zero: int | None = None
        self._heard_ns = self._asked_ns = 0

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The force."""
        late = f"minus latency_ms = {self.config.latency_ms:g}"
        clock = f"the box's packet count, brought to the host's clock by the least delay, {late}"
        return (DeclaredStream("force", "wrench", self.config.rate_hz, clock),)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Reads the configuration of the box, then requests a continuous stream."""
        facts = self._configuration()
        self._rate_hz = float(facts["comrdtrate"])
        counts = [float(facts[key]) for key in ("cfgcpf", "cfgcpt")]
        if not all(value > 0 and math.isfinite(value) for value in (*counts, self._rate_hz)):
            raise DeviceError(
                f"{self._where}: states {counts} counts a unit at {self._rate_hz:g} Hz; expected more than 0"
            )
        force, torque = unit_in_newtons(facts["scfgfu"]), unit_in_newton_metres(facts["scfgtu"])
        self._scale = np.repeat([force / counts[0], torque / counts[1]], 3)
        self._clock, self._map, self._check = clock, ArrivalClock(), RdtCheck(self.counts)
        self._zero = None
        udp_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            udp_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            udp_socket.connect((self.config.host, self.config.port))  # packets from other hosts are ignored
        except OSError as error:
            udp_socket.close()
            raise DeviceError(f"{self._where}: {error.strerror or error}") from None
        self._socket = udp_socket
        if self.config.bias:
            self._send(BIAS)
        self._send(STREAM)
        self._heard_ns = self._asked_ns = clock.now_ns()
        return (
            Setting("rate_hz", self.config.rate_hz, self._rate_hz),
            Setting("counts_per_force", None, counts[0]),
            Setting("counts_per_torque", None, counts[1]),
            Setting("force_unit", None, facts["scfgfu"]),
            Setting("torque_unit", None, facts["scfgtu"]),
            Setting("calibration", None, facts.get("calsn", "")),
            Setting("filter", None, facts.get("setuserfilter", "")),
            Setting("buffer_bytes", _BUFFER_BYTES, min(self._buffer_bytes(), _BUFFER_BYTES)),
        )

    def _buffer_bytes(self) -> int:
        """Returns the size that the system grants; Linux reports twice of it, and limits it by net.core.rmem_max."""
        assert self._socket is not None
        granted = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        return granted // 2 if sys.platform == "linux" else granted

    def bias(self) -> None:
        """Makes the present reading of the sensor the zero of the box."""
        self._send(BIAS)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the packets that have come; where the box is silent, requests the stream again, then gives up."""
        assert self._socket is not None
        assert self._clock is not None
        events: list[Event] = []
        self._socket.settimeout(timeout_s)
        try:
            while True:
                packet = self._socket.recv(2 * RDT_REPLY.size)
                arrival = self._heard_ns = self._clock.now_ns()
                if (wrench := self._wrench(packet, arrival)) is not None:
                    events.append(wrench)
                if len(events) >= 64:  # a limit, so that they are used before the whole buffer is read
                    return events
                self._socket.setblocking(False)  # only the first packet is waited for
        except BlockingIOError:
            return events
        except TimeoutError:
            self._silent(self._clock.now_ns())
            return events
        except OSError as error:  # a closed port responds by ICMP
            raise DeviceError(f"{self._where}: {error.strerror or error}") from None

    def _wrench(self, packet: bytes, arrival_ns: int) -> Wrench | None:
        """Converts a packet to a reading; None where it gives none.

        The stamp is the packet's number over the rate, brought to the clock of the host by the packets with the least
        delay. After a restart of the count this map begins again.

        Args:
            packet: a reply of the box.
            arrival_ns: time of its arrival on the clock of the host.
        """
        restarts = self.counts["restarts"]
        reading = self._check.take(packet)
        if self.counts["restarts"] > restarts:
            self._map, self._zero = ArrivalClock(), None
        if self._check.status:
            self.remark = f"{self._where}: refused readings with the status word 0x{self._check.status:08x}"
        if reading is None:
            return None
        rdt, counts = reading
        if self._zero is None:
            self._zero = rdt
        device_ns = round((rdt - self._zero) % _COUNT * 1e9 / self._rate_hz)
        stamp = self._map.host_ns(device_ns, arrival_ns) - round(self.config.latency_ms * 1e6)
        values = self._scale * counts
        return Wrench(stamp, values[:3], values[3:], "sensor")

    def _silent(self, now_ns: int) -> None:
        """Requests the stream again after a short silence; raises DeviceError after `MAX_SILENCE_S`."""
        if now_ns - self._heard_ns > MAX_SILENCE_S * 1e9:
            self.counts["silences"] += 1
            raise DeviceError(
                f"{self._where}: has sent no packet for {MAX_SILENCE_S:g} s; check its cable and its power"
            )
        if now_ns - max(self._asked_ns, self._heard_ns) > REQUEST_AGAIN_S * 1e9:
            self._asked_ns = now_ns
            self._send(STREAM)
            self._check.restart()

    def close(self) -> None:
        """Asks the box to stop, and releases it."""
        if self._socket is not None:
            try:
                self._socket.send(RDT_REQUEST.pack(HEADER, STOP, 0))
            except OSError:  # the connection is lost already
                self.counts["stops_unsent"] += 1
            self._socket.close()
            self._socket = None

    def clocks(self) -> Mapping[str, ClockReport]:
        """Returns the report on the packet count, compared with the clock of the host."""
        return {"force": self._map.report()}

    @property
    def _where(self) -> str:
        return f"hardware.{self.name}: the Net F/T box at {self.config.host}"

    def _send(self, command: int) -> None:
        if self._socket is None:
            raise DeviceError(f"{self._where}: is not connected")
        try:
            self._socket.send(RDT_REQUEST.pack(HEADER, command, 0))
        except OSError as error:
            raise DeviceError(f"{self._where}: {error.strerror or error}") from None

    def _configuration(self) -> dict[str, str]:
        """Reads the configuration of the box by HTTP; returns tag -> text."""
        url = f"http://{self.config.host}:{self.config.http_port}/netftapi2.xml"
        try:
            with urllib.request.urlopen(url, timeout=_HTTP_S) as reply:
                root = ElementTree.fromstring(reply.read(1 << 20))
        except (urllib.error.URLError, OSError, ElementTree.ParseError) as error:
            reason = error.reason if isinstance(error, urllib.error.URLError) else error
            raise DeviceError(f"{self._where}: {url} cannot be read: {reason}") from None
        facts = {node.tag: (node.text or "").strip() for node in root.iter()}
        lacking = [key for key in ("cfgcpf", "cfgcpt", "scfgfu", "scfgtu", "comrdtrate") if not facts.get(key)]
        if lacking:
            raise DeviceError(f"{self._where}: {url} does not state {', '.join(lacking)}")
        return facts
