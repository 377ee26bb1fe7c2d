"""WebSocket servers on threads of their own that reject web pages of other origins.

A program sends no Origin header and is accepted. A web page always sends one: without this check any page that is open
in a browser on this machine could read the stream.
"""

import contextlib
import threading
from collections.abc import Callable, Hashable, Sequence

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.sync.server import Server, ServerConnection, serve
from websockets.typing import Origin, Subprotocol

MAX_REQUEST_BYTES = 1 << 16
"""Largest size of a message from a client in bytes."""
CLOSE_S = 1.0
"""Longest wait at the end of the run for a client that does not answer."""
END_CHECK_S = 0.05
"""Interval of the check for the end of the run while a client has not acknowledged its messages."""


class OriginServer:
    """Serves each connection with ``handler`` on a thread of its own, until `close`."""

    def __init__(
        self,
        host: str,
        port: int,
        handler: Callable[[ServerConnection], None],
        *,
        origins: Sequence[str] = (),
        subprotocols: Sequence[Subprotocol] | None = None,
    ) -> None:
        """Begins to listen.

        Args:
            host: address to listen on.
            port: port to listen on.
            handler: serves one connection, on a thread of its own.
            origins: web pages that are accepted, as in ``http://127.0.0.1:8000``.
            subprotocols: WebSocket subprotocols that are offered.

        Raises:
            OSError: the port is in use.
        """
        self._server: Server = serve(
            handler,
            host,
            port,
            origins=[None, *map(Origin, origins)],
            subprotocols=subprotocols,
            max_size=MAX_REQUEST_BYTES,
            compression=None,  # costs more time than a local network
            close_timeout=CLOSE_S,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name=f"serve-{port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops listening. Open connections end with their handlers."""
        self._server.shutdown()
        self._thread.join()


class OriginDoor:
    """Protects a WebSocket server that accepts every web page and that keeps a queue for slow clients.

    Each client has a connection of its own to that server. While a client has not acknowledged its messages, new
    messages with the same key replace each other, and only the newest is sent.

    Args:
        host: address on which clients connect.
        port: port on which clients connect.
        behind: host and port of the protected server.
        origins: web pages that are accepted.
        subprotocol: WebSocket subprotocol of client and server.
        key_of: returns the key of a message, such as its topic; None for a message that must not be left out.

    Raises:
        OSError: the port is in use.
    """

    def __init__(
        self,
        host: str,
        port: int,
        behind: tuple[str, int],
        *,
        origins: Sequence[str],
        subprotocol: str,
        key_of: Callable[[str | bytes], Hashable],
    ) -> None:
        """Opens the port. Each client that comes is connected with ``behind``."""
        self._behind, self._subprotocol, self._key_of = behind, Subprotocol(subprotocol), key_of
        self._clients = 0
        self._client_left = threading.Condition()
        self._server = OriginServer(host, port, self._serve, origins=origins, subprotocols=[self._subprotocol])

    def close(self) -> None:
        """Stops listening, after the server behind has ended and all clients have its last messages."""
        with self._client_left:
            self._client_left.wait_for(lambda: self._clients == 0, CLOSE_S)
        self._server.close()

    def _serve(self, client: ServerConnection) -> None:
        """Connects one client with the protected server, on three threads: one for each direction, one between."""
        host, port = self._behind
        with self._client_left:
            self._clients += 1
        try:
            with connect(
                f"ws://{host}:{port}", subprotocols=[self._subprotocol], compression=None, max_size=None
            ) as server:
                waiting = _Waiting(self._key_of)
                threading.Thread(target=waiting.fill, args=(server,), name="door-out", daemon=True).start()
                threading.Thread(target=_forward, args=(client, server), name="door-in", daemon=True).start()
                _feed(client, waiting)
        except (ConnectionClosed, OSError):  # client or server is gone
            pass
        finally:
            with self._client_left:
                self._clients -= 1
                self._client_left.notify_all()


class _Waiting:
    """Messages that wait for a client; the newest of each key."""

    def __init__(self, key_of: Callable[[str | bytes], Hashable]) -> None:
        self._key_of = key_of
        self._changed = threading.Condition()
        self._messages: dict[Hashable, str | bytes] = {}
        self._count = 0
        self.ended = False

    def fill(self, server: ClientConnection) -> None:
        """Takes all messages of ``server`` until it ends."""
        with contextlib.suppress(ConnectionClosed):
            for message in server:
                self._put(message)
        with self._changed:
            self.ended = True
            self._changed.notify()

    def _put(self, message: str | bytes) -> None:
        with self._changed:
            self._count += 1
            key = self._key_of(message)
            self._messages.pop(key, None)
            self._messages[self._count if key is None else key] = message
            self._changed.notify()

    def take(self) -> list[str | bytes]:
        """Waits for messages and returns them; returns none after the server has ended."""
        with self._changed:
            self._changed.wait_for(lambda: self._messages or self.ended)
            taken, self._messages = list(self._messages.values()), {}
            return taken


def _feed(client: ServerConnection, waiting: _Waiting) -> None:
    """Sends the waiting messages; after their acknowledgement, those that came meanwhile."""
    while messages := waiting.take():
        for message in messages:
            client.send(message)
        taken = client.ping(ack_on_close=True)
        while not waiting.ended and not taken.wait(END_CHECK_S):
            pass


def _forward(client: ServerConnection, server: ClientConnection) -> None:
    """Passes all messages of ``client`` to ``server`` until one of them ends; then closes the latter."""
    with contextlib.suppress(ConnectionClosed):
        for message in client:
            server.send(message)
    server.close()
