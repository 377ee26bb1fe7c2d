"""Emulates a Net F/T box on this machine: RDT by UDP and ``netftapi2.xml`` by HTTP, with all faults of a network."""

import random
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

from .._net_ft import BIAS, HEADER, RDT_REPLY, RDT_REQUEST, STOP, STREAM

_POLL_S = 0.02


@dataclass
class NetFtFaults:
    """Faults of the box; they may be changed while it runs.

    Attributes:
        loss: share of the packets that are lost.
        reorder: share of the packets that are sent after a later one.
        skip: number of packets that the box itself leaves out next.
        status: its status word.
        silent: it sends nothing.
        frozen: its F/T sequence does not change.
        deaf: it accepts no request.
    """

    loss: float = 0.0
    reorder: float = 0.0
    skip: int = 0
    status: int = 0
    silent: bool = False
    frozen: bool = False
    deaf: bool = False


@dataclass
class NetFtEmulator:
    """Emulated Net F/T box. ``sent`` has the number of packets by their fate: "made", "lost", ...

    Attributes:
        force: time since the start in s -> three forces and three torques in the units of the box.
        rate_hz: packets per second.
        counts_per_force: counts of one ``force_unit``.
        counts_per_torque: counts of one ``torque_unit``.
        force_unit: "N", or another unit that the box has.
        torque_unit: "Nm", or another unit that the box has.
        faults: shares of packets that are lost or late, and other faults.
        seed: seed of the faults.
        port: UDP port; 0: any free port.
        http_port: port of its page of settings; 0: any free port.
        garbage_while_faulty: counts while the status word is not 0, so that a false force is detected.
    """

    force: Callable[[float], tuple[float, ...]] = lambda _: (0.0,) * 6
    rate_hz: float = 1000.0
    counts_per_force: float = 1_000_000.0
    counts_per_torque: float = 1_000_000.0
    force_unit: str = "N"
    torque_unit: str = "Nm"
    faults: NetFtFaults = field(default_factory=NetFtFaults)
    seed: int = 0
    port: int = 0
    http_port: int = 0
    garbage_while_faulty: int = 2_000_000_000

    def __enter__(self) -> Self:
        """Starts the UDP socket and the HTTP page, each served by a thread, and the thread that sends packets."""
        self.sent = {"made": 0, "lost": 0, "reordered": 0, "skipped": 0, "silenced": 0, "requests": 0}
        self.biased = 0
        self.rdt, self._ft = 0, 0
        self._random = random.Random(self.seed)
        self._stopped = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", self.port))
        self._socket.settimeout(_POLL_S)
        self.port = self._socket.getsockname()[1]
        emulator = self

        class Page(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                body = emulator.configuration().encode()
                self.send_response(200 if self.path == "/netftapi2.xml" else 404)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                del format, args

        self._http = ThreadingHTTPServer(("127.0.0.1", self.http_port), Page)
        self.http_port = self._http.server_address[1]
        self._peer: tuple[str, int] | None = None
        self._threads = [
            threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": _POLL_S}, daemon=True),
            threading.Thread(target=self._listen, daemon=True),
            threading.Thread(target=self._send, daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._http.shutdown()
        for thread in self._threads:
            thread.join()
        self._http.server_close()
        self._socket.close()

    def configuration(self) -> str:
        """Returns its page of the active configuration, with the values that a driver reads."""
        return (
            '<?xml version="1.0" encoding="utf-8"?><netft><runstat>0x00000000</runstat><runrate>7000</runrate>'
            f"<setuserfilter>0</setuserfilter><cfgnam>Configuration #1</cfgnam><scfgfu>{self.force_unit}</scfgfu>"
            f"<scfgtu>{self.torque_unit}</scfgtu><cfgcpf>{self.counts_per_force:g}</cfgcpf>"
            f"<cfgcpt>{self.counts_per_torque:g}</cfgcpt><calsn>FT00000</calsn><comrdte>Enabled</comrdte>"
            f"<comrdtrate>{self.rate_hz:g}</comrdtrate></netft>"
        )

    def restart(self) -> None:
        """Restarts the count of packets, as after a loss of power; the stream must be requested again."""
        self.rdt, self._ft, self._peer = 0, 0, None

    def _listen(self) -> None:
        """Executes the requests of clients: start, stop and zero of the stream."""
        while not self._stopped.is_set():
            try:
                request, peer = self._socket.recvfrom(64)
            except OSError:  # no request, or the last client is gone
                continue
            if self.faults.deaf or len(request) != RDT_REQUEST.size:
                continue
            header, command, _ = RDT_REQUEST.unpack(request)
            if header != HEADER:
                continue
            self.sent["requests"] += 1
            if command == STREAM:
                self._peer = peer
            elif command == STOP:
                self._peer = None
            elif command == BIAS:
                self.biased += 1

    def _send(self) -> None:
        """Sends packets at the stated rate until the box stops; applies the faults to them."""
        held: bytes | None = None  # a packet that is sent after the next one
        zero, done = time.monotonic(), 0
        while not self._stopped.is_set():
            due = int((time.monotonic() - zero) * self.rate_hz)
            if due <= done:
                time.sleep(0.5 / self.rate_hz)
                continue
            done += 1
            peer = self._peer
            if peer is None:
                continue
            self.rdt = (self.rdt + 1) % (1 << 32)
            self.sent["made"] += 1
            if self.faults.silent:  # the cable is disconnected: the box continues
                self.sent["silenced"] += 1
                continue
            if self.faults.skip:
                self.faults.skip -= 1
                self.sent["skipped"] += 1
                continue
            packet = self._packet(done / self.rate_hz)
            if self._random.random() < self.faults.loss:
                self.sent["lost"] += 1
                continue
            if held is None and self._random.random() < self.faults.reorder:
                held = packet
                self.sent["reordered"] += 1
                continue
            for each in (packet, held) if held else (packet,):
                try:
                    self._socket.sendto(each, peer)
                except OSError:  # the client is gone
                    self._peer = None
            held = None

    def _packet(self, seconds: float) -> bytes:
        """Returns the packet at ``seconds`` since the start; its F/T sequence counts the box's inner rate of 7 kHz."""
        if not self.faults.frozen:
            self._ft = (self._ft + round(7000 / self.rate_hz)) % (1 << 32)
        if self.faults.status:
            counts = [self.garbage_while_faulty] * 6
        else:
            units = self.force(seconds)
            counts = [round(value * self.counts_per_force) for value in units[:3]]
            counts += [round(value * self.counts_per_torque) for value in units[3:]]
        return RDT_REPLY.pack(self.rdt, self._ft, self.faults.status, *counts)
