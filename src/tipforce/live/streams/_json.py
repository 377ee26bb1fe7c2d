"""Sends estimates as JSON: datagrams to one receiver, or a WebSocket that any number of clients may read."""

import socket
import threading
import time

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection

from ...errors import InputError
from ...types import SessionInfo
from .._update import LiveUpdate
from ._address import Address
from ._message import message_of
from ._server import OriginServer

UDP_PORT, WEBSOCKET_PORT = 8766, 8767
CONNECTION_CHECK_S = 1.0
"""Interval at which a client's thread checks whether its connection exists while nothing is sent."""
END_CHECK_S = 0.05
"""Interval at which it checks for the end of the run while a client has not acknowledged a message."""
LAST_MESSAGE_S = 1.0
"""Longest wait at the end of the run until the last message is sent to all clients."""


class JsonUdp:
    """Sends one datagram of about 1 kB for each update to one receiver; its arrival is not confirmed.

    A slow receiver first gets the datagrams that wait in its own socket; a sender cannot remove them. The option
    ``rate_hz`` limits the number of valid estimates per second; an estimate that becomes invalid is always sent
    immediately.
    """

    keeps_all = False

    def __init__(self, address: Address) -> None:
        """Raises InputError if ``rate_hz`` is not a positive number."""
        address.only("rate_hz")
        self.name = address.text
        self._period_s, self._next_s = _period_s(address), 0.0
        self._target = address.with_port(UDP_PORT)
        self._session, self._model = SessionInfo(), ""
        self._socket: socket.socket | None = None

    def start(self, info: SessionInfo, model: str) -> None:
        """Looks up the receiver; see `Sink.start`. Raises OSError if its name is unknown."""
        self._session, self._model = info, model
        family, kind, protocol, _, self._to = socket.getaddrinfo(*self._target, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, protocol)

    def put(self, update: LiveUpdate) -> None:
        """Sends one datagram."""
        assert self._socket is not None
        now_s = time.monotonic()
        if update.estimate.valid:
            if now_s < self._next_s:
                return
            self._next_s = now_s + self._period_s
        text = message_of(update, self._session, self._model).model_dump_json(by_alias=True)
        self._socket.sendto(text.encode(), self._to)

    def close(self) -> None:
        """Closes the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _period_s(address: Address) -> float:
    """Returns the shortest time between two valid estimates in seconds."""
    stated = address.options.get("rate_hz")
    if stated is None:
        return 0.0
    try:
        return 1.0 / _positive(float(stated[-1]))
    except ValueError:
        raise InputError(
            f"out={address.text}: rate_hz={stated[-1]}: expected messages a second, as in rate_hz=30"
        ) from None


def _positive(value: float) -> float:
    if not 0.0 < value < float("inf"):
        raise ValueError
    return value


class JsonWebSocket:
    """Sends the newest message to each client as one text; a slow client gets fewer messages, never an older one.

    A ping follows each message, and the next message is sent after its pong: so at most one message is on its way to a
    client that has stopped reading.
    """

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
        self._clients = 0

    def start(self, info: SessionInfo, model: str) -> None:
        """Begins to listen; see `Sink.start`. Raises OSError if the port is in use."""
        self._session, self._model = info, model
        self._open = True
        self._server = OriginServer(*self._target, self._serve, origins=self._origins)

    def put(self, update: LiveUpdate) -> None:
        """Passes the update to all clients; does not wait for them."""
        text = message_of(update, self._session, self._model).model_dump_json(by_alias=True)
        with self._changed:
            self._newest, self._count = text, self._count + 1
            self._changed.notify_all()

    def close(self) -> None:
        """Ends all connections, after the last message."""
        with self._changed:
            self._open = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._clients == 0, LAST_MESSAGE_S)
        if self._server is not None:
            self._server.close()
            self._server = None

    def _serve(self, client: ServerConnection) -> None:
        """Serves one client on a thread of its own, from the next message on, until it or the run ends."""
        with self._changed:
            self._clients += 1
            sent = self._count  # messages from before the connection are old
        try:
            self._feed(client, sent)
        except ConnectionClosed:
            pass
        finally:
            with self._changed:
                self._clients -= 1
                self._changed.notify_all()

    def _feed(self, client: ServerConnection, sent: int) -> None:
        """Sends every message after number ``sent`` that is the newest when the client is ready for one."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._count != sent or not self._open, CONNECTION_CHECK_S)  # noqa: B023
                is_open, count, text = self._open, self._count, self._newest
            if count != sent:
                sent = count
                client.send(text)
            if not is_open:
                return
            taken = client.ping(ack_on_close=True)  # raises if the client is gone
            while self._open and not taken.wait(END_CHECK_S):
                pass
