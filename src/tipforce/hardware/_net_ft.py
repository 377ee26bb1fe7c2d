"""ATI Net F/T over Ethernet: Raw Data Transfer (RDT) by UDP, configuration by HTTP.

After ATI's manual 9620-05-NET FT: a request is ``!HHI``, a reply ``!3I6i`` with two sequence numbers, a status word and
the counts of Fx, Fy, Fz, Tx, Ty, Tz. How many counts a unit has, and which unit, is in the box's ``netftapi2.xml``.
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
_ASK_AGAIN_S, _LOST_S = 0.25, 1.0
"""Silence after which the stream is asked for again, and after which the box counts as lost."""
_BUFFER_BYTES = 4 << 20
"""For a host that is busy: some 5000 packets, which take 768 bytes each in Linux; less may be granted."""
_BEHIND = 1000
"""A packet further behind than this comes from a box that began to count anew."""
_RATE = (1.0, 7000.0)


def unit_in_newtons(unit: str) -> float:
    """What one ``unit`` of force, as ATI writes it, is in newtons.

    Raises DeviceError for a unit that is not known.

    >>> unit_in_newtons("N"), round(unit_in_newtons("lbf"), 4)
    (1.0, 4.4482)
    """
    return _known_unit(unit, _FORCE_UNITS, "force")


def unit_in_newton_metres(unit: str) -> float:
    """What one ``unit`` of torque, as ATI writes it, is in N m. Raises DeviceError for a unit that is not known.

    >>> unit_in_newton_metres("N-mm")
    0.001
    """
    return _known_unit(unit, _TORQUE_UNITS, "torque")


def _known_unit(unit: str, known: Mapping[str, float], what: str) -> float:
    key = "".join(letter for letter in unit.lower() if letter.isalpha())
    if key not in known:
        raise DeviceError(f"the {what} unit {unit!r} is not known; expected one of {', '.join(known)}")
    return known[key]


class NetFtConfig(DeviceConfig, frozen=True):
    """``[hardware.force]`` with ``driver = "net-ft"``.

    ``rate_hz``: the RDT output rate that the box is expected to be set to; ``latency_ms``: from the force to the
    packet's arrival at the least (the box's filter and the network); ``bias``: set the box's own zero when connected.
    """

    driver: Literal["net-ft"] = "net-ft"
    host: str
    port: Annotated[int, Field(ge=1, le=65535)] = 49152
    http_port: Annotated[int, Field(ge=1, le=65535)] = 80
    rate_hz: Annotated[float, Field(ge=_RATE[0], le=_RATE[1])] | None = None
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0
    bias: bool = False


class RdtCheck:
    """Holds every packet to its sequence numbers and status; only what is new and sound becomes a reading.

    ``counts``: "lost" packets; "late", which came behind a later one (and count as lost no more); "duplicate";
    "status", refused for a status word that is not 0; "frozen", with a new RDT sequence but the F/T sequence of before;
    "malformed"; "restarts" of the count after it was asked for a new stream. ``status``: the last status word but 0.
    """

    def __init__(self, counts: dict[str, int]) -> None:
        self._counts = counts
        self.status = 0
        self._last: tuple[int, int] | None = None
        self._asked_anew = False
        self._missing: set[int] = set()

    def take(self, packet: bytes) -> tuple[int, tuple[int, ...]] | None:
        """RDT sequence and the six counts; None where the packet gives no reading.

        Raises DeviceError where the box began to count anew.
        """
        if len(packet) != RDT_REPLY.size:
            self._count("malformed")
            return None
        rdt, ft, status, *counts = RDT_REPLY.unpack(packet)
        if self._last is not None and self._asked_anew and self._step(rdt) <= 0:
            self._last = None
            self._missing.clear()
            self._count("restarts")
        self._asked_anew = False
        if self._last is not None:
            step = self._step(rdt)
            if step < -_BEHIND:
                self._last = None
                raise DeviceError("the Net F/T box counts its packets anew: it was restarted, or somebody else uses it")
            if step <= 0:
                if rdt in self._missing:
                    self._missing.discard(rdt)
                    self._counts["lost"] -= 1
                    self._count("late")
                else:
                    self._count("duplicate")
                return None
            if step > 1:
                self._count("lost", step - 1)
                self._missing |= {(rdt - back) % (1 << 32) for back in range(1, min(step, _BEHIND))}
                if len(self._missing) > 2 * _BEHIND:
                    self._missing = {each for each in self._missing if (rdt - each) % (1 << 32) <= _BEHIND}
        frozen = self._last is not None and ft == self._last[1]
        self._last = rdt, ft
        if status:
            self._count("status")
            self.status = status
            return None
        if frozen:
            self._count("frozen")
            return None
        return rdt, tuple(counts)

    def restart(self) -> None:
        """The box was asked for a new stream, whose packets may count from anywhere."""
        self._asked_anew = True

    def _step(self, rdt: int) -> int:
        """How far ``rdt`` lies ahead of the last one: 32 bits that wrap round."""
        assert self._last is not None
        return (rdt - self._last[0] + (1 << 31)) % (1 << 32) - (1 << 31)

    def _count(self, what: str, by: int = 1) -> None:
        self._counts[what] = self._counts.get(what, 0) + by


class NetFt(Driver):
    """One Net F/T box."""

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
        return (
            DeclaredStream(
                "force",
                "wrench",
                self.config.rate_hz,
                f"the box's packet count, brought to the host's clock by the least delay, minus latency_ms = "
                f"{self.config.latency_ms:g}",
            ),
        )

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Read the box's configuration, then ask for packets without end."""
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
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            made.connect((self.config.host, self.config.port))  # from nobody else
        except OSError as error:
            made.close()
            raise DeviceError(f"{self._where}: {error.strerror or error}") from None
        self._socket = made
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
        """What the operating system grants; Linux says twice of it, and holds it below net.core.rmem_max."""
        assert self._socket is not None
        granted = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        return granted // 2 if sys.platform == "linux" else granted

    def bias(self) -> None:
        """Make what the sensor shows now the box's zero."""
        self._send(BIAS)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """The packets that have come; asks again, then gives up, where the box is silent."""
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
                if len(events) >= 64:  # enough for now: those who wait for them shall not wait for the whole buffer
                    return events
                self._socket.setblocking(False)
        except BlockingIOError:
            return events
        except TimeoutError:
            self._silent(self._clock.now_ns())
            return events
        except OSError as error:  # a port that is closed answers by ICMP
            raise DeviceError(f"{self._where}: {error.strerror or error}") from None

    def _wrench(self, packet: bytes, arrival_ns: int) -> Wrench | None:
        restarts = self.counts["restarts"]
        taken = self._check.take(packet)
        if self.counts["restarts"] > restarts:
            self._map, self._zero = ArrivalClock(), None
        if self._check.status:
            self.remark = f"{self._where}: refused readings with the status word 0x{self._check.status:08x}"
        if taken is None:
            return None
        rdt, counts = taken
        if self._zero is None:
            self._zero = rdt
        device_ns = round((rdt - self._zero) % (1 << 32) * 1e9 / self._rate_hz)
        stamp = self._map.host_ns(device_ns, arrival_ns) - round(self.config.latency_ms * 1e6)
        values = self._scale * counts
        return Wrench(stamp, values[:3], values[3:], "sensor")

    def _silent(self, now_ns: int) -> None:
        if now_ns - self._heard_ns > _LOST_S * 1e9:
            self.counts["silences"] += 1
            raise DeviceError(f"{self._where}: has sent no packet for {_LOST_S:g} s; check its cable and its power")
        if now_ns - max(self._asked_ns, self._heard_ns) > _ASK_AGAIN_S * 1e9:
            self._asked_ns = now_ns
            self._send(STREAM)
            self._check.restart()

    def close(self) -> None:
        """Ask the box to stop, and let go of it."""
        if self._socket is not None:
            try:
                self._socket.send(RDT_REQUEST.pack(HEADER, STOP, 0))
            except OSError:  # it is why we leave
                self.counts["stops_unsent"] += 1
            self._socket.close()
            self._socket = None

    def clocks(self) -> Mapping[str, ClockReport]:
        """The packet count against the host's clock."""
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
