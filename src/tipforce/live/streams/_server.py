"""WebSocket servers on threads of their own that refuse web pages of other origins.

A program sends no Origin and is let in. A web page sends one, whichever address it connects to: without this check any
page that is open in a browser on this machine could read the stream.
"""

import contextlib
import io
import socket
import socketserver
import threading
from collections.abc import Callable, Sequence
from http.client import HTTPException, parse_headers

from websockets.sync.server import Server, ServerConnection, serve
from websockets.typing import Origin

__all__ = ["OriginDoor", "OriginServer"]

_LARGEST_REQUEST = 1 << 16
"""Bytes of a message or of the head of a request."""
_HEAD_S = 5.0
"""So long a client may take to send the head of its request."""
_AT_ONCE = 1 << 18
"""Bytes that are passed on at once, and that wait for a slow client in this machine's buffers."""
_CLOSE_S = 1.0
"""So long the end of the run waits for a client that does not answer."""
_REFUSED = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class OriginServer:
    """Serves each connection with ``handler`` on a thread of its own, until `close`."""

    def __init__(
        self,
        host: str,
        port: int,
        handler: Callable[[ServerConnection], None],
        *,
        origins: Sequence[str] = (),
    ) -> None:
        """``origins``: those that are let in, as in ``http://127.0.0.1:8000``. Raises OSError: the port is in use."""
        self._server: Server = serve(
            handler,
            host,
            port,
            origins=[None, *map(Origin, origins)],
            max_size=_LARGEST_REQUEST,
            compression=None,  # costs more time than a local network
            close_timeout=_CLOSE_S,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name=f"serve-{port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening. Open connections end with their handlers."""
        self._server.shutdown()
        self._thread.join()


class OriginDoor:
    """In front of a WebSocket server that lets every web page in: passes the others on, byte by byte."""

    def __init__(self, host: str, port: int, behind: tuple[str, int], *, origins: Sequence[str]) -> None:
        """``behind``: where the server listens. Raises OSError: the port is in use."""

        class Handler(socketserver.BaseRequestHandler):
            def handle(self) -> None:
                client: socket.socket = self.request
                with contextlib.suppress(OSError):  # one of both is gone
                    _let_in(client, behind, origins)

        class Door(socketserver.ThreadingTCPServer):
            allow_reuse_address, daemon_threads, block_on_close = True, True, False
            address_family = socket.AF_INET6 if ":" in host else socket.AF_INET

        self._server = Door((host, port), Handler)
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), name=f"door-{port}", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop listening. Open connections end with the server behind."""
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def _let_in(client: socket.socket, behind: tuple[str, int], origins: Sequence[str]) -> None:
    head = _head(client)
    if not head or _foreign(head, origins):
        client.sendall(_REFUSED)
        return
    with socket.create_connection(behind) as server:
        for each in (client, server):
            each.settimeout(None)
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            each.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _AT_ONCE)
        server.sendall(head)
        back = threading.Thread(target=_pump, args=(client, server), name="door-back", daemon=True)
        back.start()
        _pump(server, client)
        back.join()


def _head(client: socket.socket) -> bytes:
    """The head of the request and what came with it; nothing where there is none."""
    client.settimeout(_HEAD_S)
    head = b""
    while b"\r\n\r\n" not in head:
        more = client.recv(_LARGEST_REQUEST)
        head += more
        if not more or len(head) > _LARGEST_REQUEST:
            return b""
    return head


def _foreign(head: bytes, origins: Sequence[str]) -> bool:
    try:
        stated = parse_headers(io.BytesIO(head.partition(b"\r\n")[2])).get_all("Origin", [])
    except HTTPException:
        return True
    return any(each.strip() not in origins for each in stated)


def _pump(source: socket.socket, target: socket.socket) -> None:
    """All bytes of ``source`` to ``target``, until one of them ends; then both do."""
    with contextlib.suppress(OSError):
        while data := source.recv(_AT_ONCE):
            target.sendall(data)
    for each in (source, target):
        with contextlib.suppress(OSError):  # ended already
            each.shutdown(socket.SHUT_RDWR)
