"""Estimates as JSON: datagrams to one receiver, or a WebSocket that any number of clients may read."""

import contextlib
import socket
import threading

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection

from ...types import SessionInfo
from .._update import LiveUpdate
from ._address import Address
from ._message import message_of
from ._server import OriginServer

__all__ = ["JsonUdp", "JsonWebSocket"]

UDP_PORT, WEBSOCKET_PORT = 8766, 8767
_LOOK_AGAIN_S = 1.0
"""How often a client's thread checks whether its connection is still there while nothing is sent."""


class JsonUdp:
    """One datagram an update, some 1 kB, to one receiver; nobody knows whether it arrived."""

    keeps_all = False

    def __init__(self, address: Address) -> None:
        address.only()
        self.name = address.text
        self._target = address.with_port(UDP_PORT)
        self._session, self._model = SessionInfo(), ""
        self._socket: socket.socket | None = None

    def start(self, info: SessionInfo, model: str) -> None:
        """Look the receiver up. Raises OSError where its name is unknown."""
        self._session, self._model = info, model
        family, kind, protocol, _, self._to = socket.getaddrinfo(*self._target, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, protocol)

    def put(self, update: LiveUpdate) -> None:
        """Send one datagram."""
        assert self._socket is not None
        text = message_of(update, self._session, self._model).model_dump_json(by_alias=True)
        self._socket.sendto(text.encode(), self._to)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class JsonWebSocket:
    """A server; each client gets the newest message as one text, a slow one fewer of them and never an older one."""

    keeps_all = False

    def __init__(self, address: Address) -> None:
        address.only("origin")
        self.name = address.text
        self._target = address.with_port(WEBSOCKET_PORT)
        self._origins = address.options.get("origin", ())
        self._session, self._model = SessionInfo(), ""
        self._server: OriginServer | None = None
        self._changed = threading.Condition()
        self._newest, self._count, self._open = "", 0, False

    def start(self, info: SessionInfo, model: str) -> None:
        """Listen. Raises OSError where the port is in use."""
        self._session, self._model = info, model
        self._open = True
        self._server = OriginServer(*self._target, self._serve, origins=self._origins)

    def put(self, update: LiveUpdate) -> None:
        """Show all clients what is new; does not wait for them."""
        text = message_of(update, self._session, self._model).model_dump_json(by_alias=True)
        with self._changed:
            self._newest, self._count = text, self._count + 1
            self._changed.notify_all()

    def close(self) -> None:
        """End all connections."""
        with self._changed:
            self._open = False
            self._changed.notify_all()
        if self._server is not None:
            self._server.close()
            self._server = None

    def _serve(self, client: ServerConnection) -> None:
        sent = self._count  # what came before the client is old
        with contextlib.suppress(ConnectionClosed):
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._count != sent or not self._open, _LOOK_AGAIN_S)  # noqa: B023
                    if not self._open:
                        return
                    if self._count == sent:
                        client.ping()  # raises where the client is gone
                        continue
                    sent, text = self._count, self._newest
                client.send(text)
